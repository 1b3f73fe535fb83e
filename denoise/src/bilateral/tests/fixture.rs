//! Rust against Python: the network and the filter of `denoise/training`, which trained the weights, on the same numbers.

use super::super::features::Feature;
use super::super::filter::{Multipliers, Settings};
use super::super::mlp::{OUTPUTS, RowOfPixels};
use super::super::secondary::{COUNT, names};
use super::super::stack::Stack;
use super::*;
use crate::simd::vectorise;

/// What `denoise/training/make_bilateral_fixture.py` wrote.
struct Fixture {
    record: serde_json::Value,
    width: usize,
    height: usize,
}

impl Fixture {
    fn read() -> Self {
        let text = include_str!("../../../tests/fixtures/bilateral.json");
        let record: serde_json::Value = serde_json::from_str(text).unwrap();
        let size = |index: usize| record["size"][index].as_u64().unwrap() as usize;
        let (width, height) = (size(0), size(1));
        Self { record, width, height }
    }

    fn image(&self, name: &str) -> Image {
        let numbers = self.record[name].as_array().unwrap();
        let numbers: Vec<f32> =
            numbers.iter().map(|value| value.as_f64().unwrap() as f32).collect();
        let channels = numbers.len() / (self.width * self.height);
        Image::from_shape_vec((channels, self.height, self.width), numbers).unwrap()
    }

    fn network(&self) -> Network {
        let mut weights = self.record["weights"].clone();
        weights["features"] = serde_json::json!(names());
        Network::parse(&weights.to_string(), "fixture".as_ref()).unwrap()
    }
}

#[test]
fn the_network_equals_that_of_python() {
    let fixture = Fixture::read();
    let (features, expected) = (fixture.image("features"), fixture.image("multipliers"));
    let network = fixture.network();
    for y in 0..fixture.height {
        let mut row: Vec<f32> = features.slice(s![.., y, ..]).iter().copied().collect();
        let mut out = vec![0.0; OUTPUTS * fixture.width];
        let present = &[true; COUNT];
        vectorise(RowOfPixels { network: &network, features: &mut row, present, out: &mut out });
        for (found, expected) in out.iter().zip(expected.slice(s![..OUTPUTS, y, ..])) {
            assert!((found / expected - 1.0).abs() < 1e-4, "{found} instead of {expected}");
        }
        assert!((network.colour() / expected[[6, y, 0]] - 1.0).abs() < 1e-6);
    }
}

#[test]
fn the_filter_equals_that_of_python() {
    let fixture = Fixture::read();
    let (planes, multipliers) = (fixture.image("planes"), fixture.image("multipliers"));
    let part =
        |first: usize, count: usize| planes.slice(s![first..first + count, .., ..]).to_owned();
    let mut first = 6;
    let features: Vec<Feature> = GROUPS
        .iter()
        .enumerate()
        .map(|(group, kind)| {
            let count = kind.components().len();
            let (mean, variance) = (part(first, count), part(first + count, count));
            first += 2 * count;
            Feature { group, mean, variance }
        })
        .collect();
    let lambda = multipliers.slice(s![..OUTPUTS, .., ..]).to_owned();
    let colour = fixture.network().colour();
    let settings = Settings { lambda: Multipliers::PerPixel(&lambda), colour, radius: 27 };
    let found = Stack::new(&part(0, 3), &part(3, 3), &features).filter(&settings, &|| ());
    // The weights are the exponentials of distances of up to 24 in single precision: 24 · 2⁻²³.
    assert_close(&found, &fixture.image("filtered"), 1e-5);
}
