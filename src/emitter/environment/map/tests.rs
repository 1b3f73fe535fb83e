use super::*;
use crate::emitter::Environment;
use glam::{DQuat, DVec3};

/// 5 × 4 texels without any symmetry.
fn texels() -> Vec<Rgb> {
    let texel = |x: usize, y: usize| [1 + x + 10 * y, (7 * x + 3 * y) % 5, (x * x + y) % 4];
    let texels = (0..4).flat_map(|y| (0..5).map(move |x| texel(x, y)));
    texels.map(|texel| Rgb::from(texel.map(|value| value as f32))).collect()
}

fn turned(texels: Vec<Rgb>) -> EnvironmentMap {
    let rotation = DQuat::from_axis_angle(DVec3::new(2.0, 2.0, -1.0) / 3.0, 40f64.to_radians());
    EnvironmentMap::new([5, 4], texels, 2.0, DMat3::from_quat(rotation)).unwrap()
}

#[test]
fn the_lookup_is_that_of_mitsuba() {
    // Mitsuba 3.9.1 scalar_rgb: envmap with these texels as bitmap, scale 2 and to_world
    // rotate([2/3, 2/3, -1/3], 40): emitter.eval for these directions, normalised.
    let golden: [([f32; 3], [f32; 3]); 8] = [
        ([0.3, 0.4, -0.5], [25.1667, 4.91467, 2.51384]),
        ([0.0, 1.0, 0.0], [17.2824, 3.68565, 0.984616]),
        ([0.1, -0.99, 0.05], [53.6723, 2.90783, 4.51238]),
        ([-0.7, 0.1, 0.6], [36.3568, 6.16312, 4.59764]),
        ([0.01, 0.02, 1.0], [29.0662, 5.28652, 3.0838]),
        ([-0.01, 0.02, 1.0], [29.2309, 5.32504, 3.1295]),
        ([1.0, 0.0, 0.001], [27.9585, 1.30098, 4.22908]),
        ([-0.2, -0.5, -0.9], [50.3549, 4.48642, 4.76644]),
    ];
    let environment = Environment::from(turned(texels()));
    for (direction, expected) in golden {
        let radiance = environment.radiance(Vec3::from(direction).normalize());
        let difference = (radiance - Rgb::from(expected)).map(f32::abs).max_component();
        assert!(difference < 2e-4, "{direction:?}: {radiance:?}, expected {expected:?}");
    }
}

#[test]
fn texels_that_are_no_radiance_are_counted_and_harmless() {
    let mut spoiled = texels();
    spoiled[3] = Rgb::new(f32::NAN, 1.0, 1.0);
    spoiled[8] = Rgb::new(-1.0, 1.0, 1.0);
    spoiled[12] = Rgb::new(1.0, f32::INFINITY, 1.0);
    let map = turned(spoiled);
    assert_eq!(map.invalid_texels(), 3);
    assert_eq!(colour(map.texels[3]), Rgb::new(0.0, 2.0, 2.0));
    assert_eq!(colour(map.texels[8]), Rgb::new(0.0, 2.0, 2.0));
    assert_eq!(colour(map.texels[12]), Rgb::new(2.0, 1e30, 2.0));
    for i in 0..100 {
        let u = Vec2::new(i as f32 / 100.0, (i * 37 % 100) as f32 / 100.0);
        let (direction, radiance, pdf) = map.sample(u).unwrap();
        assert!(direction.is_finite() && radiance.is_finite() && pdf.is_finite() && pdf > 0.0);
    }
    assert_eq!(turned(texels()).invalid_texels(), 0);
}

#[test]
fn the_fluence_is_the_integral_of_the_radiance() {
    let environment = Environment::from(turned(texels()));
    let count = 400;
    let mut sum = 0.0;
    for i in 0..count {
        for j in 0..2 * count {
            let z = (i as f32 + 0.5) / count as f32 * 2.0 - 1.0;
            let phi = (j as f32 + 0.5) / (2 * count) as f32 * TAU;
            let sine = (1.0 - z * z).sqrt();
            sum += mean(environment.radiance(Vec3::new(sine * phi.cos(), sine * phi.sin(), z)));
        }
    }
    let integral = sum * 4.0 * PI / f64::from(2 * count * count);
    // Cells count with the mean of their corners, which for four rows is a coarse quadrature of the sine.
    assert!(
        (environment.fluence() / integral - 1.0).abs() < 0.03,
        "{} and {integral}",
        environment.fluence()
    );
}

#[test]
fn what_is_no_map_is_refused() {
    let size = EnvironmentMap::new([5, 5], texels(), 1.0, DMat3::IDENTITY).unwrap_err();
    assert_eq!(size, EnvironmentError::Size { width: 5, height: 5, texels: 20 });
    assert!(EnvironmentMap::new([0, 0], Vec::new(), 1.0, DMat3::IDENTITY).is_err());
    let stretch = DMat3::from_diagonal(DVec3::new(1.0, 2.0, 1.0));
    let transform = EnvironmentMap::new([5, 4], texels(), 1.0, stretch).unwrap_err();
    assert!(matches!(transform, EnvironmentError::Transform { .. }));
    assert!(EnvironmentMap::new([5, 4], texels(), 1.0, DMat3::IDENTITY * -3.0).is_ok());
}

#[test]
fn a_changed_map_is_turned_around_its_poles_and_scaled() {
    let texels = (0..32).map(|i| Rgb::new(i as f32, 1.0, (i * 7 % 5) as f32)).collect();
    let tilt = DMat3::from_rotation_x(0.4);
    let map = EnvironmentMap::new([8, 4], texels, 1.0, tilt).unwrap();
    let turn = 0.9;
    let changed = map.changed(Rgb::new(2.0, 0.5, 1.0), turn);
    let turned = (tilt * DMat3::from_rotation_y(turn) * tilt.transpose()).as_mat3();
    for i in 0..200 {
        let u = Vec2::new(i as f32 * 0.618 % 1.0, i as f32 / 200.0);
        let direction = warp::square_to_sphere(u);
        let expected = map.radiance(direction) * Rgb::new(2.0, 0.5, 1.0);
        let found = changed.radiance(turned * direction);
        for (a, b) in expected.to_array().into_iter().zip(found.to_array()) {
            // Directions are rounded to 1e-7, a texel of up to 62 is 0.8 wide.
            assert!((a - b).abs() < 1e-4, "{a} {b} towards {direction}");
        }
        if let Some((direction, radiance, pdf)) = changed.sample(u) {
            assert_eq!((radiance, pdf), changed.radiance_and_pdf(direction));
        }
    }
    let grey = map.changed(Rgb::splat(3.0), 0.0);
    assert!((grey.fluence / map.fluence - 3.0).abs() < 1e-6);
}
