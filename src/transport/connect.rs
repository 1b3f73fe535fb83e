//! Every way of joining a walk from an emitter with one from the lens.

use super::mis::{Heuristic, nearest_other, others, others_before, weight};
use super::vertex::LightVertex;
use super::visibility::{shadow_ray_from, transmittance};
use super::walk::{Subpath, colour};
use crate::emitter::LightPoint;
use crate::geometry::Ray;
use crate::math::Rgb;
use crate::scene::Scene;
use glam::{DVec3, Vec2, Vec3};

/// What one path of `s` vertices from the light and `t` from the eye adds.
///
/// In units of the picture: with `n` samples for each pixel of the crop window, a pixel is the sum of `weight × colour` of all
/// contributions that fall on it, divided by `n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// Where on the whole film, in pixels; within the crop window.
    pub raster: Vec2,
    /// Vertices found from the light.
    pub s: u32,
    /// Vertices found from the eye.
    pub t: u32,
    /// `f / p` of the path, without weight: what a diffuse lobe scattered at the first hit.
    pub diffuse: Rgb,
    /// All the rest.
    pub specular: Rgb,
    /// Weight among the strategies that could have found the path.
    pub weight: f64,
}

impl Contribution {
    /// Luminance, weighted.
    pub fn luminance(&self) -> f64 {
        f64::from((self.diffuse + self.specular).luminance()) * self.weight
    }
}

/// Which ways of finding a path there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Strategies {
    /// All, also light that walks into a lens of finite size.
    #[default]
    All,
    /// All that end on a point of the lens that the camera chose: those of Markov chains.
    ToLens,
    /// Those of path tracing: walks from the camera, joined with a point of an emitter or meeting one themselves.
    FromCamera,
}

/// A pair of walks.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a, 's> {
    /// Where they walked.
    pub scene: &'s Scene,
    /// How weights are made.
    pub heuristic: Heuristic,
    /// Which strategies there are.
    pub strategies: Strategies,
    /// The walk from the eye.
    pub eye: &'a Subpath<'s>,
    /// Raster position of its ray, in pixels.
    pub raster: Vec2,
    /// What chose its point of the aperture.
    pub lens: Vec2,
    /// The walk from an emitter.
    pub light: &'a Subpath<'s>,
    /// Where that began; `None` where there is no light.
    pub start: Option<LightVertex>,
}

/// Vertices nearer to each other than this are not connected: `1 / d²` is noise there (METHODS 14).
pub fn nearest(scene: &Scene) -> f64 {
    1e-10 * f64::from(scene.emitters.target().radius)
}

/// The direction and the geometry between two points.
struct Edge {
    direction: Vec3,
    distance2: f64,
}

impl Edge {
    /// `None` where the points are too near for a direction, seen from either.
    fn between(scene: &Scene, from: Vec3, to: Vec3) -> Option<Self> {
        let span = to - from;
        let distance2 = span.as_dvec3().length_squared();
        let nearest = nearest(scene);
        (distance2 > nearest * nearest && distance2.is_finite()).then(|| Self {
            direction: (span.as_dvec3() * distance2.sqrt().recip()).as_vec3(),
            distance2,
        })
    }
}

