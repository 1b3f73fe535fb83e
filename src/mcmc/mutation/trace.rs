//! What mutations share: walks that repeat the delta events of a path, and what they end in.

use super::super::{Failure, LogUniform};
use crate::emitter::LightPoint;
use crate::geometry::Ray;
use crate::math::Frame;
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::connect::nearest;
use crate::transport::path::between;
use crate::transport::{Event, LightVertex, Path, Side, Surface, Vertex};
use glam::{Vec2, Vec3};
use std::f64::consts::TAU;

/// A walk that repeats the delta events of a path.
pub(super) struct Walk<'a, 's, S> {
    scene: &'s Scene,
    path: &'a Path<'s>,
    sampler: &'a mut S,
    /// Vertices in the order in which they were found.
    pub(super) found: Vec<Vertex<'s>>,
}

impl<'a, 's, S: Sampler> Walk<'a, 's, S> {
    pub(super) fn new(scene: &'s Scene, path: &'a Path<'s>, sampler: &'a mut S) -> Self {
        Self { scene, path, sampler, found: Vec::with_capacity(path.k()) }
    }

    /// Finds new delta vertices for that of index `i` and those behind it, seen from `side`, as long as they are delta: the
    /// ray that will find the smooth one, and its index.
    pub(super) fn chain(
        &mut self,
        mut ray: Ray,
        mut i: usize,
        side: Side,
    ) -> Result<(Ray, usize), Failure> {
        while let Event::Delta(lobe) = self.path.events()[i] {
            let surface = hit(self.scene, ray, self.sampler)?;
            let from = surface.local(-ray.direction).ok_or(Failure::Dark)?;
            // A mirror where there was glass, or all light reflected where some was refracted.
            let deflected = surface.shading.bsdf.delta(from, lobe).ok_or(Failure::Label)?;
            let direction = surface.shading.frame.to_world(deflected.wi);
            if !surface.shading.is_consistent(deflected.wi, direction) {
                return Err(Failure::Dark);
            }
            ray = surface.at.spawn(direction);
            self.found.push(Vertex::Surface(surface));
            i = match side {
                Side::Eye => i - 1,
                Side::Light => i + 1,
            };
        }
        Ok((ray, i))
    }

    /// Finds a surface that can be connected.
    pub(super) fn smooth(&mut self, ray: Ray) -> Result<Surface<'s>, Failure> {
        let surface = hit(self.scene, ray, self.sampler)?;
        if !surface.shading.bsdf.has_smooth() {
            return Err(Failure::Label);
        }
        self.found.push(Vertex::Surface(surface.clone()));
        Ok(surface)
    }

    /// Finds the beginning of the light.
    pub(super) fn light(&mut self, ray: Ray) -> Result<(), Failure> {
        self.found.push(light(self.scene, ray, self.sampler)?);
        Ok(())
    }

    /// The path with what was found from the eye instead of the vertices that it replaces, and another raster position.
    pub(super) fn into_path_from_eye(self, raster: Vec2) -> Result<Path<'s>, Failure> {
        let kept = self.path.k() - self.found.len();
        let mut vertices = self.path.vertices()[..kept].to_vec();
        vertices.extend(self.found.into_iter().rev());
        let (_, lens) = self.path.lens();
        let position = self.scene.camera.lens_point(lens);
        vertices.push(Vertex::Lens { raster, lens, position });
        Path::new(self.scene, vertices, self.path.events().to_vec()).ok_or(Failure::Dark)
    }

    /// The path with what was found from the light instead of all behind the vertices of index `0..=last`, seen by the same
    /// point of the lens.
    pub(super) fn into_path_from_light(self, last: usize) -> Result<Path<'s>, Failure> {
        let Some(Vertex::Surface(seen)) = self.found.last() else {
            return Err(Failure::Impossible);
        };
        let end = seen_by_lens(self.scene, seen, self.path.lens().1)?;
        let mut vertices = self.path.vertices()[..=last].to_vec();
        vertices.extend(self.found);
        vertices.push(end);
        Path::new(self.scene, vertices, self.path.events().to_vec()).ok_or(Failure::Dark)
    }
}

