//! A ray made ready for the tree: what boxes and triangles both need, computed once.

use crate::geometry::Ray;
use glam::Vec3;

/// Slab distances are computed with three roundings each: a box is entered when `near ≤ far · (1 + 2γ(3))` (Ize 2013,
/// "Robust BVH Ray Traversal", section 3); the factor sits in the reciprocal, which costs one rounding more.
const FAR: f32 = 1.0 + 4.0 * f32::EPSILON;

/// A ray, with its reciprocal directions for slabs and its shear for triangles.
///
/// The shear makes the ray the positive or negative `z` axis after `axes` permuted the coordinates (Woop, Benthin and
/// Wald 2013, "Watertight Ray/Triangle Intersection", section 3).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Query {
    pub(crate) origin: Vec3,
    pub(crate) direction: Vec3,
    /// `1 / direction`; infinite where the direction is 0, of the sign of that 0.
    pub(crate) near_rcp: [f32; 3],
    /// The same, made longer by the error of a slab distance.
    pub(crate) far_rcp: [f32; 3],
    /// Which plane of each axis is entered first: 0 the lower, 1 the upper.
    pub(crate) near_plane: [usize; 3],
    /// The permutation of axes; the last is where the direction is longest.
    pub(crate) axes: [usize; 3],
    /// Shear of the first and second of `axes`, and scale of the last.
    pub(crate) shear: [f32; 3],
    pub(crate) t_max: f32,
}

impl Query {
    /// `None` for a ray that hits nothing: no direction, no length, or anything that is not a number.
    #[inline(always)]
    pub(crate) fn new(ray: &Ray) -> Option<Self> {
        let Ray { origin, direction, t_max } = *ray;
        let length = direction.abs();
        // Infinity and NaN both make the sum times 0 a NaN.
        let finite = (origin.x + origin.y + origin.z + length.x + length.y + length.z) * 0.0 == 0.0;
        let longest = length.x.max(length.y).max(length.z);
        if !(finite && longest > 0.0 && t_max > 0.0) {
            return None;
        }
        let near_rcp = [1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z];
        // Which axis it is nobody can predict: without a branch.
        let kz = usize::from(longest != length.x) * (1 + usize::from(longest != length.y));
        let (kx, ky) = ([1, 2, 0][kz], [2, 0, 1][kz]);
        let components = direction.to_array();
        let scale = near_rcp[kz];
        Some(Self {
            origin,
            direction,
            near_rcp,
            far_rcp: near_rcp.map(|rcp| rcp * FAR),
            near_plane: near_rcp.map(|rcp| usize::from(rcp.is_sign_negative())),
            axes: [kx, ky, kz],
            shear: [components[kx] * scale, components[ky] * scale, scale],
            t_max,
        })
    }

    /// A limit for boxes a little beyond `t`: a slab distance may be too large by its rounding error.
    #[inline(always)]
    pub(crate) fn limit(t: f32) -> f32 {
        t * FAR
    }
}
