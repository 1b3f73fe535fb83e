//! A whole path, and every factor that mutations and strategies weigh it by.

use super::mis::Heuristic;
use super::vertex::{LightVertex, Surface, Vertex};
use super::visibility::{connecting_ray, shadow_ray, transmittance};
use super::walk::colour;
use crate::bsdf::DeltaLobe;
use crate::emitter::LightPoint;
use crate::geometry::Ray;
use crate::math::Rgb;
use crate::scene::Scene;
use glam::{DVec3, Vec2, Vec3};

/// What happens at a vertex; it belongs to the path, not to the material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Event {
    /// Smooth lobes scatter, or the path ends here: it can be connected.
    #[default]
    Smooth,
    /// That delta lobe scatters.
    Delta(DeltaLobe),
}

impl Event {
    /// Is it a delta lobe?
    pub fn is_delta(self) -> bool {
        matches!(self, Self::Delta(_))
    }
}

/// A path `x_0 … x_k` from an emitter to the lens, every edge of which is free.
#[derive(Clone, Debug)]
pub struct Path<'s> {
    /// `x_0 … x_k`; the first is a [`Vertex::Light`], the last a [`Vertex::Lens`].
    vertices: Vec<Vertex<'s>>,
    /// What happens at each.
    events: Vec<Event>,
    edges: Vec<Edge>,
    scatterings: Vec<Factors>,
    /// Product of emission and of all values of events, scaled: its diffuse part and the rest, summing to luminance 1.
    colour: [DVec3; 2],
    /// Natural logarithm of the luminance of that product.
    ln_value: f64,
    ends: Ends,
}

/// The segment between `x_i` and `x_{i+1}`.
#[derive(Clone, Copy, Debug)]
struct Edge {
    /// Unit vector from `x_i` to `x_{i+1}`.
    direction: Vec3,
    /// Squared length; 1 from infinity.
    distance2: f64,
    /// Absolute cosine with the geometric normal at `x_i`; 1 where there is none.
    cosine_light: f64,
    /// The same at `x_{i+1}`.
    cosine_eye: f64,
    /// What masks leave.
    transmittance: f64,
}

impl Edge {
    /// Geometry term without visibility.
    fn geometry(&self) -> f64 {
        self.cosine_light * self.cosine_eye / self.distance2
    }
}

/// Scalars of the event at an inner vertex.
#[derive(Clone, Copy, Debug, Default)]
struct Factors {
    /// Factor of a step of the light's walk that is not in the event's value: the cosine of a smooth event, the correction of a
    /// delta event.
    light: f64,
    /// The same of the eye's walk.
    eye: f64,
    /// Density or probability with which the light's walk takes it.
    pdf_eye: f64,
    /// The same of the eye's walk.
    pdf_light: f64,
}

/// Densities at the ends.
#[derive(Clone, Copy, Debug, Default)]
struct Ends {
    point_pdf: f64,
    emission_pdf: f64,
    /// Density of raster points uniform over the crop window, per steradian of the lens's ray.
    raster_pdf: f64,
    lens_pdf: f64,
    is_emitter_hittable: bool,
    is_lens_hittable: bool,
}

impl<'s> Path<'s> {
    /// The path through these vertices with these events. Edges are taken as free. `None` where it carries no light, or where
    /// something about it is not finite.
    pub fn new(scene: &'s Scene, vertices: Vec<Vertex<'s>>, events: Vec<Event>) -> Option<Self> {
        debug_assert_eq!(vertices.len(), events.len());
        let edges = vertices
            .windows(2)
            .map(|pair| edge(scene, &pair[0], &pair[1]))
            .collect::<Option<Vec<_>>>()?;
        let mut path = Self {
            scatterings: vec![Factors::default(); vertices.len()],
            vertices,
            events,
            edges,
            colour: [DVec3::ZERO; 2],
            ln_value: 0.0,
            ends: Ends::default(),
        };
        path.evaluate(scene)?;
        Some(path)
    }

    /// Edges.
    pub fn k(&self) -> usize {
        self.edges.len()
    }

    /// `x_0 … x_k`.
    pub fn vertices(&self) -> &[Vertex<'s>] {
        &self.vertices
    }

    /// What happens at each vertex; smooth at both ends.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Unit vector from `x_i` to `x_{i+1}`.
    pub fn direction(&self, i: usize) -> Vec3 {
        self.edges[i].direction
    }

