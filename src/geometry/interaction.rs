//! A point on a surface, with what shading and further rays need to know of it.

use super::{Mesh, Ray};
use crate::math::float::{gamma, offset_point, offset_points};
use glam::{DVec3, Vec2, Vec3};

/// A point on a surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interaction {
    /// Which part of the scene was hit.
    pub part: u32,
    /// The point, computed so that its error is small (barycentric for triangles).
    pub position: Vec3,
    /// Absolute bound of the rounding error of `position`, per axis; on triangles also of the test that further rays
    /// make with the same triangle.
    pub error: Vec3,
    /// Unit geometric normal, on the side that the part defines, not turned to the viewer.
    pub normal: Vec3,
    /// Unit interpolated normal. As in Mitsuba 3 it is what the mesh says, turned round together with `normal` where the
    /// part flips normals, but never turned to the side of `normal`: a mesh whose vertex normals point against its
    /// winding is shaded by them.
    pub shading_normal: Vec3,
    /// Surface coordinates.
    pub uv: Vec2,
    /// Derivative of the position by `u`.
    pub dp_du: Vec3,
    /// Derivative of the position by `v`.
    pub dp_dv: Vec3,
}

/// The test that later rays make with the triangle they leave errs, measured along its normal, by roundings of its size `L`:
/// some for the sheared corners, and for the edge functions `L²/(2·area)` times as many, since rounding `a·d − b·c` moves
/// the weights by `L²/determinant` roundings and those average depths that differ by `L`. In sweeps over needles of 100 : 1 a
/// quarter of a rounding let rays hit the triangle they left, a half did not; 4 is near the worst case.
const TEST_ROUNDINGS: u32 = 4;

/// Triangles more slender than this get no larger error: it would exceed their width, and rays meet them as rarely.
const MOST_SLENDER: f32 = 256.0;

impl Interaction {
    /// An unbounded ray in `direction` whose origin is moved off the surface, to the side `direction` points to, by the
    /// rounding-error bound.
    #[inline]
    pub fn spawn(&self, direction: Vec3) -> Ray {
        Ray::new(self.offset_towards(direction), direction)
    }

    /// A ray to `target`, where its parameter is 1, from a point moved off the surface as by [`Interaction::spawn`]. It is
    /// aimed from there: a parallel ray would pass beside the target, and meet a round emitter too early at its rim.
    pub fn spawn_to(&self, target: Vec3) -> Ray {
        let origin = self.offset_towards(target - self.position);
        Ray::new(origin, target - origin)
    }

    /// The point moved off the surface, to the side `direction` points to, by the rounding-error bound: where a ray from
    /// elsewhere may end without meeting the surface.
    #[inline]
    pub fn offset_towards(&self, direction: Vec3) -> Vec3 {
        offset_point(self.position, self.error, self.normal, direction)
    }

    /// The point moved off to the side of `normal`, and to the other one, as by [`Interaction::offset_towards`].
    pub fn both_offsets(&self) -> [Vec3; 2] {
        offset_points(self.position, self.error, self.normal)
    }

    /// At barycentric weights `u`, `v` of the second and third corner of a mesh's triangle.
    #[inline(always)]
    pub(super) fn on_triangle(part: u32, mesh: &Mesh, triangle: usize, u: f32, v: f32) -> Self {
        let indices = mesh.triangles[triangle].map(|index| index as usize);
        let [a, b, c] = indices.map(|index| mesh.positions[index]);
        let (ab, ac) = (b - a, c - a);
        let (along, across) = (ab * u, ac * v);
        let position = a + (along + across);
        let size = ab.abs().max_element().max(ac.abs().max_element());
        let (normal, double_area) = face([a, b, c], size);
        let error = triangle_error(position, [along, across], size, double_area);
        let interpolated = match mesh.normals.len() == mesh.positions.len() {
            true => {
                let [na, nb, nc] = indices.map(|index| mesh.normals[index]);
                (na * (1.0 - u - v) + nb * u + nc * v)
                    .try_normalize()
                    .filter(|normal| normal.is_finite())
            }
            false => None,
        };
        // Zero and NaN normals occur in files; the surface has a normal all the same.
        let shading_normal = interpolated.unwrap_or(normal);
        let (uv, dp_du, dp_dv) = surface_coordinates(mesh, indices, [ab, ac], u, v);
        let side = if mesh.flip_normals { -1.0 } else { 1.0 };
        Self {
            part,
            position,
            error,
            normal: normal * side,
            shading_normal: shading_normal * side,
            uv,
            dp_du,
            dp_dv,
        }
    }
}

/// The error of a point of a triangle, as in [`Interaction::error`]: `steps` lead to it along the edges from a corner, `size`
/// is the largest coordinate of an edge.
#[inline]
pub(crate) fn triangle_error(
    position: Vec3,
    [along, across]: [Vec3; 2],
    size: f32,
    double_area: f32,
) -> Vec3 {
    // Edge, product and sum round once each, on the way to a last sum; any weights give a point of the plane.
    let slenderness = (size * size / double_area).min(MOST_SLENDER);
    (along.abs() + across.abs()) * gamma(3)
        + position.abs() * gamma(1)
        + Vec3::splat(size * gamma(TEST_ROUNDINGS) * (1.0 + slenderness))
}

