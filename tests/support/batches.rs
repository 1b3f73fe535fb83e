//! Means of many independent batches, in blocks of 8×8 pixels (METHODS 12.1).

use super::scenes::{render_finite, settings};
use glam::Vec2;
use quietlight::integrator::bdpt::{Bdpt, Workspace};
use quietlight::integrator::{Integrator, PathTracing, Strategy};
use quietlight::math::Rgb;
use quietlight::render::RenderSettings;
use quietlight::sampler::{IndependentSampler, Sampler};
use quietlight::scene::Scene;
use quietlight::transport::connect::Contribution;
use quietlight_denoise::LayerKind;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Pixels along the side of a block.
const SIDE: u32 = 8;

/// Block means of luminance of several estimates, batch by batch.
#[derive(Debug, Default)]
pub(crate) struct Batches {
    /// One entry a batch: of each estimate, the mean of each block.
    batches: Vec<BTreeMap<usize, Vec<f64>>>,
    blocks: usize,
}

fn blocks_of(scene: &Scene) -> (u32, usize) {
    let across = scene.film.width.div_ceil(SIDE);
    (across, (across * scene.film.height.div_ceil(SIDE)) as usize)
}

impl Batches {
    /// `count` batches; each fills block sums through the function it is given (estimate, raster, luminance of a pixel's
    /// value).
    pub(crate) fn run(
        scene: &Scene,
        count: u32,
        batch: impl Fn(u32, &mut dyn FnMut(usize, Vec2, f64)) + Sync,
    ) -> Self {
        let (across, blocks) = blocks_of(scene);
        let batches = (0..count)
            .into_par_iter()
            .map(|index| {
                let mut sums: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
                batch(index, &mut |estimate, raster, value| {
                    let block = raster.y as u32 / SIDE * across + raster.x as u32 / SIDE;
                    sums.entry(estimate).or_insert_with(|| vec![0.0; blocks])[block as usize] +=
                        value / f64::from(SIDE * SIDE);
                });
                sums
            })
            .collect();
        Self { batches, blocks }
    }

    /// Mean and standard error of one block of one estimate.
    fn block(&self, estimate: usize, block: usize) -> (f64, f64) {
        self.statistics(|sums| sums.get(&estimate).map_or(0.0, |sums| sums[block]))
    }

    /// The same over all blocks.
    pub(crate) fn whole(&self, estimate: usize) -> (f64, f64) {
        let blocks = self.blocks as f64;
        self.statistics(|sums| {
            sums.get(&estimate).map_or(0.0, |sums| sums.iter().sum::<f64>() / blocks)
        })
    }

    fn statistics(&self, value: impl Fn(&BTreeMap<usize, Vec<f64>>) -> f64) -> (f64, f64) {
        let n = self.batches.len() as f64;
        let mean = self.batches.iter().map(&value).sum::<f64>() / n;
        let squares: f64 = self.batches.iter().map(|sums| (value(sums) - mean).powi(2)).sum();
        (mean, (squares / (n * (n - 1.0))).sqrt())
    }
}

fn luminance(colour: Rgb) -> f64 {
    f64::from(colour.luminance())
}

/// Batches of bidirectional path tracing; `estimate` says which sum a contribution adds to, and with what factor.
pub(crate) fn bdpt_batches(
    scene: &Scene,
    integrator: Bdpt,
    batches: u32,
    samples: u32,
    estimate: impl Fn(&Contribution) -> Option<(usize, f64)> + Sync,
) -> Batches {
    let [left, top, width, height] = scene.film.crop;
    let scale = 1.0 / f64::from(samples);
    Batches::run(scene, batches, |batch, add| {
        let mut workspace = Workspace::default();
        let mut found = Vec::new();
        for y in top..top + height {
            for x in left..left + width {
                for sample in 0..samples {
                    let mut sampler = IndependentSampler::new(
                        7,
                        y * scene.film.width + x,
                        batch * samples + sample,
                    );
                    let raster = Vec2::new(x as f32, y as f32) + sampler.next_2d();
                    let lens = sampler.next_2d();
                    found.clear();
                    integrator.trace(scene, raster, lens, &mut sampler, &mut workspace, &mut found);
                    for one in &found {
                        if let Some((index, factor)) = estimate(one) {
                            let value = luminance(one.diffuse + one.specular) * factor * scale;
                            add(index, one.raster, value);
                        }
                    }
                }
            }
        }
    })
}

/// Batches of path tracing: estimate 0.
pub(crate) fn path_batches(scene: &Scene, batches: u32, samples: u32) -> Batches {
    render_batches(scene, PathTracing::default().into(), batches, samples)
}

/// Batches of any method, each a whole render of its own: estimate 0.
pub(crate) fn render_batches(
    scene: &Scene,
    integrator: Integrator,
    batches: u32,
    samples: u32,
) -> Batches {
    let [left, top, ..] = scene.film.crop;
    Batches::run(scene, batches, |batch, add| {
        let settings = RenderSettings {
            integrator,
            ..settings(samples, 1000 + u64::from(batch), Strategy::Mis)
        };
        let rendered = render_finite(scene, &settings);
        let beauty = &rendered.layers.layers[&LayerKind::Beauty].mean;
        let (_, height, width) = beauty.dim();
        for y in 0..height {
            for x in 0..width {
                let colour = Rgb::from([0, 1, 2].map(|channel| beauty[[channel, y, x]]));
                let raster = Vec2::new((left as usize + x) as f32, (top as usize + y) as f32);
                add(0, raster, luminance(colour));
            }
        }
    })
}

/// Asserts that two estimates agree block by block: the mean of z² below `1 + 4 sqrt(2 / n)` with the `n` blocks a quarter as
/// many for their correlation, and no |z| beyond the Student quantile of level 10⁻⁴ over all blocks.
pub(crate) fn assert_same(a: &Batches, index_a: usize, b: &Batches, index_b: usize, what: &str) {
    let mut scores = Vec::new();
    for block in 0..a.blocks {
        let ((mean_a, error_a), (mean_b, error_b)) =
            (a.block(index_a, block), b.block(index_b, block));
        let error = error_a.hypot(error_b);
        if error > 0.0 {
            scores.push((mean_a - mean_b) / error);
        } else {
            assert!((mean_a - mean_b).abs() <= 1e-6 * mean_b.abs(), "{what}: {mean_a} {mean_b}");
        }
    }
    let n = scores.len() as f64;
    let mean_square = scores.iter().map(|z| z * z).sum::<f64>() / n;
    let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
    // 32 batches a side give Welch's t some 50 degrees of freedom: variance 1.04, tails a little heavier than Gauss.
    let bound = 1.04 + 4.0 * (2.0 / (n / 4.0)).sqrt();
    assert!(mean_square < bound, "{what}: mean z² {mean_square:.2} over {n} blocks");
    assert!(largest < 6.0, "{what}: largest |z| {largest:.2} over {n} blocks");
    let ((mean_a, error_a), (mean_b, error_b)) = (a.whole(index_a), b.whole(index_b));
    let z = (mean_a - mean_b) / error_a.hypot(error_b).max(1e-7 * mean_b.abs());
    assert!(z.abs() < 4.4, "{what}: whole picture {mean_a} ± {error_a}, {mean_b} ± {error_b}");
}
