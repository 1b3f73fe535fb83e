//! The multi-chain perturbation: paths that, seen from the eye, go through two or more chains of delta events, each ended by
//! a smooth vertex, before they meet a smooth edge (Veach and Guibas 1997, section 5.3.4; METHODS 5.7).
//!
//! The chains may also go down to the light and meet the emitter there, as those of a lamp seen from above the water that it
//! shines through: then nothing is connected (Mitsuba 0.6 does the same through its node for all emitters).
//!
//! The first chain begins at a moved raster position; at each smooth vertex but the last the old direction turns a little.
//! With `x_j` the last, `C ∝ lum(L_e ∏ f̄ ∏ ρ) ∏ |cos θ_i| G(x_{j-1}, x_j)` over the smooth vertices between, without the
//! last factor where an emitter is met: the angle of a
//! turn is the same both ways, and so is its density.

use super::super::{Failure, Proposal};
use super::MutationSettings;
use super::trace::{Walk, check, is_smooth, moved, smooth_before, turned};
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::{Path, Side};

pub(super) fn is_suitable(path: &Path<'_>) -> bool {
    end(path).is_some()
}

/// Index of the smooth vertex that the last chain ends in; 0 where it meets the emitter.
fn end(path: &Path<'_>) -> Option<usize> {
    let first = smooth_before(path, path.k());
    let mut j = first;
    while j > 0 {
        if is_smooth(path, j - 1) {
            return (j < first).then_some(j);
        }
        j = smooth_before(path, j - 1);
    }
    (first > 0 && path.is_emitter_hittable()).then_some(0)
}

pub(super) fn propose<'s, S: Sampler>(
    scene: &'s Scene,
    settings: &MutationSettings,
    path: &Path<'s>,
    sampler: &mut S,
) -> Result<Proposal<Path<'s>>, Failure> {
    let end = end(path).ok_or(Failure::Impossible)?;
    let (raster, lens) = path.lens();
    let raster = moved(scene, raster, settings.raster, sampler)?;
    let turns: Vec<(f64, f32)> = (end + 1..path.k())
        .filter(|&i| is_smooth(path, i))
        .map(|_| (settings.turn.sample(f64::from(sampler.next_1d())), sampler.next_1d()))
        .collect();
    let mut walk = Walk::new(scene, path, sampler);
    let (mut ray, mut i) = walk.chain(scene.camera.ray(raster, lens), path.k() - 1, Side::Eye)?;
    for (angle, u) in turns {
        let surface = walk.smooth(ray)?;
        let direction = turned(-path.direction(i - 1), angle, u);
        surface.local(direction).ok_or(Failure::Dark)?;
        (ray, i) = walk.chain(surface.at.spawn(direction), i - 1, Side::Eye)?;
    }
    let state = if end == 0 {
        walk.light(ray)?;
        walk.from_eye(raster)?
    } else {
        walk.smooth(ray)?;
        let state = walk.from_eye(raster)?;
        check(scene, path, &state, end - 1)?;
        state
    };
    let [forward, backward] = [&state, path].map(|path| {
        let cosines: f64 = (end + 1..path.k()).map(|i| path.ln_eye_factor(i)).sum();
        let connection = if end == 0 { 0.0 } else { path.ln_connection(end - 1) };
        path.ln_value() + cosines + connection
    });
    Ok(Proposal { state, forward, backward })
}
