//! What a walk does from edge to edge, in the order in which it does so.

use super::{Arrival, Departure, Numbers, Rules, Taken, Walk};
use crate::bsdf::BsdfEval;
use crate::emitter::EmitterSample;
use crate::integrator::mis::power_heuristic;
use crate::integrator::path_tracing::{PathSample, Strategy, Vertex};
use crate::integrator::receiver::Receiver;
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::transport::roulette::survive;
use crate::transport::visibility::{shadow_ray, transmittance};
use std::ops::ControlFlow;

impl<'a, S: Sampler> Walk<'a, S> {
    /// Is there room for one more edge?
    #[inline]
    pub(crate) fn may_go_on(&self, rules: &Rules<'_>) -> bool {
        self.depth < rules.max_depth
    }

    /// Follows the ray. Does it meet anything?
    #[inline]
    pub(crate) fn intersect(&mut self, rules: &Rules<'a>) -> bool {
        self.depth += 1;
        let hit = rules.scene.geometry.intersect(&self.ray);
        if let Some(hit) = hit {
            self.hit = hit;
        }
        hit.is_some()
    }

    /// The ray left the scene: adds the radiance of the environment, weighted.
    #[inline]
    pub(crate) fn escape(&mut self, rules: &Rules<'_>) {
        if self.is_left_out {
            return;
        }
        let (emitters, direction) = (&rules.scene.emitters, self.ray.direction);
        let radiance = if rules.scene.limits.hide_emitters && self.depth == 1 {
            Rgb::BLACK
        } else {
            let (radiance, light_pdf) =
                if self.departure.is_delta || rules.strategy != Strategy::Mis {
                    (emitters.environment(direction), 0.0)
                } else {
                    emitters.environment_with_pdf(direction)
                };
            if radiance.is_black() {
                radiance
            } else {
                radiance * self.hit_weight(rules, || light_pdf)
            }
        };
        self.add_emission(radiance);
    }

    /// Adds radiance that the walk ran into.
    #[inline]
    fn add_emission(&mut self, radiance: Rgb) {
        if self.scatterings == 0 {
            self.sample.specular += self.throughput * radiance;
        } else {
            self.indirect += self.throughput * radiance;
        }
    }

    /// Weight of emission that a walk ran into; `light_pdf` is the density of finding it as direct light.
    #[inline]
    fn hit_weight(&self, rules: &Rules<'_>, light_pdf: impl FnOnce() -> f32) -> f32 {
        match rules.strategy {
            _ if self.departure.is_delta => 1.0,
            Strategy::Light | Strategy::Features => 0.0,
            Strategy::Bsdf => 1.0,
            Strategy::Mis => power_heuristic(self.departure.pdf, light_pdf()),
        }
    }

    /// Finds out what there is to know of the surface that the ray met.
    #[inline]
    pub(crate) fn interact(&mut self, rules: &Rules<'a>) {
        rules.scene.geometry.interact(&self.ray, &self.hit, &mut self.at);
    }

    /// Adds what the surface sends, and makes ready to scatter.
    #[inline]
    pub(crate) fn arrive(&mut self, rules: &Rules<'a>) -> Arrival {
        let scene = rules.scene;
        let surface = scene.surfaces[self.at.part as usize];
        let material = &scene.materials[surface.material.0 as usize];

        self.emitted = Rgb::BLACK;
        if let Some(id) = surface.emitter
            && rules.strategy != Strategy::Features
            && !(scene.limits.hide_emitters && self.depth == 1)
            && !self.is_left_out
        {
            let radiance = scene.emitters.radiance(id, &self.at, -self.ray.direction);
            if !radiance.is_black() {
                let light_pdf = || scene.emitters.pdf(id, self.departure.position, &self.at);
                self.emitted = radiance * self.hit_weight(rules, light_pdf);
                self.add_emission(self.emitted);
            }
        }

        let sampler = &mut self.sampler;
        self.numbers = Numbers {
            light: sampler.next_2d(),
            bsdf: sampler.next_2d(),
            selection: sampler.next_1d(),
            lobe: sampler.next_1d(),
            roulette: sampler.next_1d(),
        };

        // Masks let the ray pass unscattered; the densities of the last scattering stay in force.
        let opacity = material.opacity(&self.at);
        if opacity < 1.0 && sampler.next_1d() >= opacity {
            // No scattering and no edge, as for shadow rays: what both find is weighted against each other.
            self.depth -= 1;
            self.features.pass(self.hit.t);
            self.ray = self.at.spawn(self.ray.direction);
            return Arrival::Passed;
        }

        let wo = -self.ray.direction;
        self.shading.set(material, &self.at, wo);
        self.features.visit(&mut self.sample, &self.shading, &self.at, self.hit.t);
        let is_consistent = self.shading.is_consistent(self.shading.wo, wo);
        if is_consistent { Arrival::Surface } else { Arrival::Ended }
    }

    /// What there is to report of the surface; `direct` is the direct light that was added there.
    pub(crate) fn vertex(&self, direct: Rgb) -> Vertex {
        Vertex {
            depth: self.depth,
            at: self.at,
            throughput: self.first_weight * self.throughput,
            added: self.emitted + direct,
        }
    }

