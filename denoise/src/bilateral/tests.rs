//! Proofs of METHODS 13.7 (the filter) and 14 (extremes).

use super::features::Feature;
use super::filter::Stack;
use super::prefilter::prefilter;
use super::*;
use crate::window::clipped;

/// Repeatable noise in `[−0.5, 0.5)`.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 16_777_216.0 - 0.5
    }

    fn image(&mut self, shape: (usize, usize, usize), centre: f32, width: f32) -> Image {
        Image::from_shape_simple_fn(shape, || centre + width * self.next())
    }
}

/// Layers of noise with everything there is; variances vary from pixel to pixel.
fn noisy_layers(width: usize, height: usize, seed: u32) -> Layers {
    let mut noise = Noise(seed);
    let mut layers = Layers { width, height, ..Default::default() };
    for kind in [LayerKind::Beauty].into_iter().chain(GROUPS) {
        let shape = (kind.components().len(), height, width);
        let halves = [noise.image(shape, 0.5, 1.0), noise.image(shape, 0.5, 1.0)];
        let mean = (&halves[0] + &halves[1]) * 0.5;
        let variance = Some(noise.image(shape, 0.05, 0.09));
        layers.layers.insert(kind, Layer { mean, variance, halves: Some(halves) });
    }
    layers
}

/// Parameters without spike removal, which is no part of the filter proper.
fn plain(lambda: [f32; 6]) -> Parameters {
    Parameters {
        lambda: Lambda::Constant(lambda),
        variance_spikes: None,
        result_spikes: None,
        ..Default::default()
    }
}

fn beauty_only(mean: Image, variance: f32) -> Layers {
    let (_, height, width) = mean.dim();
    let variance = Some(Image::from_elem(mean.dim(), variance));
    let layer = Layer { mean, variance, halves: None };
    Layers { width, height, layers: [(LayerKind::Beauty, layer)].into(), ..Default::default() }
}

fn run(layers: &Layers, parameters: &Parameters) -> Image {
    denoise(layers, parameters, &|_| ()).unwrap().image
}

fn assert_close(found: &Image, expected: &Image, tolerance: f32) {
    assert_eq!(found.dim(), expected.dim());
    for ((index, &found), &expected) in found.indexed_iter().zip(expected) {
        assert!(
            (found - expected).abs() <= tolerance,
            "{found} instead of {expected} at {index:?}"
        );
    }
}

/// Equations of METHODS 9.6 as a double loop in double precision.
fn naive_filter(prepared: &Prepared, parameters: &Parameters) -> Image {
    let (colour, variance) = (&prepared.colour, &prepared.colour_variance);
    let (_, height, width) = colour.dim();
    let value =
        |image: &Image, channel: usize, (y, x): (usize, usize)| f64::from(image[[channel, y, x]]);
    Image::from_shape_fn(colour.dim(), |(channel, y, x)| {
        let lambda = |index: usize| match &parameters.lambda {
            Lambda::Constant(values) => f64::from(values[index]),
            Lambda::PerPixel(image) => value(image, index, (y, x)),
        };
        let (mut sum, mut weights) = (0.0, 0.0);
        let i = (y, x);
        for j in clipped(y, parameters.window_radius, height)
            .flat_map(|y| clipped(x, parameters.window_radius, width).map(move |x| (y, x)))
        {
            let mut distance =
                lambda(0) * ((j.0 as f64 - y as f64).powi(2) + (j.1 as f64 - x as f64).powi(2));
            for q in 0..3 {
                let difference = value(colour, q, j) - value(colour, q, i);
                distance += f64::from(parameters.colour) * difference * difference
                    / (1e-10 + value(variance, q, j) + value(variance, q, i));
            }
            for feature in &prepared.features {
                for q in 0..feature.mean.dim().0 {
                    let difference = value(&feature.mean, q, j) - value(&feature.mean, q, i);
                    distance += lambda(feature.group + 1) * difference * difference
                        / value(&feature.variance, q, i).max(1e-4);
                }
            }
            let weight = (-distance).exp();
            sum += weight * value(colour, channel, j);
            weights += weight;
        }
        (sum / weights) as f32
    })
}

