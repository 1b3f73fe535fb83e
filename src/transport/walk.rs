//! Random walks from the lens and from the emitters.

use super::mis::{Heuristic, Node, close};
use super::path::Event;
use super::roulette::survive;
use super::vertex::{LightVertex, Side, Surface};
use super::visibility::transmittance;
use crate::emitter::LightPoint;
use crate::geometry::Ray;
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::{LensView, Scene};
use glam::{DVec3, Vec2, Vec3};

/// Three colours in double precision: products along a path neither overflow nor vanish.
pub fn colour(rgb: Rgb) -> DVec3 {
    DVec3::from_array(rgb.to_array().map(f64::from))
}

/// A vertex found by a walk.
#[derive(Clone, Debug)]
pub struct Step<'s> {
    /// Where.
    pub surface: Surface<'s>,
    /// Unit vector to the vertex before.
    pub previous: Vec3,
    /// What the walk chose to happen here; smooth where it ended.
    pub event: Event,
    /// Product of all weights up to here, this vertex's own scattering not included; of a walk from the eye without the first
    /// scattering, which [`Subpath::first`] keeps.
    pub throughput: DVec3,
    /// Can it be connected? Not if it scatters only in delta lobes, or nothing of what comes from the vertex before.
    pub is_connectable: bool,
    /// Where rays leave it to the side of the geometric normal, and to the other.
    pub starts: [Vec3; 2],
}

impl Step<'_> {
    /// Where a ray leaves it whose direction has this cosine with the geometric normal.
    #[inline]
    pub fn start(&self, cosine: f32) -> Vec3 {
        self.starts[usize::from(cosine < 0.0)]
    }
}

/// Where a walk left the scene.
#[derive(Clone, Copy, Debug)]
pub struct Escape {
    /// Unit vector.
    pub direction: Vec3,
    /// As [`Step::throughput`].
    pub throughput: DVec3,
}

/// Where a walk from an emitter went through the aperture on its way from a surface.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// Index of the surface in [`Subpath::steps`].
    pub step: usize,
    /// What the lens sees there.
    pub view: LensView,
    /// What the weights need to know of the lens.
    pub node: Node,
    /// Product of all weights, in what a diffuse lobe of that surface scattered and the rest.
    pub throughput: [DVec3; 2],
}

/// A walk. `nodes[0]` is its beginning; `nodes[i]` belongs to `steps[i - 1]`, and the last one to `escape` if there is one.
#[derive(Clone, Debug, Default)]
pub struct Subpath<'s> {
    /// What weights need to know of each vertex.
    pub nodes: Vec<Node>,
    /// Surfaces met.
    pub steps: Vec<Step<'s>>,
    /// Set when the walk left the scene.
    pub escape: Option<Escape>,
    /// Where a walk from an emitter met the lens.
    pub crossings: Vec<Crossing>,
    /// Weight of the first scattering of a walk from the eye: its diffuse and its other part.
    pub first: [DVec3; 2],
}

impl<'s> Subpath<'s> {
    fn begin(&mut self, node: Node) {
        self.nodes.clear();
        self.steps.clear();
        self.crossings.clear();
        self.escape = None;
        self.first = [DVec3::ZERO, DVec3::ONE];
        self.nodes.push(node);
    }

    /// The path's radiance weight at `step` of a walk from the eye, in its diffuse and its other part; `scattered` is what
    /// happens there, in the same parts.
    pub fn split(&self, step: usize, scattered: [DVec3; 2]) -> [DVec3; 2] {
        let throughput = self.steps[step].throughput;
        if step == 0 {
            scattered.map(|part| part * throughput)
        } else {
            let rest = (scattered[0] + scattered[1]) * throughput;
            self.first.map(|part| part * rest)
        }
    }
}

/// How walks go.
#[derive(Clone, Copy, Debug)]
pub struct Walker<'s> {
    /// Where.
    pub scene: &'s Scene,
    /// Most surfaces met.
    pub max_steps: u32,
    /// Roulette from this many surfaces on.
    pub rr_depth: u32,
    /// How weights are made.
    pub heuristic: Heuristic,
    /// Does light walk into the lens? Only if that is of finite size.
    pub sees_lens: bool,
}

/// A ray, and the density of the vertex it will find.
struct Departure {
    ray: Ray,
    /// Density of the direction per solid angle, or the probability of the delta lobe; of light from infinity, per area.
    pdf: f64,
    is_delta: bool,
    /// Does light come from infinity? Then `pdf` is per area perpendicular to the ray.
    is_parallel: bool,
    /// Absolute cosine at the vertex it leaves.
    cosine: f64,
    /// Where it leaves; the ray itself may begin elsewhere.
    origin: Vec3,
    /// Is the vertex it leaves a point without surface, or the lens or an emitter with one?
    has_cosine: bool,
}

