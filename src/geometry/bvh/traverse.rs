//! Traversal with AVX2: eight boxes or eight triangles at a time, in the roundings of [`super::portable`].
//!
//! The only file with `unsafe` code. It rests on three facts: an [`Avx2`] exists only where the processor has AVX2,
//! indices in a tree are in range since [`super::collapse`] made them, and a tree that needs more than [`super::STACK`] is
//! never made.
#![allow(
    unsafe_code,
    reason = "intrinsics, and a loop where bounds checks and a cleared stack cost time"
)]

use super::wide::{Child, Node, Packet, WIDTH};
use super::{Bvh, Query, STACK};
use crate::geometry::{Hit, triangle};
use std::arch::x86_64::*;
use std::mem::MaybeUninit;

/// Proof that this processor has AVX2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2(());

impl Avx2 {
    pub(super) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt"))
        .then_some(Self(()))
    }

    /// The nearest hit.
    #[inline]
    pub(super) fn intersect(self, bvh: &Bvh, root: Child, query: &Query) -> Option<Hit> {
        // SAFETY: `self` exists, so the processor has the features.
        unsafe { nearest(bvh, root, query) }
    }

    /// Is there any hit?
    #[inline]
    pub(super) fn is_occluded(self, bvh: &Bvh, root: Child, query: &Query) -> bool {
        // SAFETY: `self` exists, so the processor has the features.
        unsafe { any(bvh, root, query) }
    }
}

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
fn nearest(bvh: &Bvh, root: Child, query: &Query) -> Option<Hit> {
    walk::<false>(bvh, root, query)
}

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
fn any(bvh: &Bvh, root: Child, query: &Query) -> bool {
    walk::<true>(bvh, root, query).is_some()
}

/// Visits the tree, the nearest child first and then the others in order; `ANY` stops at the first hit and leaves the
/// others in no order.
///
/// What waits is an entry distance and a child in one number, `distance << 32 | child`: distances are not negative, and
/// such floats order as their bits do.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
#[inline]
fn walk<const ANY: bool>(bvh: &Bvh, root: Child, query: &Query) -> Option<Hit> {
    let rays = Lanes::new(query);
    let mut stack = [const { MaybeUninit::<u64>::uninit() }; STACK];
    let mut waiting = 0;
    let mut nearest = Hit { t: query.t_max, u: 0.0, v: 0.0, primitive: 0 };
    let mut is_found = false;
    let mut limit = Query::limit(query.t_max);
    let mut current = root.0;
    loop {
        let is_nearer = if current & Child::LEAF == 0 {
            // SAFETY: children are in range.
            let node = unsafe { bvh.nodes.get_unchecked(current as usize) };
            let (entries, mut entered) = enter(node, &rays, limit);
            if entered != 0 {
                let take = |lane: u32| {
                    let lane = lane as usize;
                    // SAFETY: a bit of an 8-bit mask is below 8.
                    let (entry, child) = unsafe {
                        (entries.0.get_unchecked(lane), node.children.get_unchecked(lane))
                    };
                    prefetch(bvh, *child);
                    (u64::from(entry.to_bits()) << 32) | u64::from(child.0)
                };
                let first = waiting;
                let mut next = take(entered.trailing_zeros());
                entered &= entered - 1;
                while entered != 0 {
                    let other = take(entered.trailing_zeros());
                    entered &= entered - 1;
                    let later = next.max(other);
                    next = next.min(other);
                    let mut slot = waiting;
                    while !ANY && slot > first {
                        // SAFETY: slots from `first` to `waiting` are initialised.
                        let before = unsafe { stack.get_unchecked(slot - 1).assume_init() };
                        if before >= later {
                            break;
                        }
                        // SAFETY: `slot` is at most `waiting`, which is below `STACK`.
                        unsafe { stack.get_unchecked_mut(slot).write(before) };
                        slot -= 1;
                    }
                    debug_assert!(waiting < STACK);
                    // SAFETY: the tree was made so that `waiting` stays below `STACK`.
                    unsafe { stack.get_unchecked_mut(slot).write(later) };
                    waiting += 1;
                }
                current = next as u32;
                continue;
            }
            false
        } else if current & Child::SHAPE == 0 {
            // SAFETY: children are in range.
            let packet = unsafe { bvh.packets.get_unchecked((current & Child::INDEX) as usize) };
            nearest_in_packet::<ANY>(packet, query, &mut nearest)
        } else {
            let (primitive, shape) = &bvh.shapes[(current & Child::INDEX) as usize];
            let t = shape.intersect(query, nearest.t);
            if let Some(t) = t {
                nearest = Hit { t, u: 0.0, v: 0.0, primitive: *primitive };
            }
            t.is_some()
        };
        if is_nearer {
            if ANY {
                return Some(nearest);
            }
            is_found = true;
            limit = Query::limit(nearest.t);
        }
        loop {
            if waiting == 0 {
                return is_found.then_some(nearest);
            }
            waiting -= 1;
            // SAFETY: slots below `waiting` were written.
            let entry = unsafe { stack.get_unchecked(waiting).assume_init() };
            if f32::from_bits((entry >> 32) as u32) <= limit {
                current = entry as u32;
                break;
            }
        }
    }
}

