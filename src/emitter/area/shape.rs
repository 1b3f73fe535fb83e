//! What points are chosen on.

use crate::geometry::interaction::triangle_error;
use crate::geometry::{Mesh, Part};
use crate::math::arc_tangent::arc_tangent2;
use crate::math::distribution::AliasTable;
use crate::math::float::gamma;
use crate::math::sine::sine_cosine_of_turns;
use crate::math::{Frame, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};
use std::f64::consts::PI;

/// A shape, with what sampling it needs.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// Two triangles that make one: the square maps to it without a seam, which keeps stratified points stratified.
    Parallelogram {
        corner: Vec3,
        edges: [Vec3; 2],
        normal: Vec3,
        /// How far the fourth corner is from where it is taken to be.
        gap: f32,
    },
    Triangles {
        triangles: Vec<Triangle>,
        /// By area; missing when no triangle has any.
        choice: Option<AliasTable>,
        /// Surface coordinates of the corners; empty where the radiance does not depend on them.
        uvs: Vec<[Vec2; 3]>,
    },
    Sphere {
        center: Vec3,
        radius: f32,
        flip_normals: bool,
    },
    Disk {
        center: Vec3,
        axes: [Vec3; 2],
        normal: Vec3,
    },
    Cylinder {
        start: Vec3,
        /// Tangent, bitangent and, as `normal`, the unit axis.
        frame: Frame,
        length: f32,
        radius: f32,
        flip_normals: bool,
    },
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
    normal: Vec3,
}

/// A point chosen on an emitter.
pub(in crate::emitter) struct SurfacePoint {
    pub(in crate::emitter) position: Vec3,
    /// Unit, on the side that shines.
    pub(in crate::emitter) normal: Vec3,
}

impl Shape {
    /// The shape of a part, and its area.
    pub(super) fn new(part: Part, is_textured: bool) -> (Self, f64) {
        match part {
            Part::Mesh(mesh) => mesh_shape(&mesh, is_textured),
            Part::Sphere { center, radius, flip_normals } => (
                Self::Sphere { center, radius, flip_normals },
                4.0 * PI * f64::from(radius).powi(2),
            ),
            Part::Disk { center, axes, flip_normals } => {
                let [a, b] = axes.map(|axis| axis.as_dvec3());
                let across = if flip_normals { b.cross(a) } else { a.cross(b) };
                let normal = across.normalize_or_zero().as_vec3();
                (Self::Disk { center, axes, normal }, PI * across.length())
            }
            Part::Cylinder { start, end, radius, flip_normals } => {
                let span = end.as_dvec3() - start.as_dvec3();
                let frame = Frame::from_normal(span.normalize_or(glam::DVec3::Z).as_vec3());
                let length = span.length();
                let shape =
                    Self::Cylinder { start, frame, length: length as f32, radius, flip_normals };
                (shape, 2.0 * PI * f64::from(radius) * length)
            }
        }
    }

    /// A point, uniform in area; `triangle` chooses among triangles. `None` when there is no area.
    #[inline(always)]
    pub(super) fn sample(&self, triangle: f32, u: Vec2) -> Option<SurfacePoint> {
        match self {
            // The most frequent shape is worth the space.
            Self::Parallelogram { corner, edges, normal, .. } => Some(SurfacePoint {
                position: *corner + edges[0] * u.x + edges[1] * u.y,
                normal: *normal,
            }),
            // Taken apart, what the parallelogram gives stays in registers.
            _ => {
                let SurfacePoint { position, normal } = self.sample_others(triangle, u)?;
                Some(SurfacePoint { position, normal })
            }
        }
    }