impl<'s> Walker<'s> {
    /// Walks from the lens through `raster`.
    pub fn from_lens<S: Sampler>(
        &self,
        path: &mut Subpath<'s>,
        raster: Vec2,
        lens: Vec2,
        sampler: &mut S,
    ) {
        let camera = &self.scene.camera;
        let ray = camera.ray(raster, lens);
        let is_hittable = self.sees_lens;
        path.begin(Node { pdf: camera.lens_pdf(), is_hittable, cosine: 1.0, ..Node::default() });
        let departure = Departure {
            pdf: camera.raster_pdf(ray.direction) * self.scene.film.crop_pdf(),
            is_delta: false,
            is_parallel: false,
            cosine: camera.cosine(ray.direction),
            origin: camera.lens_point(lens),
            has_cosine: true,
            ray,
        };
        self.go(path, Side::Eye, departure, DVec3::ONE, sampler);
    }

    /// Chooses a point of an emitter and walks from there; `None` where there is no light.
    pub fn from_light<S: Sampler>(
        &self,
        path: &mut Subpath<'s>,
        sampler: &mut S,
    ) -> Option<LightVertex> {
        let emitters = &self.scene.emitters;
        let selection = sampler.next_1d();
        let u_point = sampler.next_2d();
        let u_direction = sampler.next_2d();
        path.begin(Node::default());
        let (id, point, pdf) = emitters.sample_point(selection, u_point)?;
        path.begin(Node {
            pdf,
            is_hittable: !emitters.is_delta(id),
            cosine: 1.0,
            ..Node::default()
        });
        let vertex = LightVertex { id, point };
        let Some((ray, pdf_emission)) = emitters.sample_emission(id, &point, u_direction) else {
            return Some(vertex);
        };
        let (cosine, is_parallel, has_cosine) = match point {
            LightPoint::Surface { normal, .. } => {
                (f64::from(normal.dot(ray.direction)), false, true)
            }
            LightPoint::Point { .. } => (1.0, false, false),
            LightPoint::Infinite { .. } => (1.0, true, false),
        };
        let emitted = colour(emitters.emitted(id, &point, ray.direction));
        let throughput = emitted * (cosine / (pdf * pdf_emission));
        let departure = Departure {
            pdf: pdf_emission,
            is_delta: false,
            is_parallel,
            cosine,
            origin: ray.origin,
            has_cosine,
            ray,
        };
        if throughput.max_element() > 0.0 {
            self.go(path, Side::Light, departure, throughput, sampler);
        }
        Some(vertex)
    }

    fn go<S: Sampler>(
        &self,
        path: &mut Subpath<'s>,
        side: Side,
        mut departure: Departure,
        mut throughput: DVec3,
        sampler: &mut S,
    ) {
        let mut eta_squared = 1.0f64;
        let mut relative = throughput.max_element().recip();
        for step in 0..self.max_steps {
            let direction = departure.ray.direction;
            let Some(surface) = Surface::find(self.scene, departure.ray, sampler) else {
                if side == Side::Eye {
                    path.nodes.push(Node {
                        pdf: departure.pdf,
                        to_previous: departure.cosine,
                        cosine: 1.0,
                        ..Node::default()
                    });
                    path.escape = Some(Escape { direction, throughput });
                }
                return;
            };
            let cosine = surface.cosine(direction);
            path.nodes.push(departure.arrive(surface.at.position, cosine));
            let previous = -direction;
            let u_bsdf = sampler.next_2d();
            let u_lobe = sampler.next_1d();
            let u_roulette = sampler.next_1d();
            let is_open = surface.shading.is_consistent(surface.shading.wo, previous);
            path.steps.push(Step {
                previous,
                event: Event::Smooth,
                throughput,
                is_connectable: is_open && surface.shading.bsdf.has_smooth(),
                starts: surface.at.both_offsets(),
                surface,
            });
            if !is_open || step + 1 == self.max_steps {
                return;
            }
            let surface = &path.steps[step as usize].surface;
            let Some(leaving) = Leaving::choose(surface, side, previous, u_lobe, u_bsdf) else {
                return;
            };
            let last = path.nodes.len() - 1;
            path.nodes[last].is_delta = leaving.event.is_delta();
            close(&mut path.nodes, leaving.pdf_back, self.heuristic);
            path.steps[step as usize].event = leaving.event;
            let surface = &path.steps[step as usize].surface;
            let weight = leaving.weight[0] + leaving.weight[1];
            if side == Side::Eye && step == 0 {
                path.first = leaving.weight;
                relative = weight.max_element();
            } else {
                throughput *= weight;
            }
            eta_squared *= leaving.eta_squared;
            let importance = throughput.max_element() * relative;
            if !(importance > 0.0) {
                return;
            }
            if step + 1 >= self.rr_depth {
                match survive((importance * eta_squared) as f32, u_roulette) {
                    Some(scale) => throughput *= f64::from(scale),
                    None => return,
                }
            }
            let along_normal = surface.at.normal.dot(leaving.direction);
            let start = path.steps[step as usize].start(along_normal);
            departure = Departure {
                ray: Ray::new(start, leaving.direction),
                pdf: leaving.pdf,
                is_delta: leaving.event.is_delta(),
                is_parallel: false,
                cosine: f64::from(along_normal.abs()),
                origin: surface.at.position,
                has_cosine: true,
            };
            if side == Side::Light && self.sees_lens {
                let parts = leaving.weight.map(|part| part * path.steps[step as usize].throughput);
                path.crossings.extend(self.crossing(step as usize, &departure, parts));
            }
        }
    }