#[test]
fn the_filter_equals_the_double_loop() {
    // Odd sizes, wider and narrower than the window and than a block of pixels, all groups present.
    for (width, height, lambda) in [
        (37, 70, [0.003, 0.02, 0.02, 0.02, 0.02, 0.02]),
        (70, 13, [0.0, 0.001, 0.01, 0.1, 0.0, 0.2]),
        (9, 5, [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ] {
        let prepared = Prepared::new(&noisy_layers(width, height, 7)).unwrap();
        let parameters = plain(lambda);
        let found = prepared.filter(&parameters, &|_| ()).unwrap().image;
        assert_close(&found, &naive_filter(&prepared, &parameters), 2e-6);
    }
}

#[test]
fn parameters_may_differ_from_pixel_to_pixel() {
    let (width, height) = (41, 9);
    let prepared = Prepared::new(&noisy_layers(width, height, 3)).unwrap();
    let lambda = Noise(11).image((6, height, width), 0.05, 0.1);
    let parameters = Parameters { lambda: Lambda::PerPixel(lambda), ..plain([0.0; 6]) };
    let found = prepared.filter(&parameters, &|_| ()).unwrap().image;
    assert_close(&found, &naive_filter(&prepared, &parameters), 2e-6);

    let constant = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
    let image = Image::from_shape_fn((6, height, width), |(index, _, _)| constant[index]);
    let per_pixel = Parameters { lambda: Lambda::PerPixel(image), ..plain([0.0; 6]) };
    let [one, other] =
        [plain(constant), per_pixel].map(|p| prepared.filter(&p, &|_| ()).unwrap().image);
    assert_eq!(one, other);
}

#[test]
fn a_small_window_is_a_window() {
    let prepared = Prepared::new(&noisy_layers(33, 20, 5)).unwrap();
    for radius in [0, 1, 5] {
        let parameters =
            Parameters { window_radius: radius, ..plain([0.01, 0.01, 0.01, 0.01, 0.01, 0.01]) };
        let found = prepared.filter(&parameters, &|_| ()).unwrap().image;
        assert_close(&found, &naive_filter(&prepared, &parameters), 2e-6);
    }
}

#[test]
fn huge_parameters_give_the_input() {
    let layers = noisy_layers(30, 31, 2);
    for index in 0..6 {
        let mut lambda = [0.0; 6];
        lambda[index] = 1e30;
        if index == 5 {
            continue; // Visibility has few values below its floor of variance that differ; it is tested by the loop above.
        }
        assert_eq!(
            run(&layers, &plain(lambda)),
            layers.layers[&LayerKind::Beauty].mean,
            "lambda {index}"
        );
    }
}

#[test]
fn no_distance_gives_the_box_mean() {
    // λ = 0 and a huge variance: the mean of the 55×55 window clipped at the borders.
    let mean = Noise(1).image((3, 40, 60), 0.5, 1.0);
    let found = run(&beauty_only(mean.clone(), 1e12), &plain([0.0; 6]));
    let expected = Image::from_shape_fn(mean.dim(), |(channel, y, x)| {
        let (rows, columns) = (clipped(y, 27, 40), clipped(x, 27, 60));
        let count = (rows.len() * columns.len()) as f64;
        let values = rows.flat_map(|y| columns.clone().map(move |x| (y, x)));
        (values.map(|(y, x)| f64::from(mean[[channel, y, x]])).sum::<f64>() / count) as f32
    });
    assert_close(&found, &expected, 1e-6);
}

#[test]
fn a_constant_image_stays_exactly_constant() {
    for value in [0.1, 0.333_333, 7e-4, 1234.567, 0.0] {
        let mut layers = noisy_layers(65, 12, 9);
        let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
        beauty.mean.fill(value);
        let image = run(&layers, &Parameters::default());
        assert!(image.iter().all(|&pixel| pixel == value), "{value}");
    }
}

#[test]
fn a_permutation_of_the_channels_commutes() {
    let layers = noisy_layers(45, 29, 4);
    let order = [2, 0, 1];
    let permuted = |image: &Image| image.select(ndarray::Axis(0), &order);
    let mut other = layers.clone();
    let beauty = other.layers.get_mut(&LayerKind::Beauty).unwrap();
    beauty.mean = permuted(&beauty.mean);
    beauty.variance = beauty.variance.as_ref().map(permuted);
    beauty.halves = beauty.halves.as_ref().map(|halves| halves.each_ref().map(permuted));
    // The three colour distances are added in another order, hence not bit for bit.
    let parameters = plain([0.01, 0.05, 0.05, 0.05, 0.05, 0.05]);
    assert_close(&run(&other, &parameters), &permuted(&run(&layers, &parameters)), 1e-6);
}

#[test]
fn different_pixels_without_variance_pass_through() {
    // Any two pixels differ by 1e-3 or more in the red channel: λ_c D_c ≥ 0.01 · 1e-6 / 1e-10 = 100.
    let mean = Image::from_shape_fn((3, 23, 35), |(channel, y, x)| {
        let index = (y * 35 + x) * 283 % (23 * 35);
        if channel == 0 { index as f32 * 1.01e-3 } else { 0.5 }
    });
    assert_close(&run(&beauty_only(mean.clone(), 0.0), &plain([0.0; 6])), &mean, 1e-6);
}

#[test]
fn two_pixels_of_the_worked_example_mix_one_to_two() {
    // METHODS N.11: λ₀ = ln 2, all else 0, c = (0, 1) gives 1/3 and 2/3.
    let mean = Image::from_shape_fn((3, 1, 2), |(_, _, x)| x as f32);
    let parameters =
        Parameters { colour: 0.0, ..plain([std::f32::consts::LN_2, 0.0, 0.0, 0.0, 0.0, 0.0]) };
    let image = run(&beauty_only(mean, 0.0), &parameters);
    for channel in 0..3 {
        assert!(
            (image[[channel, 0, 0]] - 1.0 / 3.0).abs() < 1e-6
                && (image[[channel, 0, 1]] - 2.0 / 3.0).abs() < 1e-6
        );
    }
}

#[test]
fn the_window_is_clipped_at_the_borders() {
    // One bright pixel; with λ = 0 its light reaches exactly the pixels within 27 rows and columns.
    let mut mean = Image::zeros((3, 64, 70));
    for channel in 0..3 {
        mean[[channel, 3, 66]] = 1.0;
    }
    let image = run(&beauty_only(mean, 1e12), &plain([0.0; 6]));
    for ((_, y, x), &value) in image.indexed_iter() {
        let expected = if y <= 30 && x >= 39 {
            1.0 / (clipped(y, 27, 64).len() * clipped(x, 27, 70).len()) as f32
        } else {
            0.0
        };
        assert!((value - expected).abs() < 1e-9, "{value} instead of {expected} at ({x}, {y})");
    }
}

#[test]
fn a_pixel_does_not_know_its_block_tile_or_thread() {
    // A pixel whose whole support (27 of the filter, 10 of the variance, 10 of the prefilter) lies in a crop has the same
    // bits there, though it lies in other blocks and tiles.
    let layers = noisy_layers(151, 103, 8);
    let (left, top, margin) = (13, 5, 48);
    let mut crop = layers.clone();
    (crop.width, crop.height) = (151 - left, 103 - top);
    let cut = |image: &Image| image.slice(ndarray::s![.., top.., left..]).to_owned();
    for layer in crop.layers.values_mut() {
        layer.mean = cut(&layer.mean);
        layer.variance = layer.variance.as_ref().map(cut);
        layer.halves = layer.halves.as_ref().map(|halves| halves.each_ref().map(cut));
    }
    // The position is normalised by the box of the picture, which the crop changes.
    crop.layers.remove(&LayerKind::Position);
    let mut whole = layers;
    whole.layers.remove(&LayerKind::Position);
    let parameters = plain([0.005, 0.0, 0.02, 0.02, 0.02, 0.02]);
    let [one, other] = [run(&whole, &parameters), run(&crop, &parameters)];
    for y in top + margin..103 {
        for x in left + margin..151 {
            for channel in 0..3 {
                assert_eq!(
                    one[[channel, y, x]].to_bits(),
                    other[[channel, y - top, x - left]].to_bits(),
                    "({x}, {y})"
                );
            }
        }
    }

    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(alone.install(|| run(&whole, &parameters)), one);
}

#[test]
fn vectors_of_every_width_give_the_same_bits() {
    let layers = noisy_layers(70, 12, 6);
    let prepared = Prepared::new(&layers).unwrap();
    let stack = Stack::new(&prepared.colour, &prepared.colour_variance, &prepared.features);
    let parameters = plain([0.01; 6]);
    let vectors = stack.filter(&parameters, &|| ());
    assert_eq!(stack.filter_portably(&parameters), vectors);
}

/// Equations of METHODS 9.3 as loops in double precision.
fn naive_prefilter(feature: &Feature) -> [Image; 2] {
    let (channels, height, width) = feature.mean.dim();
    let partner = |(y, x): (usize, usize), (dy, dx): (isize, isize)| {
        let (y, x) = (y.checked_add_signed(dy)?, x.checked_add_signed(dx)?);
        (y < height && x < width).then_some((y, x))
    };
    let near = |(y, x): (usize, usize), radius: usize| {
        clipped(y, radius, height).flat_map(move |y| clipped(x, radius, width).map(move |x| (y, x)))
    };
    let value = |image: &Image, q: usize, (y, x): (usize, usize)| f64::from(image[[q, y, x]]);
    let squared = |i, offset| {
        let j = partner(i, offset)?;
        let term = |q| {
            let difference = value(&feature.mean, q, j) - value(&feature.mean, q, i);
            difference * difference
                / (1e-10 + value(&feature.variance, q, j) + value(&feature.variance, q, i))
        };
        Some((0..channels).map(term).sum::<f64>() / channels as f64)
    };
    let average = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let mut results = [(); 2].map(|()| Image::zeros(feature.mean.dim()));
    for i in near((0, 0), height.max(width)) {
        let mut weights = 0.0;
        let mut sums = vec![[0.0; 2]; channels];
        for offset in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
            let Some(j) = partner(i, offset) else { continue };
            let weight = |i| {
                let patch = near(i, 3).filter_map(|p| squared(p, offset)).collect();
                (-average(patch)).exp()
            };
            let smooth =
                average(near(i, 2).filter(|&p| partner(p, offset).is_some()).map(weight).collect());
            weights += smooth;
            for (q, sums) in sums.iter_mut().enumerate() {
                sums[0] += smooth * value(&feature.mean, q, j);
                sums[1] += smooth * value(&feature.variance, q, j);
            }
        }
        for (q, sums) in sums.iter().enumerate() {
            for (result, sum) in results.iter_mut().zip(sums) {
                result[[q, i.0, i.1]] = (sum / weights) as f32;
            }
        }
    }
    results
}

#[test]
fn the_prefilter_equals_the_loops() {
    for shape in [(3, 9, 13), (1, 12, 4), (3, 1, 1), (1, 2, 7)] {
        let mut noise = Noise(17);
        let mean = noise.image(shape, 0.5, 1.0);
        let feature = Feature { group: 0, mean, variance: noise.image(shape, 0.04, 0.07) };
        let found = prefilter(&feature);
        let [mean, variance] = naive_prefilter(&feature);
        assert_close(&found.mean, &mean, 2e-6);
        assert_close(&found.variance, &variance, 2e-6);
    }
}

#[test]
fn the_prefilter_takes_noise_and_leaves_edges() {
    let mut noise = Noise(23);
    let shape = (1, 40, 80);
    // Two flat halves, noise of variance 1/300 on both.
    let mean = Image::from_shape_fn(shape, |(_, _, x)| if x < 40 { 0.2 } else { 0.8 })
        + noise.image(shape, 0.0, 0.2);
    let clean = Image::from_shape_fn(shape, |(_, _, x)| if x < 40 { 0.2 } else { 0.8 });
    let feature =
        Feature { group: 0, mean: mean.clone(), variance: Image::from_elem(shape, 1.0 / 300.0) };
    let error = |image: &Image| (image - &clean).mapv(|value| value * value).sum();
    assert!(error(&prefilter(&feature).mean) < 0.1 * error(&mean));
}

#[test]
fn the_filter_takes_noise_and_leaves_what_the_features_show() {
    let (width, height) = (96, 64);
    let clean = Image::from_shape_fn((3, height, width), |(_, y, x)| {
        if (x / 16 + y / 16) % 2 == 0 { 0.2 } else { 0.8 }
    });
    let noisy = &clean + &Noise(31).image((3, height, width), 0.0, 1.0);
    let mut layers = beauty_only(noisy.clone(), 1.0 / 12.0);
    let albedo =
        Layer { mean: clean.clone(), variance: Some(Image::zeros(clean.dim())), halves: None };
    layers.layers.insert(LayerKind::Albedo, albedo);
    let error = |image: &Image| (image - &clean).mapv(|value| value * value).mean().unwrap();
    let denoised = denoise(&layers, &Parameters::default(), &|_| ()).unwrap();
    assert_eq!(denoised.report.groups, [LayerKind::Albedo]);
    assert!(
        error(&denoised.image) < 0.02 * error(&noisy),
        "{} of {}",
        error(&denoised.image),
        error(&noisy)
    );
}

#[test]
fn progress_ends_at_one() {
    let heard = std::sync::Mutex::new(Vec::new());
    denoise(&noisy_layers(9, 8, 1), &Parameters::default(), &|part| {
        heard.lock().unwrap().push(part)
    })
    .unwrap();
    let mut heard = heard.into_inner().unwrap();
    heard.sort_by(f32::total_cmp);
    assert_eq!((heard.len(), heard[7]), (8, 1.0));
}

#[test]
fn the_parts_make_a_beauty_where_there_is_none() {
    let mut layers = noisy_layers(12, 10, 1);
    let beauty = layers.layers.remove(&LayerKind::Beauty).unwrap();
    assert!(matches!(
        denoise(&layers, &Parameters::default(), &|_| ()),
        Err(Error::MissingLayer { .. })
    ));
    let half = |layer: &Layer| Layer { mean: &layer.mean * 0.5, variance: None, halves: None };
    layers
        .layers
        .extend([(LayerKind::Diffuse, half(&beauty)), (LayerKind::Specular, half(&beauty))]);
    assert_close(&run(&layers, &plain([1e30, 0.0, 0.0, 0.0, 0.0, 0.0])), &beauty.mean, 1e-6);
}

#[test]
fn senseless_parameters_are_refused() {
    let layers = noisy_layers(4, 4, 1);
    let default = Parameters::default;
    for parameters in [
        plain([f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]),
        plain([0.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
        Parameters { colour: f32::INFINITY, ..default() },
        Parameters { window_radius: 28, ..default() },
        Parameters { result_spikes: Some(-1.0), ..default() },
        Parameters { lambda: Lambda::PerPixel(Image::from_elem((6, 4, 4), -0.5)), ..default() },
    ] {
        assert!(
            matches!(denoise(&layers, &parameters, &|_| ()), Err(Error::Parameter { .. })),
            "{parameters:?}"
        );
    }
    let parameters = Parameters { lambda: Lambda::PerPixel(Image::zeros((6, 4, 5))), ..default() };
    assert!(matches!(denoise(&layers, &parameters, &|_| ()), Err(Error::Shape { .. })));
}

// METHODS 14: the result is finite, nothing panics, and what the row states.

#[test]
fn nan_infinite_and_negative_buffers_give_a_finite_picture_and_a_count() {
    let mut layers = noisy_layers(33, 21, 12);
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    for (index, &value) in bad.iter().enumerate() {
        for layer in layers.layers.values_mut() {
            layer.mean[[0, 3 + index, 4]] = value;
            layer.variance.as_mut().unwrap()[[0, 5, 6 + index]] = value;
        }
    }
    layers.layers.get_mut(&LayerKind::Normal).unwrap().variance.as_mut().unwrap()[[1, 0, 0]] = -1.0;
    layers.layers.get_mut(&LayerKind::Beauty).unwrap().halves = None;
    let denoised = denoise(&layers, &Parameters::default(), &|_| ()).unwrap();
    assert!(denoised.image.iter().all(|value| value.is_finite()));
    // The noise has a third of its variances below 0.005, none of them negative.
    assert_eq!(
        denoised.report.sanitised,
        Sanitised { radiance: 3, variance: 6 * 3 + 1, features: 5 * 3 }
    );
}

#[test]
fn a_picture_of_nothing_but_nan_is_black() {
    let layers = beauty_only(Image::from_elem((3, 5, 6), f32::NAN), f32::NAN);
    assert!(run(&layers, &Parameters::default()).iter().all(|&value| value == 0.0));
}

#[test]
fn the_smallest_pictures_are_filtered() {
    for (width, height) in [(1, 1), (1, 9), (40, 1), (2, 2)] {
        let layers = noisy_layers(width, height, 3);
        let denoised = denoise(&layers, &Parameters::default(), &|_| ()).unwrap();
        assert_eq!(denoised.image.dim(), (3, height, width));
        assert!(denoised.image.iter().all(|value| value.is_finite()), "{width}x{height}");
        if width * height == 1 {
            assert_eq!(denoised.image, layers.layers[&LayerKind::Beauty].mean);
        }
    }
    let nothing = Layers {
        layers: beauty_only(Image::zeros((3, 0, 4)), 0.0).layers,
        width: 4,
        ..Default::default()
    };
    assert!(matches!(denoise(&nothing, &Parameters::default(), &|_| ()), Err(Error::Shape { .. })));
}

#[test]
fn a_finite_firefly_of_1e30_stays_finite_and_alone() {
    let mut layers = noisy_layers(64, 64, 14);
    for layer in layers.layers.values_mut() {
        layer.halves = None;
    }
    let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
    for channel in 0..3 {
        beauty.mean[[channel, 32, 32]] = 1e30;
        beauty.variance.as_mut().unwrap()[[channel, 32, 32]] = f32::MAX;
    }
    let denoised = denoise(&layers, &Parameters::default(), &|_| ()).unwrap();
    // The spikes of variance and of the result remove it; without its variance nobody else accepts its light.
    assert!(denoised.image.iter().all(|value| value.abs() < 2.0), "{:?}", denoised.report);
    let plain = plain([0.01; 6]);
    assert!(run(&layers, &plain).iter().all(|value| value.is_finite()));
}

#[test]
fn one_sample_a_pixel_takes_the_variance_of_the_neighbours_and_says_so() {
    let mut layers = noisy_layers(20, 16, 15);
    for layer in layers.layers.values_mut() {
        (layer.variance, layer.halves) = (None, None);
    }
    layers.samples = Some(Image::from_elem((1, 16, 20), 1.0));
    let denoised = denoise(&layers, &Parameters::default(), &|_| ()).unwrap();
    assert_eq!(denoised.report.spatial_variance.len(), 6);
    assert!(denoised.image.iter().all(|value| value.is_finite()));
}

#[test]
fn constant_features_are_no_features() {
    let layers = noisy_layers(40, 20, 16);
    let mut constant = layers.clone();
    let mut missing = layers;
    for kind in GROUPS {
        let layer = constant.layers.get_mut(&kind).unwrap();
        layer.mean.fill(0.7);
        (layer.variance, layer.halves) = (Some(Image::zeros(layer.mean.dim())), None);
        missing.layers.remove(&kind);
    }
    let parameters = Parameters::default();
    // Equal features have a distance of exactly 0 after a prefilter whose means round the same everywhere but at the
    // borders, where fewer numbers are added.
    assert_close(&run(&constant, &parameters), &run(&missing, &parameters), 1e-6);
    assert!(denoise(&missing, &parameters, &|_| ()).unwrap().report.groups.is_empty());
}
