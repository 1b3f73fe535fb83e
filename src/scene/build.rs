//! From a description in double precision to a [`Scene`] in single precision.
//!
//! The readers of scene files describe where things are in the numbers of the file; here everything is moved so that
//! the scene lies around the origin, and only then rounded.

use super::mesh_file::{MeshOptions, RawMesh};
use super::{FilmSettings, Material, MaterialId, PathLimits, Scene, Surface};
use crate::emitter::{Emitter, EmitterId, Emitters};
use crate::geometry::{Geometry, Part};
use crate::math::Rgb;
use crate::texture::Texture;
use glam::{DMat4, DVec3, Vec3};

/// All that a scene file says.
pub(super) struct Description {
    pub(super) shapes: Vec<ShapeDescription>,
    /// Found by [`MaterialId`].
    pub(super) materials: Vec<Material>,
    /// Light that no shape sends.
    pub(super) lights: Vec<Light>,
    pub(super) camera: CameraDescription,
    pub(super) film: FilmSettings,
    pub(super) limits: PathLimits,
    /// A pixel.
    pub(super) samples: u32,
    pub(super) warnings: Vec<String>,
}

/// A shape, what it is made of, and the radiance it sends, if it does.
pub(super) struct ShapeDescription {
    pub(super) shape: Shape,
    pub(super) material: MaterialId,
    pub(super) radiance: Option<Texture>,
}

/// As [`Part`], in double precision and before the scene is moved.
pub(super) enum Shape {
    Mesh { mesh: RawMesh, to_world: DMat4, options: MeshOptions },
    Sphere { center: DVec3, radius: f64, flip_normals: bool },
    Disk { center: DVec3, axes: [DVec3; 2], flip_normals: bool },
    Cylinder { start: DVec3, end: DVec3, radius: f64, flip_normals: bool },
}

/// Light that no shape sends.
pub(super) enum Light {
    /// Radiant intensity the same in all directions.
    Point { position: DVec3, intensity: Rgb },
    /// Full intensity around `direction` up to `beam_degrees`, falling to nothing at `cutoff_degrees`, both from the axis.
    Spot { position: DVec3, direction: DVec3, intensity: Rgb, cutoff_degrees: f64, beam_degrees: f64 },
    /// From infinity: it does not matter where the scene is.
    Infinite(Emitter),
}

impl Light {
    /// Does it shine from all directions? There can only be one such.
    pub(super) fn is_environment(&self) -> bool {
        matches!(self, Self::Infinite(Emitter::Environment(_)))
    }

    fn into_emitter(self, origin: DVec3) -> Emitter {
        match self {
            Self::Point { position, intensity } => {
                Emitter::Point { position: (position - origin).as_vec3(), intensity }
            }
            Self::Spot { position, direction, intensity, cutoff_degrees, beam_degrees } => Emitter::Spot {
                position: (position - origin).as_vec3(),
                direction: direction.as_vec3(),
                intensity,
                cutoff_angle: cutoff_degrees as f32,
                beam_width: beam_degrees as f32,
            },
            Self::Infinite(emitter) => emitter,
        }
    }
}

/// A camera that looks along +z of its own space, with +y up and +x to the left.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CameraDescription {
    /// Camera space to world space.
    pub(super) to_world: DMat4,
    /// Field of view across the whole film, from left to right.
    pub(super) x_fov_degrees: f64,
    /// Where the axis of view meets the film, right and down of its middle, in parts of its width and height.
    pub(super) principal_point: [f64; 2],
    /// Radius of the lens; 0 for a pinhole.
    pub(super) aperture_radius: f64,
    /// Distance of the plane in focus.
    pub(super) focus_distance: f64,
    /// Nothing nearer along the axis of view is seen.
    pub(super) near_clip: f64,
    /// Nothing farther along the axis of view is seen.
    pub(super) far_clip: f64,
}

/// The side of the picture that a field of view spans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FovAxis {
    /// Left to right.
    X,
    /// Top to bottom.
    Y,
    /// Corner to corner.
    Diagonal,
    /// The shorter of width and height.
    Smaller,
    /// The longer of width and height.
    Larger,
}

impl FovAxis {
    /// Degrees from left to right, for `fov` degrees along this axis of a picture of `aspect` = width / height.
    pub(super) fn to_x_fov(self, fov: f64, aspect: f64) -> f64 {
        let half = (fov.to_radians() / 2.0).tan();
        let half_width = match self {
            Self::X => half,
            Self::Y => half * aspect,
            Self::Diagonal => half * aspect / f64::hypot(aspect, 1.0),
            Self::Smaller => half * aspect.max(1.0),
            Self::Larger => half * aspect.min(1.0),
        };
        2.0 * half_width.atan().to_degrees()
    }
}

