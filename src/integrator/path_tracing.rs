//! Unidirectional path tracing (Kajiya 1986) with next-event estimation and multiple importance sampling.

use super::mis::power_heuristic;
use super::receiver::Receiver;
use crate::emitter::EmitterSample;
use crate::geometry::{Interaction, Ray};
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::roulette::survive;
use crate::transport::shading::Shading;
use crate::transport::visibility::{shadow_ray, transmittance};
use glam::Vec3;
use std::ops::ControlFlow;

/// How direct light is found. All three have the same mean, which is how they test each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Strategy {
    /// Only by choosing points on emitters; emission counts where a camera ray or a delta lobe leads to it.
    Light,
    /// Only by walking into emitters; point, spot and directional emitters stay dark.
    Bsdf,
    /// Both, weighted by the power heuristic.
    #[default]
    Mis,
    /// Not at all: walks end as soon as the features of a sample are known, and its radiance means nothing. The features are
    /// those of the other strategies that have shadow rays, bit for bit.
    Features,
}

/// A path tracer: prefer it wherever light is not mainly found through narrow openings or focused by glass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathTracing {
    /// How direct light is found.
    pub strategy: Strategy,
    /// Longest path in edges, where the scene does not set a lower limit: 2 for direct light alone.
    pub max_depth: u32,
}

impl Default for PathTracing {
    fn default() -> Self {
        Self { strategy: Strategy::default(), max_depth: u32::MAX }
    }
}

/// What one camera sample found. Radiance is `diffuse + specular`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathSample {
    /// Radiance scattered by a diffuse lobe at the first hit.
    pub diffuse: Rgb,
    /// All other radiance, emission and background included.
    pub specular: Rgb,
    /// Albedo at the first surface that is not only delta; 0 when there is none.
    pub albedo: Rgb,
    /// Unit shading normal there, turned to where the ray came from.
    pub normal: Vec3,
    /// Position of the first hit, relative to [`Scene::origin`].
    pub position: Vec3,
    /// Length of the path to the first surface that is not only delta.
    pub depth: f32,
    /// Albedo at the second hit.
    pub texture2: Rgb,
    /// Did the shadow ray of the first hit reach its emitter? 1 or 0, or the transmittance of the masks between.
    pub visibility: f32,
}

impl PathSample {
    /// Are radiance and features all finite?
    pub fn is_finite(&self) -> bool {
        (self.diffuse + self.specular).is_finite()
            && (self.albedo + self.texture2).is_finite()
            && self.normal.is_finite()
            && self.position.is_finite()
            && (self.depth + self.visibility).is_finite()
    }
}

/// One hit of a walk, as [`PathTracing::trace_observed`] reports it for the replay of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// Edges from the camera to here.
    pub depth: u32,
    /// What was hit.
    pub at: Interaction,
    /// Product of all weights up to here.
    pub throughput: Rgb,
    /// Radiance added to the sample here: emission and direct light, weighted.
    pub added: Rgb,
}

/// What the last scattering leaves for the weight of emission found next.
struct Departure {
    position: Vec3,
    pdf: f32,
    is_delta: bool,
}

impl PathTracing {
    /// Follows one camera ray through `scene`.
    pub fn trace<S: Sampler>(&self, scene: &Scene, ray: Ray, sampler: &mut S) -> PathSample {
        self.trace_observed(scene, ray, sampler, |_| {})
    }

    /// The same, calling `observe` at every hit.
    pub fn trace_observed<S: Sampler>(
        &self,
        scene: &Scene,
        ray: Ray,
        sampler: &mut S,
        observe: impl FnMut(Vertex),
    ) -> PathSample {
        self.walk::<S, false>(scene, ray, sampler, observe, |_| ControlFlow::Continue(()))
    }

    /// Follows one camera ray without the light that [`Receiver::scatter`] leads straight from emitters to the camera:
    /// `receive` is given the receiver, if the ray meets one that may be lit, and may end the walk there. With the light that
    /// reaches the receiver directly this has the mean of [`PathTracing::trace`]; its shadow ray's visibility is 0.
    pub fn trace_without_direct<'a, S: Sampler>(
        &self,
        scene: &'a Scene,
        ray: Ray,
        sampler: &mut S,
        receive: impl FnMut(Receiver<'a>) -> ControlFlow<()>,
    ) -> PathSample {
        self.walk::<S, true>(scene, ray, sampler, |_| {}, receive)
    }

