//! METHODS 14: the result is finite, nothing panics, and what the row states.

use super::*;

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
    let denoised = denoise(&layers, &Parameters::constant(), &|_| ()).unwrap();
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
    assert!(run(&layers, &Parameters::constant()).iter().all(|&value| value == 0.0));
}

#[test]
fn the_smallest_pictures_are_filtered() {
    for (width, height) in [(1, 1), (1, 9), (40, 1), (2, 2)] {
        let layers = noisy_layers(width, height, 3);
        let denoised = denoise(&layers, &Parameters::constant(), &|_| ()).unwrap();
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
    assert!(matches!(
        denoise(&nothing, &Parameters::constant(), &|_| ()),
        Err(Error::Shape { .. })
    ));
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
    let denoised = denoise(&layers, &Parameters::constant(), &|_| ()).unwrap();
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
    let denoised = denoise(&layers, &Parameters::constant(), &|_| ()).unwrap();
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
    let parameters = Parameters::constant();
    // Equal features have a distance of exactly 0 after a prefilter whose means round the same everywhere but at the
    // borders, where fewer numbers are added.
    assert_close(&run(&constant, &parameters), &run(&missing, &parameters), 1e-6);
    assert!(denoise(&missing, &parameters, &|_| ()).unwrap().report.groups.is_empty());
}
