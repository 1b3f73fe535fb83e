//! Light that leaves: its directions, its rays from infinity and its power against what is claimed.

use super::places::{Cells, N, cell, turn};
use super::{FIRST, area, emitters, meet, octahedron, parts};
use crate::support::chi_square::chi_square;
use crate::support::mean::Mean;
use crate::support::random::Random;
use crate::support::sphere::SphereGrid;
use crate::support::{LEVEL, sidak};
use glam::{DMat3, DVec3, Vec2, Vec3};
use quietlight::emitter::{
    BoundingSphere, Emitter, EmitterId, Emitters, Environment, EnvironmentMap, LightPoint,
};
use quietlight::geometry::{Geometry, Mesh, Part};
use quietlight::math::{Frame, Rgb};
use quietlight::texture::{Checkerboard, Texture};
use std::f64::consts::{PI, TAU};

/// The sphere that [`emitters`] makes.
const RADIUS: f64 = 10.0;

pub(super) const INTENSITY: Rgb = Rgb::new(3.0, 2.0, 1.0);

pub(super) fn spot(cutoff_angle: f32, beam_width: f32) -> Emitter {
    Emitter::Spot {
        position: Vec3::new(1.0, 2.0, 3.0),
        direction: Vec3::new(0.3, -2.0, 0.6),
        intensity: INTENSITY,
        cutoff_angle,
        beam_width,
    }
}

pub(super) fn point() -> Emitter {
    Emitter::Point { position: Vec3::new(-1.0, 0.5, 2.0), intensity: INTENSITY }
}

pub(super) fn directional() -> Emitter {
    Emitter::Directional { direction: Vec3::new(0.3, -2.0, 0.6), irradiance: INTENSITY }
}

/// A map without symmetry, partly black.
pub(super) fn map() -> Emitter {
    let mut random = Random::new(31);
    let texel = |i: usize, random: &mut Random| {
        if i.is_multiple_of(9) { 0.0 } else { 20.0 * random.next_f32().powi(6) }
    };
    let texels = (0..16 * 8).map(|i| Rgb::splat(texel(i, &mut random))).collect();
    let turn = DMat3::from_axis_angle(DVec3::new(2.0, 2.0, -1.0) / 3.0, 1.0);
    Emitter::Environment(
        EnvironmentMap::new([16, 8], texels, 1.0, turn).expect("the sizes fit").into(),
    )
}

pub(super) fn constant() -> Emitter {
    Emitter::Environment(Environment::Constant(INTENSITY))
}

pub(super) fn draw_point(emitters: &Emitters, random: &mut Random) -> (EmitterId, LightPoint, f64) {
    let selection = random.next_f32();
    emitters.sample_point(selection, random.next_vec2()).expect("there is light")
}

/// A name, an emitter, and the axis around which it shines with the half-angle in radians.
type Beam = (String, Emitter, Option<(Vec3, f64)>);

/// Emitters that are somewhere.
fn finite_emitters() -> Vec<Beam> {
    let mut all: Vec<Beam> = parts()
        .into_iter()
        .map(|(name, part)| (name.to_owned(), area(part, INTENSITY), None))
        .collect();
    all.push(("point".to_owned(), point(), None));
    for (cutoff, beam) in [(0.5f32, 0.5f32), (30.0, 18.0), (110.0, 20.0), (180.0, 180.0)] {
        let axis = Vec3::new(0.3, -2.0, 0.6).normalize();
        let width = f64::from(cutoff).to_radians();
        all.push((format!("spot {cutoff} {beam}"), spot(cutoff, beam), Some((axis, width))));
    }
    all
}

#[test]
fn directions_of_emission_have_the_claimed_density() {
    let all = finite_emitters();
    let level = sidak(LEVEL, all.len());
    for (name, emitter, axis) in all {
        let emitters = emitters(vec![emitter]);
        let mut random = Random::new(35);
        let (id, at, _) = draw_point(&emitters, &mut random);
        let grid = match axis {
            // The rim of the cone is the edge after the twelfth of sixteen rows, so that no cell is cut.
            Some((axis, width)) if width < 2.3 => {
                let scale = width * 0.25 * PI / (0.75 * PI - width);
                SphereGrid::crowded(axis, scale, 16, 32)
            }
            _ => SphereGrid::uniform(Vec3::new(0.3, 0.4, -0.5).normalize(), 16, 32),
        };
        let test = grid.test(
            100_000,
            || {
                let (ray, pdf) = emitters.sample_emission(id, &at, random.next_vec2())?;
                assert!((ray.direction.length() - 1.0).abs() < 1e-6, "{name}");
                assert_eq!(pdf, emitters.emission_pdf(id, &at, ray.direction), "{name}");
                Some(ray.direction)
            },
            |direction| emitters.emission_pdf(id, &at, direction),
        );
        assert!(test.p > level, "{name}: {test:?}");
    }
}