    /// Length of the edge from `x_i` to `x_{i+1}`; 1 from infinity.
    pub fn length(&self, i: usize) -> f64 {
        self.edges[i].distance2.sqrt()
    }

    /// Where it meets the film, in pixels, and what chose its point of the aperture.
    pub fn lens(&self) -> (Vec2, Vec2) {
        match self.vertices.last() {
            Some(&Vertex::Lens { raster, lens, .. }) => (raster, lens),
            _ => unreachable!("a path ends on the lens"),
        }
    }

    /// Its light divided by its luminance: what a diffuse lobe scattered at the first hit, and the rest.
    pub fn colour(&self) -> [Rgb; 2] {
        self.colour.map(|part| Rgb::from(part.as_vec3().to_array()))
    }

    /// Natural logarithm of the luminance of `L_e ∏ f̄`, where delta events have their reflectance: the value of the path but
    /// for geometry terms and importance.
    pub fn ln_value(&self) -> f64 {
        self.ln_value
    }

    /// `ln (G T)` of the edge from `x_i` to `x_{i+1}`; where that is the lens, with the importance of the direction, per unit of
    /// the lens's density: `|cos_{k-1}| / d² · |dρ/dω|`, where `ρ` is 1 over the crop window.
    pub fn ln_connection(&self, i: usize) -> f64 {
        let edge = &self.edges[i];
        let transfer = edge.geometry() * edge.transmittance;
        if i + 1 == self.k() {
            (transfer * self.ends.raster_pdf / edge.cosine_eye).ln()
        } else {
            transfer.ln()
        }
    }

    /// `ln` of what a step of the light's walk from `x_i` to `x_{i+1}` multiplies by beside the event's value, before the
    /// division by its density: the cosine of a smooth event, the correction of a delta event.
    pub fn ln_light_factor(&self, i: usize) -> f64 {
        if i == 0 { self.edges[0].cosine_light.ln() } else { self.scatterings[i].light.ln() }
    }

    /// The same of the eye's walk from `x_i` to `x_{i-1}`.
    pub fn ln_eye_factor(&self, i: usize) -> f64 {
        self.scatterings[i].eye.ln()
    }

    /// `ln` of the factor with which the light's walk finds `x_i`, relative to the event's value: `1 / p` with the cosine.
    pub fn ln_found_from_light(&self, i: usize) -> f64 {
        match i {
            0 => -self.ends.point_pdf.ln(),
            1 => self.ln_light_factor(0) - self.ends.emission_pdf.ln(),
            _ => (self.scatterings[i - 1].light / self.scatterings[i - 1].pdf_eye).ln(),
        }
    }

    /// The same of the eye's walk.
    pub fn ln_found_from_eye(&self, i: usize) -> f64 {
        match self.k() - i {
            // The importance of a ray is the density of its raster point.
            0 | 1 => 0.0,
            _ => (self.scatterings[i + 1].eye / self.scatterings[i + 1].pdf_light).ln(),
        }
    }

    /// Can `x_i` and `x_{i+1}` be connected?
    pub fn is_connectable(&self, i: usize) -> bool {
        !self.events[i].is_delta() && !self.events[i + 1].is_delta()
    }

    /// Can the eye's walk meet the emitter?
    pub fn is_emitter_hittable(&self) -> bool {
        self.ends.is_emitter_hittable
    }

    /// `ln` of the luminance of `f / p` in picture units (see [`super::Contribution`]) for `s` vertices from the light, `0 ≤ s ≤ k`: −∞ where that strategy cannot find the
    /// path.
    pub fn ln_contribution(&self, s: usize) -> f64 {
        let exists = match s {
            0 => self.ends.is_emitter_hittable,
            _ => self.is_connectable(s - 1),
        };
        if !exists {
            return f64::NEG_INFINITY;
        }
        let light: f64 = (0..s).map(|i| self.ln_found_from_light(i)).sum();
        let eye: f64 = (s..=self.k()).map(|i| self.ln_found_from_eye(i)).sum();
        let connection = if s == 0 { 0.0 } else { self.ln_connection(s - 1) };
        self.ln_value + light + connection + eye
    }

