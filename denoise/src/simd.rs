//! The one `unsafe` of image space: running a kernel with the vectors that this machine has.
//!
//! The release build is for every x86-64 processor, that is for vectors of four numbers. The filters below take 2–3 times
//! as long with them as with AVX2 (see `benches/filter.rs`), which is why they are compiled twice. Both give the same
//! bits: AVX2 computes the same operations in the same order, and fused multiply-adds, which round differently, are
//! not used.

#![allow(unsafe_code, reason = "calling a function compiled for AVX2 is unsafe where AVX2 is not known to exist")]

/// A computation over arrays. `run` and all it calls must be `#[inline(always)]`: what is not inlined stays compiled
/// for the smallest processor.
pub(crate) trait Kernel {
    /// What it gives.
    type Output;

    /// Computes it.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` with AVX2 where the machine has it.
pub(crate) fn vectorise<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the machine has AVX2, as asked on the line above; the function has no other precondition.
        return unsafe { run_avx2(kernel) };
    }
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
