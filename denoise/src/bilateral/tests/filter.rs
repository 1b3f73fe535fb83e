//! The filter against its equations (METHODS 13.7).

use super::super::stack::Stack;
use super::*;
use crate::window::clipped;

/// Equations of METHODS 9.6 as a double loop in double precision.
fn naive_filter(prepared: &Prepared, parameters: &Parameters) -> Image {
    let (colour, variance) = (&prepared.colour, &prepared.colour_variance);
    let (_, height, width) = colour.dim();
    let value =
        |image: &Image, channel: usize, (y, x): (usize, usize)| f64::from(image[[channel, y, x]]);
    Image::from_shape_fn(colour.dim(), |(channel, y, x)| {
        let lambda = |index: usize| match &parameters.lambda {
            Lambda::Learned => unreachable!(),
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
    // Not visibility: its prefiltered values, of one channel, may be equal in two pixels.
    for index in 0..5 {
        let mut lambda = [0.0; 6];
        lambda[index] = 1e30;
        assert_eq!(
            run(&layers, &plain(lambda)),
            layers.layers[&LayerKind::Beauty].mean,
            "lambda {index}"
        );
    }
}

#[test]
fn features_without_variance_differ_in_units_of_their_floor() {
    let mut layers = noisy_layers(37, 30, 7);
    let albedo = layers.layers.get_mut(&LayerKind::Albedo).unwrap();
    (albedo.variance, albedo.halves) = (Some(Image::zeros(albedo.mean.dim())), None);
    let prepared = Prepared::new(&layers).unwrap();
    let parameters = plain([0.0, 0.0, 0.0, 1e-4, 0.0, 0.0]);
    let found = prepared.filter(&parameters, &|_| ()).unwrap().image;
    assert_close(&found, &naive_filter(&prepared, &parameters), 2e-6);
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
        let image = run(&layers, &Parameters::constant());
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
    let settings = Settings { lambda: Multipliers::Constant([0.01; 6]), colour: 0.2, radius: 27 };
    let vectors = stack.filter(&settings, &|| ());
    assert_eq!(stack.filter_portably(&settings), vectors);
}