/// What boxes need of a ray, in every lane.
struct Lanes {
    origin: [__m256; 3],
    near_rcp: [__m256; 3],
    far_rcp: [__m256; 3],
    /// Where in [`Node::planes`], counted in f32, the near planes of each axis begin; the far ones are the others.
    near_plane: [usize; 3],
}

impl Lanes {
    #[target_feature(enable = "avx2")]
    #[inline]
    fn new(query: &Query) -> Self {
        let [x, y, z] = query.origin.to_array();
        let [near_x, near_y, near_z] = query.near_rcp;
        let [far_x, far_y, far_z] = query.far_rcp;
        Self {
            origin: [_mm256_set1_ps(x), _mm256_set1_ps(y), _mm256_set1_ps(z)],
            near_rcp: [_mm256_set1_ps(near_x), _mm256_set1_ps(near_y), _mm256_set1_ps(near_z)],
            far_rcp: [_mm256_set1_ps(far_x), _mm256_set1_ps(far_y), _mm256_set1_ps(far_z)],
            near_plane: query.near_plane,
        }
    }
}

/// Eight numbers that a register is stored to.
#[repr(align(32))]
struct Stored([f32; WIDTH]);

/// Where the ray enters each child's box, and a bit for each that it enters before `limit`.
///
/// A ray in the plane of a box with no motion across it gives 0·∞, a NaN; max and min then give their second operand.
#[target_feature(enable = "avx2")]
#[inline]
fn enter(node: &Node, rays: &Lanes, limit: f32) -> (Stored, u32) {
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(limit);
    for axis in 0..3 {
        let planes = &node.planes[axis];
        let near_plane = rays.near_plane[axis];
        debug_assert!(near_plane < 2);
        // SAFETY: `near_plane` is 0 or 1.
        let (near_planes, far_planes) =
            unsafe { (planes.get_unchecked(near_plane), planes.get_unchecked(1 - near_plane)) };
        let to_near =
            _mm256_mul_ps(_mm256_sub_ps(load(near_planes), rays.origin[axis]), rays.near_rcp[axis]);
        let to_far =
            _mm256_mul_ps(_mm256_sub_ps(load(far_planes), rays.origin[axis]), rays.far_rcp[axis]);
        near = _mm256_max_ps(to_near, near);
        far = _mm256_min_ps(to_far, far);
    }
    let entered = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));
    (store(near), entered as u32)
}