    /// The walk of both. Which of them it is, is known when it is compiled, so that path tracing does not pay for it.
    fn walk<'a, S: Sampler, const WITHOUT_DIRECT: bool>(
        &self,
        scene: &'a Scene,
        mut ray: Ray,
        sampler: &mut S,
        mut observe: impl FnMut(Vertex),
        mut receive: impl FnMut(Receiver<'a>) -> ControlFlow<()>,
    ) -> PathSample {
        let mut sample = PathSample::default();
        let max_depth = scene.limits.max_depth.unwrap_or(u32::MAX).min(self.max_depth);
        // The weight of the first scattering is kept apart, in its two parts: all light found after it is summed up
        // in `indirect` and split by them at the end.
        let (mut first_diffuse, mut first_specular) = (Rgb::BLACK, Rgb::BLACK);
        let mut indirect = Rgb::BLACK;
        let mut throughput = Rgb::WHITE;
        let mut first_weight = Rgb::WHITE;
        let mut scatterings = 0u32;
        let mut eta_squared = 1.0f32;
        let mut departure = Departure { position: ray.origin, pdf: 0.0, is_delta: true };
        // Rays start on the near plane, depth at the camera.
        let length = ray.origin.distance(scene.camera.center());
        let mut features = FeatureWalk { length, ..FeatureWalk::default() };
        let mut depth = 0u32;
        // Of a walk without direct light: has it met the receiver, and did the receiver's smooth lobe scatter last?
        let (mut is_received, mut is_left_out) = (false, false);

        while depth < max_depth {
            depth += 1;
            let Some(hit) = scene.geometry.intersect(&ray) else {
                if WITHOUT_DIRECT && is_left_out {
                    break;
                }
                let radiance = self.background(scene, &ray, &departure, depth);
                if scatterings == 0 {
                    sample.specular += throughput * radiance;
                } else {
                    indirect += throughput * radiance;
                }
                break;
            };
            let at = scene.geometry.interaction(&ray, &hit);
            let surface = scene.surfaces[at.part as usize];
            let material = &scene.materials[surface.material.0 as usize];

            // Emission.
            let mut emitted = Rgb::BLACK;
            if let Some(id) = surface.emitter
                && self.strategy != Strategy::Features
                && !(scene.limits.hide_emitters && depth == 1)
                && !(WITHOUT_DIRECT && is_left_out)
            {
                let radiance = scene.emitters.radiance(id, &at, -ray.direction);
                if !radiance.is_black() {
                    let weight = self
                        .hit_weight(&departure, || scene.emitters.pdf(id, departure.position, &at));
                    emitted = radiance * weight;
                    if scatterings == 0 {
                        sample.specular += throughput * emitted;
                    } else {
                        indirect += throughput * emitted;
                    }
                }
            }

            let u_light = sampler.next_2d();
            let u_bsdf = sampler.next_2d();
            let u_selection = sampler.next_1d();
            let u_lobe = sampler.next_1d();
            let u_roulette = sampler.next_1d();

            // Masks let the ray pass unscattered; the densities of the last scattering stay in force.
            let opacity = material.opacity(&at);
            if opacity < 1.0 && sampler.next_1d() >= opacity {
                features.length += hit.t;
                ray = at.spawn(ray.direction);
                continue;
            }

            let shading = Shading::new(material, &at, -ray.direction);
            features.visit(&mut sample, &shading, &at, hit.t);
            if !shading.is_consistent(shading.wo, -ray.direction) {
                break;
            }
            let mut vertex =
                Vertex { depth, at, throughput: first_weight * throughput, added: emitted };
            if depth == max_depth {
                observe(vertex);
                break;
            }

            // Direct light.
            let is_lit = match self.strategy {
                Strategy::Bsdf => false,
                Strategy::Features => scatterings == 0,
                Strategy::Light | Strategy::Mis => true,
            };
            let is_receiver = WITHOUT_DIRECT && !is_received && shading.bsdf.has_smooth();
            if is_receiver {
                is_received = true;
                let receiver = Receiver {
                    at,
                    shading: shading.clone(),
                    throughput: first_weight * throughput,
                    is_first: scatterings == 0,
                };
                if receive(receiver).is_break() {
                    break;
                }
            } else if is_lit
                && shading.bsdf.has_smooth()
                && let Some(light) = scene.emitters.sample(at.position, u_selection, u_light)
            {
                let direct = self.direct_light(scene, &shading, &at, &light, scatterings == 0);
                if scatterings == 0 {
                    sample.visibility = direct.visibility;
                    sample.diffuse += direct.diffuse;
                    sample.specular += direct.specular;
                } else {
                    indirect += throughput * (direct.diffuse + direct.specular);
                }
                vertex.added += direct.diffuse + direct.specular;
            }
            observe(vertex);
            if self.strategy == Strategy::Features && features.are_known() {
                break;
            }

            // The next direction.
            let Some(scattered) = shading.bsdf.sample(shading.wo, u_lobe, u_bsdf) else { break };
            let direction = shading.frame.to_world(scattered.wi);
            if !shading.is_consistent(scattered.wi, direction) {
                break;
            }
            let weight = scattered.diffuse + scattered.specular;
            if scatterings == 0 {
                (first_diffuse, first_specular) = (scattered.diffuse, scattered.specular);
                first_weight = weight;
            } else {
                throughput *= weight;
            }
            scatterings += 1;
            eta_squared *= scattered.eta * scattered.eta;
            departure = Departure {
                position: at.position,
                pdf: scattered.pdf,
                is_delta: scattered.is_delta(),
            };

            if WITHOUT_DIRECT {
                is_left_out = is_receiver && !departure.is_delta;
                if is_left_out && depth + 1 == max_depth {
                    break;
                }
            }

            // Russian roulette.
            let importance = (first_weight * throughput).max_component();
            if importance == 0.0 {
                break;
            }
            if depth >= scene.limits.rr_depth {
                match survive(importance * eta_squared, u_roulette) {
                    Some(scale) => throughput *= scale,
                    None => break,
                }
            }
            ray = at.spawn(direction);
        }

        if scatterings > 0 {
            sample.diffuse += first_diffuse * indirect;
            sample.specular += first_specular * indirect;
        }
        sample
    }

