//! Emitters at the limits of numbers and of sense (METHODS 14).

use super::{FIRST, area, emitters, irradiance, meet, octahedron, quad, rectangle};
use crate::support::mean::Mean;
use crate::support::random::Random;
use crate::support::{LEVEL, sidak};
use glam::{DMat3, Vec2, Vec3};
use quietlight::emitter::{
    BoundingSphere, Emitter, EmitterId, Emitters, Environment, EnvironmentMap,
};
use quietlight::geometry::{Geometry, Mesh, Part};
use quietlight::math::Rgb;
use std::f64::consts::PI;

/// Many samples are taken; all must be finite, and their number is returned.
fn count_samples(emitters: &Emitters, from: Vec3) -> usize {
    let mut random = Random::new(1);
    let samples =
        (0..1000).filter_map(|_| emitters.sample(from, random.next_f32(), random.next_vec2()));
    samples
        .inspect(|sample| {
            assert!(
                sample.direction.is_finite() && sample.pdf.is_finite() && sample.pdf > 0.0,
                "{sample:?}"
            );
            assert!(sample.radiance.is_finite() && sample.distance > 0.0, "{sample:?}");
        })
        .count()
}

#[test]
fn what_cannot_shine_is_never_chosen() {
    let flat = quad([Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + 2.0 * Vec3::X, Vec3::Z + 3.0 * Vec3::X]);
    let broken = quad([Vec3::NAN, Vec3::X, Vec3::Y, Vec3::X + Vec3::Y]);
    let missing = Part::Mesh(Mesh {
        positions: vec![Vec3::X],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    });
    let map = |texel: f32| {
        EnvironmentMap::new([4, 4], vec![Rgb::splat(texel); 16], 1.0, DMat3::IDENTITY)
            .expect("the sizes fit")
    };
    let black: Vec<Emitter> = vec![
        area(rectangle(), Rgb::BLACK),
        area(flat, Rgb::WHITE),
        area(broken, Rgb::WHITE),
        area(missing, Rgb::WHITE),
        area(Part::Mesh(Mesh::default()), Rgb::WHITE),
        area(Part::Sphere { center: Vec3::Z, radius: 0.0, flip_normals: false }, Rgb::WHITE),
        area(
            Part::Disk { center: Vec3::Z, axes: [Vec3::X, Vec3::X], flip_normals: false },
            Rgb::WHITE,
        ),
        area(
            Part::Cylinder { start: Vec3::Z, end: Vec3::Z, radius: 1.0, flip_normals: false },
            Rgb::WHITE,
        ),
        Emitter::Point { position: Vec3::Z, intensity: Rgb::BLACK },
        Emitter::Spot {
            position: Vec3::Z,
            direction: -Vec3::Z,
            intensity: Rgb::WHITE,
            cutoff_angle: 0.0,
            beam_width: 0.0,
        },
        Emitter::Directional { direction: Vec3::ZERO, irradiance: Rgb::WHITE },
        Emitter::Environment(Environment::from(map(0.0))),
    ];
    let dark = emitters(black.clone());
    assert!(dark.is_dark());
    assert_eq!(count_samples(&dark, Vec3::ZERO), 0);
    assert_eq!((dark.environment(Vec3::X), dark.environment_pdf(Vec3::X)), (Rgb::BLACK, 0.0));
    assert!(Emitters::default().is_dark());

    let count = black.len() as u32;
    let mut list = black;
    list.push(Emitter::Point { position: Vec3::Z, intensity: Rgb::WHITE });
    let lit = emitters(list);
    (0..count).for_each(|id| assert_eq!(lit.probability(EmitterId(id)), 0.0, "emitter {id}"));
    assert_eq!(lit.probability(EmitterId(count)), 1.0);
    assert_eq!(count_samples(&lit, Vec3::ZERO), 1000);

    let mut texels = vec![Rgb::BLACK; 16];
    texels[5] = Rgb::splat(f32::NAN);
    let spoiled = EnvironmentMap::new([4, 4], texels, 1.0, DMat3::IDENTITY).expect("the sizes fit");
    assert!(emitters(vec![Emitter::Environment(Environment::from(spoiled))]).is_dark());
}