    /// Weights of the strategies `s = 0 … k`, from the densities of the whole path; what is seen directly belongs to the
    /// eye's walk alone. Light that walks into the lens is the last entry, `s = k + 1`.
    pub fn weights(&self, heuristic: Heuristic) -> Vec<f64> {
        let k = self.k();
        if k == 1 {
            return vec![1.0, 0.0, 0.0];
        }
        let (light, eye) = self.nodes();
        // Relative to s = 0: the density of s + 1 over that of s is pL_s / pE_s.
        let mut ln_density = vec![0.0];
        for s in 0..=k {
            let last: f64 = ln_density[s];
            ln_density.push(last + light[s].ln() - eye[s].ln());
        }
        let exists = |s: usize| match s {
            0 => self.ends.is_emitter_hittable,
            s if s == k + 1 => self.ends.is_lens_hittable,
            s => self.is_connectable(s - 1),
        };
        let largest = (0..=k + 1)
            .filter(|&s| exists(s))
            .map(|s| ln_density[s])
            .fold(f64::NEG_INFINITY, f64::max);
        let shares: Vec<f64> = (0..=k + 1)
            .map(|s| if exists(s) { heuristic.raise((ln_density[s] - largest).exp()) } else { 0.0 })
            .collect();
        let total: f64 = shares.iter().sum();
        shares.iter().map(|share| share / total).collect()
    }

    /// Densities of every vertex from the light's and from the eye's side, in the measures of [`super::mis`].
    fn nodes(&self) -> (Vec<f64>, Vec<f64>) {
        let k = self.k();
        let mut light = vec![self.ends.point_pdf];
        for i in 1..=k {
            let edge = &self.edges[i - 1];
            // From infinity a density is per area of the disk, and 1 / d² is 1.
            let (pdf, cosine) = match i {
                1 => (self.ends.emission_pdf, edge.cosine_light),
                _ => (self.scatterings[i - 1].pdf_eye, edge.cosine_light),
            };
            light.push(match (self.events[i - 1], self.events[i]) {
                (Event::Delta(_), _) => pdf,
                (_, Event::Delta(_)) => pdf / cosine,
                _ => pdf * edge.cosine_eye / edge.distance2,
            });
        }
        let mut eye = Vec::with_capacity(k + 1);
        for (i, edge) in self.edges.iter().enumerate() {
            let pdf =
                if i + 1 == k { self.ends.raster_pdf } else { self.scatterings[i + 1].pdf_light };
            eye.push(match (self.events[i + 1], self.events[i]) {
                (Event::Delta(_), _) => pdf,
                (_, Event::Delta(_)) => pdf / edge.cosine_eye,
                _ => pdf * edge.cosine_light / edge.distance2,
            });
        }
        eye.push(self.ends.lens_pdf);
        (light, eye)
    }

    /// Fills in everything that depends on the vertices.
    fn evaluate(&mut self, scene: &Scene) -> Option<()> {
        let k = self.k();
        let Vertex::Light(LightVertex { id, point }) = &self.vertices[0] else { return None };
        let (Some(&Vertex::Lens { .. }), first) = (self.vertices.last(), self.edges[0].direction)
        else {
            return None;
        };
        let emitters = &scene.emitters;
        let towards_scene = -self.edges[k - 1].direction;
        self.ends = Ends {
            point_pdf: emitters.point_pdf(*id, point),
            emission_pdf: emitters.emission_pdf(*id, point, first),
            raster_pdf: scene.camera.raster_pdf(towards_scene) * scene.film.crop_pdf(),
            lens_pdf: scene.camera.lens_pdf(),
            is_emitter_hittable: !emitters.is_delta(*id),
            is_lens_hittable: scene.camera.has_lens(),
        };
        let emitted = colour(emitters.emitted(*id, point, first));
        let mut product = [DVec3::ZERO, emitted];
        let mut ln_scale = 0.0;
        for i in 1..k {
            let (eye, light) = (self.edges[i].direction, -self.edges[i - 1].direction);
            let Vertex::Surface(surface) = &self.vertices[i] else { return None };
            let (parts, factors) = self.event(surface, i, eye, light)?;
            self.scatterings[i] = factors;
            // Only the first hit from the eye keeps its parts apart.
            let before = product[0] + product[1];
            product = if i + 1 == k {
                parts.map(|part| part * before)
            } else {
                [DVec3::ZERO, (parts[0] + parts[1]) * before]
            };
            let largest = (product[0] + product[1]).max_element();
            if !(1e-100..1e100).contains(&largest) && largest > 0.0 {
                product = product.map(|part| part / largest);
                ln_scale += largest.ln();
            }
        }
        let luminance = luminance(product[0] + product[1]);
        self.ln_value = luminance.ln() + ln_scale;
        self.colour = product.map(|part| part / luminance);
        let is_good = luminance > 0.0
            && self.ln_value.is_finite()
            && self.colour.iter().all(|part| part.is_finite())
            && self.ends.raster_pdf > 0.0;
        is_good.then_some(())
    }

