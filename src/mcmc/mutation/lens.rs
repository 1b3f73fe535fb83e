//! The lens perturbation: paths of which the eye sees, through any delta events, a smooth vertex whose other neighbour is
//! smooth, too, or the emitter itself (Veach and Guibas 1997, section 5.3.2; METHODS 5.5).
//!
//! With `x_j` the first smooth vertex seen from the eye, `C ∝ lum(L_e ∏ f̄ ∏ ρ) G(x_{j-1}, x_j)`: the density of the raster
//! offset is symmetric, and the importance is the density of raster points, so that nothing about the camera is left.
//! Nothing is connected, and nothing left but the luminance, where `j = 0`.

use super::super::{Failure, Proposal};
use super::MutationSettings;
use super::trace::{Walk, check, is_smooth, moved, smooth_before};
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::{Path, Side};

pub(super) fn is_suitable(path: &Path<'_>) -> bool {
    let j = smooth_before(path, path.k());
    j == 0 || is_smooth(path, j - 1)
}

pub(super) fn propose<'s, S: Sampler>(
    scene: &'s Scene,
    settings: &MutationSettings,
    path: &Path<'s>,
    sampler: &mut S,
) -> Result<Proposal<Path<'s>>, Failure> {
    let (raster, lens) = path.lens();
    let raster = moved(scene, raster, settings.raster, sampler)?;
    let mut walk = Walk::new(scene, path, sampler);
    let (ray, j) = walk.chain(scene.camera.ray(raster, lens), path.k() - 1, Side::Eye)?;
    if j == 0 {
        walk.light(ray)?;
        let state = walk.from_eye(raster)?;
        let [forward, backward] = [state.ln_value(), path.ln_value()];
        return Ok(Proposal { state, forward, backward });
    }
    walk.smooth(ray)?;
    let state = walk.from_eye(raster)?;
    check(scene, path, &state, j - 1)?;
    let [forward, backward] =
        [&state, path].map(|path| path.ln_value() + path.ln_connection(j - 1));
    Ok(Proposal { state, forward, backward })
}
