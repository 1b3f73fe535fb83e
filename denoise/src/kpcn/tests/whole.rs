//! Networks and all around them, from layers to the picture.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value;

use super::{Random, fixtures, whole};
use crate::kpcn::buffers::Buffers;
use crate::kpcn::noise::Noise;
use crate::kpcn::tile::{Grid, Tile};
use crate::kpcn::{
    Branch, Denoiser, LAYERS, Model, Network, kernel, orientation, pyramid, reconstruct,
};
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::metrics::relative_l2;

/// The files of tiny random networks of a tier, diffuse and specular.
pub(super) fn files(tier: &str) -> [PathBuf; 2] {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    Branch::ALL.map(|branch| folder.join(format!("kpcn-{tier}-{}.onnx", branch.name())))
}

pub(super) fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

fn denoiser(tier: &str) -> Denoiser {
    let [diffuse, specular] = files(tier);
    Denoiser::from_files([&diffuse, &specular], 2).unwrap()
}

/// Filters tiles, without mixing.
fn unmixed(layers: &Layers, tier: &str, tiles: &[Tile]) -> Image {
    let networks: Vec<Arc<Network>> = files(tier)
        .iter()
        .map(|path| Network::of(&Model::read(path).unwrap(), 2).unwrap())
        .collect();
    let buffers = Buffers::new(layers).unwrap();
    reconstruct(&buffers, &networks, tiles, &pool(2), &|_| ()).unwrap().0.denoised()
}

/// All layers that the networks use, of random numbers with random variances.
fn random_layers(width: usize, height: usize, seed: u64) -> Layers {
    let mut random = Random(seed);
    let mut layers = Layers { width, height, ..Default::default() };
    for kind in LAYERS {
        let shape = (kind.components().len(), height, width);
        let mean = Image::from_shape_simple_fn(shape, || random.uniform());
        let variance = Image::from_shape_simple_fn(shape, || 0.01 * random.uniform());
        layers.layers.insert(kind, Layer { mean, variance: Some(variance), halves: None });
    }
    let sum = &layers.layers[&LayerKind::Diffuse].mean + &layers.layers[&LayerKind::Specular].mean;
    layers.layers.get_mut(&LayerKind::Beauty).unwrap().mean = sum;
    layers
}

#[test]
fn whole_networks_make_pytorchs_picture() {
    let layers = fixtures::layers();
    let expected: Value =
        serde_json::from_str(include_str!("../../../tests/fixtures/networks.json")).unwrap();
    for (tier, multiple) in [("unit", 16), ("unit-kernel", 1)] {
        let image = unmixed(&layers, tier, &[whole(layers.width, layers.height, multiple)]);
        let found: Vec<f32> = image.iter().copied().collect();
        let expected = fixtures::numbers(&expected[tier]);
        fixtures::assert_close(&found, &expected, &|_| tier.into());
    }
}

#[test]
fn tiles_and_the_whole_are_the_same() {
    for (tier, width, height, grid, bound) in [
        ("unit", 560, 40, pyramid::GRID, 320 * 48),
        ("unit", 24, 530, pyramid::GRID, 320 * 32),
        ("unit-kernel", 150, 47, kernel::GRID, 80 * 48),
    ] {
        let layers = random_layers(width, height, 5);
        let tiles = Grid { most_pixels: bound, ..grid }.tiles(width, height);
        assert!(tiles.len() > 2, "{tier}: {} tiles", tiles.len());
        let cut = unmixed(&layers, tier, &tiles);
        let uncut = unmixed(&layers, tier, &[whole(width, height, grid.multiple)]);
        for ((index, cut), uncut) in cut.indexed_iter().zip(&uncut) {
            assert!(
                (cut - uncut).abs() <= 1e-5 * uncut.abs().max(1.0),
                "{tier} {index:?}: {cut} {uncut}"
            );
        }
    }
}

