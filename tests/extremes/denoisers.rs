//! The denoisers at their extremes: both filters and the networks at every quality.

use super::{methods, rendered};
use crate::support::scenes::scene_from;
use ndarray::s;
use quietlight::integrator::PathTracing;
use quietlight::scene::Scene;
use quietlight_denoise::kpcn::Quality;
use quietlight_denoise::metrics::{flip, one_minus_ssim, psnr, relative_l2};
use quietlight_denoise::{Denoised, Denoiser, Image, Layer, LayerKind, Layers};

/// Every denoiser that a user can ask for.
pub(super) fn denoisers() -> [(&'static str, Denoiser); 5] {
    let network = |quality| Denoiser::embedded(quality).expect("the networks are there");
    [
        ("bilateral", Denoiser::bilateral()),
        ("bilateral-constant", Denoiser::bilateral_constant()),
        ("kpcn fast", network(Quality::Fast)),
        ("kpcn balanced", network(Quality::Balanced)),
        ("kpcn high", network(Quality::High)),
    ]
}

pub(super) fn threads() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads")
}

/// Denoises; the result must have the size of the picture and be finite.
pub(super) fn denoised(name: &str, denoiser: &Denoiser, layers: &Layers) -> Denoised {
    let denoised = denoiser.denoise(layers, &threads(), &|_| {}).expect(name);
    assert_eq!(denoised.image.dim(), (3, layers.height, layers.width), "{name}");
    assert!(denoised.image.iter().all(|value| value.is_finite()), "{name}");
    denoised
}

/// A ball of rough metal over a textured floor under a lamp and a sky: every layer there is.
fn scene(width: u32, height: u32) -> Scene {
    scene_from(&format!(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="5"/></integrator>
        <sensor type="perspective"><float name="fov" value="50"/>
            <transform name="to_world"><lookat origin="0,0.5,3" target="0,0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
                <rfilter type="box"/></film></sensor>
        <shape type="sphere"><point name="center" x="-0.5" y="0" z="0"/><float name="radius" value="0.6"/>
            <bsdf type="roughconductor"><string name="material" value="Cu"/><float name="alpha" value="0.2"/></bsdf></shape>
        <shape type="sphere"><point name="center" x="0.8" y="0" z="0"/><float name="radius" value="0.5"/>
            <bsdf type="dielectric"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/>
            <translate y="-0.6"/></transform><bsdf type="diffuse"><texture name="reflectance" type="checkerboard">
            <transform name="to_uv"><scale x="8" y="8"/></transform></texture></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.5"/>
            <translate y="2"/></transform><emitter type="area"><rgb name="radiance" value="5 4 3"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.5"/></emitter></scene>"#
    ))
}

/// The layers of a path-traced picture of the [`scene`].
fn picture(width: u32, height: u32, samples: u32) -> Layers {
    rendered(&scene(width, height), PathTracing::default().into(), samples, 1).layers
}

fn every_image(layer: &mut Layer) -> impl Iterator<Item = &mut Image> {
    let Layer { mean, variance, halves } = layer;
    [mean].into_iter().chain(variance).chain(halves.iter_mut().flatten())
}

#[test]
fn the_smallest_pictures_are_denoised_and_scored() {
    for (width, height) in [(1, 1), (1, 23), (23, 1), (2, 2)] {
        for samples in [1, 4] {
            let layers = picture(width, height, samples);
            let noisy = &layers.layers[&LayerKind::Beauty].mean;
            for (name, denoiser) in denoisers() {
                let image = denoised(name, &denoiser, &layers).image;
                let what = format!("{name}, {width}×{height}, {samples}");
                assert!(relative_l2(&image, noisy).expect(&what).is_finite(), "{what}");
                assert!(!psnr(&image, noisy).expect(&what).is_nan(), "{what}");
                assert!(flip(&image, noisy, 67.0).expect(&what).is_finite(), "{what}");
                // No window of structure fits into one or two pixels.
                assert_eq!(one_minus_ssim(&image, noisy).expect(&what), None, "{what}");
            }
        }
    }
}

#[test]
fn one_sample_a_pixel_of_every_method_is_denoised() {
    let scene = scene(20, 14);
    let path = [("path", PathTracing::default().into())];
    for (method, integrator) in path.into_iter().chain(methods()) {
        let layers = rendered(&scene, integrator, 1, 1).layers;
        for (name, denoiser) in denoisers() {
            let denoised = denoised(name, &denoiser, &layers);
            // Energy redistribution has two or three chains here, a few bright pixels that a filter takes away.
            let is_lit = denoised.image.iter().any(|&value| value > 0.0);
            assert!(is_lit || method.starts_with("erpt"), "{method}, {name}");
            // Of one sample nobody knows the noise, and nothing noisy is mixed back in; chains are in two halves.
            let is_sampled = matches!(method, "path" | "bdpt" | "visibility");
            if is_sampled && name.starts_with("kpcn") {
                let (_, told) = &denoised
                    .details
                    .iter()
                    .find(|(key, _)| *key == "denoiser.mixture")
                    .expect("told");
                assert!(told.contains("not known"), "{method}, {name}: {told}");
            }
        }
    }
}

