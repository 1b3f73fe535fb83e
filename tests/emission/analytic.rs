//! Irradiance of emitters with nothing in between, against closed forms (METHODS, appendix H).

use super::{area, bent, emitters, irradiance, octahedron, rectangle};
use crate::support::mean::Mean;
use crate::support::random::Random;
use crate::support::{LEVEL, sidak};
use glam::{DMat3, DVec3, Vec3};
use quietlight::emitter::{Emitter, Emitters, Environment, EnvironmentMap};
use quietlight::geometry::Part;
use quietlight::math::Rgb;
use std::f64::consts::PI;

/// Irradiance of a polygon of radiance 1, all above the horizon, its corners clockwise seen from the receiver at the
/// origin (Lambert 1760): half the sum over the edges of the angle that each subtends times the cosine of the receiver's
/// normal with the edge's plane.
fn lambert(normal: DVec3, corners: &[Vec3]) -> f64 {
    let corners: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3().normalize()).collect();
    let edge = |i: usize| {
        let (from, to) = (corners[i], corners[(i + 1) % corners.len()]);
        let across = from.cross(to);
        across.length().atan2(from.dot(to)) * normal.dot(across.normalize())
    };
    -0.5 * (0..corners.len()).map(edge).sum::<f64>()
}

fn corners(part: &Part) -> Vec<Vec<Vec3>> {
    match part {
        Part::Mesh(mesh) => mesh
            .triangles
            .iter()
            .map(|t| t.map(|index| mesh.positions[index as usize]).to_vec())
            .collect(),
        _ => Vec::new(),
    }
}

/// p-value of the sampled irradiance at the origin against `expected`.
fn p_of(emitters: &Emitters, normal: Vec3, expected: f64, samples: usize) -> f64 {
    let mut random = Random::new(1);
    let estimates: Mean = (0..samples)
        .map(|_| irradiance(emitters, Vec3::ZERO, normal, random.next_f32(), random.next_vec2()))
        .collect();
    estimates.p_against(expected)
}

#[test]
fn polygons_give_lambert_s_irradiance() {
    let normal = Vec3::new(0.2, -0.1, 1.0).normalize();
    // Of the octahedron only the triangles that face the receiver shine on it, and none hides another.
    let octahedron = octahedron(Vec3::new(0.3, -0.4, 1.5), 0.8);
    for (name, part) in [("rectangle", rectangle()), ("bent", bent()), ("octahedron", octahedron)] {
        let expected: f64 = corners(&part)
            .iter()
            .map(|triangle| lambert(normal.as_dvec3(), triangle).max(0.0))
            .sum();
        let emitters = emitters(vec![area(part, Rgb::splat(2.0))]);
        let p = p_of(&emitters, normal, 2.0 * expected, 100_000);
        assert!(p > sidak(LEVEL, 3), "{name}: p {p}");
    }
}

#[test]
fn a_disk_on_its_axis_gives_pi_sine_squared() {
    let (radius, height) = (0.7f32, 1.2f32);
    let disk = Part::Disk {
        center: Vec3::Z * height,
        axes: [Vec3::Y * radius, Vec3::X * radius],
        flip_normals: false,
    };
    let sine_squared = f64::from(radius * radius / (radius * radius + height * height));
    let p = p_of(&emitters(vec![area(disk, Rgb::WHITE)]), Vec3::Z, PI * sine_squared, 100_000);
    assert!(p > LEVEL, "p {p}");
}

#[test]
fn spheres_give_the_square_of_their_angular_size() {
    // E = π (r / d)² cos θ, fully above the horizon; from near, far, and so far that the cosine rounds to one.
    for (distance, radius) in [(1.5f32, 1.0f32), (3.0, 1.0), (1e4, 1.0), (1e3, 1e-3)] {
        let direction = Vec3::new(0.1, 0.2, 1.0).normalize();
        let sphere = Part::Sphere { center: direction * distance, radius, flip_normals: false };
        let expected = PI * f64::from(radius / distance).powi(2) * f64::from(direction.z);
        let emitters = emitters(vec![area(sphere, Rgb::WHITE)]);
        let mut random = Random::new(2);
        let mean: Mean = (0..20_000)
            .map(|_| {
                irradiance(&emitters, Vec3::ZERO, Vec3::Z, random.next_f32(), random.next_vec2())
            })
            .collect();
        // From afar all samples are the same up to their rounding to single precision.
        let error = (mean.mean() / expected - 1.0).abs();
        let p = mean.p_against(expected);
        assert!(
            p > sidak(LEVEL, 4) || error < 2e-6,
            "at {distance}: p {p}, relative error {error}"
        );
    }
}

#[test]
fn a_closed_emitter_around_the_receiver_gives_pi() {
    let center = Vec3::new(0.3, -0.4, 0.5);
    let sphere = Part::Sphere { center, radius: 2.0, flip_normals: true };
    let constant = Emitter::Environment(Environment::Constant(Rgb::WHITE));
    let map = EnvironmentMap::new([7, 5], vec![Rgb::WHITE; 35], 1.0, DMat3::IDENTITY)
        .expect("the sizes fit");
    let map = Emitter::Environment(Environment::from(map));
    for (name, emitter) in
        [("sphere", area(sphere, Rgb::WHITE)), ("constant", constant), ("map", map)]
    {
        let p = p_of(&emitters(vec![emitter]), Vec3::new(0.6, 0.0, 0.8), PI, 100_000);
        assert!(p > sidak(LEVEL, 3), "{name}: p {p}");
    }
}