#[test]
fn tiny_and_huge_emitters_stand_beside_each_other() {
    // Squares of area 1e-12 and 1e6, of radiances that make them equally strong at the receiver, and one far dimmer.
    let square = |height: f32, side: f32| {
        let half = 0.5 * side;
        quad([
            Vec3::new(-half, -half, height),
            Vec3::new(-half, half, height),
            Vec3::new(half, half, height),
            Vec3::new(half, -half, height),
        ])
    };
    let list = vec![
        area(square(1.0, 1e-6), Rgb::splat(1e8)),
        area(square(1e4, 1e3), Rgb::splat(1e-8)),
        Emitter::Point { position: Vec3::Z * 1e3, intensity: Rgb::splat(1e-2) },
    ];
    // Both squares are small against their distances: E = L A / d² to 1e-3; the point adds I / d².
    let expected = [1e8 * 1e-12, 1e-8 * 1e6 / 1e8, 1e-2 / 1e6];
    let all = emitters(list.clone());
    for id in 0..3 {
        assert!(all.probability(EmitterId(id)) >= 0.05 / 3.0);
    }
    let mut random = Random::new(2);
    for (emitter, expected) in list.into_iter().zip(expected) {
        let alone = emitters(vec![emitter]);
        let mean: Mean = (0..1000)
            .map(|_| irradiance(&alone, Vec3::ZERO, Vec3::Z, random.next_f32(), random.next_vec2()))
            .collect();
        assert!((mean.mean() / expected - 1.0).abs() < 5e-3, "{mean:?}, expected {expected}");
    }
    let together: Mean = (0..100_000)
        .map(|_| irradiance(&all, Vec3::ZERO, Vec3::Z, random.next_f32(), random.next_vec2()))
        .collect();
    let total: f64 = expected.iter().sum();
    assert!(
        (together.mean() / total - 1.0).abs()
            < 5e-3 + 5.0 * together.variance_of_mean().sqrt() / total
    );
}

#[test]
fn an_emitter_too_small_for_its_density_is_left_to_chance_consistently() {
    // 1 / area overflows single precision: neither sampled nor given a density, so that hits keep all their weight.
    let part = octahedron(Vec3::Z, 1e-25);
    let emitters = emitters(vec![area(part, Rgb::WHITE)]);
    assert!(emitters.is_dark());
}

#[test]
fn irradiance_does_not_depend_on_the_scale_of_the_scene() {
    for (i, scale) in [1e-4f32, 1.0, 1e3, 1e7].into_iter().enumerate() {
        let sphere =
            Part::Sphere { center: Vec3::Z * 3.0 * scale, radius: scale, flip_normals: false };
        let disk = Part::Disk {
            center: Vec3::new(0.0, 0.0, scale),
            axes: [Vec3::Y * scale * 0.3, Vec3::X * scale * 0.3],
            flip_normals: false,
        };
        let emitters = Emitters::new(
            vec![
                area(sphere, Rgb::WHITE),
                area(disk, Rgb::WHITE),
                Emitter::Environment(Environment::Constant(Rgb::splat(0.1))),
            ],
            BoundingSphere { center: Vec3::ZERO, radius: 5.0 * scale },
        );
        let mut random = Random::new(3 + i as u64);
        let mean: Mean = (0..100_000)
            .map(|_| {
                irradiance(&emitters, Vec3::ZERO, Vec3::Z, random.next_f32(), random.next_vec2())
            })
            .collect();
        let p = mean.p_against(PI / 9.0 + PI * 0.09 / 1.09 + 0.1 * PI);
        assert!(p > sidak(LEVEL, 4), "scale {scale}: p {p}");
    }
}

#[test]
fn receivers_behind_beside_and_on_an_emitter_stay_finite() {
    let lit = emitters(vec![area(rectangle(), Rgb::WHITE)]);
    let center = Vec3::new(-0.25, 0.5, 2.0);
    // Behind, in its plane, at one of its corners and inside it.
    for from in [center + Vec3::Z, center + Vec3::X * 5.0, Vec3::new(-1.0, -0.5, 2.0), center] {
        assert_eq!(count_samples(&lit, from), 0, "from {from}");
    }
    // A hair in front of it; nearly edge-on.
    count_samples(&lit, center - Vec3::Z * 1e-6);
    count_samples(&lit, center + Vec3::new(1e5, 0.0, -1e-3));

    let sphere = Part::Sphere { center: Vec3::ZERO, radius: 1.0, flip_normals: false };
    let geometry = Geometry::new(vec![sphere.clone()]);
    let outward = emitters(vec![area(sphere, Rgb::WHITE)]);
    let inside = Vec3::new(0.1, 0.2, 0.3);
    assert_eq!(count_samples(&outward, inside), 0);
    let at = meet(&geometry, inside, Vec3::X).expect("the sphere surrounds the point");
    assert_eq!(outward.pdf(FIRST, inside, &at), 0.0);
    assert_eq!(outward.radiance(FIRST, &at, -Vec3::X), Rgb::BLACK);
    for surface in [Vec3::X, Vec3::ONE.normalize(), Vec3::new(1.0 + f32::EPSILON, 0.0, 0.0)] {
        count_samples(&outward, surface);
    }
    let inward = emitters(vec![area(
        Part::Sphere { center: Vec3::ZERO, radius: 1.0, flip_normals: true },
        Rgb::WHITE,
    )]);
    assert_eq!(count_samples(&inward, Vec3::X * 2.0), 0);
    assert_eq!(count_samples(&inward, Vec3::ZERO), 1000);
}

