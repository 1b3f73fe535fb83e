//! Area emitters: parts of the scene that shine, from the side that their normals point to.
//!
//! Points are sampled uniformly by area, and the density converted to solid angle; a sphere seen from outside is sampled
//! by the cone of directions to it, which is exact and never gives its far side.

use super::{EmitterSample, mean};
use crate::geometry::interaction::triangle_error;
use crate::geometry::{Interaction, Mesh, Part};
use crate::math::distribution::AliasTable;
use crate::math::float::gamma;
use crate::math::{Frame, Rgb, warp};
use crate::texture::Texture;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};
use std::f64::consts::PI;

/// A part that shines, with what sampling it needs.
#[derive(Clone, Debug)]
pub(super) struct AreaEmitter {
    shape: Shape,
    radiance: Radiance,
    area: f64,
    /// Density of points per unit of area, `1 / area`; 0 where there is nothing to sample.
    pdf_area: f32,
}

/// Emitted radiance; most emitters have the same everywhere, and then no surface coordinates are computed.
#[derive(Clone, Debug)]
enum Radiance {
    Uniform(Rgb),
    Textured(Texture),
}

#[derive(Clone, Debug)]
enum Shape {
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
struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
    normal: Vec3,
}

/// A point chosen on an emitter.
pub(super) struct SurfacePoint {
    pub(super) position: Vec3,
    /// Unit, on the side that shines.
    pub(super) normal: Vec3,
    pub(super) uv: Vec2,
}

impl AreaEmitter {
    pub(super) fn new(part: Part, radiance: Texture) -> Self {
        let radiance = match radiance {
            Texture::Constant(colour) => Radiance::Uniform(colour),
            textured => Radiance::Textured(textured),
        };
        let (shape, area) = match part {
            Part::Mesh(mesh) => mesh_shape(&mesh, matches!(radiance, Radiance::Textured(_))),
            Part::Sphere { center, radius, flip_normals } => (
                Shape::Sphere { center, radius, flip_normals },
                4.0 * PI * f64::from(radius).powi(2),
            ),
            Part::Disk { center, axes, flip_normals } => {
                let [a, b] = axes.map(|axis| axis.as_dvec3());
                let across = if flip_normals { b.cross(a) } else { a.cross(b) };
                let normal = across.normalize_or_zero().as_vec3();
                (Shape::Disk { center, axes, normal }, PI * across.length())
            }
            Part::Cylinder { start, end, radius, flip_normals } => {
                let span = end.as_dvec3() - start.as_dvec3();
                let frame = Frame::from_normal(span.normalize_or(glam::DVec3::Z).as_vec3());
                let length = span.length();
                let shape =
                    Shape::Cylinder { start, frame, length: length as f32, radius, flip_normals };
                (shape, 2.0 * PI * f64::from(radius) * length)
            }
        };
        // An area whose inverse single precision does not hold is treated as none at all.
        let pdf_area = (1.0 / area) as f32;
        let usable = area > 0.0 && pdf_area > 0.0 && pdf_area.is_finite();
        let (area, pdf_area) = if usable { (area, pdf_area) } else { (0.0, 0.0) };
        Self { shape, radiance, area, pdf_area }
    }

    /// Watts: `π · area · mean radiance`.
    pub(super) fn power(&self) -> f64 {
        let radiance = match &self.radiance {
            Radiance::Uniform(colour) => *colour,
            Radiance::Textured(texture) => texture.mean(),
        };
        PI * self.area * mean(radiance)
    }

    /// Radiance sent from the side that shines.
    #[inline]
    pub(super) fn radiance(&self, uv: Vec2) -> Rgb {
        match &self.radiance {
            Radiance::Uniform(colour) => *colour,
            Radiance::Textured(texture) => texture.eval(uv),
        }
    }