    /// [`Shape::sample`] of all shapes but parallelograms.
    fn sample_others(&self, triangle: f32, u: Vec2) -> Option<SurfacePoint> {
        Some(match self {
            Self::Parallelogram { .. } => self.sample(triangle, u)?,
            Self::Triangles { triangles, choice, .. } => {
                let index = choice.as_ref()?.sample(triangle).index;
                let Triangle { corner, edges, normal } = triangles[index];
                let weights = warp::square_to_triangle(u);
                SurfacePoint {
                    position: corner + edges[0] * weights.x + edges[1] * weights.y,
                    normal,
                }
            }
            Self::Sphere { center, radius, flip_normals } => {
                let outward = warp::square_to_sphere(u);
                SurfacePoint {
                    position: *center + outward * *radius,
                    normal: if *flip_normals { -outward } else { outward },
                }
            }
            Self::Disk { center, axes, normal } => {
                let disk = warp::square_to_disk(u);
                SurfacePoint {
                    position: *center + axes[0] * disk.x + axes[1] * disk.y,
                    normal: *normal,
                }
            }
            Self::Cylinder { start, frame, length, radius, flip_normals } => {
                let (sine, cosine) = sine_cosine_of_turns(u.x);
                let outward = frame.tangent * cosine + frame.bitangent * sine;
                SurfacePoint {
                    position: *start + outward * *radius + frame.normal * (*length * u.y),
                    normal: if *flip_normals { -outward } else { outward },
                }
            }
        })
    }

    /// Surface coordinates of the point of [`Shape::sample`].
    pub(super) fn uv(&self, triangle: f32, u: Vec2) -> Vec2 {
        match self {
            // Only radiance without a texture is sampled so.
            Self::Parallelogram { .. } => Vec2::ZERO,
            Self::Triangles { choice, uvs, .. } => {
                let corners = choice.as_ref().and_then(|all| uvs.get(all.sample(triangle).index));
                let weights = warp::square_to_triangle(u);
                corners.map_or(Vec2::ZERO, |[a, b, c]| {
                    *a * (1.0 - weights.x - weights.y) + *b * weights.x + *c * weights.y
                })
            }
            Self::Sphere { .. } => sphere_uv(warp::square_to_sphere(u)),
            Self::Disk { .. } => {
                let disk = warp::square_to_disk(u);
                Vec2::new(disk.length(), turn(disk))
            }
            Self::Cylinder { .. } => u,
        }
    }
}

/// How many roundings of its size a point of a round shape is off: those of sine, cosine and root, and of two products and
/// a sum. They were counted to 6.
const ROUND_ROUNDINGS: u32 = 8;

impl Shape {
    /// Bound of the error of a point of [`Shape::sample`], per axis, for the same `triangle`. As that of an
    /// [`Interaction`](crate::geometry::Interaction), it also holds what the test of rays that leave errs by.
    pub(super) fn error(&self, triangle: f32, position: Vec3) -> Vec3 {
        let flat = |edges: [Vec3; 2]| {
            let across = edges[0].as_dvec3().cross(edges[1].as_dvec3()).length() as f32;
            let size = edges.iter().map(|edge| edge.abs().max_element()).fold(0.0, f32::max);
            triangle_error(position, edges, size, across)
        };
        let round =
            |size: f32| position.abs() * gamma(2) + Vec3::splat(size * gamma(ROUND_ROUNDINGS));
        match self {
            // One of the two triangles may have the diagonal for an edge.
            Self::Parallelogram { edges: [a, b], gap, .. } => {
                flat([*a, *b - *a]).max(flat([*b, *a + *b])) + Vec3::splat(*gap)
            }
            Self::Triangles { triangles, choice, .. } => choice
                .as_ref()
                .map_or(Vec3::ZERO, |choice| flat(triangles[choice.sample(triangle).index].edges)),
            Self::Sphere { radius, .. } => round(*radius),
            Self::Disk { axes, .. } => round(axes[0].length() + axes[1].length()),
            Self::Cylinder { radius, length, .. } => round(*radius + *length),
        }
    }
}

/// Surface coordinates of a sphere, as in Mitsuba 3: `φ/2π` around `z` from `x`, `θ/π` from the north pole.
pub(super) fn sphere_uv(outward: Vec3) -> Vec2 {
    let theta = arc_tangent2(outward.truncate().length(), outward.z);
    Vec2::new(turn(outward.truncate()), theta * FRAC_1_PI)
}

