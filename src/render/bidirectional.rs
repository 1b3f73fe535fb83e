//! Rounds of bidirectional path tracing: samples of pixels, and splats from walks of light.

use super::method::{Found, Method};
use super::{RenderSettings, SamplerKind, Shard};
use crate::film::{Film, SplatFilm, Tile};
use crate::integrator::bdpt::{Bdpt, Workspace};
use crate::integrator::{PathSample, Splat};
use crate::sampler::{IndependentSampler, Sampler, SobolSampler};
use crate::scene::{Requirements, Scene};
use crate::transport::Contribution;
use crate::transport::connect::Pair;
use glam::Vec2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Samples of a whole picture that a round takes, about: a second at most, and few enough that their splats fit in memory.
const ROUND: u64 = 1 << 18;

/// A bidirectional render under way.
#[derive(Debug)]
pub(super) struct Bidirectional<'s> {
    scene: &'s Scene,
    bdpt: Bdpt,
    numbers: Numbers,
    shard: Shard,
    found: Sums,
}

/// What bidirectional walks found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Sums {
    /// What walks from the lens found, sample by sample.
    film: Film,
    /// What walks of light threw elsewhere.
    splats: SplatFilm,
    samples: u32,
    /// Pixels of the crop window.
    pixels: u64,
}

impl<'s> Bidirectional<'s> {
    pub(super) fn new(
        scene: &'s Scene,
        bdpt: Bdpt,
        settings: &RenderSettings,
        found: Option<Sums>,
    ) -> Self {
        Self {
            scene,
            bdpt,
            numbers: Numbers { seed: settings.seed, sampler: settings.sampler },
            shard: settings.shard,
            found: found.unwrap_or_else(|| Sums {
                film: Film::of_radiance(scene.film, &Requirements::of(scene)),
                splats: SplatFilm::of_independent(scene.film),
                samples: 0,
                pixels: scene.film.crop_pixels(),
            }),
        }
    }
}

impl Method for Bidirectional<'_> {
    fn round(&mut self, most: u32) {
        let Self { scene, bdpt, numbers, shard, found } = self;
        let Sums { film, splats, samples, pixels } = found;
        let size = (ROUND / (*pixels).max(1)).clamp(1, 256) as u32;
        let count = size.min(shard.share(most).saturating_sub(*samples));
        let own = (*samples..*samples + count).map(|own| shard.number(own));
        let (tiles, kept) = film.tiles_mut();
        let work = Work { scene, bdpt: *bdpt, numbers: *numbers };
        let thrown: Vec<Vec<(usize, Splat)>> = tiles
            .par_iter_mut()
            .map_init(Workspace::default, |workspace, tile| {
                work.fill(tile, kept, own.clone(), workspace)
            })
            .collect();
        for (half, splat) in thrown.iter().flatten() {
            splats.add(*half, splat);
        }
        *samples += count;
    }

    fn is_complete(&self, most: u32) -> bool {
        self.found.samples >= self.shard.share(most)
    }

    fn found(&self) -> Found<'_> {
        Found::Bidirectional(Cow::Borrowed(&self.found))
    }
}

impl Sums {
    pub(super) fn film(&self) -> &Film {
        &self.film
    }

    pub(super) fn splats(&self) -> &SplatFilm {
        &self.splats
    }

    pub(super) fn samples(&self) -> u32 {
        self.samples
    }

    pub(super) fn done(&self) -> u64 {
        u64::from(self.samples) * self.pixels
    }

    pub(super) fn invalid(&self) -> u64 {
        self.film.invalid_samples() + self.splats.invalid_splats()
    }

    /// Adds what other samples of the same picture found.
    pub(super) fn merge(&mut self, other: &Self) {
        self.film.merge(&other.film);
        self.splats.merge(&other.splats);
        self.samples += other.samples;
    }
}

/// What each tile is filled with.
struct Work<'s> {
    scene: &'s Scene,
    bdpt: Bdpt,
    numbers: Numbers,
}

impl<'s> Work<'s> {
    /// Takes those samples in each pixel of the tile; returns the splats and the halves that they belong to.
    fn fill(
        &self,
        tile: &mut Tile,
        kept: &[usize],
        samples: impl Iterator<Item = u32> + Clone,
        workspace: &mut Workspace<'s>,
    ) -> Vec<(usize, Splat)> {
        let (mut found, mut splats) = (Vec::<Contribution>::new(), Vec::new());
        let max_depth = self.scene.limits.max_depth.unwrap_or(u32::MAX);
        for (index, [x, y]) in tile.film_pixels().enumerate() {
            for sample in samples.clone() {
                found.clear();
                self.numbers.walk(self.scene, &self.bdpt, [x, y], sample, workspace, |pair| {
                    pair.connect(max_depth, &mut found);
                });
                let half = (sample & 1) as usize;
                let mut seen = PathSample::default();
                for one in &found {
                    let splat = Splat::from(one).weighted(one.weight);
                    if one.t > 1 {
                        seen.diffuse += splat.diffuse;
                        seen.specular += splat.specular;
                    } else {
                        splats.push((half, splat));
                    }
                }
                tile.add(index, half, &seen, kept);
            }
        }
        splats
    }
}

/// Where the random numbers of samples come from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Numbers {
    pub(super) seed: u64,
    pub(super) sampler: SamplerKind,
}

impl Numbers {
    /// The walks of one sample of a pixel, to be joined by `join`.
    pub(super) fn walk<'s>(
        self,
        scene: &'s Scene,
        bdpt: &Bdpt,
        pixel: [u32; 2],
        sample: u32,
        workspace: &mut Workspace<'s>,
        join: impl FnOnce(Pair<'_, 's>),
    ) {
        let index = pixel[1] * scene.film.width + pixel[0];
        let corner = Vec2::from(pixel.map(|number| number as f32));
        match self.sampler {
            SamplerKind::Sobol => {
                let mut sampler = SobolSampler::new(self.seed, index, sample);
                join(walk(scene, bdpt, corner, &mut sampler, workspace));
            }
            SamplerKind::Independent => {
                let mut sampler = IndependentSampler::new(self.seed, index, sample);
                join(walk(scene, bdpt, corner, &mut sampler, workspace));
            }
        }
    }
}

fn walk<'a, 's, S: Sampler>(
    scene: &'s Scene,
    bdpt: &Bdpt,
    corner: Vec2,
    sampler: &mut S,
    workspace: &'a mut Workspace<'s>,
) -> Pair<'a, 's> {
    let raster = corner + sampler.next_2d();
    let lens = sampler.next_2d_if(scene.camera.has_lens());
    bdpt.walk(scene, raster, lens, sampler, workspace)
}
