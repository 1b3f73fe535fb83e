//! From a description in double precision to a [`Scene`] in single precision.
//!
//! The readers of scene files describe where things are in the numbers of the file; here everything is moved so that
//! the scene lies around the origin, and only then rounded.

use super::camera::Perspective;
use super::mesh_file::{MeshOptions, RawMesh};
use super::{Camera, FilmSettings, Material, MaterialId, PathLimits, Scene, Surface};
use crate::emitter::{BoundingSphere, Emitter, EmitterId, Emitters};
use crate::geometry::{Geometry, Part};
use crate::math::Rgb;
use crate::texture::Texture;
use glam::{DMat4, DVec3};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// All that a scene file says.
pub(super) struct Description {
    pub(super) shapes: Vec<ShapeDescription>,
    /// Found by [`MaterialId`].
    pub(super) materials: Vec<Material>,
    /// Light that no shape sends.
    pub(super) lights: Vec<Light>,
    /// Before the scene is moved; [`Camera::perspective`] accepts it.
    pub(super) camera: Perspective,
    pub(super) film: FilmSettings,
    pub(super) limits: PathLimits,
    /// A pixel.
    pub(super) samples: u32,
    pub(super) warnings: Vec<String>,
    pub(super) image_files: BTreeSet<PathBuf>,
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
    Spot {
        position: DVec3,
        direction: DVec3,
        intensity: Rgb,
        cutoff_degrees: f64,
        beam_degrees: f64,
    },
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
            Self::Spot { position, direction, intensity, cutoff_degrees, beam_degrees } => {
                Emitter::Spot {
                    position: (position - origin).as_vec3(),
                    direction: direction.as_vec3(),
                    intensity,
                    cutoff_angle: cutoff_degrees as f32,
                    beam_width: beam_degrees as f32,
                }
            }
            Self::Infinite(emitter) => emitter,
        }
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
            let mut part = shape.into_part(origin);
            if let Part::Mesh(mesh) = &mut part
                && !self.materials[material.0 as usize].needs_coordinates()
                && radiance.as_ref().is_none_or(|radiance| radiance.constant().is_some())
            {
                mesh.uvs = Vec::new();
            }
            let emitter = radiance.map(|radiance| {
                emitters.push(Emitter::Area { part: part.clone(), radiance });
                EmitterId((emitters.len() - 1) as u32)
            });
            parts.push(part);
            surfaces.push(Surface { material, emitter });
        }
        emitters.extend(self.lights.into_iter().map(|light| light.into_emitter(origin)));
        let geometry = Geometry::new(parts);
        let mut camera = self.camera;
        camera.to_world = DMat4::from_translation(-origin) * camera.to_world;
        let eye = camera.to_world.transform_point3(DVec3::ZERO).as_vec3();
        let mut warnings = self.warnings;
        let rejected = geometry.rejected();
        for (count, what) in [
            (rejected.out_of_range, "name vertices that do not exist"),
            (rejected.non_finite, "have a coordinate that is no finite number"),
            (rejected.without_area, "have no area"),
        ] {
            if count > 0 {
                warnings.push(format!("{count} triangles or shapes {what}; left out"));
            }
        }
        let lens = BoundingSphere { center: eye, radius: camera.aperture_radius as f32 };
        let bounds = BoundingSphere::around(geometry.bounds(), eye);
        Scene {
            geometry,
            has_masks: surfaces
                .iter()
                .any(|surface| !self.materials[surface.material.0 as usize].is_opaque()),
            surfaces,
            materials: self.materials,
            emitters: Emitters::new(emitters, bounds).reaching(lens),
            camera: Camera::perspective(&camera)
                .expect("moving a camera that was checked leaves it valid"),
            film: self.film,
            limits: self.limits,
            samples: self.samples,
            origin,
            warnings,
            image_files: self.image_files,
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
            // Adding zero makes a zero of either sign a positive one.
            (center / step).round() * step + DVec3::ZERO
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
            Self::Cylinder { start, end, radius, .. } => {
                Some((start.min(*end) - *radius, start.max(*end) + *radius))
            }
        }
    }

    fn into_part(self, origin: DVec3) -> Part {
        let point = |point: DVec3| (point - origin).as_vec3();
        match self {
            Self::Mesh { mesh, to_world, options } => {
                Part::Mesh(mesh.into_mesh(&to_world, origin, options))
            }
            Self::Sphere { center, radius, flip_normals } => {
                Part::Sphere { center: point(center), radius: radius as f32, flip_normals }
            }
            Self::Disk { center, axes, flip_normals } => Part::Disk {
                center: point(center),
                axes: axes.map(|axis| axis.as_vec3()),
                flip_normals,
            },
            Self::Cylinder { start, end, radius, flip_normals } => Part::Cylinder {
                start: point(start),
                end: point(end),
                radius: radius as f32,
                flip_normals,
            },
        }
    }
}