/// The angle of a vector as a share of the full circle, in `[0, 1)`.
fn turn(vector: Vec2) -> f32 {
    let turn = arc_tangent2(vector.y, vector.x) / TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}

/// The shape of a mesh, and its area. Triangles without area or with missing vertices are never chosen.
fn mesh_shape(mesh: &Mesh, is_textured: bool) -> (Shape, f64) {
    let corner = |index: u32| mesh.positions.get(index as usize).copied().unwrap_or(Vec3::NAN);
    let corners: Vec<[Vec3; 3]> =
        mesh.triangles.iter().map(|indices| indices.map(corner)).collect();
    let vertex_normal =
        |index: u32| mesh.normals.get(index as usize).copied().unwrap_or(Vec3::ZERO);
    let (triangles, areas): (Vec<Triangle>, Vec<f64>) = mesh
        .triangles
        .iter()
        .zip(&corners)
        .map(|(&indices, &corners)| {
            triangle(corners, indices.map(vertex_normal), mesh.flip_normals)
        })
        .unzip();
    let area = areas.iter().sum();
    if let [first, second] = corners[..]
        && !is_textured
        && let Some((corner, [p, q], gap)) = parallelogram(first, second)
        && triangles[0].normal.dot(triangles[1].normal) > 0.0
    {
        let normal = triangles[0].normal;
        return (
            Shape::Parallelogram { corner, edges: [p - corner, q - corner], normal, gap },
            area,
        );
    }
    let uvs = if is_textured {
        // Without coordinates the barycentric weights of the second and third vertex serve.
        const BARYCENTRIC: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];
        let uv = |index: u32| mesh.uvs.get(index as usize).copied().unwrap_or(Vec2::ZERO);
        let has_uvs = !mesh.uvs.is_empty();
        mesh.triangles
            .iter()
            .map(|&indices| if has_uvs { indices.map(uv) } else { BARYCENTRIC })
            .collect()
    } else {
        Vec::new()
    };
    (Shape::Triangles { triangles, choice: AliasTable::new(&areas), uvs }, area)
}

/// A triangle, its normal on the side of its corners' normals, and its area, 0 where that is not finite.
fn triangle(
    [a, b, c]: [Vec3; 3],
    vertex_normals: [Vec3; 3],
    flip_normals: bool,
) -> (Triangle, f64) {
    let across = (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3());
    let area = 0.5 * across.length();
    let face = across.normalize_or_zero().as_vec3();
    let is_turned = vertex_normals.into_iter().sum::<Vec3>().dot(face) < 0.0;
    let normal = if is_turned != flip_normals { -face } else { face };
    let triangle = Triangle { corner: a, edges: [b - a, c - a], normal };
    (triangle, if area.is_finite() { area } else { 0.0 })
}

/// A corner of the parallelogram that two triangles make together, its two neighbours, and how far the fourth corner is from
/// where these put it; `None` when they make none.
fn parallelogram(first: [Vec3; 3], second: [Vec3; 3]) -> Option<(Vec3, [Vec3; 2], f32)> {
    let apex = |of: [Vec3; 3], other: [Vec3; 3]| of.iter().position(|point| !other.contains(point));
    let (i, j) = (apex(first, second)?, apex(second, first)?);
    let (corner, opposite) = (first[i], second[j]);
    let (p, q) = (first[(i + 1) % 3], first[(i + 2) % 3]);
    if !second.contains(&p) || !second.contains(&q) {
        return None;
    }
    // The diagonals halve each other, up to the rounding of the corners.
    let size = [corner, opposite, p, q]
        .map(|point| point.abs().max_element())
        .into_iter()
        .fold(0.0, f32::max);
    let gap = (corner + opposite - p - q).abs().max_element();
    (gap <= 8.0 * f32::EPSILON * size).then_some((corner, [p, q], gap))
}
