//! Rust computes what PyTorch computes: the fixtures are written by `denoise/training/make_fixture.py`.

use serde_json::Value;

use super::kernels::apply_logits;
use super::whole;
use crate::kpcn::buffers::Buffers;
use crate::kpcn::picture::{Filtered, Picture, WITH_NOISE};
use crate::kpcn::{Branch, EPSILON, Kind, channels, kernel};
use crate::layers::{Image, Layer, LayerKind, Layers};

/// METHODS: Rust = PyTorch to 1e-4, of the larger of 1 and the number.
const TOLERANCE: f32 = 1e-4;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn pyramid_fixture() -> Value {
    json(include_str!("../../../tests/fixtures/pyramid.json"))
}

fn kernel_fixture() -> Value {
    json(include_str!("../../../tests/fixtures/kernel.json"))
}

pub(super) fn numbers(value: &Value) -> Vec<f32> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap() as f32).collect()
}

/// The layers of the fixture; beauty is their sum.
pub(super) fn layers() -> Layers {
    let fixture = json(include_str!("../../../tests/fixtures/layers.json"));
    let [width, height] = ["width", "height"].map(|key| fixture[key].as_u64().unwrap() as usize);
    let mut layers = Layers { width, height, ..Default::default() };
    for kind in LayerKind::ALL {
        let layer = &fixture["layers"][kind.name()];
        if layer.is_null() {
            continue;
        }
        let image = |role: &str| {
            let shape = (kind.components().len(), height, width);
            Image::from_shape_vec(shape, numbers(&layer[role])).unwrap()
        };
        let layer = Layer { mean: image("mean"), variance: Some(image("variance")), halves: None };
        layers.layers.insert(kind, layer);
    }
    layers
}

#[track_caller]
pub(super) fn assert_close(found: &[f32], expected: &[f32], what: &dyn Fn(usize) -> String) {
    assert_eq!(found.len(), expected.len(), "{}", what(0));
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let bound = TOLERANCE * expected.abs().max(1.0);
        assert!((found - expected).abs() <= bound, "{}: {found}, {expected}", what(index));
    }
}

/// Planes of that size from four times as many of half the size, in the order of PyTorch's `pixel_shuffle`.
fn depth_to_space(half: &[f32], [height, width]: [usize; 2]) -> Vec<f32> {
    let (rows, columns) = (height / 2, width / 2);
    (0..half.len())
        .map(|index| {
            let (channel, y, x) = (index / (height * width), index / width % height, index % width);
            let plane = 4 * channel + 2 * (y % 2) + x % 2;
            half[(plane * rows + y / 2) * columns + x / 2]
        })
        .collect()
}

/// The first rows and columns of planes that are padded on the right and at the bottom.
fn cropped(padded: &[f32], [height, width]: [usize; 2], [h, w]: [usize; 2]) -> Vec<f32> {
    let rows = padded.chunks(width).enumerate();
    rows.filter(|(row, _)| row % height < h).flat_map(|(_, row)| row[..w].to_vec()).collect()
}

/// From `[height, channels, width]` to `[channels, height, width]`.
fn planar(rows: &[f32], channels: usize, width: usize) -> Vec<f32> {
    let row = |y: usize, channel: usize| &rows[(y * channels + channel) * width..][..width];
    let height = rows.len() / channels / width;
    (0..channels).flat_map(|c| (0..height).flat_map(move |y| row(y, c).to_vec())).collect()
}

#[test]
fn the_channels_have_the_names_and_the_order_of_the_training() {
    for (fixture, names) in
        [(pyramid_fixture(), &channels::PYRAMID[..]), (kernel_fixture(), &channels::KERNEL[..])]
    {
        let expected: Vec<_> =
            fixture["channels"].as_array().unwrap().iter().map(|v| v.as_str().unwrap()).collect();
        assert_eq!(names, expected);
        assert_eq!(fixture["epsilon"].as_f64().unwrap() as f32, EPSILON);
    }
    assert_eq!((channels::PYRAMID.len(), channels::KERNEL.len()), (22, 27));
}

#[test]
fn the_pyramids_channels_are_pytorchs() {
    let (layers, fixture) = (layers(), pyramid_fixture());
    let buffers = Buffers::new(&layers).unwrap();
    let exposure = fixture["exposure"].as_f64().unwrap() as f32;
    assert!((buffers.exposure / exposure - 1.0).abs() < 1e-6, "{}", buffers.exposure);
    let tile = whole(layers.width, layers.height, 16);
    for branch in Branch::ALL {
        let input = channels::pyramid(&buffers, branch, &tile);
        let input = cropped(&depth_to_space(&input, tile.padded), tile.padded, tile.size());
        let expected = numbers(&fixture[branch.name()]["input"]);
        let name = |index: usize| channels::PYRAMID[index / (layers.width * layers.height)];
        assert_close(&input, &expected, &|i| format!("{} {}", branch.name(), name(i)));
    }
}

