//! A point on a surface, with what shading and further rays need to know of it.

use super::{Mesh, Ray};
use crate::math::float::{gamma, offset_point};
use glam::{DVec3, Vec2, Vec3};

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
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

/// The tests of a triangle by later rays err by this many roundings of its size, as seen along its normal: three for each
/// sheared coordinate, and eight for edge functions, weights and the depth that they average. It is the worst that
/// was seen in sweeps, times two; slivers err more, but a ray that leaves them meets them as rarely.
const TEST_ROUNDINGS: u32 = 16;

impl Interaction {
    /// An unbounded ray in `direction` whose origin is moved off the surface, to the side `direction` points to, by the
    /// rounding-error bound.
    pub fn spawn(&self, direction: Vec3) -> Ray {
        Ray::new(offset_point(self.position, self.error, self.normal, direction), direction)
    }

    /// At barycentric weights `u`, `v` of the second and third corner of a mesh's triangle.
    pub(super) fn on_triangle(part: u32, mesh: &Mesh, triangle: usize, u: f32, v: f32) -> Self {
        let indices = mesh.triangles[triangle].map(|index| index as usize);
        let [a, b, c] = indices.map(|index| mesh.positions[index]);
        let (ab, ac) = (b - a, c - a);
        let (along, across) = (ab * u, ac * v);
        let position = a + (along + across);
        // Edge, product and sum round once each, on the way to a last sum; any weights give a point of the plane.
        let size = ab.abs().max_element().max(ac.abs().max_element());
        let error = (along.abs() + across.abs()) * gamma(3)
            + position.abs() * gamma(1)
            + Vec3::splat(size * gamma(TEST_ROUNDINGS));
        let normal = face_normal(a, b, c);
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

/// The unit normal of a triangle, counter-clockwise seen from its tip, in f64: f32 underflows on triangles of 1e-10.
fn face_normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let origin = a.as_dvec3();
    (b.as_dvec3() - origin).cross(c.as_dvec3() - origin).normalize_or(DVec3::Z).as_vec3()
}

/// Texture coordinates and the derivatives of the position by them; where the texture is degenerate, or where there is none,
/// the derivatives by the barycentric weights.
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
    let dp_du = (ab * uv_ac.y - ac * uv_ab.y) / determinant;
    let dp_dv = (ac * uv_ab.x - ab * uv_ac.x) / determinant;
    if dp_du.is_finite() && dp_dv.is_finite() { (uv, dp_du, dp_dv) } else { (uv, ab, ac) }
}