impl<'s> Pair<'_, 's> {
    /// Adds to `found` what all strategies found, in a fixed order; paths have at most `max_depth` edges.
    pub fn connect(&self, max_depth: u32, found: &mut Vec<Contribution>) {
        let (eye, light) = (self.eye.steps.len(), self.light.steps.len());
        let limit = max_depth as usize;
        for step in 0..eye.min(limit) {
            found.extend(self.emission(step));
        }
        found.extend(self.escape(limit));
        if self.start.is_none() {
            return;
        }
        // With s light and t eye vertices a path has s + t - 1 edges; steps count surfaces, one less than vertices.
        for z in 0..eye.min(limit.saturating_sub(1)) {
            found.extend(self.direct(z));
            for y in 0..light.min(limit.saturating_sub(z + 2)) {
                found.extend(self.surfaces(y, z));
            }
        }
        for y in 0..light.min(limit.saturating_sub(1)) {
            found.extend(self.lens(y));
        }
        if self.eye.nodes[0].is_hittable {
            for y in 0..light.min(limit.saturating_sub(1)) {
                found.extend(self.through_lens(y));
            }
        }
    }

    /// Density of raster points, uniform over the crop window, of rays in that direction, per steradian.
    fn raster_pdf(&self, direction: Vec3) -> f64 {
        self.scene.camera.raster_pdf(direction) * self.scene.film.crop_pdf()
    }

    fn contribution(
        &self,
        raster: Vec2,
        [s, t]: [usize; 2],
        parts: [DVec3; 2],
        weight: f64,
    ) -> Option<Contribution> {
        let [diffuse, specular] = parts.map(|part| Rgb::from(part.as_vec3().to_array()));
        let is_dark = diffuse.is_black() && specular.is_black();
        (!is_dark && weight > 0.0).then_some(Contribution {
            raster,
            s: s as u32,
            t: t as u32,
            diffuse,
            specular,
            weight,
        })
    }

    /// Is light from `edges` edges away to be left out of the picture?
    fn is_hidden(&self, edges: usize) -> bool {
        self.scene.limits.hide_emitters && edges == 1
    }

    /// The strategies with more vertices from the light than the one that connects after the eye's `nodes` first vertices; as
    /// [`others`].
    fn eye_others(&self, nodes: usize, [pdf, pdf_previous]: [f64; 2]) -> f64 {
        let nodes = &self.eye.nodes[..nodes];
        match self.strategies {
            Strategies::All | Strategies::ToLens => {
                others(nodes, pdf, pdf_previous, self.heuristic)
            }
            Strategies::FromCamera => nearest_other(nodes, pdf, self.heuristic),
        }
    }

    /// The share of a path that the eye's walk found whole. Only that one finds what is seen directly.
    fn hit_weight(&self, nodes: usize, pdf: f64, pdf_previous: f64) -> f64 {
        match nodes {
            2 => 1.0,
            _ => weight(0.0, self.eye_others(nodes, [pdf, pdf_previous])),
        }
    }

    /// s = 0: the walk from the eye met an emitter.
    fn emission(&self, step: usize) -> Option<Contribution> {
        let emitters = &self.scene.emitters;
        let found = &self.eye.steps[step];
        let id = found.surface.emitter?;
        if self.is_hidden(step + 1) {
            return None;
        }
        let radiance = emitters.radiance(id, &found.surface.at, found.previous);
        if radiance.is_black() {
            return None;
        }
        let point = emitters.surface_point(id, &found.surface.at);
        let weight = self.hit_weight(
            step + 2,
            emitters.point_pdf(id, &point),
            emitters.emission_pdf(id, &point, found.previous),
        );
        let parts = self.eye.split(step, [DVec3::ZERO, colour(radiance)]);
        self.contribution(self.raster, [0, step + 2], parts, weight)
    }

    /// s = 0: the walk from the eye left the scene.
    fn escape(&self, limit: usize) -> Option<Contribution> {
        let escape = self.eye.escape?;
        let edges = self.eye.steps.len() + 1;
        let id = self.scene.emitters.environment_id()?;
        if edges > limit || self.is_hidden(edges) {
            return None;
        }
        let radiance = colour(self.scene.emitters.environment(escape.direction));
        let point = LightPoint::Infinite { direction: escape.direction, is_delta: false };
        let emitters = &self.scene.emitters;
        let weight = self.hit_weight(
            edges + 1,
            emitters.point_pdf(id, &point),
            emitters.emission_pdf(id, &point, -escape.direction),
        );
        let light = radiance * escape.throughput;
        let parts = match edges {
            1 => [DVec3::ZERO, light],
            _ => self.eye.first.map(|part| part * light),
        };
        self.contribution(self.raster, [0, edges + 1], parts, weight)
    }

    /// s = 1: a point of an emitter seen from the eye's surface `z`.
    fn direct(&self, z: usize) -> Option<Contribution> {
        let LightVertex { id, point } = self.start?;
        let emitters = &self.scene.emitters;
        let step = &self.eye.steps[z];
        let surface = &step.surface;
        if !step.is_connectable {
            return None;
        }
        // Direction to the light; cos / d² there; the ray that must be free.
        let (direction, geometry, distance2) = match point {
            LightPoint::Surface { position, normal, .. } => {
                let edge = Edge::between(self.scene, surface.at.position, position)?;
                let cosine = f64::from(-normal.dot(edge.direction));
                (edge.direction, cosine.max(0.0) / edge.distance2, edge.distance2)
            }
            LightPoint::Point { position } => {
                let edge = Edge::between(self.scene, surface.at.position, position)?;
                (edge.direction, 1.0 / edge.distance2, edge.distance2)
            }
            LightPoint::Infinite { direction, .. } => (direction, 1.0, 1.0),
        };
        if geometry <= 0.0 {
            return None;
        }
        let wo = surface.shading.wo;
        let wi = surface.local(direction)?;
        let scattered = surface.shading.bsdf.eval(wo, wi);
        if scattered.is_black() {
            return None;
        }
        let emitted = colour(emitters.emitted(id, &point, -direction));
        let light = emitted * (geometry / self.light.nodes[0].pdf);
        let parts = self
            .eye
            .split(z, [colour(scattered.diffuse) * light, colour(scattered.specular) * light]);
        if is_dark(parts) {
            return None;
        }
        let cosine = surface.at.normal.dot(direction);
        let start = step.start(cosine);
        let ray = match point {
            LightPoint::Surface { position, .. } | LightPoint::Point { position } => {
                shadow_ray_from(start, position)
            }
            LightPoint::Infinite { .. } => Ray::new(start, direction),
        };
        let visible = f64::from(transmittance(self.scene, ray));
        if visible == 0.0 {
            return None;
        }
        let pdf_emission = emitters.emission_pdf(id, &point, -direction);
        let back = f64::from(surface.shading.bsdf.pdf(wi, wo));
        let weight = weight(
            others(
                &self.light.nodes[..1],
                f64::from(scattered.pdf) * geometry,
                0.0,
                self.heuristic,
            ),
            match self.strategies {
                Strategies::FromCamera => 0.0,
                _ => self
                    .eye_others(z + 2, [pdf_emission * f64::from(cosine.abs()) / distance2, back]),
            },
        );
        self.contribution(self.raster, [1, z + 2], parts.map(|part| part * visible), weight)
    }

    /// s, t ≥ 2: the light's surface `y` and the eye's surface `z`.
    fn surfaces(&self, y: usize, z: usize) -> Option<Contribution> {
        let (from, to) = (&self.light.steps[y], &self.eye.steps[z]);
        if !from.is_connectable || !to.is_connectable {
            return None;
        }
        let (bsdf_y, bsdf_z) = (&from.surface.shading.bsdf, &to.surface.shading.bsdf);
        let (light_side, eye_side) = (from.surface.shading.wo, to.surface.shading.wo);
        let (at_y, at_z) = (&from.surface.at, &to.surface.at);
        let edge = Edge::between(self.scene, at_y.position, at_z.position)?;
        let to_eye = from.surface.local(edge.direction)?;
        let to_light = to.surface.local(-edge.direction)?;
        let scattered_z = bsdf_z.eval(eye_side, to_light);
        if scattered_z.is_black() {
            return None;
        }
        let scattered_y = bsdf_y.eval(to_eye, light_side);
        if scattered_y.is_black() {
            return None;
        }
        let (cosine_y, cosine_z) =
            (at_y.normal.dot(edge.direction), -at_z.normal.dot(edge.direction));
        let ray = Ray::between(from.start(cosine_y), to.start(cosine_z));
        let [cosine_y, cosine_z] = [cosine_y, cosine_z].map(|cosine| f64::from(cosine.abs()));
        let light = from.throughput
            * colour(scattered_y.diffuse + scattered_y.specular)
            * (cosine_y / (self.light.nodes[y + 1].cosine * edge.distance2));
        let parts = self
            .eye
            .split(z, [colour(scattered_z.diffuse) * light, colour(scattered_z.specular) * light]);
        if is_dark(parts) {
            return None;
        }
        let visible = f64::from(transmittance(self.scene, ray));
        if visible == 0.0 {
            return None;
        }
        let weight = weight(
            others(
                &self.light.nodes[..y + 2],
                f64::from(scattered_z.pdf) * cosine_y / edge.distance2,
                f64::from(scattered_y.pdf),
                self.heuristic,
            ),
            others(
                &self.eye.nodes[..z + 2],
                f64::from(bsdf_y.pdf(light_side, to_eye)) * cosine_z / edge.distance2,
                f64::from(bsdf_z.pdf(to_light, eye_side)),
                self.heuristic,
            ),
        );
        self.contribution(self.raster, [y + 2, z + 2], parts.map(|part| part * visible), weight)
    }

    /// t = 1: the lens seen from the light's surface `y`.
    fn lens(&self, y: usize) -> Option<Contribution> {
        let camera = &self.scene.camera;
        let step = &self.light.steps[y];
        let surface = &step.surface;
        if !step.is_connectable {
            return None;
        }
        let view = camera.view(surface.at.position, self.lens)?;
        self.scene.film.crop_pixel(view.raster)?;
        let to_eye = surface.local(-view.direction)?;
        let light_side = surface.shading.wo;
        let scattered = surface.shading.bsdf.eval(to_eye, light_side);
        if scattered.is_black() {
            return None;
        }
        let distance2 = f64::from(view.distance).powi(2);
        let cosine = -surface.at.normal.dot(view.direction);
        let ray = Ray::between(step.start(cosine), view.start);
        let cosine = f64::from(cosine.abs());
        let raster_pdf = self.raster_pdf(view.direction);
        let light =
            step.throughput * (cosine * raster_pdf / (self.light.nodes[y + 1].cosine * distance2));
        let parts = [colour(scattered.diffuse) * light, colour(scattered.specular) * light];
        if is_dark(parts) {
            return None;
        }
        let visible = f64::from(transmittance(self.scene, ray));
        if visible == 0.0 {
            return None;
        }
        let forward = f64::from(surface.shading.bsdf.pdf(light_side, to_eye));
        let weight = weight(
            others(
                &self.light.nodes[..y + 2],
                raster_pdf * cosine / distance2,
                f64::from(scattered.pdf),
                self.heuristic,
            ),
            others(
                &self.eye.nodes[..1],
                forward * camera.cosine(view.direction) / distance2,
                0.0,
                self.heuristic,
            ),
        );
        self.contribution(view.raster, [y + 2, 1], parts.map(|part| part * visible), weight)
    }

    /// t = 0: the walk from the light went through the aperture on its way from the surface `y`.
    fn through_lens(&self, y: usize) -> Option<Contribution> {
        let crossing = self.light.crossings.iter().find(|crossing| crossing.step == y)?;
        let camera = &self.scene.camera;
        let view = &crossing.view;
        self.scene.film.crop_pixel(view.raster)?;
        let raster_pdf = self.raster_pdf(view.direction);
        let importance = camera.lens_pdf() * raster_pdf / camera.cosine(view.direction);
        let parts = crossing.throughput.map(|part| part * importance);
        let nodes = &self.light.nodes[..y + 2];
        let light =
            others_before(nodes, &crossing.node, camera.lens_pdf(), raster_pdf, self.heuristic);
        let weight = weight(light, 0.0);
        self.contribution(view.raster, [y + 3, 0], parts, weight)
    }
}

fn is_dark(parts: [DVec3; 2]) -> bool {
    let light = (parts[0] + parts[1]).max_element();
    light <= 0.0 || light.is_nan()
}