#[test]
fn numbers_at_the_ends_of_their_interval_are_harmless() {
    let last = 1.0 - f32::EPSILON / 2.0;
    let texels = vec![Rgb::WHITE; 6];
    let map = EnvironmentMap::new([3, 2], texels, 1.0, DMat3::IDENTITY).expect("the sizes fit");
    let lists = super::parts().into_iter().map(|(_, part)| area(part, Rgb::WHITE));
    for emitter in lists.chain([Emitter::Environment(Environment::from(map))]) {
        let emitters = emitters(vec![emitter]);
        for selection in [0.0, last] {
            for u in [
                Vec2::ZERO,
                Vec2::splat(last),
                Vec2::new(0.0, last),
                Vec2::new(last, 0.0),
                Vec2::splat(0.5),
            ] {
                if let Some(sample) = emitters.sample(Vec3::ZERO, selection, u) {
                    assert!(
                        (sample.direction.length() - 1.0).abs() < 1e-6 && sample.pdf > 0.0,
                        "{u}: {sample:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_mesh_shines_to_the_side_of_its_vertex_normals() {
    // As Mitsuba 3.9.1: winding, vertex normals and `flip_normals` together decide, see the cases.
    for (vertex_normal, flip_normals, shines_up) in [
        (None, false, true),
        (None, true, false),
        (Some(Vec3::Z), false, true),
        (Some(-Vec3::Z), false, false),
        (Some(Vec3::Z), true, false),
        (Some(-Vec3::Z), true, true),
    ] {
        let part = Part::Mesh(Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vertex_normal.map_or(Vec::new(), |normal| vec![normal; 3]),
            triangles: vec![[0, 1, 2]],
            flip_normals,
            ..Mesh::default()
        });
        let geometry = Geometry::new(vec![part.clone()]);
        let lit = emitters(vec![area(part, Rgb::WHITE)]);
        for (side, is_lit) in [(1.0, shines_up), (-1.0, !shines_up)] {
            let from = Vec3::new(0.2, 0.3, side);
            let at = meet(&geometry, from, Vec3::Z * -side).expect("the triangle is below");
            assert_eq!(lit.radiance(FIRST, &at, Vec3::Z * side).is_black(), !is_lit);
            assert_eq!(lit.pdf(FIRST, from, &at) > 0.0, is_lit);
            assert_eq!(lit.sample(from, 0.5, Vec2::splat(0.4)).is_some(), is_lit);
        }
    }
}

#[test]
fn light_of_a_sphere_comes_from_its_surface_however_near_it_is() {
    // What of the distance is missing at its end is inside of the sphere, where the shadow ray would meet it from within.
    let (center, radius) = (Vec3::new(0.3, -1.7, 2.9), 1.0);
    let part = Part::Sphere { center, radius, flip_normals: false };
    let emitters = emitters(vec![area(part, Rgb::WHITE)]);
    for gap in [1e-1_f32, 1e-2, 1e-3, 3e-4, 1e-4] {
        // Obliquely, so that the distance is no sum of few powers of two.
        let axis = Vec3::new(0.51, -0.33, 0.79).normalize();
        let from = center - axis * (radius + gap);
        let mut checked = 0;
        for (x, y) in (0..16).flat_map(|x| (0..16).map(move |y| (x, y))) {
            let u = (Vec2::new(x as f32, y as f32) + 0.5) / 16.0;
            let sample = emitters.sample(from, 0.5, u).expect("the sphere is seen");
            let (d, to_center) =
                (sample.direction.as_dvec3().normalize(), (center - from).as_dvec3());
            let middle = d.dot(to_center);
            let chord = middle * middle - to_center.length_squared() + f64::from(radius).powi(2);
            // Not at the rim, where the distance depends on the last digit of the direction.
            if d.dot(axis.as_dvec3()) > 0.3 {
                let nearer = middle - chord.sqrt();
                let error = f64::from(sample.distance) / nearer - 1.0;
                assert!(error.abs() < 1e-4, "gap {gap}, {u}: {error:e} of {nearer:e}");
                checked += 1;
            }
        }
        assert!(checked > 100, "{gap}: {checked}");
    }
}
