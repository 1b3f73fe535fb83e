//! Colours of surfaces and of lights.

use super::random::Random;
use glam::DVec3;

/// A colour by hue (turns), saturation and value, each in `[0, 1]`, as linear components (Smith 1978, "Color gamut
/// transform pairs", the hexcone model).
pub(super) fn hsv(hue: f64, saturation: f64, value: f64) -> DVec3 {
    let channel = |offset: f64| {
        let k = (offset + hue * 6.0).rem_euclid(6.0);
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    };
    DVec3::new(channel(5.0), channel(3.0), channel(1.0))
}

/// A reflectance: from near black to 0.95, a third of them grey, some saturated.
pub(super) fn albedo(random: &mut Random) -> DVec3 {
    let value = match random.integer(0, 9) {
        0 => random.log_uniform(0.01, 0.1),
        1..=3 => random.uniform(0.7, 0.95),
        _ => random.uniform(0.08, 0.8),
    };
    let saturation = match random.integer(0, 9) {
        0..=2 => 0.0,
        3..=5 => random.uniform(0.05, 0.35),
        6..=8 => random.uniform(0.3, 0.8),
        _ => random.uniform(0.8, 0.98),
    };
    hsv(random.unit(), saturation, value)
}

/// A light reflectance of little saturation, as walls and ceilings have.
pub(super) fn pale(random: &mut Random) -> DVec3 {
    let saturation =
        if random.chance(0.4) { random.uniform(0.0, 0.05) } else { random.uniform(0.05, 0.4) };
    hsv(random.unit(), saturation, random.uniform(0.45, 0.92))
}

/// Browns of wood, earth, stone, brick.
pub(super) fn earthen(random: &mut Random) -> DVec3 {
    hsv(random.uniform(0.02, 0.13), random.uniform(0.15, 0.7), random.log_uniform(0.08, 0.7))
}

/// A tint of specular light: mostly white.
pub(super) fn tint(random: &mut Random) -> DVec3 {
    match random.integer(0, 5) {
        0..=2 => DVec3::ONE,
        3 => DVec3::splat(random.uniform(0.3, 1.0)),
        4 => hsv(random.unit(), random.uniform(0.1, 0.4), random.uniform(0.8, 1.0)),
        _ => hsv(random.unit(), random.uniform(0.4, 0.9), random.uniform(0.6, 1.0)),
    }
}

/// The colour of a light with luminance near 1: warm, neutral, cold, one in twenty of any hue.
pub(super) fn light(random: &mut Random) -> DVec3 {
    let colour = match random.integer(0, 19) {
        0..=7 => hsv(random.uniform(0.06, 0.12), random.uniform(0.1, 0.65), 1.0),
        8..=13 => DVec3::ONE,
        14..=18 => hsv(random.uniform(0.55, 0.65), random.uniform(0.05, 0.4), 1.0),
        _ => hsv(random.unit(), random.uniform(0.3, 0.85), 1.0),
    };
    colour / luminance(colour).max(0.05)
}

/// Rec. 709 luminance.
pub(super) fn luminance(colour: DVec3) -> f64 {
    let [r, g, b] = quietlight_denoise::LUMINANCE.map(f64::from);
    colour.dot(DVec3::new(r, g, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hues_are_where_the_hexcone_has_them() {
        assert_eq!(hsv(0.0, 1.0, 1.0), DVec3::X);
        assert!((hsv(1.0 / 3.0, 1.0, 0.5) - DVec3::Y * 0.5).length() < 1e-12);
        assert!((hsv(2.0 / 3.0, 1.0, 1.0) - DVec3::Z).length() < 1e-12);
        assert_eq!(hsv(0.7, 0.0, 0.4), DVec3::splat(0.4));
    }

    #[test]
    fn reflectances_span_their_range() {
        let mut random = Random::new(1, 0);
        let values: Vec<DVec3> = (0..2000).map(|_| albedo(&mut random)).collect();
        assert!(values.iter().all(|c| c.min_element() >= 0.0 && c.max_element() <= 0.95));
        assert!(values.iter().any(|c| c.max_element() < 0.03));
        assert!(values.iter().any(|c| c.max_element() > 0.93));
        assert!(values.iter().any(|c| c.max_element() > 10.0 * c.min_element()));
    }
}
