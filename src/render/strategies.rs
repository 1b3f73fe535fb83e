//! What each strategy of bidirectional path tracing finds by itself (Veach 1997, figure 10.3; METHODS 3.3).

use super::RenderSettings;
use super::bidirectional::Numbers;
use crate::integrator::bdpt::{Bdpt, Workspace};
use crate::math::Rgb;
use crate::scene::Scene;
use crate::transport::Contribution;
use crate::transport::connect::Strategies;
use ndarray::Array3;
use quietlight_denoise::Image;
use rayon::prelude::*;

/// Memory that the images made together may take, in bytes. A single one of a very large picture may take more: 72 bytes a
/// pixel.
const MEMORY: u64 = 1 << 30;

/// Bytes for each pixel of an image, unweighted and weighted, while it is summed up and made.
const BYTES: u64 = 72;

/// Pixels whose contributions wait to be added up, about: a hundred megabytes at most.
const WAITING: usize = 1 << 14;

/// What one strategy finds: `s` vertices from the light, `t` from the eye.
#[derive(Clone, Debug)]
pub struct StrategyImage {
    /// Vertices found from the light.
    pub s: u32,
    /// Vertices found from the eye.
    pub t: u32,
    /// What the strategy would find alone, `[3, height, width]` of the crop window.
    pub unweighted: Image,
    /// Its share of the picture.
    pub weighted: Image,
    /// Non-finite contributions dropped.
    pub dropped: u64,
}

/// The strategies, `[s, t]`, for paths of one to `longest` edges: length after length, in each by the vertices from the
/// light. What is seen directly only the eye's walk finds; light walks into a lens of finite size only.
pub fn strategies(scene: &Scene, bdpt: &Bdpt, longest: u32) -> Vec<[u32; 2]> {
    let sees_lens = bdpt.strategies == Strategies::All && scene.camera.has_lens();
    let exists = |&[s, t]: &[u32; 2]| match s + t {
        2 => s == 0,
        _ => (t > 0 || sees_lens) && (s < 2 || bdpt.strategies != Strategies::FromCamera),
    };
    (1..=longest).flat_map(|k| (0..=k + 1).map(move |s| [s, k + 1 - s])).filter(exists).collect()
}

/// Makes the images of `wanted` from as many samples per pixel, those of a render with the same settings, on the threads of
/// the current rayon pool, and hands them to `each` in their order. As many are made together as fit into a gigabyte.
///
/// # Errors
/// The first one of `each`.
pub fn strategy_images<E>(
    scene: &Scene,
    bdpt: &Bdpt,
    settings: &RenderSettings,
    samples: u32,
    wanted: &[[u32; 2]],
    mut each: impl FnMut(StrategyImage) -> Result<(), E>,
) -> Result<(), E> {
    let at_once = (MEMORY / (BYTES * scene.film.crop_pixels().max(1))).max(1);
    for wanted in wanted.chunks(usize::try_from(at_once).unwrap_or(usize::MAX)) {
        for image in together(scene, bdpt, settings, samples, wanted) {
            each(image)?;
        }
    }
    Ok(())
}

/// Sums of one strategy.
struct Sums {
    /// Of each pixel: red, green, blue without weights, then with them.
    pixels: Vec<[f64; 6]>,
    dropped: u64,
}

fn together(
    scene: &Scene,
    bdpt: &Bdpt,
    settings: &RenderSettings,
    samples: u32,
    wanted: &[[u32; 2]],
) -> Vec<StrategyImage> {
    let [left, top, columns, rows] = scene.film.crop;
    let pixels: Vec<[u32; 2]> =
        (top..top + rows).flat_map(|y| (left..left + columns).map(move |x| [x, y])).collect();
    let longest = wanted.iter().map(|[s, t]| s + t - 1).max().unwrap_or(0);
    let max_depth = scene.limits.max_depth.unwrap_or(u32::MAX).min(longest);
    let numbers = Numbers { seed: settings.seed, sampler: settings.sampler };
    let empty = || Sums { pixels: vec![[0.0; 6]; pixels.len()], dropped: 0 };
    let mut sums: Vec<Sums> = wanted.iter().map(|_| empty()).collect();
    let place = |one: &Contribution| wanted.iter().position(|&[s, t]| [one.s, one.t] == [s, t]);

    for sample in 0..samples {
        for some in pixels.chunks(WAITING) {
            let found: Vec<Vec<Contribution>> = some
                .par_chunks(256)
                .map_init(Workspace::default, |workspace, pixels| {
                    let mut found = Vec::new();
                    for &pixel in pixels {
                        numbers.walk(scene, bdpt, pixel, sample, workspace, |pair| {
                            pair.connect(max_depth, &mut found);
                        });
                    }
                    found
                })
                .collect();
            for one in found.iter().flatten() {
                if let Some(place) = place(one) {
                    sums[place].add(one, scene.film.crop_pixel(one.raster));
                }
            }
        }
    }
    let (columns, rows) = (columns as usize, rows as usize);
    wanted
        .iter()
        .zip(sums)
        .map(|(&[s, t], sums)| {
            let image = |first: usize| {
                Array3::from_shape_fn((3, rows, columns), |(channel, y, x)| {
                    (sums.pixels[y * columns + x][first + channel] / f64::from(samples)) as f32
                })
            };
            let (unweighted, weighted) = (image(0), image(3));
            StrategyImage { s, t, unweighted, weighted, dropped: sums.dropped }
        })
        .collect()
}

impl Sums {
    fn add(&mut self, one: &Contribution, pixel: Option<usize>) {
        let colour: Rgb = one.diffuse + one.specular;
        if !colour.is_finite() {
            self.dropped += 1;
        } else if let Some(sums) = pixel.and_then(|pixel| self.pixels.get_mut(pixel)) {
            for (channel, value) in colour.to_array().map(f64::from).into_iter().enumerate() {
                sums[channel] += value;
                sums[channel + 3] += value * one.weight;
            }
        }
    }
}
