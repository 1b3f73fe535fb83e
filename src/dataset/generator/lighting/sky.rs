//! Environment maps by formula: skies with and without a sun, studios, nights, clouds of colour.

use crate::dataset::generator::colour;
use crate::dataset::generator::noise::Noise;
use crate::dataset::generator::random::Random;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Radiance in all directions, row 0 up.
pub(super) struct Map {
    pub(super) width: usize,
    pub(super) texels: Vec<DVec3>,
    pub(super) tags: Vec<&'static str>,
}

impl Map {
    /// Colours by direction, at 128×64 or 256×128.
    fn of(random: &mut Random, tags: &[&'static str], radiance: impl Fn(DVec3) -> DVec3) -> Self {
        let width = if random.chance(0.5) { 256 } else { 128 };
        let height = width / 2;
        let texel = |index: usize| {
            let theta = PI * (index / width) as f64 / (height - 1) as f64;
            let phi = TAU * ((index % width) as f64 + 0.5) / width as f64;
            let (sine, y) = theta.sin_cos();
            radiance(DVec3::new(sine * phi.sin(), y, -sine * phi.cos())).max(DVec3::ZERO)
        };
        Self { width, texels: (0..width * height).map(texel).collect(), tags: tags.to_vec() }
    }

    /// Over the sphere.
    pub(super) fn mean_luminance(&self) -> f64 {
        let height = self.texels.len() / self.width;
        let weight = |i: usize| (PI * (i / self.width) as f64 / (height - 1) as f64).sin();
        let sum: f64 =
            self.texels.iter().enumerate().map(|(i, c)| weight(i) * colour::luminance(*c)).sum();
        sum / (0..self.texels.len()).map(weight).sum::<f64>()
    }
}

/// One of all kinds.
pub(super) fn random(random: &mut Random) -> Map {
    match random.integer(0, 9) {
        0..=3 => sky(random),
        4..=6 => studio(random),
        7 => night(random),
        _ => clouds(random),
    }
}

/// A gradient from horizon to zenith over a ground; half of the skies with a sun, from a fifth of a degree of blur to
/// several texels, and some with clouds.
fn sky(random: &mut Random) -> Map {
    let zenith =
        colour::hsv(random.uniform(0.55, 0.65), random.uniform(0.2, 0.8), random.uniform(0.3, 1.0));
    let warmth = random.uniform(0.0, 0.6);
    let horizon = colour::hsv(random.uniform(0.04, 0.12), warmth, random.uniform(0.6, 1.4));
    let ground = colour::earthen(random) * 0.5;
    let falloff = random.uniform(1.0, 6.0);
    let has_sun = random.chance(0.55);
    let mut sun = random.direction();
    sun.y = random.uniform(0.05, 0.9);
    let sun = sun.normalize();
    let sun_colour = colour::hsv(0.1, random.uniform(0.0, 0.5), 1.0);
    // Irradiance of the sun against that of the sky, about π: real skies have ratios from 1 to 10.
    let radius = random.log_uniform(0.03, 0.12);
    let strength = random.log_uniform(1.0, 12.0) / (radius * radius);
    let cover = if random.chance(0.5) { random.uniform(0.3, 1.0) } else { 0.0 };
    let noise = Noise::new(random.seed());
    let tags: &[&'static str] = if has_sun { &["sky", "sun"] } else { &["sky"] };
    Map::of(random, tags, |direction| {
        if direction.y < 0.0 {
            return ground;
        }
        let blue = horizon.lerp(zenith, 1.0 - (-falloff * direction.y).exp());
        let cloud = noise.space_octaves(direction * 3.0 / (0.3 + direction.y), 4);
        let cloudy = blue.lerp(DVec3::splat(1.1), cover * (2.0 * cloud).clamp(0.0, 1.0));
        let distance = direction.distance(sun);
        // A smooth edge: the map has few texels across the sun.
        let disc = (-(distance / radius).powi(4)).exp();
        cloudy + if has_sun { sun_colour * disc * strength } else { DVec3::ZERO }
    })
}

/// Rectangles of light in a dark or grey surrounding.
fn studio(random: &mut Random) -> Map {
    let base = DVec3::splat(random.log_uniform(0.005, 0.3));
    let boxes: Vec<(DVec3, DVec3, DVec3, [f64; 2], DVec3)> = (0..random.integer(1, 6))
        .map(|_| {
            let mut normal = random.direction();
            normal.y = normal.y * 0.6 + 0.4;
            let normal = normal.normalize();
            let right = normal.cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X);
            let half = [random.log_uniform(0.05, 0.8), random.log_uniform(0.05, 0.8)];
            let radiance = colour::light(random) * random.log_uniform(2.0, 60.0);
            (normal, right, right.cross(normal), half, radiance)
        })
        .collect();
    Map::of(random, &["studio"], |direction| {
        let mut sum = base * (0.6 + 0.4 * direction.y);
        for (normal, right, up, [width, height], radiance) in &boxes {
            let distance = direction.dot(*normal);
            if distance > 0.0 {
                let (x, y) = (direction.dot(*right) / distance, direction.dot(*up) / distance);
                let edge =
                    |value: f64, half: f64| ((half - value.abs()) * 12.0 + 0.5).clamp(0.0, 1.0);
                sum += *radiance * edge(x, *width) * edge(y, *height);
            }
        }
        sum
    })
}

/// Many small lights around a dark horizon.
fn night(random: &mut Random) -> Map {
    let glow = colour::light(random) * random.log_uniform(0.003, 0.05);
    let lights: Vec<(DVec3, f64, DVec3)> = (0..random.integer(5, 40))
        .map(|_| {
            let mut direction = random.direction();
            direction.y = direction.y.abs() * 0.5;
            let radius = random.log_uniform(0.02, 0.08);
            (direction.normalize(), radius, colour::light(random) * random.log_uniform(3.0, 100.0))
        })
        .collect();
    Map::of(random, &["night"], |direction| {
        let horizon = glow * (-5.0 * direction.y.abs()).exp();
        lights.iter().fold(horizon, |sum, (center, radius, radiance)| {
            sum + *radiance * (-(direction.distance(*center) / radius).powi(2)).exp()
        })
    })
}

/// Two colours mixed by noise, with bright patches.
fn clouds(random: &mut Random) -> Map {
    let (first, second) = (colour::albedo(random), colour::albedo(random));
    let (scale, power) = (random.uniform(0.8, 3.0), random.uniform(1.0, 8.0));
    let noise = Noise::new(random.seed());
    Map::of(random, &["noise-environment"], |direction| {
        let value = 0.5 + 0.5 * noise.space_octaves(direction * scale, 4);
        first.lerp(second, value.clamp(0.0, 1.0)) + DVec3::ONE * (1.4 * value).max(0.0).powf(power)
    })
}