    /// A direction to a point of the emitter, seen from its shining side; `triangle` chooses among triangles.
    #[inline(always)]
    pub(super) fn sample(&self, from: Vec3, triangle: f32, u: Vec2) -> Option<EmitterSample> {
        if let Shape::Sphere { center, radius, flip_normals } = self.shape
            && let Some(cone) = Cone::to_sphere(from, center, radius)
        {
            // From outside only a sphere with outward normals shines.
            return if flip_normals { None } else { self.sample_cone(&cone, radius, u) };
        }
        let point = self.shape.sample(triangle, u)?;
        let to_point = point.position - from;
        let distance = to_point.length();
        let direction = to_point / distance;
        let cosine = -point.normal.dot(direction);
        // The direction to the point itself is NaN.
        if cosine <= 0.0 || cosine.is_nan() {
            return None;
        }
        let pdf = to_solid_angle(self.pdf_area, distance, cosine);
        Some(EmitterSample {
            direction,
            distance,
            radiance: self.radiance(point.uv),
            pdf,
            is_delta: false,
        })
    }

    /// A point, uniform in area, and the bound of its rounding error; `triangle` chooses among triangles.
    pub(super) fn sample_point(&self, triangle: f32, u: Vec2) -> Option<(SurfacePoint, Vec3)> {
        let point = self.shape.sample(triangle, u)?;
        let error = self.shape.error(triangle, point.position);
        Some((point, error))
    }

    /// Density of [`AreaEmitter::sample_point`] per unit of area; 0 where there is nothing to sample.
    pub(super) fn point_pdf(&self) -> f64 {
        if self.area > 0.0 { 1.0 / self.area } else { 0.0 }
    }

    /// Density, per steradian, with which [`AreaEmitter::sample`] from `from` gives the direction to `at`.
    #[inline]
    pub(super) fn pdf(&self, from: Vec3, at: &Interaction) -> f32 {
        let to_point = at.position - from;
        let distance = to_point.length();
        let cosine = -shining_normal(at).dot(to_point / distance);
        if cosine <= 0.0 || cosine.is_nan() || self.pdf_area == 0.0 {
            return 0.0;
        }
        if let Shape::Sphere { center, radius, .. } = self.shape
            && let Some(cone) = Cone::to_sphere(from, center, radius)
        {
            return cone.pdf;
        }
        to_solid_angle(self.pdf_area, distance, cosine)
    }

    fn sample_cone(&self, cone: &Cone, radius: f32, u: Vec2) -> Option<EmitterSample> {
        let local = warp::square_to_cone(u, cone.cap);
        let direction = Frame::from_normal(cone.axis).to_world(local);
        // The nearer intersection; at the cone's rim rounding may miss the sphere by a hair.
        let sine_squared = local.truncate().length_squared();
        let half_chord =
            (radius * radius - cone.distance * cone.distance * sine_squared).max(0.0).sqrt();
        let distance = cone.distance * local.z - half_chord;
        let radiance = match &self.radiance {
            Radiance::Uniform(colour) => *colour,
            Radiance::Textured(texture) => {
                let from_center = direction * distance - cone.axis * cone.distance;
                texture.eval(sphere_uv(from_center.normalize_or(-cone.axis)))
            }
        };
        Some(EmitterSample { direction, distance, radiance, pdf: cone.pdf, is_delta: false })
    }
}

impl Shape {
    /// A point, uniform in area; `triangle` chooses among triangles. `None` when there is no area.
    #[inline(always)]
    fn sample(&self, triangle: f32, u: Vec2) -> Option<SurfacePoint> {
        match self {
            // The most frequent shape is worth the space.
            Self::Parallelogram { corner, edges, normal, .. } => Some(SurfacePoint {
                position: *corner + edges[0] * u.x + edges[1] * u.y,
                normal: *normal,
                // Only radiance without a texture is sampled so.
                uv: Vec2::ZERO,
            }),
            // Taken apart, what the parallelogram gives stays in registers.
            _ => {
                let SurfacePoint { position, normal, uv } = self.sample_others(triangle, u)?;
                Some(SurfacePoint { position, normal, uv })
            }
        }
    }

