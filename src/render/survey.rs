//! What walks from the camera meet: a short look at a scene before it is rendered.

use super::{RenderSettings, replay};
use crate::scene::Scene;
use rayon::prelude::*;

/// Walks: a tenth of a second of one thread.
const WALKS: u32 = 1 << 13;

/// Cells along each side of the picture whose brightness is compared.
const CELLS: u32 = 16;

/// What walks of path tracing met, evenly spread over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Survey {
    /// Mean number of surfaces that a walk hit.
    pub hits: f64,
    /// Part of the walks that left the scene at once.
    pub background: f64,
    /// Part of the hits that were on materials with a delta lobe.
    pub delta_hits: f64,
    /// Most such hits in a row.
    pub longest_delta_chain: u32,
    /// Mean luminance of the picture, W/(sr·m²).
    pub mean: f64,
    /// Luminance of the brightest sample.
    pub brightest_sample: f64,
    /// Mean luminance of the darkest and the brightest cell, a sixteenth of the picture wide and high, that has any light.
    pub cells: Option<[f64; 2]>,
    /// Samples with something non-finite in them.
    pub invalid: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Walk {
    cell: usize,
    hits: u32,
    delta_hits: u32,
    longest: u32,
    luminance: Option<f64>,
}

impl Survey {
    /// Walks, on the threads of the current rayon pool; the same seed gives the same numbers.
    pub fn of(scene: &Scene, settings: &RenderSettings) -> Self {
        let walks: Vec<Walk> =
            (0..WALKS).into_par_iter().map(|index| walk(scene, settings, index)).collect();
        let sum = |number: fn(&Walk) -> u32| walks.iter().map(number).sum::<u32>();
        let count = f64::from(WALKS);
        let lights = || walks.iter().filter_map(|walk| walk.luminance);
        let valid = lights().count();
        let mut cells = vec![(0.0, 0u32); (CELLS * CELLS) as usize];
        for (cell, luminance) in walks.iter().filter_map(|walk| Some((walk.cell, walk.luminance?)))
        {
            cells[cell].0 += luminance;
            cells[cell].1 += 1;
        }
        let lit = cells.iter().filter(|cell| cell.0 > 0.0);
        let means = lit.map(|&(sum, count)| sum / f64::from(count));
        let cells = means.fold(None, |range: Option<[f64; 2]>, mean| {
            let [low, high] = range.unwrap_or([mean; 2]);
            Some([low.min(mean), high.max(mean)])
        });
        let hits = sum(|walk| walk.hits);
        Self {
            hits: f64::from(hits) / count,
            background: walks.iter().filter(|walk| walk.hits == 0).count() as f64 / count,
            delta_hits: f64::from(sum(|walk| walk.delta_hits)) / f64::from(hits.max(1)),
            longest_delta_chain: walks.iter().map(|walk| walk.longest).max().unwrap_or(0),
            mean: lights().sum::<f64>() / valid.max(1) as f64,
            brightest_sample: lights().fold(0.0, f64::max),
            cells,
            invalid: WALKS - valid as u32,
        }
    }
}

fn walk(scene: &Scene, settings: &RenderSettings, index: u32) -> Walk {
    let [left, top, width, height] = scene.film.crop;
    // The additive recurrence of the plastic number, as in `probe`.
    let at = |step: f64| (0.5 + f64::from(index) * step).fract();
    let [u, v] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3].map(at);
    let within = |u: f64, count: u32| ((u * f64::from(count)) as u32).min(count - 1);
    let pixel = [left + within(u, width), top + within(v, height)];
    let cell = within(v, CELLS) * CELLS + within(u, CELLS);
    let mut walk = Walk { cell: cell as usize, ..Walk::default() };
    let mut chain = 0;
    let found = replay(scene, settings, pixel, index, |vertex| {
        walk.hits += 1;
        let surface = scene.surfaces[vertex.at.part as usize];
        let is_delta = scene.materials[surface.material.0 as usize].has_delta();
        chain = if is_delta { chain + 1 } else { 0 };
        walk.delta_hits += u32::from(is_delta);
        walk.longest = walk.longest.max(chain);
    });
    let radiance = found.diffuse + found.specular;
    walk.luminance = found.is_finite().then(|| f64::from(radiance.luminance()));
    walk
}