    /// Where the ray goes through the aperture before it meets a surface.
    fn crossing(
        &self,
        step: usize,
        departure: &Departure,
        throughput: [DVec3; 2],
    ) -> Option<Crossing> {
        let camera = &self.scene.camera;
        let found = camera.lens_hit(&departure.ray)?;
        let ray = Ray { t_max: departure.ray.origin.distance(found.view.start), ..departure.ray };
        let visible = f64::from(transmittance(self.scene, ray));
        (visible > 0.0).then(|| Crossing {
            step,
            view: found.view,
            node: departure.arrive(found.position, camera.cosine(found.view.direction)),
            throughput: throughput.map(|part| part * visible),
        })
    }
}

impl Departure {
    /// The node of the vertex found at `position`, where the ray comes in under `cosine`.
    #[inline]
    fn arrive(&self, position: Vec3, cosine: f64) -> Node {
        let distance2 = f64::from((position - self.origin).length_squared());
        let (pdf, pdf_if_delta) = match (self.is_delta, self.is_parallel) {
            (true, _) => (self.pdf, self.pdf),
            (_, true) => (self.pdf * cosine, self.pdf),
            _ => (self.pdf * cosine / distance2, self.pdf / self.cosine),
        };
        let to_previous = match (self.is_parallel, self.has_cosine) {
            (true, _) => 1.0,
            (_, true) => self.cosine / distance2,
            _ => 1.0 / distance2,
        };
        Node { pdf, pdf_if_delta, to_previous, cosine, ..Node::default() }
    }
}

/// A direction chosen at a surface.
pub(crate) struct Leaving {
    pub(crate) direction: Vec3,
    pub(crate) event: Event,
    /// Density of the direction per solid angle, or the probability of the lobe.
    pub(crate) pdf: f64,
    /// The same for the direction to where the walk came from, for a walk that comes from the new direction.
    pub(crate) pdf_back: f64,
    /// Weight of the throughput: the diffuse part and the rest.
    pub(crate) weight: [DVec3; 2],
    /// Square of the factor by which a refraction compresses radiance, for a walk from the eye; else 1.
    pub(crate) eta_squared: f64,
}

impl Leaving {
    /// Chooses a direction at `surface` for a walk that came from the unit direction `previous`.
    pub(crate) fn choose(
        surface: &Surface<'_>,
        side: Side,
        previous: Vec3,
        u_lobe: f32,
        u: Vec2,
    ) -> Option<Self> {
        let shading = &surface.shading;
        let wo = surface.local(previous)?;
        let sampled = shading.bsdf.sample(wo, u_lobe, u)?;
        let direction = shading.frame.to_world(sampled.wi);
        if !shading.is_consistent(sampled.wi, direction) {
            return None;
        }
        let pdf = f64::from(sampled.pdf);
        let eta_squared = f64::from(sampled.eta).powi(2);
        if let Some(lobe) = sampled.delta {
            let back = shading.bsdf.delta(sampled.wi, lobe)?;
            let correction = match side {
                Side::Eye => 1.0,
                Side::Light => {
                    eta_squared * f64::from(wo.z.abs()) * surface.cosine(direction)
                        / (surface.cosine(previous) * f64::from(sampled.wi.z.abs()))
                }
            };
            return Some(Self {
                direction,
                event: Event::Delta(lobe),
                pdf,
                pdf_back: f64::from(back.probability),
                weight: [
                    colour(sampled.diffuse) * correction,
                    colour(sampled.specular) * correction,
                ],
                eta_squared: if side == Side::Eye { eta_squared } else { 1.0 },
            });
        }
        // The other way round: for the density back, and, of light, for the value as the eye will see it.
        let back = shading.bsdf.eval(sampled.wi, wo);
        let weight = match side {
            Side::Eye => [colour(sampled.diffuse), colour(sampled.specular)],
            Side::Light => {
                let scale = surface.cosine(direction) / (surface.cosine(previous) * pdf);
                [colour(back.diffuse) * scale, colour(back.specular) * scale]
            }
        };
        Some(Self {
            direction,
            event: Event::Smooth,
            pdf,
            pdf_back: f64::from(back.pdf),
            weight,
            eta_squared: if side == Side::Eye { eta_squared } else { 1.0 },
        })
    }
}