#[test]
fn a_cylinder_gives_the_irradiance_of_many_quadrilaterals() {
    let (start, end, radius) = (Vec3::new(-1.0, 0.2, 1.2), Vec3::new(0.8, 0.5, 1.6), 0.3);
    let cylinder = Part::Cylinder { start, end, radius, flip_normals: false };
    // 2000 facets as wide as the arc: their area differs from the cylinder's by 1e-6.
    let axis = (end - start).normalize();
    let side = axis.cross(Vec3::Z).normalize();
    let up = axis.cross(side);
    let rim = |i: u32| {
        let angle = f64::from(i) / 2000.0 * 2.0 * PI;
        (side * angle.cos() as f32 + up * angle.sin() as f32) * radius
    };
    let facet = |i: u32| [start + rim(i), start + rim(i + 1), end + rim(i + 1), end + rim(i)];
    let expected: f64 = (0..2000)
        .map(|i| lambert(DVec3::Z, &facet(i)).abs().max(0.0) * facing(facet(i), start, end))
        .sum();
    let p = p_of(&emitters(vec![area(cylinder, Rgb::WHITE)]), Vec3::Z, expected, 100_000);
    assert!(p > LEVEL, "p {p}, expected {expected}");
}

/// 1 if a facet of the cylinder turns its outside to the origin, else 0.
fn facing(facet: [Vec3; 4], start: Vec3, end: Vec3) -> f64 {
    let middle = (facet[0] + facet[1] + facet[2] + facet[3]) / 4.0;
    let axis = (end - start).normalize();
    let outward = (middle - start).reject_from_normalized(axis);
    if outward.dot(middle) < 0.0 { 1.0 } else { 0.0 }
}

#[test]
fn an_environment_map_gives_the_integral_of_its_lookup() {
    let mut random = Random::new(9);
    let texels: Vec<Rgb> =
        (0..16 * 8).map(|_| Rgb::splat(random.next_f32().powi(16) * 10.0)).collect();
    let map = EnvironmentMap::new([16, 8], texels, 1.0, DMat3::IDENTITY).expect("the sizes fit");
    let emitters = emitters(vec![Emitter::Environment(Environment::from(map))]);
    let normal = Vec3::new(0.5, 0.1, -0.7).normalize();
    let uniform: Mean = (0..1_000_000)
        .map(|_| {
            let direction = random.next_direction();
            f64::from(emitters.environment(direction).r * normal.dot(direction).max(0.0)) * 4.0 * PI
        })
        .collect();
    let sampled: Mean = (0..1_000_000)
        .map(|_| irradiance(&emitters, Vec3::ZERO, normal, random.next_f32(), random.next_vec2()))
        .collect();
    let p = uniform.p_same_as(&sampled);
    assert!(p > LEVEL, "p {p}: {uniform:?} {sampled:?}");
    // The reason for it all.
    assert!(sampled.variance() < 0.5 * uniform.variance(), "{uniform:?} {sampled:?}");
}

#[test]
fn delta_emitters_give_exact_irradiance() {
    let at = |emitter: Emitter, expected: f64| {
        let emitters = emitters(vec![emitter]);
        let value = irradiance(&emitters, Vec3::ZERO, Vec3::Z, 0.3, glam::Vec2::splat(0.5));
        assert!((value / expected - 1.0).abs() < 1e-6, "{value}, expected {expected}");
    };
    // E = I cos θ / d²: d² = 9, cos θ = 2/3.
    let position = Vec3::new(1.0, 2.0, 2.0);
    let intensity = Rgb::splat(5.0);
    at(Emitter::Point { position, intensity }, 5.0 * (2.0 / 3.0) / 9.0);
    let spot = |direction| Emitter::Spot {
        position,
        direction,
        intensity,
        cutoff_angle: 40.0,
        beam_width: 20.0,
    };
    at(spot(-position), 5.0 * (2.0 / 3.0) / 9.0);
    // 30° off the axis the intensity is half.
    let side = position.cross(Vec3::Z).normalize();
    let turned = -position.normalize() * 30f32.to_radians().cos() + side * 30f32.to_radians().sin();
    at(spot(turned), 0.5 * 5.0 * (2.0 / 3.0) / 9.0);
    at(
        Emitter::Directional { direction: Vec3::new(0.0, 0.6, -0.8), irradiance: intensity },
        5.0 * 0.8,
    );
}

#[test]
fn several_emitters_add_up() {
    let disk = Part::Disk { center: Vec3::Z, axes: [Vec3::Y, Vec3::X], flip_normals: false };
    let sphere =
        Part::Sphere { center: Vec3::new(3.0, 0.0, 3.0), radius: 0.5, flip_normals: false };
    let list = vec![
        area(disk, Rgb::splat(1e-3)),
        area(sphere, Rgb::splat(0.3)),
        Emitter::Point { position: Vec3::new(0.0, 0.0, 2.0), intensity: Rgb::splat(0.01) },
        Emitter::Directional { direction: -Vec3::Z, irradiance: Rgb::splat(0.002) },
        Emitter::Environment(Environment::Constant(Rgb::splat(0.001))),
    ];
    let expected = PI * 1e-3 * 0.5
        + PI * 0.3 * (0.25 / 18.0) * 0.5f64.sqrt()
        + 0.01 / 4.0
        + 0.002
        + PI * 0.001;
    let p = p_of(&emitters(list), Vec3::Z, expected, 1_000_000);
    assert!(p > LEVEL, "p {p}, expected {expected}");
}