#[test]
fn the_result_is_the_mean_over_the_orientations() {
    let layers = random_layers(35, 18, 9);
    let once = denoiser("unit").without_mixing();
    let often = Denoiser { orientations: &orientation::ALL, ..once.clone() };
    let run = |denoiser: &Denoiser, layers: &Layers| {
        denoiser.denoise(layers, &pool(2), &|_| ()).unwrap().image
    };
    let mut expected = Image::zeros((3, 18, 35));
    for orientation in orientation::ALL {
        let mut turned = layers.clone();
        [turned.height, turned.width] = orientation.size([18, 35]);
        for layer in turned.layers.values_mut() {
            layer.mean = orientation.turn(&layer.mean);
            layer.variance = layer.variance.as_ref().map(|variance| orientation.turn(variance));
        }
        let image = run(&once, &turned);
        for ((channel, y, x), sum) in expected.indexed_iter_mut() {
            let [y, x] = orientation.place([y, x], [turned.height, turned.width]);
            *sum += image[(channel, y, x)] / 8.0;
        }
    }
    let found = run(&often, &layers);
    for ((index, found), expected) in found.indexed_iter().zip(&expected) {
        assert!((found - expected).abs() <= 1e-5, "{index:?}: {found} {expected}");
    }
    assert_ne!(found, run(&once, &layers));
}

#[test]
fn noise_keeps_its_signs_when_the_picture_is_turned() {
    let layers = random_layers(7, 5, 11);
    let buffers = Buffers::new(&layers).unwrap();
    for orientation in orientation::ALL {
        let turned = buffers.turned(orientation);
        let [noise, turned_noise] = [&buffers, &turned].map(Noise::new);
        for (y, x) in (0..5).flat_map(|y| (0..7).map(move |x| (y, x))) {
            let [turned_y, turned_x] = turned.place([y, x]);
            let place = turned_y * turned.width + turned_x;
            for branch in Branch::ALL {
                let of = |noise: &Noise, pixel| noise.signs(branch, pixel..pixel + 1).next();
                assert_eq!(of(&turned_noise, place), of(&noise, y * 7 + x), "{orientation:?}");
            }
        }
    }
}

#[test]
fn the_threads_do_not_change_the_bits() {
    let layers = random_layers(70, 50, 6);
    let denoiser = denoiser("unit");
    let [one, three] =
        [1, 3].map(|threads| denoiser.denoise(&layers, &pool(threads), &|_| ()).unwrap().image);
    assert_eq!(one, three);
}

#[test]
fn a_branch_without_light_does_not_run() {
    let denoiser = denoiser("unit");
    let run = |layers: &Layers| denoiser.denoise(layers, &pool(1), &|_| ()).unwrap();
    let both = random_layers(20, 20, 7);
    assert_eq!(run(&both).report.branches, Branch::ALL);

    let mut dark = both.clone();
    for kind in [LayerKind::Specular, LayerKind::Diffuse] {
        let mut layers = both.clone();
        let layer = layers.layers.get_mut(&kind).unwrap();
        layer.mean.fill(0.0);
        layer.variance.as_mut().unwrap().fill(0.0);
        layers.layers.get_mut(&LayerKind::Beauty).unwrap().mean.assign(&match kind {
            LayerKind::Specular => both.layers[&LayerKind::Diffuse].mean.view(),
            _ => both.layers[&LayerKind::Specular].mean.view(),
        });
        let left = if kind == LayerKind::Specular { Branch::Diffuse } else { Branch::Specular };
        assert_eq!(run(&layers).report.branches, [left]);
        dark.layers.insert(kind, layers.layers[&kind].clone());
    }
    dark.layers.get_mut(&LayerKind::Beauty).unwrap().mean.fill(0.0);
    let dark = run(&dark);
    assert!(dark.report.branches.is_empty() && dark.image.iter().all(|&value| value == 0.0));

    // Whole radiance, not split, is the diffuse branch's.
    let mut unsplit = both.clone();
    unsplit.layers.retain(|kind, _| !matches!(kind, LayerKind::Diffuse | LayerKind::Specular));
    assert_eq!(run(&unsplit).report.branches, [Branch::Diffuse]);
}

