//! What the whole denoiser promises its callers.

use super::*;

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
    let wide = Parameters {
        lambda: Lambda::Constant([0.01, 0.1, 0.1, 0.1, 0.1, 0.1]),
        colour: 0.01,
        ..Parameters::constant()
    };
    let denoised = denoise(&layers, &wide, &|_| ()).unwrap();
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
    denoise(&noisy_layers(9, 8, 1), &Parameters::constant(), &|part| {
        heard.lock().unwrap().push(part);
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
        denoise(&layers, &Parameters::constant(), &|_| ()),
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