    /// [`Shape::sample`] of all shapes but parallelograms.
    fn sample_others(&self, triangle: f32, u: Vec2) -> Option<SurfacePoint> {
        Some(match self {
            Self::Parallelogram { .. } => self.sample(triangle, u)?,
            Self::Triangles { triangles, choice, uvs } => {
                let index = choice.as_ref()?.sample(triangle).index;
                let Triangle { corner, edges, normal } = triangles[index];
                let weights = warp::square_to_triangle(u);
                let uv = uvs.get(index).map_or(Vec2::ZERO, |[a, b, c]| {
                    *a * (1.0 - weights.x - weights.y) + *b * weights.x + *c * weights.y
                });
                SurfacePoint {
                    position: corner + edges[0] * weights.x + edges[1] * weights.y,
                    normal,
                    uv,
                }
            }
            Self::Sphere { center, radius, flip_normals } => {
                let outward = warp::square_to_sphere(u);
                SurfacePoint {
                    position: *center + outward * *radius,
                    normal: if *flip_normals { -outward } else { outward },
                    uv: sphere_uv(outward),
                }
            }
            Self::Disk { center, axes, normal } => {
                let disk = warp::square_to_disk(u);
                SurfacePoint {
                    position: *center + axes[0] * disk.x + axes[1] * disk.y,
                    normal: *normal,
                    uv: Vec2::new(disk.length(), turn(disk)),
                }
            }
            Self::Cylinder { start, frame, length, radius, flip_normals } => {
                let around = Vec2::from_angle(TAU * u.x);
                let outward = frame.tangent * around.x + frame.bitangent * around.y;
                SurfacePoint {
                    position: *start + outward * *radius + frame.normal * (*length * u.y),
                    normal: if *flip_normals { -outward } else { outward },
                    uv: u,
                }
            }
        })
    }
}

/// How many roundings of its size a point of a round shape is off: those of sine, cosine and root, and of two products and
/// a sum. They were counted to 6.
const ROUND_ROUNDINGS: u32 = 8;

impl Shape {
    /// Bound of the error of a point of [`Shape::sample`], per axis, for the same `triangle`. As that of an
    /// [`Interaction`], it also holds what the test of rays that leave errs by.
    fn error(&self, triangle: f32, position: Vec3) -> Vec3 {
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

/// The directions in which a sphere is seen from a point outside.
struct Cone {
    /// Unit vector to the centre.
    axis: Vec3,
    /// How far the centre is.
    distance: f32,
    /// `1 - cos` of the half-angle.
    cap: f32,
    /// Density of uniform directions, per steradian; 0 where the cone is too narrow for single precision.
    pdf: f32,
}

impl Cone {
    /// `None` from inside.
    #[inline]
    fn to_sphere(from: Vec3, center: Vec3, radius: f32) -> Option<Self> {
        let to_center = center - from;
        let distance = to_center.length();
        let sine = radius / distance;
        if sine >= 1.0 || sine.is_nan() {
            return None;
        }
        let cap = warp::one_minus_cosine(sine * sine);
        Some(Self {
            axis: to_center / distance,
            distance,
            cap,
            pdf: finite_or_zero(warp::cone_pdf(cap)),
        })
    }
}

/// The density per steradian of a point with density `pdf_area` per unit of area, `distance` away, whose normal makes an
/// angle of the given cosine with the direction: `pdf_area · distance² / cosine`; 0 where that is not finite.
#[inline]
fn to_solid_angle(pdf_area: f32, distance: f32, cosine: f32) -> f32 {
    finite_or_zero(pdf_area * distance * distance / cosine)
}

/// A density that single precision cannot hold counts as 0 both when sampling and when evaluating, so that the two
/// agree and the light is left to the other sampling method.
#[inline]
fn finite_or_zero(pdf: f32) -> f32 {
    if pdf.is_finite() { pdf } else { 0.0 }
}

/// Surface coordinates of a sphere, as in Mitsuba 3: `φ/2π` around `z` from `x`, `θ/π` from the north pole.
fn sphere_uv(outward: Vec3) -> Vec2 {
    let theta = outward.truncate().length().atan2(outward.z);
    Vec2::new(turn(outward.truncate()), theta * FRAC_1_PI)
}

/// The angle of a vector as a share of the full circle, in `[0, 1)`.
fn turn(vector: Vec2) -> f32 {
    let turn = vector.y.atan2(vector.x) / TAU;
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

/// The unit geometric normal on the side that shines: that of the shading normal, which is the other one where a mesh
/// has vertex normals against its winding. As in Mitsuba 3, apart from triangles whose normals lean over by more than a
/// right angle.
#[inline]
pub(super) fn shining_normal(at: &Interaction) -> Vec3 {
    if at.normal.dot(at.shading_normal) < 0.0 { -at.normal } else { at.normal }
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
