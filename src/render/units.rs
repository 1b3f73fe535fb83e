//! Work that makes splats, shared among threads.

use crate::film::SplatFilm;
use crate::integrator::Splat;
use rayon::prelude::*;

/// How many units work before their splats go to the film: bounds the memory that waiting splats take, while threads wait
/// for the last of so many hardly at all.
const BATCH: usize = 1024;

/// Runs units of work on the threads of the current rayon pool, and adds their splats to `film` in the order of the units,
/// so that the bits do not depend on the threads. `run` says into which half they go.
pub(super) fn run_units<U: Send>(
    units: &mut [U],
    film: &mut SplatFilm,
    run: impl Fn(&mut U, &mut Vec<Splat>) -> usize + Sync,
) {
    for batch in units.chunks_mut(BATCH) {
        let work = |unit: &mut U| {
            let mut splats = Vec::new();
            (run(unit, &mut splats), splats)
        };
        let found: Vec<(usize, Vec<Splat>)> =
            batch.par_iter_mut().with_max_len(1).map(work).collect();
        for (half, splats) in &found {
            film.add_all(*half, splats);
        }
    }
}
