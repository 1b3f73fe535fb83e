//! Samples against densities.

use super::{FIRST, area, emitters, meet, parts};
use crate::support::random::Random;
use crate::support::sphere::SphereGrid;
use crate::support::{LEVEL, sidak};
use glam::{DMat3, DQuat, DVec3, Vec3};
use quietlight::emitter::{Emitter, EmitterId, Environment, EnvironmentMap};
use quietlight::geometry::Geometry;
use quietlight::math::Rgb;

/// Environments of several sizes and contents.
fn environments() -> Vec<(&'static str, Environment)> {
    let mut random = Random::new(5);
    let rotation = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(2.0, 2.0, -1.0) / 3.0, 1.0));
    let mut map = |size: [usize; 2], texel: &mut dyn FnMut(usize, &mut Random) -> f32| {
        let texels = (0..size[0] * size[1]).map(|i| Rgb::splat(texel(i, &mut random))).collect();
        Environment::from(EnvironmentMap::new(size, texels, 1.0, rotation).expect("the sizes fit"))
    };
    vec![
        ("constant", Environment::Constant(Rgb::WHITE)),
        ("1 × 1", map([1, 1], &mut |_, _| 3.0)),
        ("2 × 2", map([2, 2], &mut |_, random| random.next_f32())),
        ("rough", map([32, 16], &mut |_, random| random.next_f32().powi(8))),
        ("one hot texel", map([32, 16], &mut |i, _| if i == 200 { 1e6 } else { 1e-3 })),
        ("hot pole", map([32, 16], &mut |i, _| if i < 32 { 1.0 } else { 0.0 })),
        (
            "half black",
            map([8, 9], &mut |i, random| if i % 8 < 4 { 0.0 } else { random.next_f32() }),
        ),
    ]
}

#[test]
fn directions_to_parts_have_the_claimed_density() {
    let parts = parts();
    let level = sidak(LEVEL, parts.len());
    for (name, part) in parts {
        let geometry = Geometry::new(vec![part.clone()]);
        let emitters = emitters(vec![area(part, Rgb::WHITE)]);
        let mut random = Random::new(1);
        let grid = SphereGrid::crowded(Vec3::new(0.1, 0.05, 1.0).normalize(), 0.6, 16, 32);
        let test = grid.test(
            200_000,
            || {
                let sample = emitters.sample(Vec3::ZERO, random.next_f32(), random.next_vec2())?;
                // What is hidden by the emitter itself is sampled, but lies elsewhere than the ray's first hit.
                let at = meet(&geometry, Vec3::ZERO, sample.direction)?;
                let gap = at.position.length() - sample.distance;
                (gap.abs() < 1e-3 * sample.distance).then_some(sample.direction)
            },
            |direction| {
                let at = meet(&geometry, Vec3::ZERO, direction);
                at.map_or(0.0, |at| f64::from(emitters.pdf(FIRST, Vec3::ZERO, &at)))
            },
        );
        assert!(test.p > level, "{name}: {test:?}");
    }
}

#[test]
fn directions_to_environments_have_the_claimed_density() {
    let environments = environments();
    let level = sidak(LEVEL, environments.len());
    for (name, environment) in environments {
        let emitters = emitters(vec![Emitter::Environment(environment)]);
        let mut random = Random::new(2);
        let grid = SphereGrid::uniform(Vec3::new(0.3, 0.4, -0.5).normalize(), 48, 96);
        let test = grid.test(
            200_000,
            || {
                emitters
                    .sample(Vec3::ONE, random.next_f32(), random.next_vec2())
                    .map(|sample| sample.direction)
            },
            |direction| f64::from(emitters.environment_pdf(direction)),
        );
        assert!(test.p > level, "{name}: {test:?}");
    }
}