/// [`triangle::intersect`] on every lane. Is one met nearer than `nearest`? Then `nearest` becomes that hit; of hits at the
/// same `t`, the first lane's. `ANY` leaves it as it is.
#[target_feature(enable = "avx2,bmi1")]
#[inline]
fn nearest_in_packet<const ANY: bool>(packet: &Packet, query: &Query, nearest: &mut Hit) -> bool {
    let [kx, ky, kz] = query.axes;
    debug_assert!(kx < 3 && ky < 3 && kz < 3);
    // SAFETY: `axes` is a permutation of 0, 1 and 2.
    let coordinate =
        |corner: usize, axis: usize| unsafe { packet.vertices[corner].get_unchecked(axis) };
    let origin = query.origin.to_array();
    let [ox, oy, oz] = [origin[kx], origin[ky], origin[kz]];
    let (ox, oy, oz) = (_mm256_set1_ps(ox), _mm256_set1_ps(oy), _mm256_set1_ps(oz));
    let [shear_x, shear_y, scale_z] = query.shear;
    let (shear_x, shear_y) = (_mm256_set1_ps(shear_x), _mm256_set1_ps(shear_y));

    // The corners as seen from the origin, sheared so that the ray is the z axis.
    let az = _mm256_sub_ps(load(coordinate(0, kz)), oz);
    let bz = _mm256_sub_ps(load(coordinate(1, kz)), oz);
    let cz = _mm256_sub_ps(load(coordinate(2, kz)), oz);
    let ax = _mm256_sub_ps(_mm256_sub_ps(load(coordinate(0, kx)), ox), _mm256_mul_ps(shear_x, az));
    let bx = _mm256_sub_ps(_mm256_sub_ps(load(coordinate(1, kx)), ox), _mm256_mul_ps(shear_x, bz));
    let cx = _mm256_sub_ps(_mm256_sub_ps(load(coordinate(2, kx)), ox), _mm256_mul_ps(shear_x, cz));
    let ay = _mm256_sub_ps(_mm256_sub_ps(load(coordinate(0, ky)), oy), _mm256_mul_ps(shear_y, az));
    let by = _mm256_sub_ps(_mm256_sub_ps(load(coordinate(1, ky)), oy), _mm256_mul_ps(shear_y, bz));
    let cy = _mm256_sub_ps(_mm256_sub_ps(load(coordinate(2, ky)), oy), _mm256_mul_ps(shear_y, cz));

    let mut a = _mm256_sub_ps(_mm256_mul_ps(cx, by), _mm256_mul_ps(cy, bx));
    let mut b = _mm256_sub_ps(_mm256_mul_ps(ax, cy), _mm256_mul_ps(ay, cx));
    let mut c = _mm256_sub_ps(_mm256_mul_ps(bx, ay), _mm256_mul_ps(by, ax));
    let zero = _mm256_setzero_ps();
    let is_zero = _mm256_or_ps(
        _mm256_cmp_ps::<_CMP_EQ_OQ>(a, zero),
        _mm256_or_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(b, zero), _mm256_cmp_ps::<_CMP_EQ_OQ>(c, zero)),
    );
    let doubtful = _mm256_movemask_ps(is_zero) as u32;
    if doubtful != 0 {
        [a, b, c] = exact_edges([a, b, c], [ax, bx, cx], [ay, by, cy], doubtful);
    }
    // Where a NaN is lost here, `t` is one.
    let all_positive = _mm256_cmp_ps::<_CMP_GE_OQ>(_mm256_min_ps(a, _mm256_min_ps(b, c)), zero);
    let all_negative = _mm256_cmp_ps::<_CMP_LE_OQ>(_mm256_max_ps(a, _mm256_max_ps(b, c)), zero);
    let inside = _mm256_or_ps(all_positive, all_negative);

    let reciprocal = _mm256_div_ps(_mm256_set1_ps(1.0), _mm256_add_ps(_mm256_add_ps(a, b), c));
    let (w, u, v) =
        (_mm256_mul_ps(a, reciprocal), _mm256_mul_ps(b, reciprocal), _mm256_mul_ps(c, reciprocal));
    let depth = _mm256_add_ps(
        _mm256_add_ps(_mm256_mul_ps(w, az), _mm256_mul_ps(u, bz)),
        _mm256_mul_ps(v, cz),
    );
    let t = _mm256_mul_ps(depth, _mm256_set1_ps(scale_z));
    let in_range = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GT_OQ>(t, zero),
        _mm256_cmp_ps::<_CMP_LT_OQ>(t, _mm256_set1_ps(nearest.t)),
    );
    let mut hits = _mm256_movemask_ps(_mm256_and_ps(inside, in_range)) as u32;
    if ANY || hits == 0 {
        return hits != 0;
    }
    let (Stored(t), Stored(u), Stored(v)) = (store(t), store(u), store(v));
    let mut lane = hits.trailing_zeros() as usize;
    hits &= hits - 1;
    while hits != 0 {
        let other = hits.trailing_zeros() as usize;
        hits &= hits - 1;
        if t[other] < t[lane] {
            lane = other;
        }
    }
    *nearest = Hit { t: t[lane], u: u[lane], v: v[lane], primitive: packet.primitives[lane] };
    true
}