#[test]
fn pictures_of_any_size_are_denoised() {
    for tier in ["unit", "unit-kernel"] {
        let denoiser = denoiser(tier);
        for (width, height) in [(1, 1), (1, 9), (17, 1), (2, 2), (3, 33), (16, 16)] {
            let layers = random_layers(width, height, 8);
            let denoised = denoiser.denoise(&layers, &pool(1), &|_| ()).unwrap();
            assert_eq!(denoised.image.dim(), (3, height, width));
            assert!(
                denoised.image.iter().all(|value| value.is_finite()),
                "{tier} {width}x{height}"
            );
        }
    }
    let nothing = Layers { width: 0, height: 3, ..random_layers(1, 1, 1) };
    assert!(denoiser("unit").denoise(&nothing, &pool(1), &|_| ()).is_err());
}

#[test]
fn broken_numbers_are_replaced_and_the_result_is_finite() {
    for tier in ["unit", "unit-kernel"] {
        let denoiser = denoiser(tier);
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -5.0, 1e30, 1e-42] {
            for kind in random_layers(1, 1, 1).layers.into_keys() {
                let mut layers = random_layers(21, 18, 9);
                let layer = layers.layers.get_mut(&kind).unwrap();
                layer.mean[[0, 4, 5]] = value;
                layer.variance.as_mut().unwrap()[[0, 11, 7]] = value;
                let denoised = denoiser.denoise(&layers, &pool(1), &|_| ()).unwrap();
                let what = format!("{tier}, {value} in {}", kind.name());
                assert!(denoised.image.iter().all(|value| value.is_finite()), "{what}");
                // As means −5 and 1e-42 are good; −5 is no variance.
                let bad = if value == -5.0 { 1 } else { 2 * usize::from(value != 1e-42) };
                assert_eq!(denoised.report.sanitised.total(), bad, "{what}");
            }
        }
    }
}

#[test]
fn everything_at_its_extreme_is_finite() {
    for tier in ["unit", "unit-kernel"] {
        let denoiser = denoiser(tier);
        for (light, variance) in
            [(1e15, 1e30), (1e15, 0.0), (1e-38, 1e-38), (1e-38, 1e30), (-1.0, 1.0)]
        {
            let mut layers = random_layers(19, 17, 10);
            for (kind, layer) in &mut layers.layers {
                layer.mean.fill(light);
                layer.variance.as_mut().unwrap().fill(variance);
                if *kind == LayerKind::Albedo {
                    layer.mean.fill(0.0);
                }
            }
            let denoised = denoiser.denoise(&layers, &pool(1), &|_| ()).unwrap();
            assert!(
                denoised.image.iter().all(|value| value.is_finite()),
                "{tier}: {light} ± √{variance}"
            );
        }
    }
}

#[test]
fn missing_layers_are_done_without() {
    let denoiser = denoiser("unit");
    let run = |layers: &Layers| denoiser.denoise(layers, &pool(1), &|_| ());
    for kind in [LayerKind::Albedo, LayerKind::Normal, LayerKind::Depth, LayerKind::Beauty] {
        let mut layers = random_layers(18, 18, 11);
        layers.layers.remove(&kind);
        assert!(
            run(&layers).unwrap().image.iter().all(|value| value.is_finite()),
            "{}",
            kind.name()
        );
    }
    // Colour alone, without a variance: it is that of the neighbours, which says nothing of noise.
    let mut layers = random_layers(18, 18, 11);
    layers.layers.retain(|kind, layer| {
        layer.variance = None;
        *kind == LayerKind::Beauty
    });
    let denoised = run(&layers).unwrap();
    assert_eq!(denoised.report.spatial_variance, [LayerKind::Beauty]);
    assert_eq!(denoised.report.fractions, None);
    // Nothing to denoise.
    layers.layers.clear();
    assert!(run(&layers).is_err());
}

