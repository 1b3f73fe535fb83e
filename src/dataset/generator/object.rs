//! Things to put down: on floors, tables, shelves and pedestals.

mod clutter;
mod furniture;
mod sculpture;
mod slender;
mod vessel;

pub(super) use furniture::{basin, bench, chair, lampshade, pedestal, shelf, stairs, table};

use super::form::{Form, Object, Role};
use super::random::Random;
use super::solid;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// What makes an object.
type Maker = fn(&mut Random) -> Object;

/// A thing about `size` metres high or wide.
pub(super) fn thing(random: &mut Random, size: f64) -> Object {
    let makers: [(f64, Maker); 10] = [
        (4.0, block),
        (3.0, ball),
        (2.0, can),
        (5.0, vessel::vessel),
        (6.0, sculpture::sculpture),
        (4.0, clutter::clutter),
        (3.0, slender::slender),
        (1.0, furniture::books),
        (1.0, furniture::panel),
        (1.0, tower),
    ];
    let object = random.weighted(&makers)(random);
    let turned = object.transformed(&glam::DMat4::from_rotation_y(random.angle()));
    turned.fitted(size)
}

/// A box.
fn block(random: &mut Random) -> Object {
    let half = DVec3::new(
        random.log_uniform(0.2, 0.6),
        random.log_uniform(0.15, 1.2),
        random.log_uniform(0.2, 0.6),
    );
    Object::of(Role::Thing(0), Form::Mesh(solid::cuboid(-half, half)))
}

fn ball(_: &mut Random) -> Object {
    Object::of(Role::Thing(0), Form::Sphere { center: DVec3::Y, radius: 1.0 })
}

/// A cylinder with ends, at times of another material than its side.
fn can(random: &mut Random) -> Object {
    let (radius, height) = (random.uniform(0.2, 0.6), random.log_uniform(0.1, 1.5));
    let top = DVec3::Y * height;
    let side = Form::Cylinder { start: DVec3::ZERO, end: top, radius };
    let mut object = Object::of(Role::Thing(0), side);
    let ends = Role::Thing(u8::from(random.chance(0.3)));
    if random.chance(0.85) {
        object.add(ends, Form::Disk { center: top, normal: DVec3::Y, radius });
        object.add(ends, Form::Disk { center: DVec3::ZERO, normal: DVec3::NEG_Y, radius });
    }
    object
}

/// Things on things, each smaller.
fn tower(random: &mut Random) -> Object {
    let mut object = Object::default();
    let (mut top, mut size) = (0.0, 1.0);
    for level in 0..random.integer(2, 5) {
        let role = Role::Thing((level % 3) as u8);
        let outline = solid::star(random.pick(&[3, 4, 4, 5, 6, 8, 24]), 1.0);
        let height = size * random.uniform(0.15, 0.8);
        let turn = DVec2::from_angle(random.uniform(0.0, TAU));
        let outline: Vec<DVec2> = outline.iter().map(|p| turn.rotate(*p) * size * 0.6).collect();
        let mesh = solid::prism(&outline, height, random.uniform(0.6, 1.0), 0.0, 1);
        object.add_mesh(role, &mesh.transformed(&glam::DMat4::from_translation(DVec3::Y * top)));
        top += height;
        size *= random.uniform(0.55, 0.95);
    }
    object
}
