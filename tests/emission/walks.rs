//! Light at its source: where it starts and where it goes, against the densities and the power that are claimed.

use super::{FIRST, area, emitters, meet, octahedron, parts, rectangle};
use crate::support::chi_square::chi_square;
use crate::support::mean::Mean;
use crate::support::random::Random;
use crate::support::sphere::SphereGrid;
use crate::support::{LEVEL, sidak};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use quietlight::emitter::{
    BoundingSphere, Emitter, EmitterId, Emitters, Environment, EnvironmentMap, LightPoint,
};
use quietlight::geometry::{Geometry, Interaction, Mesh, Part, Ray};
use quietlight::math::{Frame, Rgb};
use quietlight::texture::{Checkerboard, Texture};
use std::f64::consts::{PI, TAU};

/// The sphere that [`emitters`] makes.
const RADIUS: f64 = 10.0;

const INTENSITY: Rgb = Rgb::new(3.0, 2.0, 1.0);

fn spot(cutoff_angle: f32, beam_width: f32) -> Emitter {
    Emitter::Spot {
        position: Vec3::new(1.0, 2.0, 3.0),
        direction: Vec3::new(0.3, -2.0, 0.6),
        intensity: INTENSITY,
        cutoff_angle,
        beam_width,
    }
}

fn point() -> Emitter {
    Emitter::Point { position: Vec3::new(-1.0, 0.5, 2.0), intensity: INTENSITY }
}

fn directional() -> Emitter {
    Emitter::Directional { direction: Vec3::new(0.3, -2.0, 0.6), irradiance: INTENSITY }
}

