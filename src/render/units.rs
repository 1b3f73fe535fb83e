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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Radiance, Scale};
    use crate::math::Rgb;
    use crate::scene::FilmSettings;
    use glam::Vec2;
    use quietlight_denoise::{Image, Layer, LayerKind, Layers};
    use std::time::Duration;

    /// Numbers of three sizes too far apart for any sum, of which the two larger ones cancel: what is left of the smallest
    /// tells the order in which they were added up.
    fn splat(unit: usize) -> Splat {
        let value = match unit % 5 {
            0 => 1e38,
            1 => 3e19,
            2 => (1000 * unit * unit) as f32,
            3 => -3e19,
            _ => -1e38,
        };
        Splat { raster: Vec2::new(0.5, 0.5), diffuse: Rgb::splat(value), specular: Rgb::BLACK }
    }

    fn diffuse(film: &SplatFilm) -> Layer {
        let mean = Image::zeros((3, 1, 1));
        let mut layers = Layers { width: 1, height: 1, ..Layers::default() };
        layers.layers.insert(LayerKind::Diffuse, Layer { mean, variance: None, halves: None });
        film.put_into(&mut layers, &Scale { half: [1.0; 2], weight: [0.5; 2] }, Radiance::Replaced);
        layers.layers[&LayerKind::Diffuse].clone()
    }

    #[test]
    fn splats_come_to_the_film_in_the_order_of_units_whoever_is_first() {
        let settings = FilmSettings { width: 1, height: 1, crop: [0, 0, 1, 1] };
        // What a small number loses next to a larger one depends on which came before.
        let mut serial = SplatFilm::new(settings);
        (0..50).for_each(|unit| serial.add(unit & 1, &splat(unit)));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let mut parallel = SplatFilm::new(settings);
        let mut units: Vec<usize> = (0..50).collect();
        pool.install(|| {
            run_units(&mut units, &mut parallel, |unit, splats| {
                // The first take longest.
                std::thread::sleep(Duration::from_micros(100 * (50 - *unit as u64)));
                splats.push(splat(*unit));
                *unit & 1
            });
        });
        assert_eq!(diffuse(&serial).halves, diffuse(&parallel).halves);
        assert!(diffuse(&serial).mean.iter().any(|&value| value != 0.0));
    }
}
