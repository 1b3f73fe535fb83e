//! Thin structures: plants, racks, springs, pipes, wire.

use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::mesh::Mesh;
use crate::dataset::generator::random::Random;
use crate::dataset::generator::solid;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Something thin.
pub(super) fn slender(random: &mut Random) -> Object {
    let object = match random.integer(0, 4) {
        0 | 1 => plant(random),
        2 => rack(random),
        3 => spring(random),
        _ => pipes(random),
    };
    object.tagged("thin")
}

/// A pot with blades that bend outward.
fn plant(random: &mut Random) -> Object {
    let profile = [
        DVec2::ZERO,
        DVec2::new(0.18, 0.0),
        DVec2::new(0.28, 0.35),
        DVec2::new(0.24, 0.35),
        DVec2::new(0.2, 0.28),
        DVec2::new(0.0, 0.28),
    ];
    let mut object = Object::of(Role::Thing(0), Form::Mesh(solid::revolve(&profile, 32)));
    let (reach, width) = (random.uniform(0.2, 0.9), random.uniform(0.015, 0.08));
    for _ in 0..random.integer(12, 60) {
        let angle = random.angle();
        let outward = DVec3::new(angle.cos(), 0.0, angle.sin());
        let across = outward.cross(DVec3::Y);
        let (height, bend) = (random.uniform(0.5, 1.3), reach * random.uniform(0.3, 1.0));
        let droop = random.uniform(0.0, 0.7);
        let blade = Mesh::grid(2, 8, |u, v| {
            let up = height * (v - droop * v * v);
            let center = DVec3::Y * (0.28 + up) + outward * (0.08 + bend * v * v);
            let half = width * (1.0 - v).max(0.02).sqrt() * (0.3 + v).min(1.0);
            let fold = 0.4 * half * (2.0 * u - 1.0).abs();
            (center + across * ((2.0 * u - 1.0) * half) + DVec3::Y * fold, DVec2::new(u, v))
        });
        object.add_mesh(Role::Leaf, &blade);
    }
    object
}

/// Bars in a frame: a grille, a railing, a cage's side.
fn rack(random: &mut Random) -> Object {
    let mut object = Object::default();
    let (width, height) = (random.uniform(0.8, 2.0), random.uniform(0.6, 1.4));
    let radius = random.log_uniform(0.008, 0.04);
    let count = random.integer(4, 24);
    let bar = |object: &mut Object, start: DVec3, end: DVec3| {
        object.add(Role::Metal, Form::Cylinder { start, end, radius });
    };
    for k in 0..=count {
        let x = width * (k as f64 / count as f64 - 0.5);
        bar(&mut object, DVec3::new(x, 0.0, 0.0), DVec3::new(x, height, 0.0));
    }
    for k in 0..random.integer(2, 5) {
        let y = height - 0.3 * f64::from(k as u32) * height;
        if y > 0.0 {
            bar(&mut object, DVec3::new(-0.5 * width, y, 0.0), DVec3::new(0.5 * width, y, 0.0));
        }
    }
    object
}

fn spring(random: &mut Random) -> Object {
    let (turns, height) = (random.uniform(3.0, 9.0), random.uniform(0.6, 2.0));
    let taper = random.uniform(0.3, 1.2);
    let count = (turns * 28.0) as usize;
    let curve: Vec<DVec3> = (0..=count)
        .map(|i| {
            let t = i as f64 / count as f64;
            let (angle, r) = (TAU * turns * t, 0.5 * (1.0 + (taper - 1.0) * t));
            DVec3::new(r * angle.cos(), height * t, r * angle.sin())
        })
        .collect();
    let radius = random.log_uniform(0.015, 0.08);
    Object::of(Role::Metal, Form::Mesh(solid::tube(&curve, |_| radius, 10, false)))
}

/// Bent pipes or cables through random points.
fn pipes(random: &mut Random) -> Object {
    let mut object = Object::default();
    for k in 0..random.integer(2, 7) {
        let radius = random.log_uniform(0.01, 0.07);
        let low = DVec3::new(-0.7, radius, -0.7);
        let points: Vec<DVec3> = (0..random.integer(4, 7))
            .map(|_| random.point(low, DVec3::new(0.7, 1.0, 0.7)))
            .collect();
        let curve: Vec<DVec3> = solid::smooth_curve(&points, 12);
        let tube = solid::tube(&curve, |_| radius, 10, false);
        object.add_mesh(Role::Thing((k % 3) as u8), &tube);
    }
    object
}