    /// Radiance of the environment along a ray that left the scene, weighted.
    fn background(&self, scene: &Scene, ray: &Ray, departure: &Departure, depth: u32) -> Rgb {
        if scene.limits.hide_emitters && depth == 1 {
            return Rgb::BLACK;
        }
        let (radiance, light_pdf) = if departure.is_delta || self.strategy != Strategy::Mis {
            (scene.emitters.environment(ray.direction), 0.0)
        } else {
            scene.emitters.environment_with_pdf(ray.direction)
        };
        if radiance.is_black() {
            return radiance;
        }
        radiance * self.hit_weight(departure, || light_pdf)
    }

    /// Weight of emission that a walk ran into; `light_pdf` is the density of finding it as direct light.
    fn hit_weight(&self, departure: &Departure, light_pdf: impl FnOnce() -> f32) -> f32 {
        match self.strategy {
            _ if departure.is_delta => 1.0,
            Strategy::Light | Strategy::Features => 0.0,
            Strategy::Bsdf => 1.0,
            Strategy::Mis => power_heuristic(departure.pdf, light_pdf()),
        }
    }

    /// Light of one emitter sample scattered at `at`. At the first hit the shadow ray is traced for the visibility
    /// layer even where the surface scatters nothing of it.
    fn direct_light(
        &self,
        scene: &Scene,
        shading: &Shading<'_>,
        at: &Interaction,
        light: &EmitterSample,
        is_first: bool,
    ) -> DirectLight {
        let wi = shading.frame.to_local(light.direction);
        let mut direct = DirectLight::default();
        if !shading.is_consistent(wi, light.direction) {
            return direct;
        }
        let scattered = shading.bsdf.eval(shading.wo, wi);
        let scatters = (scattered.diffuse + scattered.specular).max_component() > 0.0;
        if !(scatters || is_first) {
            return direct;
        }
        let shadow_ray = if light.distance.is_finite() {
            shadow_ray(at, at.position + light.direction * light.distance)
        } else {
            at.spawn(light.direction)
        };
        direct.visibility = transmittance(scene, shadow_ray);
        if scatters && direct.visibility > 0.0 {
            let weight = match self.strategy {
                Strategy::Mis if !light.is_delta => power_heuristic(light.pdf, scattered.pdf),
                _ => 1.0,
            };
            let incident = light.radiance * (weight * direct.visibility / light.pdf);
            direct.diffuse = scattered.diffuse * incident;
            direct.specular = scattered.specular * incident;
        }
        direct
    }
}

/// Direct light at one vertex.
#[derive(Default)]
struct DirectLight {
    diffuse: Rgb,
    specular: Rgb,
    visibility: f32,
}

/// Follows the walk until every feature is known.
#[derive(Default)]
struct FeatureWalk {
    hits: u32,
    length: f32,
    is_surface_found: bool,
}

impl FeatureWalk {
    /// Will further hits add nothing?
    fn are_known(&self) -> bool {
        self.hits >= 2 && self.is_surface_found
    }

    fn visit(&mut self, sample: &mut PathSample, shading: &Shading<'_>, at: &Interaction, t: f32) {
        self.hits += 1;
        if self.hits > 2 && self.is_surface_found {
            return;
        }
        self.length += t;
        if self.hits == 1 {
            sample.position = at.position;
        }
        if self.hits == 2 {
            sample.texture2 = shading.bsdf.albedo();
        }
        if !self.is_surface_found && shading.bsdf.has_smooth() {
            self.is_surface_found = true;
            sample.albedo = shading.bsdf.albedo();
            sample.normal =
                if shading.wo.z < 0.0 { -shading.frame.normal } else { shading.frame.normal };
            sample.depth = self.length;
        }
    }
}
