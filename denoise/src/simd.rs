//! The one `unsafe` of image space: running a kernel with the vectors that this machine has.
//!
//! The release build is for every x86-64 processor, that is for vectors of four numbers. The filter takes 1.7 times as
//! long with them as with AVX2, and that again 1.45 times as long as with AVX-512 (measured on an EPYC of Zen 5), which
//! is why it is compiled three times. All give the same bits: the same operations in the same order; fused multiply-adds, which round differently,
//! are not used.

#![allow(
    unsafe_code,
    reason = "calling a function compiled for AVX is unsafe where AVX is not known to exist"
)]

/// A computation over arrays. `run` and all it calls must be `#[inline(always)]`: what is not inlined stays compiled
/// for the smallest processor.
pub(crate) trait Kernel {
    /// What it gives.
    type Output;

    /// Computes it.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` with the widest vectors of this machine.
pub(crate) fn vectorise<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::is_x86_feature_detected as has;
        if has!("avx512f") && has!("avx512vl") && has!("avx512bw") && has!("avx512dq") {
            // SAFETY: the machine has all features that the function is compiled for, as asked on the line above.
            return unsafe { run_avx512(kernel) };
        }
        if has!("avx2") {
            // SAFETY: as above.
            return unsafe { run_avx2(kernel) };
        }
    }
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