#[test]
fn rays_from_infinity_are_uniform_on_the_disk_that_the_scene_shows_them() {
    const TOTAL: u64 = 100_000;
    let sphere = BoundingSphere { center: Vec3::new(5.0, -3.0, 20.0), radius: 7.0 };
    let center = sphere.center.as_dvec3();
    for (name, emitter) in [("constant", constant()), ("map", map()), ("parallel", directional())] {
        let emitters = Emitters::new(vec![emitter], sphere);
        let mut random = Random::new(36);
        let (id, at, _) = draw_point(&emitters, &mut random);
        let LightPoint::Infinite { direction, .. } = at else { panic!("{name} is at {at:?}") };
        let frame = Frame::from_normal(direction);
        let mut counts = vec![0u64; N * N];
        let mut density = 0.0;
        for _ in 0..TOTAL {
            let u = random.next_vec2();
            let (ray, pdf) = emitters.sample_emission(id, &at, u).expect("a ray");
            assert_eq!(
                (ray.direction, pdf),
                (-direction, emitters.emission_pdf(id, &at, -direction))
            );
            let from_center = ray.origin.as_dvec3() - center;
            assert!(from_center.length() > 7.0 && from_center.dot(direction.as_dvec3()) > 7.0);
            let local = frame.to_local(from_center.as_vec3()).truncate().as_dvec2() / 7.0;
            assert!(local.length() < 1.0 + 1e-5, "{name}: {local} misses the scene");
            counts[cell(local.length_squared(), turn(local.x, local.y))] += 1;
            density = pdf;
        }
        let probabilities = vec![density * PI * 49.0 / (N * N) as f64; N * N];
        let test = chi_square(&counts, &probabilities, TOTAL);
        assert!(test.p > sidak(LEVEL, 3), "{name}: {test:?}");
    }
    // The lens of a camera may lie beside the sphere.
    let lens = BoundingSphere { center: sphere.center + Vec3::X * 6.5, radius: 1.5 };
    let wider = Emitters::new(vec![constant()], sphere).reaching(lens);
    let mut random = Random::new(37);
    let (id, at, _) = draw_point(&wider, &mut random);
    assert!((wider.emission_pdf(id, &at, Vec3::Z) * PI * 64.0 - 1.0).abs() < 1e-4);
}

/// One sample of the power of all emitters in watts, red.
fn sampled_power(emitters: &Emitters, random: &mut Random) -> f64 {
    let (id, at, point_pdf) = draw_point(emitters, random);
    let Some((ray, pdf)) = emitters.sample_emission(id, &at, random.next_vec2()) else {
        return 0.0;
    };
    let cosine = match at {
        LightPoint::Surface { normal, .. } => f64::from(normal.dot(ray.direction)),
        LightPoint::Point { .. } | LightPoint::Infinite { .. } => 1.0,
    };
    f64::from(emitters.emitted(id, &at, ray.direction).r) * cosine / (point_pdf * pdf)
}

#[test]
fn the_power_of_all_light_that_leaves_is_the_analytic_one() {
    let red = f64::from(INTENSITY.r);
    let mut cases: Vec<(String, Emitter, f64)> = parts()
        .into_iter()
        .map(|(name, part)| {
            let area_of_part: f64 = Cells::new(&part).areas.iter().sum();
            (name.to_owned(), area(part, INTENSITY), PI * area_of_part * red)
        })
        .collect();
    // Half of the squares have three times the radiance.
    let board = Checkerboard {
        textures: Box::new([3.0, 1.0].map(|value| Texture::Constant(Rgb::splat(value)))),
        to_uv: glam::Affine2::IDENTITY,
    };
    let disk = Part::Sphere { center: Vec3::Y, radius: 0.5, flip_normals: false };
    let textured = Emitter::Area { part: disk, radiance: Texture::Checkerboard(board) };
    let integral: Mean = {
        // By uniform points on the surface, found by rays from the centre.
        let mut random = Random::new(38);
        let emitters = emitters(vec![textured.clone()]);
        let inside = Part::Sphere { center: Vec3::Y, radius: 0.5, flip_normals: false };
        let geometry = Geometry::new(vec![inside]);
        let radiance = |direction| {
            let at = meet(&geometry, Vec3::Y, direction).expect("the sphere is closed");
            f64::from(emitters.radiance(FIRST, &at, at.normal).r)
        };
        (0..400_000).map(|_| radiance(random.next_direction())).collect()
    };
    cases.push(("checkerboard".to_owned(), textured, PI * PI * integral.mean()));
    cases.push(("point".to_owned(), point(), 4.0 * PI * red));
    for (cutoff, beam) in [(0.5f32, 0.5f32), (30.0, 18.0), (110.0, 20.0), (180.0, 180.0)] {
        // 2π ∫ I(θ) sin θ dθ by midpoints.
        let [c, b] = [cutoff, beam].map(|angle| f64::from(angle).to_radians());
        let power: f64 = (0..100_000)
            .map(|i| {
                let theta = c * (f64::from(i) + 0.5) / 1e5;
                let falloff = if theta <= b { 1.0 } else { (c - theta) / (c - b) };
                TAU * red * falloff * theta.sin() * c / 1e5
            })
            .sum();
        cases.push((format!("spot {cutoff} {beam}"), spot(cutoff, beam), power));
    }
    let section = PI * RADIUS * RADIUS;
    cases.push(("directional".to_owned(), directional(), section * red));
    cases.push(("constant".to_owned(), constant(), section * 4.0 * PI * red));
    let sky = emitters(vec![map()]);
    let fluence: f64 = SphereGrid::uniform(Vec3::Z, 24, 48)
        .integrate(|direction| f64::from(sky.environment(direction).r))
        .iter()
        .sum();
    cases.push(("map".to_owned(), map(), section * fluence));

    let level = sidak(LEVEL, cases.len() + 1);
    let is_right = |name: &str, emitters: &Emitters, expected: f64, samples: u32| {
        let mut random = Random::new(39);
        let power: Mean = (0..samples).map(|_| sampled_power(emitters, &mut random)).collect();
        // Where every sample is the same they differ by their rounding, and the integrals are good to four digits; a spot
        // of half a degree has a cosine of four digits, which decides at its rim.
        let tolerance = if name.starts_with("spot 0.5") { 2e-3 } else { 2e-4 };
        let error = (power.mean() / expected - 1.0).abs();
        let p = power.p_against(expected);
        assert!(p > level || error < tolerance, "{name}: p {p}, error {error}, {expected} W");
    };
    for (name, emitter, expected) in &cases {
        is_right(name, &emitters(vec![emitter.clone()]), *expected, 100_000);
    }
    // A scene has one environment.
    let together: Vec<_> = cases.iter().filter(|(name, ..)| name != "constant").collect();
    let total = together.iter().map(|(.., power)| power).sum();
    let all = emitters(together.iter().map(|(_, emitter, _)| emitter.clone()).collect());
    is_right("all", &all, total, 400_000);
}

