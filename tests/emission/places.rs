//! Places where light starts, against the densities that are claimed.

use super::walks::{INTENSITY, constant, directional, draw_point, map, point, spot};
use super::{FIRST, area, emitters, parts, rectangle};
use crate::support::chi_square::chi_square;
use crate::support::random::Random;
use crate::support::sphere::SphereGrid;
use crate::support::{LEVEL, sidak};
use glam::{DVec2, DVec3, Vec3};
use quietlight::emitter::LightPoint;
use quietlight::geometry::{Geometry, Interaction, Mesh, Part, Ray};
use quietlight::math::Rgb;
use std::f64::consts::{PI, TAU};

/// Cells that cover a part: of a point the cell, and of a cell the area. `None` for a point beside the part.
pub(super) struct Cells {
    pub(super) areas: Vec<f64>,
    locate: Box<dyn Fn(DVec3) -> Option<usize>>,
}

/// Rows and columns of a piece.
pub(super) const N: usize = 12;

/// The cell of two shares in `[0, 1]`.
pub(super) fn cell(x: f64, y: f64) -> usize {
    let index = |share: f64| ((share * N as f64) as usize).min(N - 1);
    index(x) * N + index(y)
}

/// The angle of a vector as a share of the full circle.
pub(super) fn turn(x: f64, y: f64) -> f64 {
    (y.atan2(x) / TAU).rem_euclid(1.0)
}

impl Cells {
    /// Cells of equal area on each piece of the part.
    pub(super) fn new(part: &Part) -> Self {
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