/// A map without symmetry, partly black.
fn map() -> Emitter {
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

fn constant() -> Emitter {
    Emitter::Environment(Environment::Constant(INTENSITY))
}

fn draw_point(emitters: &Emitters, random: &mut Random) -> (EmitterId, LightPoint, f64) {
    let selection = random.next_f32();
    emitters.sample_point(selection, random.next_vec2()).expect("there is light")
}

/// Cells that cover a part: of a point the cell, and of a cell the area. `None` for a point beside the part.
struct Cells {
    areas: Vec<f64>,
    locate: Box<dyn Fn(DVec3) -> Option<usize>>,
}

const N: usize = 12;

fn cell(x: f64, y: f64) -> usize {
    let index = |share: f64| ((share * N as f64) as usize).min(N - 1);
    index(x) * N + index(y)
}

fn turn(x: f64, y: f64) -> f64 {
    (y.atan2(x) / TAU).rem_euclid(1.0)
}

impl Cells {
    /// Cells of equal area on each piece of the part.
    fn new(part: &Part) -> Self {
        let even = |area: f64| vec![area / (N * N) as f64; N * N];
        match part {
            Part::Mesh(mesh) => {
                let triangles: Vec<[DVec3; 3]> = mesh
                    .triangles
                    .iter()
                    .map(|t| t.map(|index| mesh.positions[index as usize].as_dvec3()))
                    .collect();
                let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
                Self {
                    areas: triangles.iter().flat_map(|&triangle| even(area(triangle))).collect(),
                    locate: Box::new(move |p| {
                        triangles.iter().enumerate().find_map(|(i, &[a, b, c])| {
                            let normal = (b - a).cross(c - a);
                            let share = |from: DVec3, to: DVec3| {
                                (to - from).cross(p - from).dot(normal) / normal.length_squared()
                            };
                            let [x, y] = [share(c, a), share(a, b)];
                            let height = (p - a).dot(normal.normalize());
                            let is_inside = x >= 0.0 && y >= 0.0 && x + y <= 1.0;
                            // For uniform points (1 - x)² and y / (1 - x) are uniform.
                            (is_inside && height.abs() < 1e-6)
                                .then(|| i * N * N + cell((1.0 - x) * (1.0 - x), y / (1.0 - x)))
                        })
                    }),
                }
            }
            &Part::Sphere { center, radius, .. } => Self {
                areas: even(4.0 * PI * f64::from(radius).powi(2)),
                locate: Box::new(move |p| {
                    let p = (p - center.as_dvec3()) / f64::from(radius);
                    ((p.length() - 1.0).abs() < 1e-6)
                        .then(|| cell(0.5 * (p.z + 1.0), turn(p.x, p.y)))
                }),
            },
            &Part::Disk { center, axes, .. } => {
                let [a, b] = axes.map(|axis| axis.as_dvec3());
                let normal = a.cross(b);
                Self {
                    areas: even(PI * normal.length()),
                    locate: Box::new(move |p| {
                        let p = p - center.as_dvec3();
                        let x = p.cross(b).dot(normal) / normal.length_squared();
                        let y = a.cross(p).dot(normal) / normal.length_squared();
                        (p.dot(normal.normalize()).abs() < 1e-6)
                            .then(|| cell(DVec2::new(x, y).length_squared(), turn(x, y)))
                    }),
                }
            }
            &Part::Cylinder { start, end, radius, .. } => {
                let span = (end - start).as_dvec3();
                let across = span.normalize().any_orthonormal_vector();
                let other = span.normalize().cross(across);
                Self {
                    areas: even(TAU * f64::from(radius) * span.length()),
                    locate: Box::new(move |p| {
                        let p = p - start.as_dvec3();
                        let (x, y) = (p.dot(across), p.dot(other));
                        ((x.hypot(y) / f64::from(radius) - 1.0).abs() < 1e-5)
                            .then(|| cell(p.dot(span) / span.length_squared(), turn(x, y)))
                    }),
                }
            }
        }
    }
}

#[test]
fn points_of_parts_have_the_claimed_density() {
    const TOTAL: u64 = 200_000;
    let parts = parts();
    let level = sidak(LEVEL, parts.len());
    for (name, part) in parts {
        let cells = Cells::new(&part);
        // Beside another, so that the selection counts.
        let emitters = emitters(vec![area(part, Rgb::WHITE), point()]);
        let mut random = Random::new(32);
        let mut counts = vec![0u64; cells.areas.len()];
        let mut density = 0.0;
        for _ in 0..TOTAL {
            let (id, at, pdf) = draw_point(&emitters, &mut random);
            assert_eq!(pdf, emitters.point_pdf(id, &at), "{name}");
            if let LightPoint::Surface { position, normal, .. } = at {
                assert!(id == FIRST && !emitters.is_delta(id), "{name}");
                assert!((normal.length() - 1.0).abs() < 1e-6, "{name}");
                let found = (cells.locate)(position.as_dvec3());
                // Rounding may put a point of an edge beside the part.
                if let Some(cell) = found {
                    counts[cell] += 1;
                }
                density = pdf;
            } else {
                assert!(id != FIRST && emitters.is_delta(id), "{name}");
            }
        }
        let probabilities: Vec<f64> = cells.areas.iter().map(|area| area * density).collect();
        let mass: f64 = probabilities.iter().sum();
        let selected = f64::from(emitters.probability(FIRST));
        assert!((mass / selected - 1.0).abs() < 1e-5, "{name}: {mass} and {selected}");
        let test = chi_square(&counts, &probabilities, TOTAL);
        assert!(test.p > level, "{name}: {test:?}");
    }
}

#[test]
fn places_at_infinity_have_the_claimed_density() {
    for (name, environment) in [("constant", constant()), ("map", map())] {
        let emitters = emitters(vec![environment, point(), directional()]);
        let mut random = Random::new(33);
        let id = emitters.environment_id().expect("there is one");
        assert!(!emitters.is_delta(id));
        let grid = SphereGrid::uniform(Vec3::new(0.3, 0.4, -0.5).normalize(), 24, 48);
        let test = grid.test(
            200_000,
            || match draw_point(&emitters, &mut random) {
                (found, LightPoint::Infinite { direction, is_delta: false }, _) => {
                    assert_eq!(found, id);
                    Some(direction)
                }
                _ => None,
            },
            |direction| {
                emitters.point_pdf(id, &LightPoint::Infinite { direction, is_delta: false })
            },
        );
        assert!(test.p > sidak(LEVEL, 2), "{name}: {test:?}");
    }
}

#[test]
fn emitters_without_extent_are_chosen_with_the_claimed_probability() {
    const TOTAL: u64 = 100_000;
    let emitters = emitters(vec![point(), spot(40.0, 20.0), directional(), spot(90.0, 90.0)]);
    assert_eq!(emitters.environment_id(), None);
    let mut random = Random::new(34);
    let mut counts = [0; 4];
    let mut probabilities = [0.0; 4];
    for _ in 0..TOTAL {
        let (id, at, pdf) = draw_point(&emitters, &mut random);
        assert_eq!(matches!(at, LightPoint::Infinite { is_delta: true, .. }), id.0 == 2);
        counts[id.0 as usize] += 1;
        probabilities[id.0 as usize] = pdf;
    }
    assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-6, "{probabilities:?}");
    let test = chi_square(&counts, &probabilities, TOTAL);
    assert!(test.p > LEVEL, "{test:?}");
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
fn a_light_point_found_by_a_ray_is_one_that_sampling_gives() {
    // Vertex normals against the winding: the other side shines.
    let turned = match rectangle() {
        Part::Mesh(mesh) => Part::Mesh(Mesh { normals: vec![Vec3::Z; 4], ..mesh }),
        part => part,
    };
    for (name, part) in parts().into_iter().chain([("turned", turned)]) {
        let geometry = Geometry::new(vec![part.clone()]);
        let emitters = emitters(vec![area(part, INTENSITY), point()]);
        let mut random = Random::new(40);
        for _ in 0..2000 {
            let (id, at, pdf) = draw_point(&emitters, &mut random);
            let LightPoint::Surface { position, normal, .. } = at else { continue };
            // From a little above the point, straight down.
            let ray = Ray::new(position + normal * 0.01, -normal);
            let Some(hit) = geometry.intersect(&ray) else { continue };
            let interaction: Interaction = geometry.interaction(&ray, &hit);
            let found = emitters.surface_point(id, &interaction);
            assert_eq!(emitters.point_pdf(id, &found), pdf, "{name}");
            let LightPoint::Surface { position: p, normal: n, .. } = found else {
                panic!("{name}: {found:?}")
            };
            assert!(
                p.distance(position) < 1e-5 && n.dot(normal) > 0.9999,
                "{name}: {at:?} {found:?}"
            );
            let direction = random.next_direction();
            let cosine = n.dot(direction);
            if cosine.abs() < 1e-3 {
                continue;
            }
            let radiance = emitters.radiance(id, &interaction, direction);
            assert_eq!(emitters.emitted(id, &found, direction), radiance, "{name}");
            assert_eq!(emitters.emitted(id, &at, direction), radiance, "{name}");
            assert_eq!(radiance.is_black(), cosine < 0.0, "{name}");
            let pdf = emitters.emission_pdf(id, &found, direction);
            assert!((pdf - f64::from(cosine.max(0.0)) / PI).abs() < 1e-6, "{name}");
        }
    }
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