    /// Value (diffuse and other part) and scalars of the event at `x_i`.
    fn event(
        &self,
        surface: &Surface<'s>,
        i: usize,
        eye: Vec3,
        light: Vec3,
    ) -> Option<([DVec3; 2], Factors)> {
        match self.events[i] {
            Event::Smooth => {
                let found = surface.scattering(eye, light);
                let factors = Factors {
                    light: self.edges[i].cosine_light,
                    eye: self.edges[i - 1].cosine_eye,
                    pdf_eye: surface.pdf(light, eye),
                    pdf_light: found.pdf_light,
                };
                Some(([colour(found.diffuse), colour(found.specular)], factors))
            }
            Event::Delta(lobe) => {
                let found = surface.delta_scattering(lobe, eye, light)?;
                let factors = Factors {
                    light: found.light_over_eye,
                    eye: 1.0,
                    pdf_eye: found.probability_eye,
                    pdf_light: found.probability_light,
                };
                Some(([DVec3::ZERO, colour(found.reflectance)], factors))
            }
        }
    }
}

fn luminance(light: DVec3) -> f64 {
    light.dot(DVec3::from_array(quietlight_denoise::LUMINANCE.map(f64::from)))
}

/// The segment between two vertices, `from` nearer to the light; `None` where they coincide.
fn edge(scene: &Scene, from: &Vertex<'_>, to: &Vertex<'_>) -> Option<Edge> {
    let target = match to {
        Vertex::Surface(surface) => surface.at.position,
        Vertex::Lens { position, .. } => *position,
        Vertex::Light(_) => return None,
    };
    let (direction, distance2) = match from {
        Vertex::Light(LightVertex { point: LightPoint::Infinite { direction, .. }, .. }) => {
            (-*direction, 1.0)
        }
        Vertex::Light(LightVertex {
            point: LightPoint::Surface { position, .. } | LightPoint::Point { position },
            ..
        }) => unit(*position, target)?,
        Vertex::Surface(surface) => unit(surface.at.position, target)?,
        Vertex::Lens { .. } => return None,
    };
    let cosine_light = match from {
        Vertex::Light(LightVertex { point: LightPoint::Surface { normal, .. }, .. }) => {
            f64::from(normal.dot(direction))
        }
        Vertex::Surface(surface) => surface.cosine(direction),
        _ => 1.0,
    };
    let cosine_eye = match to {
        Vertex::Surface(surface) => surface.cosine(direction),
        _ => scene.camera.cosine(-direction),
    };
    let transmittance = if scene.has_masks { between(scene, from, to) } else { 1.0 };
    (cosine_light > 0.0 && cosine_eye > 0.0 && distance2 > 0.0).then_some(Edge {
        direction,
        distance2,
        cosine_light,
        cosine_eye,
        transmittance,
    })
}

fn unit(from: Vec3, to: Vec3) -> Option<(Vec3, f64)> {
    let span = (to - from).as_dvec3();
    let distance2 = span.length_squared();
    (distance2 > 0.0 && distance2.is_finite())
        .then(|| ((span / distance2.sqrt()).as_vec3(), distance2))
}

/// What is left of light between two vertices of a path, `from` nearer to the light: 0 where something is in the way.
pub fn between(scene: &Scene, from: &Vertex<'_>, to: &Vertex<'_>) -> f64 {
    let ray = match (from, to) {
        (Vertex::Surface(from), Vertex::Surface(to)) => connecting_ray(&to.at, &from.at),
        (Vertex::Surface(from), &Vertex::Lens { lens, .. }) => {
            let Some(view) = scene.camera.view(from.at.position, lens) else { return 0.0 };
            Ray { t_max: 1.0, ..from.at.spawn_to(view.start) }
        }
        (Vertex::Light(LightVertex { point, .. }), Vertex::Surface(to)) => match point {
            LightPoint::Surface { position, .. } | LightPoint::Point { position } => {
                shadow_ray(&to.at, *position)
            }
            LightPoint::Infinite { direction, .. } => to.at.spawn(*direction),
        },
        // What is seen directly was found by the eye's ray.
        _ => return 1.0,
    };
    f64::from(transmittance(scene, ray))
}