#[test]
fn emission_of_a_spot_is_what_a_surface_receives_of_it() {
    for (cutoff, beam) in [(30.0, 18.0), (110.0, 20.0), (5.0, 5.0)] {
        let emitters = emitters(vec![spot(cutoff, beam)]);
        let mut random = Random::new(41);
        let (id, at, _) = draw_point(&emitters, &mut random);
        let LightPoint::Point { position } = at else { panic!("{at:?}") };
        for _ in 0..5000 {
            let direction = random.next_direction();
            let received = emitters.sample(position + direction * 2.0, 0.5, Vec2::splat(0.5));
            let emitted = emitters.emitted(id, &at, direction) / 4.0;
            let Some(received) = received else {
                assert!(emitted.r < 1e-5, "{direction}");
                continue;
            };
            // Positions and directions round by 3e-7, and the intensity falls within 12 degrees.
            assert!((received.radiance.r - emitted.r).abs() < 3e-6 * 3.0, "{direction}");
        }
    }
}

#[test]
fn light_leaves_its_emitter_and_does_not_meet_it_again() {
    for offset in [Vec3::ZERO, Vec3::new(70.0, -300.0, 20.0)] {
        let moved: Vec<(&str, Part)> = parts()
            .into_iter()
            .chain([("small octahedron", octahedron(Vec3::ZERO, 1e-3))])
            .map(|(name, part)| (name, shifted(part, offset)))
            .collect();
        for (name, part) in moved {
            // Two triangles may see each other, and so may a cylinder's sides.
            if name == "bent quadrilateral" || name == "cylinder from inside" {
                continue;
            }
            let geometry = Geometry::new(vec![part.clone()]);
            let emitters = emitters(vec![area(part, INTENSITY)]);
            let mut random = Random::new(42);
            for _ in 0..20_000 {
                let (id, at, _) = draw_point(&emitters, &mut random);
                let Some((ray, pdf)) = emitters.sample_emission(id, &at, random.next_vec2()) else {
                    continue;
                };
                let hit = geometry.intersect(&ray);
                if name == "sphere from inside" {
                    // A chord, 2 r cos θ, of a ray whose start is moved inward by up to 6e-5.
                    let cosine = PI * pdf;
                    let t = f64::from(hit.expect("the sphere is closed").t);
                    let is_chord = (t - 4.0 * cosine).abs() < 1e-4 / cosine;
                    assert!(is_chord || cosine < 0.01, "{name} {ray:?} {t}");
                } else {
                    assert!(hit.is_none(), "{name} at {offset}: {at:?} {ray:?} {hit:?}");
                }
            }
        }
    }
}

fn shifted(part: Part, by: Vec3) -> Part {
    match part {
        Part::Mesh(mesh) => {
            let positions = mesh.positions.iter().map(|&position| position + by).collect();
            Part::Mesh(Mesh { positions, ..mesh })
        }
        Part::Sphere { center, radius, flip_normals } => {
            Part::Sphere { center: center + by, radius, flip_normals }
        }
        Part::Disk { center, axes, flip_normals } => {
            Part::Disk { center: center + by, axes, flip_normals }
        }
        Part::Cylinder { start, end, radius, flip_normals } => {
            Part::Cylinder { start: start + by, end: end + by, radius, flip_normals }
        }
    }
}
