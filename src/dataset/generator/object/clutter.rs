//! Many small things: grids, heaps, rows.

use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::mesh::Mesh;
use crate::dataset::generator::random::Random;
use crate::dataset::generator::solid;
use glam::{DMat4, DQuat, DVec2, DVec3};

/// A grid or a heap of one kind of small thing, in one to three materials.
pub(super) fn clutter(random: &mut Random) -> Object {
    let materials = random.integer(1, 3);
    let small = random.integer(0, 4);
    if random.chance(0.5) { grid(random, materials, small) } else { heap(random, materials, small) }
}

/// A small thing of radius about 1 around the origin; `None` is a sphere.
fn piece(random: &mut Random, small: usize) -> Option<Mesh> {
    Some(match small {
        0 => return None,
        1 => {
            let half = DVec3::new(
                random.uniform(0.3, 0.8),
                random.uniform(0.3, 0.8),
                random.uniform(0.3, 0.8),
            );
            solid::cuboid(-half, half)
        }
        2 => solid::torus(0.3, 20),
        3 => {
            let outline = solid::star(random.pick(&[3, 5, 6, 10]), random.uniform(0.5, 1.0));
            solid::prism(&outline, 1.0, random.uniform(0.0, 1.0), 0.0, 1)
        }
        _ => solid::revolve(
            &[
                DVec2::ZERO,
                DVec2::new(0.5, 0.05),
                DVec2::new(0.8, 0.5),
                DVec2::new(0.4, 1.0),
                DVec2::ZERO + DVec2::Y * 1.2,
            ],
            16,
        ),
    })
}

fn add(
    object: &mut Object,
    role: Role,
    mesh: Option<&Mesh>,
    center: DVec3,
    scale: f64,
    turn: DQuat,
) {
    match mesh {
        None => object.add(role, Form::Sphere { center, radius: scale }),
        Some(mesh) => {
            let matrix = DMat4::from_scale_rotation_translation(DVec3::splat(scale), turn, center);
            object.add_mesh(role, &mesh.transformed(&matrix));
        }
    }
}

fn role(random: &mut Random, materials: usize) -> Role {
    Role::Thing(random.integer(0, materials - 1) as u8)
}

fn grid(random: &mut Random, materials: usize, small: usize) -> Object {
    let mut object = Object::default();
    let (columns, rows, layers) =
        (random.integer(2, 7), random.integer(2, 7), random.integer(1, 3));
    let mesh = piece(random, small);
    let radius = random.uniform(0.25, 0.48);
    let jitter = if random.chance(0.5) { 0.15 } else { 0.0 };
    for index in 0..columns * rows * layers {
        let (x, z, y) = (index % columns, index / columns % rows, index / columns / rows);
        let offset =
            random.point(DVec3::splat(-jitter), DVec3::splat(jitter)) * (DVec3::ONE - DVec3::Y);
        let center = DVec3::new(x as f64, y as f64 + 0.5, z as f64) + offset;
        let turn = DQuat::from_rotation_y(random.angle() * f64::from(u8::from(jitter > 0.0)));
        let role = role(random, materials);
        add(&mut object, role, mesh.as_ref(), center, radius, turn);
    }
    object
}

/// Things dropped on each other: each rests on the highest one below it.
fn heap(random: &mut Random, materials: usize, small: usize) -> Object {
    let mut object = Object::default();
    let mut placed: Vec<(DVec3, f64)> = Vec::new();
    let spread = random.uniform(0.8, 2.0);
    for _ in 0..random.integer(12, 70) {
        let mesh = piece(random, small);
        let radius = random.uniform(0.15, 0.4);
        let (angle, distance) = (random.angle(), spread * random.unit().sqrt());
        let at = DVec2::from_angle(angle) * distance;
        let mut y = radius * 0.9;
        for (center, other) in &placed {
            let gap = at.distance(DVec2::new(center.x, center.z));
            let reach = radius + other;
            if gap < reach {
                y = f64::max(y, center.y + (reach * reach - gap * gap).sqrt() * 0.9);
            }
        }
        let center = DVec3::new(at.x, y, at.y);
        placed.push((center, radius));
        let turn = DQuat::from_rotation_arc(DVec3::Y, random.direction());
        let role = role(random, materials);
        add(&mut object, role, mesh.as_ref(), center, radius, turn);
    }
    object
}
