//! Does a kernel keep the light where it is? Seeds that stand for it, and what flows between regions of path space
//! (METHODS 12.3).

use crate::support::mean::p_of_z;
use crate::support::{LEVEL, sidak};
use glam::{Vec2, Vec3};
use quietlight::integrator::bdpt::{Bdpt, Workspace};
use quietlight::mcmc::mutation::Mutations;
use quietlight::mcmc::{Chain, Kernels, Statistics};
use quietlight::sampler::{IndependentSampler, Sampler};
use quietlight::scene::Scene;
use quietlight::transport::mis::Heuristic;
use quietlight::transport::{Event, Path, Vertex};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Paths that the walks of sample `index` find and `is_wanted` keeps, with weights `w_s f / p`: a sum over many samples and
/// their paths stands for the integral over path space.
pub(crate) fn seeds<'s>(
    scene: &'s Scene,
    sampler: &mut IndependentSampler,
    workspace: &mut Workspace<'s>,
    is_wanted: &impl Fn(&Path<'_>) -> bool,
) -> Vec<(Path<'s>, f64)> {
    let [left, top, columns, rows] = scene.film.crop.map(|pixels| pixels as f32);
    let raster = Vec2::new(left, top) + sampler.next_2d() * Vec2::new(columns, rows);
    let lens = sampler.next_2d();
    let integrator = Bdpt { heuristic: Heuristic::Balance, ..Bdpt::default() };
    let pair = integrator.walk(scene, raster, lens, sampler, workspace);
    let mut found = Vec::new();
    pair.connect(scene.limits.max_depth.expect("a limit"), &mut found);
    found
        .iter()
        .filter_map(|one| pair.path(one.s, one.t).map(|path| (path, one.s as usize)))
        .filter(|(path, _)| is_in_picture(scene, path) && is_wanted(path))
        .map(|(path, s)| {
            // Light that walks into the lens is left out, and its share given to the others.
            let shares = path.weights(Heuristic::Balance);
            let share = shares[s] / (1.0 - shares[path.k() + 1]);
            let weight = share * path.ln_contribution(s).exp();
            (path, weight)
        })
        .collect()
}

/// Light that the camera did not look for may fall beside the crop window.
fn is_in_picture(scene: &Scene, path: &Path<'_>) -> bool {
    let [left, top, columns, rows] = scene.film.crop.map(|pixels| pixels as f32);
    let place = path.lens().0 - Vec2::new(left, top);
    place.min_element() >= 0.0 && place.x < columns && place.y < rows
}

/// The labels from the light to the eye, such as `LDSE`.
pub(crate) fn labels(path: &Path<'_>) -> String {
    let inner = &path.events()[1..path.k()];
    let inner = inner.iter().map(|event| if event.is_delta() { 'S' } else { 'D' });
    std::iter::once('L').chain(inner).chain(['E']).collect()
}

/// Where a path is, in several partitions of path space.
fn regions(scene: &Scene, path: &Path<'_>) -> [u64; 5] {
    let (raster, _) = path.lens();
    let block = |at: f32, size: u32| (at * 4.0 / size as f32) as u64;
    let cell = |i: usize| match &path.vertices()[i] {
        Vertex::Surface(surface) => {
            let [x, y, z] = (surface.at.position + Vec3::splat(8.0)).floor().to_array();
            x as u64 * 10_000 + y as u64 * 100 + z as u64
        }
        Vertex::Lens { .. } | Vertex::Light(_) => 0,
    };
    let kinds = path.events().iter().fold(1, |sum, event| {
        sum * 4
            + match event {
                Event::Smooth => 0,
                Event::Delta(lobe) => 1 + lobe.kind as u64,
            }
    });
    [
        block(raster.y, scene.film.height) * 4 + block(raster.x, scene.film.width),
        cell(1),
        cell(path.k() - 1),
        kinds,
        path.k() as u64,
    ]
}

/// A sum over independent samples whose mean should be 0.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    count: u64,
    sum: f64,
    squares: f64,
}

impl Tally {
    fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.squares += value * value;
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
    }
}

/// What went from region to region in one step, and what came to each region in all steps.
#[derive(Debug, Default)]
pub(crate) struct Flow {
    /// Partition, the two regions.
    pairs: BTreeMap<(usize, u64, u64), Tally>,
    /// Partition, region.
    arrivals: BTreeMap<(usize, u64), Tally>,
    statistics: Statistics,
}