#[test]
fn broken_numbers_in_any_buffer_are_replaced_and_counted() {
    let sound = picture(24, 17, 4);
    let numbers = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    for (name, denoiser) in denoisers() {
        let clean = denoised(name, &denoiser, &sound);
        assert_eq!(clean.sanitised.total(), 0, "{name}");
        // All kinds of numbers in all buffers at once: the picture stays what it was, up to what some pixels tell.
        let mut all = sound.clone();
        for layer in all.layers.values_mut() {
            for image in every_image(layer) {
                for (x, number) in numbers.into_iter().enumerate() {
                    image[[0, 8, 4 + 3 * x]] = number;
                }
            }
            if let Some(variance) = &mut layer.variance {
                variance[[0, 3, 3]] = -1.0;
            }
        }
        let mended = denoised(name, &denoiser, &all);
        assert!(mended.sanitised.total() > 30, "{name}: {:?}", mended.sanitised);
        let difference = relative_l2(&mended.image, &clean.image).expect(name);
        assert!(difference < 0.02, "{name}: {difference}");
        // Nothing but broken numbers, in one layer after the other: light becomes black, features say nothing.
        for kind in sound.layers.keys() {
            for number in numbers.into_iter().chain([-1e30]) {
                let mut spoiled = sound.clone();
                let layer = spoiled.layers.get_mut(kind).expect("it is there");
                every_image(layer).for_each(|image| image.fill(number));
                let denoised = denoised(name, &denoiser, &spoiled);
                assert!(
                    !denoised.image.iter().any(|value| value.abs() > 1e16),
                    "{name}: {number} in {kind:?}"
                );
            }
        }
    }
}

#[test]
fn a_firefly_of_1e30_is_finite_and_stays_where_it_is() {
    // Networks and filters see no further than some 60 pixels, and half the picture is further away.
    let sound = picture(200, 24, 4);
    for (name, denoiser) in denoisers() {
        let clean = denoised(name, &denoiser, &sound).image;
        for value in [1e30, f32::MAX] {
            let mut hot = sound.clone();
            for kind in [LayerKind::Beauty, LayerKind::Diffuse] {
                let layer = hot.layers.get_mut(&kind).expect("it is there");
                for image in every_image(layer) {
                    image.slice_mut(s![.., 12, 12]).fill(value);
                }
            }
            let image = denoised(name, &denoiser, &hot).image;
            let far = |image: &Image| image.slice(s![.., .., 100..]).to_owned();
            let difference = relative_l2(&far(&image), &far(&clean)).expect(name);
            assert!(difference < 0.01, "{name}, {value}: {difference}");
        }
    }
}

#[test]
fn features_that_are_constant_or_missing_leave_a_finite_picture_of_the_same_light() {
    let sound = picture(48, 32, 8);
    let features: Vec<LayerKind> =
        sound.layers.keys().copied().filter(|kind| !kind.is_radiance()).collect();
    assert_eq!(features.len(), 6, "{features:?}");
    let mean =
        |image: &Image| image.iter().map(|&v| f64::from(v)).sum::<f64>() / image.len() as f64;
    let light = mean(&sound.layers[&LayerKind::Beauty].mean);
    for (name, denoiser) in denoisers() {
        let check = |layers: &Layers, what: &str| {
            let found = mean(&denoised(name, &denoiser, layers).image);
            // Filters move light around and take outliers away, no more.
            assert!((found / light - 1.0).abs() < 0.1, "{name}, {what}: {found}, noisy {light}");
        };
        check(&sound, "all");
        let mut none = sound.clone();
        let mut flat = sound.clone();
        for &kind in &features {
            let mut missing = sound.clone();
            missing.layers.remove(&kind);
            check(&missing, &format!("{kind:?} missing"));
            none.layers.remove(&kind);
            for value in [0.0, 0.7] {
                let mut constant = sound.clone();
                for layers in [&mut constant, &mut flat] {
                    let layer = layers.layers.get_mut(&kind).expect("it is there");
                    every_image(layer).for_each(|image| image.fill(value));
                    layer.variance.iter_mut().for_each(|variance| variance.fill(0.0));
                }
                check(&constant, &format!("{kind:?} {value}"));
            }
        }
        check(&none, "no features");
        check(&flat, "constant features");
        // Nothing but the noisy picture.
        none.layers.retain(|&kind, _| kind == LayerKind::Beauty);
        none.layers.values_mut().for_each(|layer| (layer.variance, layer.halves) = (None, None));
        none.samples = None;
        check(&none, "colour alone");
    }
}

#[test]
fn light_a_power_of_two_brighter_is_denoised_alike() {
    // Signals have the exposure divided out, so that a picture times 2^k is denoised to 2^k times the same. Without mixing:
    // what is mixed back is judged by relative L2, whose denominator tells light below 0.1 from brighter light.
    let sound = picture(48, 32, 4);
    let [.., (_, fast), (_, balanced), (_, high)] = denoisers();
    let unmixed = |denoiser: Denoiser| match denoiser {
        Denoiser::Kpcn { networks, quality } => {
            Denoiser::Kpcn { networks: networks.without_mixing(), quality }
        }
        filter => filter,
    };
    for (name, denoiser) in [
        ("bilateral", Denoiser::bilateral()),
        ("bilateral-constant", Denoiser::bilateral_constant()),
        ("kpcn fast", unmixed(fast)),
        ("kpcn balanced", unmixed(balanced)),
        ("kpcn high", unmixed(high)),
    ] {
        let expected = denoised(name, &denoiser, &sound).image;
        for exponent in [-27, -14, 14, 27] {
            let factor = 2f32.powi(exponent);
            let mut other = sound.clone();
            for (_, layer) in other.layers.iter_mut().filter(|(kind, _)| kind.is_radiance()) {
                every_image(layer).for_each(|image| *image *= factor);
                layer.variance.iter_mut().for_each(|variance| *variance *= factor);
            }
            let found = denoised(name, &denoiser, &other).image / factor;
            let difference = relative_l2(&found, &expected).expect(name);
            assert!(difference < 1e-8, "{name}, 2^{exponent}: {difference}");
        }
    }
}