impl Description {
    /// Moves the scene to the origin, rounds it, and builds what rendering needs.
    pub(super) fn build(self) -> Scene {
        let origin = self.origin();
        let mut parts = Vec::with_capacity(self.shapes.len());
        let mut surfaces = Vec::with_capacity(self.shapes.len());
        let mut emitters = Vec::new();
        for ShapeDescription { shape, material, radiance } in self.shapes {
            let part = shape.into_part(origin);
            let emitter = radiance.map(|radiance| {
                emitters.push(Emitter::Area { part: part.clone(), radiance });
                EmitterId((emitters.len() - 1) as u32)
            });
            parts.push(part);
            surfaces.push(Surface { material, emitter });
        }
        emitters.extend(self.lights.into_iter().map(|light| light.into_emitter(origin)));
        let geometry = Geometry::new(parts);
        let eye = (self.camera.to_world.transform_point3(DVec3::ZERO) - origin).as_vec3();
        let (center, radius) = bounding_sphere(geometry.bounds(), eye);
        Scene {
            geometry,
            surfaces,
            materials: self.materials,
            emitters: Emitters::new(emitters, center, radius),
            camera: todo!(),
            film: self.film,
            limits: self.limits,
            samples: self.samples,
            origin,
            warnings: self.warnings,
        }
    }

    /// The middle of the box around all shapes, or the camera where there are none. It is rounded to about an eighth of
    /// the box by a power of two, so that moving by it adds no digits to the numbers of the file.
    fn origin(&self) -> DVec3 {
        let boxes = self.shapes.iter().filter_map(|shape| shape.shape.bounds());
        let eye = self.camera.to_world.transform_point3(DVec3::ZERO);
        let (low, high) = boxes.reduce(|(a, b), (c, d)| (a.min(c), b.max(d))).unwrap_or((eye, eye));
        let (center, diagonal) = ((low + high) * 0.5, (high - low).length());
        if diagonal > 0.0 && diagonal.is_finite() {
            let step = (diagonal.log2().floor() - 3.0).exp2();
            (center / step).round() * step
        } else {
            center
        }
    }
}

impl Shape {
    /// The corners of a box around it; `None` when it has no finite point.
    fn bounds(&self) -> Option<(DVec3, DVec3)> {
        match self {
            Self::Mesh { mesh, to_world, .. } => mesh.bounds(to_world),
            Self::Sphere { center, radius, .. } => Some((*center - *radius, *center + *radius)),
            Self::Disk { center, axes: [a, b], .. } => {
                let half = (*a * *a + *b * *b).map(f64::sqrt);
                Some((*center - half, *center + half))
            }
            Self::Cylinder { start, end, radius, .. } => Some((start.min(*end) - *radius, start.max(*end) + *radius)),
        }
    }

    fn into_part(self, origin: DVec3) -> Part {
        let point = |point: DVec3| (point - origin).as_vec3();
        match self {
            Self::Mesh { mesh, to_world, options } => Part::Mesh(mesh.into_mesh(&to_world, origin, options)),
            Self::Sphere { center, radius, flip_normals } => {
                Part::Sphere { center: point(center), radius: radius as f32, flip_normals }
            }
            Self::Disk { center, axes, flip_normals } => {
                Part::Disk { center: point(center), axes: axes.map(|axis| axis.as_vec3()), flip_normals }
            }
            Self::Cylinder { start, end, radius, flip_normals } => {
                Part::Cylinder { start: point(start), end: point(end), radius: radius as f32, flip_normals }
            }
        }
    }
}

/// Around a box and the eye: the sphere that environments and directional emitters are placed around.
fn bounding_sphere(bounds: Option<(Vec3, Vec3)>, eye: Vec3) -> (Vec3, f32) {
    let (low, high) = bounds.unwrap_or((eye, eye));
    let (low, high) = (low.min(eye), high.max(eye));
    let center = (low + high) * 0.5;
    // Rounding may not leave a corner outside.
    let radius = (high - center).length() * (1.0 + 1e-5);
    (center, if radius > 0.0 { radius } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_of_view_spans_the_axis_it_names() {
        // tan(45°) = 1, so the half-width is the aspect times 1 for y, and so on.
        for (axis, aspect, half_width) in [
            (FovAxis::X, 2.0, 1.0),
            (FovAxis::Y, 2.0, 2.0),
            (FovAxis::Smaller, 2.0, 2.0),
            (FovAxis::Smaller, 0.5, 1.0),
            (FovAxis::Larger, 2.0, 1.0),
            (FovAxis::Larger, 0.5, 0.5),
            // A 4:3 picture has a diagonal of 5.
            (FovAxis::Diagonal, 4.0 / 3.0, 0.8),
        ] {
            let x_fov = axis.to_x_fov(90.0, aspect);
            let found = (x_fov.to_radians() / 2.0).tan();
            assert!((found - half_width).abs() < 1e-12, "{axis:?} {aspect}: {found}");
        }
    }

    #[test]
    fn the_bounding_sphere_holds_box_and_eye() {
        let (center, radius) = bounding_sphere(Some((Vec3::ZERO, Vec3::ONE)), Vec3::new(0.0, 9.0, 0.0));
        for point in [Vec3::ZERO, Vec3::ONE, Vec3::new(0.0, 9.0, 0.0)] {
            assert!(point.distance(center) <= radius, "{point}");
        }
        assert_eq!(bounding_sphere(None, Vec3::X), (Vec3::X, 1.0));
    }
}