    /// The receiver, if it was still to come and this is it: it takes no direct light.
    pub(crate) fn received(&mut self) -> Option<Receiver<'a>> {
        if !(self.awaits_receiver && self.shading.bsdf.has_smooth()) {
            return None;
        }
        self.awaits_receiver = false;
        Some(Receiver {
            at: self.at,
            shading: self.shading.clone(),
            throughput: self.first_weight * self.throughput,
            is_first: self.scatterings == 0,
        })
    }

    /// Chooses a point on an emitter. At the first hit the shadow ray is traced for the visibility layer even where the
    /// surface scatters nothing of it.
    #[inline]
    pub(crate) fn light(&mut self, rules: &Rules<'a>) {
        let is_first = self.scatterings == 0;
        let is_lit = match rules.strategy {
            Strategy::Bsdf => false,
            Strategy::Features => is_first,
            Strategy::Light | Strategy::Mis => true,
        };
        let Self { at, shading, numbers, direct, .. } = self;
        direct.state = Taken::No;
        if !(is_lit && shading.bsdf.has_smooth()) {
            return;
        }
        let Some(light) =
            rules.scene.emitters.sample(at.position, numbers.selection, numbers.light)
        else {
            return;
        };
        let EmitterSample { direction, distance, radiance, pdf, is_delta } = light;
        let wi = shading.frame.to_local(direction);
        direct.state = Taken::Dark;
        if !shading.is_consistent(wi, direction) {
            return;
        }
        let scattered = shading.bsdf.eval(shading.wo, wi);
        if !(scatters(&scattered) || is_first) {
            return;
        }
        direct.state = Taken::ByRay;
        direct.ray = if distance.is_finite() {
            shadow_ray(at, at.position + direction * distance)
        } else {
            at.spawn(direction)
        };
        direct.weight = match rules.strategy {
            Strategy::Mis if !is_delta => power_heuristic(pdf, scattered.pdf),
            _ => 1.0,
        };
        (direct.scattered, direct.radiance, direct.pdf) = (scattered, radiance, pdf);
    }

    /// Finds the part of direct light that the shadow ray leaves.
    #[inline]
    pub(crate) fn shadow(&mut self, rules: &Rules<'a>) {
        self.direct.visibility = match self.direct.state {
            Taken::No | Taken::Dark => 0.0,
            Taken::ByRay => transmittance(rules.scene, self.direct.ray),
        };
    }

    /// Adds the direct light that the shadow ray left, and returns what was added.
    #[inline]
    pub(crate) fn collect(&mut self) -> Rgb {
        let direct = &self.direct;
        if direct.state == Taken::No {
            return Rgb::BLACK;
        }
        let visibility = direct.visibility;
        let (mut diffuse, mut specular) = (Rgb::BLACK, Rgb::BLACK);
        if visibility > 0.0 && scatters(&direct.scattered) {
            let incident = direct.radiance * (direct.weight * visibility / direct.pdf);
            diffuse = direct.scattered.diffuse * incident;
            specular = direct.scattered.specular * incident;
        }
        if self.scatterings == 0 {
            self.sample.visibility = visibility;
            self.sample.diffuse += diffuse;
            self.sample.specular += specular;
        } else {
            self.indirect += self.throughput * (diffuse + specular);
        }
        diffuse + specular
    }

    /// Chooses the next ray, or ends the walk.
    #[inline]
    pub(crate) fn scatter(&mut self, rules: &Rules<'a>, is_receiver: bool) -> ControlFlow<()> {
        const END: ControlFlow<()> = ControlFlow::Break(());
        if rules.strategy == Strategy::Features && self.features.are_known() {
            return END;
        }
        let Self { at, shading, numbers, .. } = self;
        let Some(scattered) = shading.bsdf.sample(shading.wo, numbers.lobe, numbers.bsdf) else {
            return END;
        };
        let direction = shading.frame.to_world(scattered.wi);
        if !shading.is_consistent(scattered.wi, direction) {
            return END;
        }
        let weight = scattered.diffuse + scattered.specular;
        if self.scatterings == 0 {
            self.first = [scattered.diffuse, scattered.specular];
            self.first_weight = weight;
        } else {
            self.throughput *= weight;
        }
        self.scatterings += 1;
        self.eta_squared *= scattered.eta * scattered.eta;
        self.departure =
            Departure { position: at.position, pdf: scattered.pdf, is_delta: scattered.is_delta() };
        self.is_left_out = is_receiver && !self.departure.is_delta;
        if self.is_left_out && self.depth + 1 == rules.max_depth {
            return END;
        }

        // Russian roulette.
        let importance = (self.first_weight * self.throughput).max_component();
        if importance == 0.0 {
            return END;
        }
        if self.depth >= rules.scene.limits.rr_depth {
            match survive(importance * self.eta_squared, numbers.roulette) {
                Some(scale) => self.throughput *= scale,
                None => return END,
            }
        }
        self.ray = at.spawn(direction);
        ControlFlow::Continue(())
    }

    /// What the walk found, at its end.
    #[inline]
    pub(crate) fn finish(&self) -> PathSample {
        let mut sample = self.sample;
        if self.scatterings > 0 {
            sample.diffuse += self.first[0] * self.indirect;
            sample.specular += self.first[1] * self.indirect;
        }
        sample
    }
}

/// Does the surface scatter any of it?
#[inline]
fn scatters(scattered: &BsdfEval) -> bool {
    (scattered.diffuse + scattered.specular).max_component() > 0.0
}
