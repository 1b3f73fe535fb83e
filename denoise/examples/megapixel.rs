use quietlight_denoise::bilateral::{Parameters, Prepared};
use quietlight_denoise::{Image, Layer, LayerKind, Layers};
use std::collections::BTreeMap;
use std::time::Instant;
/// Smooth surfaces with an edge in the middle and noise on everything.
fn noisy_layers(width: usize, height: usize) -> Layers {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0 - 0.5
    };
    let mut layers = BTreeMap::new();
    for kind in LayerKind::ALL {
        let channels = kind.components().len();
        let mut image = |noise: f32| {
            Image::from_shape_fn((channels, height, width), |(c, y, x)| {
                let edge = if 2 * x > width + y { 0.5 } else { 0.0 };
                0.3 + edge + 0.001 * (c + y) as f32 + noise * random()
            })
        };
        let halves = [image(0.2), image(0.2)];
        let mean = (&halves[0] + &halves[1]) * 0.5;
        let variance = Some(Image::from_elem((channels, height, width), 0.2 * 0.2 / 24.0));
        layers.insert(kind, Layer { mean, variance, halves: Some(halves) });
    }
    Layers { width, height, layers, ..Default::default() }
}
fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/self/stat").unwrap();
    let f: Vec<&str> = s.rsplit(')').next().unwrap().split_whitespace().collect();
    (f[11].parse::<f64>().unwrap() + f[12].parse::<f64>().unwrap()) / 100.0
}
fn main() {
    let side: usize = std::env::args().nth(1).map_or(1000, |s| s.parse().unwrap());
    let layers = noisy_layers(side, side);
    let (t, c) = (Instant::now(), cpu());
    let prepared = Prepared::new(&layers).unwrap();
    println!("prepare wall {:.2} cpu {:.2}", t.elapsed().as_secs_f64(), cpu() - c);
    let (t, c) = (Instant::now(), cpu());
    let d = prepared.filter(&Parameters::default(), &|_| ()).unwrap();
    println!("filter wall {:.2} cpu {:.2} {:?}", t.elapsed().as_secs_f64(), cpu() - c, d.report);
    println!("{}", d.image.iter().map(|v| f64::from(*v)).sum::<f64>() / d.image.len() as f64);
}
