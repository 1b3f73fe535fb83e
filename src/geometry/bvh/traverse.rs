//! Traversal with AVX2.
use super::wide::Child;
use super::{Bvh, Query, portable};
use crate::geometry::Hit;

pub(super) fn has_avx2() -> bool {
    false
}

pub(super) fn intersect(bvh: &Bvh, root: Child, query: &Query) -> Option<Hit> {
    portable::intersect(bvh, root, query)
}

pub(super) fn is_occluded(bvh: &Bvh, root: Child, query: &Query) -> bool {
    portable::is_occluded(bvh, root, query)
}