/// The surface that the ray finds.
pub(super) fn hit<'s, S: Sampler>(
    scene: &'s Scene,
    ray: Ray,
    sampler: &mut S,
) -> Result<Surface<'s>, Failure> {
    Surface::find(scene, ray, sampler).ok_or(Failure::Label)
}

/// The emitter that the ray finds.
pub(super) fn light<'s, S: Sampler>(
    scene: &'s Scene,
    ray: Ray,
    sampler: &mut S,
) -> Result<Vertex<'s>, Failure> {
    let vertex = match Surface::find(scene, ray, sampler) {
        Some(surface) => {
            let id = surface.emitter.ok_or(Failure::Dark)?;
            LightVertex { id, point: scene.emitters.surface_point(id, &surface.at) }
        }
        None => {
            let id = scene.emitters.environment_id().ok_or(Failure::Dark)?;
            let point = LightPoint::Infinite { direction: ray.direction, is_delta: false };
            LightVertex { id, point }
        }
    };
    Ok(Vertex::Light(vertex))
}

/// The lens as the surface sees it through the picture.
pub(super) fn seen_by_lens<'s>(
    scene: &Scene,
    surface: &Surface<'_>,
    lens: Vec2,
) -> Result<Vertex<'s>, Failure> {
    let view = scene.camera.view(surface.at.position, lens).ok_or(Failure::Outside)?;
    let raster = in_picture(scene, view.raster)?;
    Ok(Vertex::Lens { raster, lens, position: scene.camera.lens_point(lens) })
}

/// The raster position, if it lies in the crop window.
pub(super) fn in_picture(scene: &Scene, raster: Vec2) -> Result<Vec2, Failure> {
    let [left, top, columns, rows] = scene.film.crop.map(|pixels| pixels as f32);
    let from_corner = raster - Vec2::new(left, top);
    let is_inside =
        from_corner.cmpge(Vec2::ZERO).all() && from_corner.x < columns && from_corner.y < rows;
    is_inside.then_some(raster).ok_or(Failure::Outside)
}

/// A raster position at a random distance and in a random direction from the given one.
pub(super) fn moved<S: Sampler>(
    scene: &Scene,
    raster: Vec2,
    distance: LogUniform,
    sampler: &mut S,
) -> Result<Vec2, Failure> {
    let offset = offset(distance.sample(f64::from(sampler.next_1d())), sampler.next_1d());
    in_picture(scene, raster + offset)
}

/// The vector of that length, turned by `u` in `[0, 1)`.
pub(super) fn offset(length: f64, u: f32) -> Vec2 {
    let (sin, cos) = (TAU * f64::from(u)).sin_cos();
    Vec2::new((length * cos) as f32, (length * sin) as f32)
}

/// The unit vector at that angle to `direction`, turned around it by `u` in `[0, 1)`.
pub(super) fn turned(direction: Vec3, angle: f64, u: f32) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    Frame::from_normal(direction).to_world(offset(sin, u).extend(cos as f32)).normalize()
}

/// Has the vertex of that index a smooth event?
pub(super) fn is_smooth(path: &Path<'_>, i: usize) -> bool {
    !path.events()[i].is_delta()
}

/// Index of the last smooth vertex before that of index `i > 0`.
pub(super) fn smooth_before(path: &Path<'_>, i: usize) -> usize {
    // The light's end is smooth.
    (0..i).rev().find(|&i| is_smooth(path, i)).unwrap_or(0)
}

/// May the edge from `x_i` to `x_{i+1}` be a connection? A function of the path alone, the same whichever way it was found.
/// What is seen directly is left to walks from the eye.
pub(super) fn is_connection(scene: &Scene, path: &Path<'_>, i: usize) -> bool {
    path.k() > 1 && path.is_connectable(i) && path.length(i) > nearest(scene)
}

/// Checks the connections of a perturbed path and of the path that it came from: the one must be free, the other could have
/// been made.
pub(super) fn check(
    scene: &Scene,
    old: &Path<'_>,
    new: &Path<'_>,
    i: usize,
) -> Result<(), Failure> {
    if !is_connection(scene, old, i) {
        return Err(Failure::NoReturn);
    }
    let vertices = new.vertices();
    let is_free =
        is_connection(scene, new, i) && between(scene, &vertices[i], &vertices[i + 1]) > 0.0;
    is_free.then_some(()).ok_or(Failure::Blocked)
}
