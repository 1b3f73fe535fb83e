//! The pilot, and the first pass: resampled direct light of every camera ray, and all other light along it.

use super::exchange::Seed;
use super::marks::{Marks, Seen};
use super::sir::{Chosen, Gathered, Resampler};
use super::{PixelSums, Stream, VisibilityRendering};
use crate::integrator::path_tracing::PathTracing;
use crate::integrator::receiver::Receiver;
use crate::math::Rgb;
use crate::sampler::{Sampler, SobolSampler};
use glam::Vec2;
use rayon::prelude::*;
use std::ops::ControlFlow;

impl<'a> VisibilityRendering<'a> {
    /// Marks by samples that serve nothing else.
    pub(super) fn pilot(&mut self) -> Marks {
        let [columns, rows] = self.size();
        let this = &*self;
        let seen: Vec<Look> = (0..rows)
            .into_par_iter()
            .flat_map_iter(|row| {
                let mut resampler = Resampler::default();
                this.film_pixels(row).map(move |pixel| this.look(pixel, &mut resampler))
            })
            .collect();
        self.found.ledger.pilot_rays += seen.iter().map(|look| look.rays).sum::<u64>();
        Marks::new([columns, rows], self.settings.dilation, |pixel| seen[pixel].seen.is_partial())
    }

    /// What the pilot sees at one pixel.
    fn look(&self, pixel: [u32; 2], resampler: &mut Resampler) -> Look {
        let (mut look, mut found) = (Look::default(), Vec::new());
        for ray in 0..self.settings.pilot_hits {
            let mut numbers = self.sampler(Stream::PilotGather, pixel, ray);
            let mut walk = self.sampler(Stream::PilotWalk, pixel, ray);
            self.trace(pixel, &mut walk, |receiver| {
                let gathered = self.gather(resampler, &receiver, &mut numbers, &mut found);
                look.seen.visible += gathered.visible;
                look.seen.of += gathered.chosen;
                look.rays += u64::from(gathered.shadow_rays);
                ControlFlow::Break(())
            });
        }
        look
    }

    /// The camera ray with these numbers, followed without direct light.
    fn trace(
        &self,
        [x, y]: [u32; 2],
        sampler: &mut SobolSampler,
        receive: impl FnMut(Receiver<'a>) -> ControlFlow<()>,
    ) -> (Rgb, Rgb) {
        let raster = Vec2::new(x as f32, y as f32) + sampler.next_2d();
        let camera = &self.scene.camera;
        let lens = sampler.next_2d_if(camera.has_lens());
        let ray = camera.ray(raster, lens);
        let sample = PathTracing::default().trace_without_direct(self.scene, ray, sampler, receive);
        (sample.diffuse, sample.specular)
    }

    fn gather(
        &self,
        resampler: &mut Resampler,
        receiver: &Receiver<'_>,
        sampler: &mut SobolSampler,
        found: &mut Vec<Chosen>,
    ) -> Gathered {
        let counts = [self.settings.candidates.max(1), self.settings.shadow_rays.max(1)];
        resampler.gather(self.scene, &self.lights, receiver, counts, sampler, found)
    }

    /// The first pass over one row: `hits` camera rays of each pixel, kept where the pixel is in `kept`.
    pub(super) fn gather_row(&self, row: u32, hits: u32, kept: &Marks) -> Row<'a> {
        let columns = self.size()[0] as usize;
        let mut gathered = Row::default();
        let (mut resampler, mut found) = (Resampler::default(), Vec::new());
        for (column, pixel) in self.film_pixels(row).enumerate() {
            let slot = kept.slot(row as usize * columns + column);
            let (mut other, mut direct) = (PixelSums::default(), PixelSums::default());
            for hit in 0..hits {
                let ray = self.found.hits + hit;
                let mut all = [Rgb::BLACK; 2];
                let mut numbers = self.sampler(Stream::Gather, pixel, ray);
                let mut received = None;
                let (diffuse, specular) =
                    self.trace(pixel, &mut self.sampler(Stream::Walk, pixel, ray), |receiver| {
                        received = Some(receiver);
                        ControlFlow::Continue(())
                    });
                gathered.add(&mut other, &mut all, diffuse, specular);
                if let Some(receiver) = &received {
                    found.clear();
                    let result = self.gather(&mut resampler, receiver, &mut numbers, &mut found);
                    direct.unshadowed += result.unshadowed;
                    direct.seen.visible += result.visible;
                    direct.seen.of += result.chosen;
                    gathered.shadow_rays += u64::from(result.shadow_rays);
                    gathered.invalid += u64::from(result.invalid);
                    for chosen in &found {
                        if !gathered.add(&mut direct, &mut all, chosen.diffuse, chosen.specular) {
                            continue;
                        }
                        if let Some(slot) = slot {
                            gathered.seeds.push(Seed::new(slot as u32 * hits + hit, chosen));
                        }
                    }
                    for light in self.scene.emitters.delta_samples(receiver.at.position) {
                        let scattering = receiver.scatter(light.direction);
                        if (scattering.diffuse + scattering.specular).is_black() {
                            continue;
                        }
                        gathered.shadow_rays += 1;
                        let visibility =
                            receiver.visibility(self.scene, light.direction, light.distance);
                        let radiance = light.radiance * visibility;
                        let [diffuse, specular] =
                            [scattering.diffuse, scattering.specular].map(|part| part * radiance);
                        gathered.add(&mut other, &mut all, diffuse, specular);
                    }
                }
                other.observe(all[0], all[1]);
                if slot.is_some() {
                    gathered.receivers.push(received);
                }
            }
            gathered.other.push(other);
            gathered.direct.push(direct);
        }
        gathered
    }
}

/// What the pilot found at one pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    seen: Seen,
    rays: u64,
}

/// What the first pass found in one row of pixels.
#[derive(Default)]
pub(super) struct Row<'a> {
    /// Light that is not resampled.
    pub(super) other: Vec<PixelSums>,
    /// Light that is.
    pub(super) direct: Vec<PixelSums>,
    /// Of the pixels that are kept.
    pub(super) receivers: Vec<Option<Receiver<'a>>>,
    pub(super) seeds: Vec<Seed>,
    pub(super) shadow_rays: u64,
    pub(super) invalid: u64,
}

impl Row<'_> {
    /// Adds light to a pixel and to `all` that its camera ray found, if it is finite, else counts it.
    fn add(
        &mut self,
        sums: &mut PixelSums,
        all: &mut [Rgb; 2],
        diffuse: Rgb,
        specular: Rgb,
    ) -> bool {
        let is_finite = (diffuse + specular).is_finite();
        if is_finite {
            sums.add(diffuse, specular, 1.0);
            all[0] += diffuse;
            all[1] += specular;
        } else {
            self.invalid += 1;
        }
        is_finite
    }
}

/// Leaves only what belongs to marked pixels of what was kept of all pixels.
pub(super) fn keep_marked(
    marks: &Marks,
    hits: u32,
    receivers: &mut Vec<Option<Receiver<'_>>>,
    seeds: &mut Vec<Seed>,
) {
    let slot = |receiver: u32| marks.slot((receiver / hits) as usize);
    let mut index = 0;
    receivers.retain(|_| {
        index += 1;
        slot(index - 1).is_some()
    });
    seeds.retain_mut(|seed| match slot(seed.receiver) {
        Some(slot) => {
            seed.receiver = slot as u32 * hits + seed.receiver % hits;
            true
        }
        None => false,
    });
}