#[test]
fn the_papers_channels_are_pytorchs() {
    let (layers, fixture) = (layers(), kernel_fixture());
    let buffers = Buffers::new(&layers).unwrap();
    let tile = whole(layers.width, layers.height, 1);
    for branch in Branch::ALL {
        let input = channels::kernel(&buffers, branch, &tile);
        let expected = numbers(&fixture[branch.name()]["input"]);
        let name = |index: usize| channels::KERNEL[index / (layers.width * layers.height)];
        assert_close(&input, &expected, &|i| format!("{} {}", branch.name(), name(i)));
    }
}

#[test]
fn padding_repeats_the_channels_reflected() {
    let layers = layers();
    let buffers = Buffers::new(&layers).unwrap();
    let tile = whole(layers.width, layers.height, 16);
    let [height, width] = tile.padded;
    let input = channels::pyramid(&buffers, Branch::Diffuse, &tile);
    let input = depth_to_space(&input, tile.padded);
    for plane in input.chunks(height * width) {
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            // 11 rows and 13 columns: the rows 11, 12, ... show 9, 8, ...
            let source = (if y < 11 { y } else { 20 - y }, if x < 13 { x } else { 24 - x });
            assert_eq!(plane[y * width + x], plane[source.0 * width + source.1], "({x}, {y})");
        }
    }
}

/// Puts the filtered signals of both branches together, and returns the picture before any mixing.
fn recombine(layers: &Layers, filtered: &[Filtered], multiple: usize) -> Vec<f32> {
    let buffers = Buffers::new(layers).unwrap();
    let mut picture = Picture::new(&buffers);
    let tile = whole(layers.width, layers.height, multiple);
    filtered.iter().for_each(|filtered| picture.add(&tile, filtered));
    picture.denoised().iter().copied().collect()
}

#[test]
fn the_pyramids_result_is_pytorchs() {
    let (layers, fixture) = (layers(), pyramid_fixture());
    let buffers = Buffers::new(&layers).unwrap();
    let picture = Picture::new(&buffers);
    let tile = whole(layers.width, layers.height, 16);
    let filtered = Branch::ALL.map(|branch| {
        let expected = &fixture[branch.name()];
        let signal = picture.signal(branch, Kind::KernelPyramid, &tile);
        let light = &planar(&signal, WITH_NOISE, layers.width)[..3 * 13 * 11];
        assert_close(light, &numbers(&expected["signal"]), &|_| branch.name().into());
        let logits: Vec<_> =
            (0..5).map(|level| numbers(&expected[format!("level{level}")])).collect();
        let result = apply_logits::<WITH_NOISE>(&logits, tile.padded, tile.size(), &signal);
        let light = &planar(&result, WITH_NOISE, layers.width)[..3 * 13 * 11];
        assert_close(light, &numbers(&expected["result"]), &|_| branch.name().into());
        Filtered { branch, kind: Kind::KernelPyramid, signal: result }
    });
    let radiance = recombine(&layers, &filtered, 16);
    assert_close(&radiance, &numbers(&fixture["radiance"]), &|_| "radiance".into());
}

#[test]
fn the_papers_result_is_pytorchs() {
    let (layers, fixture) = (layers(), kernel_fixture());
    let buffers = Buffers::new(&layers).unwrap();
    let picture = Picture::new(&buffers);
    let tile = whole(layers.width, layers.height, 1);
    let size = fixture["kernel_size"].as_u64().unwrap() as usize;
    let kind = Kind::Kernel { size };
    let filtered = Branch::ALL.map(|branch| {
        let expected = &fixture[branch.name()];
        let signal = picture.signal(branch, kind, &tile);
        let logits = numbers(&expected["logits"]);
        let result = kernel::apply::<WITH_NOISE>(&logits, tile.size(), size, &signal);
        let light = &planar(&result, WITH_NOISE, layers.width)[..3 * 13 * 11];
        assert_close(light, &numbers(&expected["result"]), &|_| branch.name().into());
        Filtered { branch, kind, signal: result }
    });
    let radiance = recombine(&layers, &filtered, 1);
    assert_close(&radiance, &numbers(&fixture["radiance"]), &|_| "radiance".into());
}