/// The unit normal of a triangle, counter-clockwise seen from its tip, and twice its area.
///
/// The edges are scaled to a size of 1 first, so that squares of short ones do not underflow. Single precision loses as
/// many digits as the triangle is slender; below a sine of 1e-3 between the edges the product is computed again in f64.
#[inline(always)]
fn face([a, b, c]: [Vec3; 3], size: f32) -> (Vec3, f32) {
    let scale = 1.0 / size;
    let across = ((b - a) * scale).cross((c - a) * scale);
    let squared = across.length_squared();
    if squared > 1e-6 && squared.is_finite() {
        let length = squared.sqrt();
        (across / length, length * size * size)
    } else {
        slender_face([a, b, c])
    }
}

#[cold]
fn slender_face(corners: [Vec3; 3]) -> (Vec3, f32) {
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    let across = (b - a).cross(c - a);
    (across.normalize_or(DVec3::Z).as_vec3(), across.length() as f32)
}

/// Texture coordinates and the derivatives of the position by them; where the texture is degenerate, or where there is none,
/// the derivatives by the barycentric weights.
#[inline(always)]
fn surface_coordinates(
    mesh: &Mesh,
    indices: [usize; 3],
    edges: [Vec3; 2],
    u: f32,
    v: f32,
) -> (Vec2, Vec3, Vec3) {
    let [ab, ac] = edges;
    if mesh.uvs.len() != mesh.positions.len() {
        return (Vec2::new(u, v), ab, ac);
    }
    let [a, b, c] = indices.map(|index| mesh.uvs[index]);
    let (uv_ab, uv_ac) = (b - a, c - a);
    let uv = a + uv_ab * u + uv_ac * v;
    let determinant = uv_ab.perp_dot(uv_ac);
    let reciprocal = 1.0 / determinant;
    let dp_du = (ab * uv_ac.y - ac * uv_ab.y) * reciprocal;
    let dp_dv = (ac * uv_ab.x - ab * uv_ac.x) * reciprocal;
    if dp_du.is_finite() && dp_dv.is_finite() { (uv, dp_du, dp_dv) } else { (uv, ab, ac) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The triangle of the `mitsuba` 3.9.1 run that the expected numbers are from.
    fn mesh() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![
                Vec3::new(0.3, 0.0, -1.0),
                Vec3::new(0.0, 0.2, -1.0),
                Vec3::new(0.0, 0.0, -1.0),
            ]
            .into_iter()
            .map(Vec3::normalize)
            .collect(),
            uvs: vec![Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, -1.0)],
            triangles: vec![[0, 1, 2]],
            flip_normals: false,
        }
    }

    #[test]
    fn a_triangle_is_described_as_by_mitsuba() {
        for (flip_normals, side) in [(false, 1.0), (true, -1.0)] {
            let at = Interaction::on_triangle(7, &Mesh { flip_normals, ..mesh() }, 0, 0.2, 0.2);
            assert_eq!(at.part, 7);
            assert_eq!(at.position, Vec3::new(0.2, 0.2, 0.0));
            assert_eq!(at.normal, Vec3::Z * side);
            // Against the winding, and not turned.
            let expected = Vec3::new(0.174_718, 0.039_748_6, -0.983_816) * side;
            assert!((at.shading_normal - expected).length() < 1e-6, "{}", at.shading_normal);
            assert!((at.uv - Vec2::new(0.2, 0.6)).length() < 1e-6, "{}", at.uv);
            assert!((at.dp_du - Vec3::X).length() < 1e-6, "{}", at.dp_du);
            assert!((at.dp_dv - Vec3::new(0.0, -0.5, 0.0)).length() < 1e-6, "{}", at.dp_dv);
        }
    }

    #[test]
    fn normals_and_textures_without_meaning_are_replaced() {
        for bad in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            let at =
                Interaction::on_triangle(0, &Mesh { normals: vec![bad; 3], ..mesh() }, 0, 0.3, 0.1);
            assert_eq!(at.shading_normal, Vec3::Z);
        }
        for uvs in [vec![], vec![Vec2::ONE; 3], vec![Vec2::NAN; 3], vec![Vec2::ZERO]] {
            let at = Interaction::on_triangle(0, &Mesh { uvs, ..mesh() }, 0, 0.3, 0.1);
            assert_eq!((at.dp_du, at.dp_dv), (Vec3::X, Vec3::Y));
        }
        let at = Interaction::on_triangle(0, &Mesh { uvs: vec![], ..mesh() }, 0, 0.3, 0.1);
        assert_eq!(at.uv, Vec2::new(0.3, 0.1));
    }

    #[test]
    fn the_error_holds_the_point_that_exact_numbers_give() {
        let positions = vec![
            Vec3::new(1e4, 0.1, -3.0),
            Vec3::new(1e4 + 0.3, 7.7, 0.1),
            Vec3::new(9.9e3, -0.3, 5.0),
        ];
        let [a, b, c] = [0, 1, 2].map(|corner: usize| positions[corner].as_dvec3());
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        for step in 0..1000 {
            let u = step as f32 / 1000.0;
            let v = (1.0 - u) * ((step * 7 % 1000) as f32 / 1000.0);
            let at = Interaction::on_triangle(0, &mesh, 0, u, v);
            let exact = a + (b - a) * f64::from(u) + (c - a) * f64::from(v);
            let difference = (at.position.as_dvec3() - exact).abs();
            assert!(
                difference.cmple(at.error.as_dvec3()).all(),
                "{difference} is over {}",
                at.error
            );
            assert!(at.error.max_element() < 1e-2);
        }
    }
}
