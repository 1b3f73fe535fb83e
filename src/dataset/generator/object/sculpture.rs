//! Single pieces of curved or faceted shape.

use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::mesh::Mesh;
use crate::dataset::generator::random::Random;
use crate::dataset::generator::solid;
use glam::{DMat4, DQuat, DVec2, DVec3};
use std::f64::consts::TAU;

/// A piece.
pub(super) fn sculpture(random: &mut Random) -> Object {
    let mesh = match random.integer(0, 8) {
        0 => solid::bumpy_sphere(random, 96),
        1 => solid::bumpy_sphere(random, 12).faceted(),
        2 => turned(random, &solid::torus(0.35, 64)),
        3 => knot(random),
        4 => solid::superquadric(random, 72),
        5 => {
            let outline = solid::star(random.pick(&[6, 8, 10, 12, 16]), random.uniform(0.4, 0.9));
            let twist = random.uniform(-2.0, 2.0);
            solid::prism(&outline, random.uniform(0.5, 3.0), random.uniform(0.3, 1.2), twist, 24)
        }
        6 => gem(random),
        7 => cloth(random),
        _ => return vehicle(random),
    };
    let is_sheet = mesh.bounds().1.y - mesh.bounds().0.y < 0.6;
    let role = if is_sheet { Role::Sheet } else { Role::Thing(0) };
    Object::of(role, Form::Mesh(mesh))
}

fn turned(random: &mut Random, mesh: &Mesh) -> Mesh {
    if random.chance(0.5) {
        return mesh.clone();
    }
    let turn = DQuat::from_rotation_arc(DVec3::Y, random.direction());
    mesh.transformed(&DMat4::from_quat(turn))
}

/// A torus knot.
fn knot(random: &mut Random) -> Mesh {
    let (p, q) = random.pick(&[(2.0, 3.0), (3.0, 2.0), (2.0, 5.0), (3.0, 4.0)]);
    let count = 240;
    let curve: Vec<DVec3> = (0..count)
        .map(|i| {
            let t = TAU * f64::from(i) / f64::from(count);
            let r = 1.0 + 0.45 * (q * t).cos();
            DVec3::new(r * (p * t).cos(), 0.45 * (q * t).sin() + 0.5, r * (p * t).sin())
        })
        .collect();
    let radius = random.uniform(0.08, 0.22);
    turned(random, &solid::tube(&curve, |_| radius, 16, true))
}

/// A faceted stone: rings of corners of random radii.
fn gem(random: &mut Random) -> Mesh {
    let (segments, rows) = (random.integer(5, 9), random.integer(2, 4));
    let mut profile = vec![DVec2::ZERO];
    for row in 0..rows {
        let y = (f64::from(row as u32) + random.uniform(0.3, 1.0)) / rows as f64 * 1.6;
        profile.push(DVec2::new(random.uniform(0.4, 0.9), y));
    }
    profile.push(DVec2::new(0.0, 1.9));
    solid::revolve(&profile, segments).faceted()
}

/// A wavy sheet.
fn cloth(random: &mut Random) -> Mesh {
    let noise = crate::dataset::generator::noise::Noise::new(random.seed());
    let (scale, height) = (random.uniform(1.0, 4.0), random.uniform(0.05, 0.35));
    solid::sheet(64, 1.0, |x, z| {
        height * (1.0 + noise.space_octaves(DVec3::new(x, 0.0, z) * scale, 3))
    })
}

/// A hull with boxes growing out of it: machinery, a ship, a city.
fn vehicle(random: &mut Random) -> Object {
    let mut object = Object::default();
    let hull =
        DVec3::new(random.uniform(0.6, 1.5), random.uniform(0.15, 0.5), random.uniform(0.3, 0.8));
    object.add_mesh(Role::Thing(0), &solid::cuboid(-hull, hull));
    let mut faces = vec![(DVec3::ZERO, hull)];
    for k in 0..random.integer(10, 60) {
        let (center, half) = faces[random.integer(0, faces.len() - 1)];
        let mut axis = random.direction().abs();
        axis = if axis.y > 0.5 {
            DVec3::Y
        } else if axis.x > axis.z {
            DVec3::X
        } else {
            DVec3::Z
        };
        let side = if random.chance(0.25) && axis != DVec3::Y { -axis } else { axis };
        let size = half * random.uniform(0.15, 0.6);
        let reach = size * axis * random.uniform(0.2, 1.5);
        let free = (half - size).max(DVec3::ZERO) * (DVec3::ONE - axis);
        let place = center + random.point(-free, free) + side * (half * axis + reach).length();
        let grown = size * (DVec3::ONE - axis) + reach;
        let role = Role::Thing(if random.chance(0.7) { 0 } else { 1 + (k % 2) as u8 });
        object.add_mesh(role, &solid::cuboid(place - grown, place + grown));
        faces.push((place, grown));
    }
    object
}