/// The edge functions, exact in the lanes of the mask `doubtful`.
#[cold]
#[target_feature(enable = "avx2,bmi1")]
fn exact_edges(
    edges: [__m256; 3],
    x: [__m256; 3],
    y: [__m256; 3],
    mut doubtful: u32,
) -> [__m256; 3] {
    let [mut edges, x, y] =
        [edges, x, y].map(|registers| registers.map(|register| store(register)));
    while doubtful != 0 {
        let lane = doubtful.trailing_zeros() as usize;
        doubtful &= doubtful - 1;
        let exact = triangle::exact_edges(
            std::array::from_fn(|corner| x[corner].0[lane]),
            std::array::from_fn(|corner| y[corner].0[lane]),
        );
        for (stored, exact) in edges.iter_mut().zip(exact) {
            stored.0[lane] = exact;
        }
    }
    [load(&edges[0].0), load(&edges[1].0), load(&edges[2].0)]
}

/// Asks for the memory of a child that will be visited soon.
#[target_feature(enable = "avx2")]
#[inline]
fn prefetch(bvh: &Bvh, child: Child) {
    let index = (child.0 & Child::INDEX) as usize;
    let start = if child.0 & Child::LEAF == 0 {
        bvh.nodes.as_ptr().wrapping_add(index).cast::<i8>()
    } else {
        bvh.packets.as_ptr().wrapping_add(index).cast::<i8>()
    };
    for line in 0..4 {
        _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line));
    }
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(numbers: &[f32; WIDTH]) -> __m256 {
    // SAFETY: a reference to eight numbers; alignment is not asked for.
    unsafe { _mm256_loadu_ps(numbers.as_ptr()) }
}

#[target_feature(enable = "avx2")]
#[inline]
fn store(register: __m256) -> Stored {
    let mut stored = Stored([0.0; WIDTH]);
    // SAFETY: a reference to eight numbers; alignment is not asked for.
    unsafe { _mm256_storeu_ps(stored.0.as_mut_ptr(), register) };
    stored
}

/// The same elements, where the system is asked for huge pages: random access to a large tree misses the page table less
/// (5 % of the time of incoherent rays among a million triangles). Nothing depends on whether it complies.
#[cfg(target_os = "linux")]
pub(super) fn in_huge_pages<T: Copy>(elements: Vec<T>) -> Vec<T> {
    const PAGE: usize = 4096;
    const MADV_HUGEPAGE: i32 = 14;
    unsafe extern "C" {
        /// Of the C library: <https://man7.org/linux/man-pages/man2/madvise.2.html>.
        fn madvise(address: *mut std::ffi::c_void, length: usize, advice: i32) -> i32;
    }
    let mut moved = Vec::<T>::with_capacity(elements.len());
    let start = moved.as_mut_ptr().cast::<u8>();
    let skipped = start.align_offset(PAGE);
    let length = size_of_val(&*elements).saturating_sub(skipped) / PAGE * PAGE;
    if length > 0 {
        // SAFETY: whole pages of memory that `moved` owns; the advice changes no content.
        unsafe { madvise(start.wrapping_add(skipped).cast(), length, MADV_HUGEPAGE) };
    }
    moved.extend_from_slice(&elements);
    moved
}

/// The same elements, in their own memory.
#[cfg(not(target_os = "linux"))]
pub(super) fn in_huge_pages<T: Copy>(elements: Vec<T>) -> Vec<T> {
    elements
}