#[test]
fn a_sampled_direction_meets_the_emitter_and_gives_the_same_density_and_radiance() {
    let colour = Rgb::new(1.0, 2.0, 3.0);
    for (name, part) in parts() {
        let geometry = Geometry::new(vec![part.clone()]);
        // Beside two others, so that the selection counts.
        let point = Emitter::Point { position: Vec3::ONE, intensity: Rgb::WHITE };
        let emitters = emitters(vec![area(part, colour), point.clone(), point]);
        let mut random = Random::new(3);
        let (mut met, mut hidden, mut missed) = (0, 0, 0);
        for _ in 0..20_000 {
            let from = random.next_direction() * 0.1;
            let Some(sample) = emitters.sample(from, random.next_f32(), random.next_vec2()) else {
                continue;
            };
            if sample.is_delta {
                continue;
            }
            assert!((sample.direction.length() - 1.0).abs() < 1e-6);
            let Some(at) = meet(&geometry, from, sample.direction) else {
                missed += 1;
                continue;
            };
            if ((at.position - from).length() / sample.distance - 1.0).abs() > 1e-3 {
                hidden += 1;
                continue;
            }
            met += 1;
            let pdf = emitters.pdf(FIRST, from, &at);
            // At a grazing hit a rounding of the direction moves the point by 1 / cosine times as much, and on a curved
            // emitter the cosine turns with the point.
            let cosine = -at.normal.dot(sample.direction);
            assert!(
                (pdf / sample.pdf - 1.0).abs() < 1e-4 + 5e-7 / (cosine * cosine),
                "{name}: {pdf} and {}",
                sample.pdf
            );
            assert_eq!(emitters.radiance(FIRST, &at, -sample.direction), sample.radiance, "{name}");
            assert_eq!(emitters.radiance(FIRST, &at, sample.direction), Rgb::BLACK, "{name}");
        }
        assert!(met > 2_000, "{name}: {met} met, {hidden} hidden");
        // Rounding at an edge or a silhouette may let a ray pass by.
        assert!(missed < 20, "{name}: {missed} of {met} missed");
        assert!(
            hidden == 0 || name.starts_with("octahedron") || name.starts_with("cylinder"),
            "{name}: {hidden}"
        );
    }
    for (name, environment) in environments() {
        let emitters = emitters(vec![Emitter::Environment(environment)]);
        let mut random = Random::new(4);
        for _ in 0..10_000 {
            let Some(sample) = emitters.sample(Vec3::ZERO, random.next_f32(), random.next_vec2())
            else {
                continue;
            };
            assert_eq!(emitters.environment_pdf(sample.direction), sample.pdf, "{name}");
            assert_eq!(emitters.environment(sample.direction), sample.radiance, "{name}");
            assert!(sample.distance.is_infinite() && !sample.is_delta);
        }
    }
}

#[test]
fn emitters_are_chosen_by_power_and_five_percent_evenly() {
    let point =
        |intensity| Emitter::Point { position: Vec3::ZERO, intensity: Rgb::splat(intensity) };
    let emitters = emitters(vec![point(3.0), point(0.0), point(1.0)]);
    let expected = [0.95 * 0.75 + 0.025, 0.0, 0.95 * 0.25 + 0.025];
    let mut counts = [0; 3];
    let mut random = Random::new(6);
    for _ in 0..100_000 {
        let sample = emitters
            .sample(Vec3::Z, random.next_f32(), random.next_vec2())
            .expect("there is light");
        let which = if sample.radiance.r == 3.0 { 0 } else { 2 };
        counts[which] += 1;
        assert_eq!(sample.pdf, emitters.probability(EmitterId(which as u32)));
    }
    for (id, expected) in expected.into_iter().enumerate() {
        assert!((f64::from(emitters.probability(EmitterId(id as u32))) - expected).abs() < 1e-6);
        // A binomial's standard deviation is at most 158 of 100 000.
        assert!((f64::from(counts[id]) - 1e5 * expected).abs() < 5.0 * 158.0, "{counts:?}");
    }
}

#[test]
fn light_is_found_wherever_the_environment_shines() {
    for (name, environment) in environments() {
        let emitters = emitters(vec![Emitter::Environment(environment)]);
        let mut random = Random::new(7);
        for _ in 0..100_000 {
            let direction = random.next_direction();
            let is_lit = !emitters.environment(direction).is_black();
            assert!(
                !is_lit || emitters.environment_pdf(direction) > 0.0,
                "{name}: no samples along {direction}"
            );
        }
    }
}