#[test]
fn light_that_is_neither_diffuse_nor_specular_is_not_lost() {
    // As the emission or the transmission of other renderers.
    let mut layers = random_layers(32, 24, 13);
    layers.layers.get_mut(&LayerKind::Beauty).unwrap().mean += 2.0;
    let run = |layers: &Layers| denoiser("unit").denoise(layers, &pool(1), &|_| ()).unwrap();
    let denoised = run(&layers);
    assert_eq!(denoised.report.branches, [Branch::Diffuse]);
    layers.layers.retain(|kind, _| ![LayerKind::Diffuse, LayerKind::Specular].contains(kind));
    assert_eq!(denoised.image, run(&layers).image);
}

#[test]
fn the_progress_goes_from_nothing_to_all() {
    let heard = std::sync::Mutex::new(vec![0.0]);
    let layers = random_layers(20, 20, 12);
    denoiser("unit").denoise(&layers, &pool(1), &|part| heard.lock().unwrap().push(part)).unwrap();
    let heard = heard.into_inner().unwrap();
    assert!(heard.is_sorted() && heard.last() == Some(&1.0), "{heard:?}");
}

/// A picture of edges, gradients and fine texture, without albedo to explain any of it, under noise of `n` samples.
fn noisy(n: f32, seed: u64) -> (Layers, Image) {
    let (width, height) = (96, 64);
    let mut random = Random(seed);
    let truth = |specular: bool| {
        Image::from_shape_fn((3, height, width), |(channel, y, x)| {
            let checks = if (x / 2 + y / 2) % 2 == 0 { 0.3 } else { 0.9 };
            let smooth = 0.2 + 0.01 * (x + y + channel) as f32;
            let light = if x < 48 { smooth } else { checks };
            if specular && y < 20 { 2.0 * light } else { light }
        })
    };
    let mut layers = Layers { width, height, ..Default::default() };
    let mut beauty = Image::zeros((3, height, width));
    let mut variances = beauty.clone();
    let mut reference = beauty.clone();
    for (kind, specular) in [(LayerKind::Diffuse, false), (LayerKind::Specular, true)] {
        let truth = truth(specular);
        let variance = truth.mapv(|value| value * value / n);
        // Uniform noise of variance 1/12 scaled to the variance.
        let mean = ndarray::Zip::from(&truth).and(&variance).map_collect(|&truth, &variance| {
            truth + (12.0 * variance).sqrt() * (random.uniform() - 0.5)
        });
        beauty += &mean;
        variances += &variance;
        reference += &truth;
        layers.layers.insert(kind, Layer { mean, variance: Some(variance), halves: None });
    }
    let layer = Layer { mean: beauty, variance: Some(variances), halves: None };
    layers.layers.insert(LayerKind::Beauty, layer);
    (layers, reference)
}

#[test]
fn even_a_network_that_knows_nothing_does_no_harm() {
    // Random weights blur the checks. Mixed with the noisy picture the result is never worse than it, from few samples to
    // many, and gets better with each.
    let denoiser = denoiser("unit");
    let mut last = f64::INFINITY;
    for exponent in 1..=8 {
        let samples = 4_f32.powi(exponent);
        let (layers, reference) = noisy(samples, exponent as u64);
        let denoised = denoiser.denoise(&layers, &pool(2), &|_| ()).unwrap();
        let before = relative_l2(&layers.layers[&LayerKind::Beauty].mean, &reference).unwrap();
        let after = relative_l2(&denoised.image, &reference).unwrap();
        assert!(
            after <= before && after < last,
            "{samples}: {before} before, {after} after, {last}"
        );
        last = after;
    }
}
