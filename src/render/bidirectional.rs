//! Rounds of bidirectional path tracing: samples of pixels, and splats from walks of light.

use super::method::{Method, Report, replace_radiance};
use super::{RenderSettings, SamplerKind};
use crate::film::{Film, Radiance, Scale, SplatFilm, Tile};
use crate::integrator::bdpt::{Bdpt, Workspace};
use crate::integrator::{PathSample, Splat};
use crate::math::Rgb;
use crate::sampler::{IndependentSampler, Sampler, SobolSampler};
use crate::scene::{Requirements, Scene};
use crate::transport::Contribution;
use glam::Vec2;
use quietlight_denoise::Layers;
use rayon::prelude::*;

/// Samples of a whole picture that a round takes, about: a second at most, and few enough that their splats fit in memory.
const ROUND: u64 = 1 << 18;

/// A bidirectional render under way.
#[derive(Debug)]
pub(super) struct Bidirectional<'s> {
    scene: &'s Scene,
    bdpt: Bdpt,
    seed: u64,
    sampler: SamplerKind,
    /// What walks from the lens found, sample by sample.
    film: Film,
    /// What walks of light threw elsewhere.
    splats: SplatFilm,
    samples: u32,
}

impl<'s> Bidirectional<'s> {
    pub(super) fn new(scene: &'s Scene, bdpt: Bdpt, settings: &RenderSettings) -> Self {
        Self {
            scene,
            bdpt,
            seed: settings.seed,
            sampler: settings.sampler,
            film: Film::of_radiance(scene.film, &Requirements::of(scene)),
            splats: SplatFilm::of_independent(scene.film),
            samples: 0,
        }
    }

    fn pixels(&self) -> u64 {
        let [_, _, columns, rows] = self.scene.film.crop.map(u64::from);
        columns * rows
    }
}

impl Method for Bidirectional<'_> {
    fn round(&mut self, most: u32) {
        let size = (ROUND / self.pixels().max(1)).clamp(1, 256) as u32;
        let count = size.min(most - self.samples);
        let samples = self.samples..self.samples + count;
        let Self { scene, bdpt, seed, sampler, film, splats, .. } = self;
        let (tiles, kept) = film.tiles_mut();
        let work = Work { scene, bdpt: *bdpt, seed: *seed, sampler: *sampler };
        let thrown: Vec<Vec<(usize, Splat)>> = tiles
            .par_iter_mut()
            .map_init(Workspace::default, |workspace, tile| {
                work.fill(tile, kept, samples.clone(), workspace)
            })
            .collect();
        for (half, splat) in thrown.iter().flatten() {
            splats.add(*half, splat);
        }
        self.samples += count;
    }

    fn samples(&self) -> u32 {
        self.samples
    }

    fn done(&self) -> u64 {
        u64::from(self.samples) * self.pixels()
    }

    fn put_radiance(&self, layers: &mut Layers) {
        replace_radiance(self.film.layers(self.scene.origin), layers);
        self.splats.put_into(layers, &Scale::of_samples(self.samples), Radiance::Added);
    }

    fn invalid(&self) -> u64 {
        self.film.invalid_samples() + self.splats.invalid_splats()
    }

    fn report(&self) -> Report {
        Report::default()
    }
}

/// What each tile is filled with.
struct Work<'s> {
    scene: &'s Scene,
    bdpt: Bdpt,
    seed: u64,
    sampler: SamplerKind,
}

impl<'s> Work<'s> {
    /// Takes those samples in each pixel of the tile; returns the splats and the halves that they belong to.
    fn fill(
        &self,
        tile: &mut Tile,
        kept: &[usize],
        samples: std::ops::Range<u32>,
        workspace: &mut Workspace<'s>,
    ) -> Vec<(usize, Splat)> {
        let (mut found, mut splats) = (Vec::new(), Vec::new());
        for (index, [x, y]) in tile.film_pixels().enumerate() {
            let pixel = y * self.scene.film.width + x;
            for sample in samples.clone() {
                found.clear();
                let corner = Vec2::new(x as f32, y as f32);
                match self.sampler {
                    SamplerKind::Sobol => {
                        let sampler = SobolSampler::new(self.seed, pixel, sample);
                        self.trace(corner, sampler, workspace, &mut found);
                    }
                    SamplerKind::Independent => {
                        let sampler = IndependentSampler::new(self.seed, pixel, sample);
                        self.trace(corner, sampler, workspace, &mut found);
                    }
                }
                let half = (sample & 1) as usize;
                let mut seen = PathSample::default();
                for one in &found {
                    let [diffuse, specular] =
                        [one.diffuse, one.specular].map(|colour| weighted(colour, one.weight));
                    if one.t > 1 {
                        seen.diffuse += diffuse;
                        seen.specular += specular;
                    } else {
                        splats.push((half, Splat { raster: one.raster, diffuse, specular }));
                    }
                }
                tile.add(index, half, &seen, kept);
            }
        }
        splats
    }

    fn trace<S: Sampler>(
        &self,
        corner: Vec2,
        mut sampler: S,
        workspace: &mut Workspace<'s>,
        found: &mut Vec<Contribution>,
    ) {
        let raster = corner + sampler.next_2d();
        let is_pinhole = self.scene.camera.aperture_radius() == 0.0;
        let lens = if is_pinhole { Vec2::ZERO } else { sampler.next_2d() };
        self.bdpt.trace(self.scene, raster, lens, &mut sampler, workspace, found);
    }
}

fn weighted(colour: Rgb, weight: f64) -> Rgb {
    colour.map(|value| (f64::from(value) * weight) as f32)
}