/// How a flow is measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measure {
    /// Samples.
    pub samples: u32,
    /// Steps of the chain that starts at one of the paths of each sample.
    pub steps: u32,
}

impl Flow {
    /// Chains of the given mutations, from seeds that one of them is suitable for.
    pub(crate) fn measure(mutations: &Mutations<'_>, measure: Measure) -> Self {
        let scene = mutations.scene;
        let is_wanted = |path: &Path<'_>| (0..4).any(|m| mutations.selection(m, path) > 0.0);
        let parts: Vec<Self> = (0..measure.samples.div_ceil(500))
            .into_par_iter()
            .map(|part| {
                let mut flow = Self { statistics: Statistics::new(4), ..Self::default() };
                let mut workspace = Workspace::default();
                for index in part * 500..(part + 1) * 500 {
                    let mut sampler = IndependentSampler::new(11, index, 0);
                    let found = seeds(scene, &mut sampler, &mut workspace, &is_wanted);
                    flow.follow(*mutations, found, measure.steps, &mut sampler);
                }
                flow
            })
            .collect();
        let mut whole = Self { statistics: Statistics::new(4), ..Self::default() };
        for part in &parts {
            for (&key, tally) in &part.pairs {
                whole.pairs.entry(key).or_default().merge(tally);
            }
            for (&key, tally) in &part.arrivals {
                whole.arrivals.entry(key).or_default().merge(tally);
            }
            whole.statistics.merge(&part.statistics);
        }
        whole
    }

    /// One chain from one of the seeds, chosen by weight.
    fn follow<'s>(
        &mut self,
        mut mutations: Mutations<'s>,
        mut found: Vec<(Path<'s>, f64)>,
        steps: u32,
        sampler: &mut IndependentSampler,
    ) {
        let total: f64 = found.iter().map(|(_, weight)| weight).sum();
        let mut left = total * sampler.next_f64();
        let chosen = found.iter().position(|(_, weight)| {
            left -= weight;
            left < 0.0
        });
        let Some(chosen) = chosen else { return };
        let (path, _) = found.swap_remove(chosen);
        let scene = mutations.scene;
        let before = regions(scene, &path);
        let mut chain = Chain::new(path, 4);
        for step in 0..steps {
            chain.step(&mut mutations, sampler, &mut |_: &Path<'s>, _| {});
            if step == 0 {
                let after = regions(scene, chain.state());
                for (partition, (a, b)) in before.into_iter().zip(after).enumerate() {
                    if a != b {
                        let value = if a < b { total } else { -total };
                        self.pairs.entry((partition, a.min(b), a.max(b))).or_default().add(value);
                    }
                }
            }
        }
        let after = regions(scene, chain.state());
        for (partition, (a, b)) in before.into_iter().zip(after).enumerate() {
            if a != b {
                self.arrivals.entry((partition, a)).or_default().add(-total);
                self.arrivals.entry((partition, b)).or_default().add(total);
            }
        }
        self.statistics.merge(chain.statistics());
    }

    /// As much goes one way as the other, and no region gains or loses.
    ///
    /// Of `n` z-scores the mean of squares is below `1 + 4 sqrt(2 / n)`, taking a quarter as many for their correlation, and
    /// none is beyond the quantile of level 10⁻⁴ over all. Regions that fewer than 200 samples crossed the border of do not
    /// count: rare bright events are not normally distributed.
    pub(crate) fn assert_balanced(&self, what: &str) {
        let score = |tally: &Tally| (tally.count >= 200).then(|| tally.sum / tally.squares.sqrt());
        let pairs: Vec<f64> = self.pairs.values().filter_map(score).collect();
        let arrivals: Vec<f64> = self.arrivals.values().filter_map(score).collect();
        for (of, scores) in [("flow", pairs), ("stationarity", arrivals)] {
            let n = scores.len() as f64;
            // Small steps seldom cross a border, and there may be no flow to judge.
            assert!(n >= 8.0 || of == "flow", "{what}, {of}: only {n} regions");
            if n < 8.0 {
                continue;
            }
            let mean_square = scores.iter().map(|z| z * z).sum::<f64>() / n;
            let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
            let bound = 1.0 + 4.0 * (8.0 / n).sqrt();
            assert!(mean_square < bound, "{what}, {of}: mean z² {mean_square:.2} of {n}");
            let p = p_of_z(largest);
            assert!(p > sidak(LEVEL, scores.len()), "{what}, {of}: |z| {largest:.2} of {n}");
        }
    }

    /// How the mutations fared.
    pub(crate) fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}
