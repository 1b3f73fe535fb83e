//! How bright a scene is, and how much light makes it as bright as wished.

use super::colour;
use crate::render::{Budget, RenderSettings, render};
use crate::scene::Scene;
use glam::DVec3;
use quietlight_denoise::LayerKind;
use std::sync::atomic::AtomicBool;

/// Samples per pixel of a trial picture: the mean of its pixels is then known to some per cent in all but the hardest.
const SAMPLES: u32 = 8;

/// A pixel as bright as this many times the wished mean counts no more: a lamp in view does not darken its room.
const CEILING: f64 = 8.0;

/// Luminances of a small trial picture.
pub(super) fn luminances(scene: &Scene) -> Vec<f64> {
    let settings = RenderSettings { budget: Budget::Samples(SAMPLES), ..RenderSettings::default() };
    let rendered = render(scene, &settings, &|_| (), &AtomicBool::new(false));
    let beauty = &rendered.layers.layers[&LayerKind::Beauty].mean;
    let (_, height, width) = beauty.dim();
    let pixel = |x, y| DVec3::from_array([0, 1, 2].map(|c| f64::from(beauty[[c, y, x]])));
    (0..width * height).map(|i| colour::luminance(pixel(i % width, i / width))).collect()
}

/// The factor of all light that gives the luminances the mean `wanted`, those above [`CEILING`] times that cut off.
pub(super) fn factor(luminances: &[f64], wanted: f64) -> f64 {
    let mean = |factor: f64| {
        let cut = luminances.iter().map(|value| (value * factor).min(CEILING * wanted));
        cut.sum::<f64>() / luminances.len() as f64
    };
    let (mut low, mut high) = (1e-9_f64, 1e9_f64);
    // The mean grows with the factor; sixty halvings of its logarithm leave nothing to wish.
    for _ in 0..60 {
        let middle = (low * high).sqrt();
        if mean(middle) < wanted { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lamp_in_view_does_not_darken_its_room() {
        let room = vec![2.0; 99];
        assert!((factor(&room, 0.1) - 0.05).abs() < 1e-9);
        // One pixel of a hundred a million times as bright counts as CEILING: 99 x + 8 · 0.1 = 100 · 0.1.
        let mut with_lamp = room;
        with_lamp.push(2e6);
        assert!((factor(&with_lamp, 0.1) - 9.2 / 99.0 / 2.0).abs() < 1e-9);
    }
}
