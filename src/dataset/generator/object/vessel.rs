//! Surfaces of revolution: vases, cups, bottles, bowls, columns, eggs.

use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::random::Random;
use crate::dataset::generator::solid::{revolve, smooth_curve};
use glam::DVec2;

const SEGMENTS: usize = 64;

/// A vessel or turned piece.
pub(super) fn vessel(random: &mut Random) -> Object {
    let role = if random.chance(0.25) { Role::Glass } else { Role::Thing(0) };
    match random.integer(0, 5) {
        0 => hollow(random, role, &[0.55, 0.9, 0.35, 0.5], 1.6),
        1 => hollow(random, role, &[0.6, 0.65, 0.7, 0.75], 1.3),
        2 => hollow(random, role, &[0.5, 0.52, 0.5, 0.16, 0.15, 0.18], 2.4),
        3 => hollow(random, role, &[0.3, 0.8, 1.0, 1.1], 0.7),
        4 => turned(random),
        _ => egg(random),
    }
}

/// Walls of an even thickness around the curve of outer radii, given at even heights and jittered.
fn hollow(random: &mut Random, role: Role, radii: &[f64], height: f64) -> Object {
    let height = height * random.uniform(0.7, 1.4);
    let mut points = Vec::new();
    for (index, radius) in radii.iter().enumerate() {
        let t = index as f64 / (radii.len() - 1) as f64;
        points.push(DVec2::new(radius * random.uniform(0.75, 1.3), t * height));
    }
    let thickness = random.uniform(0.03, 0.08);
    let outer = smooth_curve(&points, 8);
    let mut profile = vec![DVec2::ZERO];
    profile.extend(&outer);
    let rim = outer[outer.len() - 1];
    profile.push(DVec2::new(rim.x - 0.5 * thickness, rim.y + 0.4 * thickness));
    let inner = outer.iter().rev().filter(|p| p.y > 2.0 * thickness);
    profile.extend(inner.map(|p| DVec2::new((p.x - thickness).max(0.02), p.y)));
    profile.push(DVec2::new(0.0, 2.0 * thickness));
    let mut object = Object::of(role, Form::Mesh(revolve(&profile, SEGMENTS)));
    if role == Role::Glass {
        object.tag = Some("caustic");
        if random.chance(0.4) {
            // A body inside, not touching the wall.
            let level = random.uniform(0.4, 0.85) * height;
            let inside = outer.iter().filter(|p| p.y > 2.5 * thickness && p.y < level);
            let mut body = vec![DVec2::new(0.0, 2.4 * thickness)];
            body.extend(inside.map(|p| DVec2::new((p.x - 1.6 * thickness).max(0.01), p.y)));
            if body.len() > 2 {
                body.push(DVec2::new(0.0, body[body.len() - 1].y));
                object.add(Role::Thing(1), Form::Mesh(revolve(&body, SEGMENTS)));
            }
        }
    }
    object
}

/// A massive turned piece: a column, a chess piece, a baluster.
fn turned(random: &mut Random) -> Object {
    let count = random.integer(3, 9);
    let points: Vec<DVec2> = (0..=count)
        .map(|i| DVec2::new(random.uniform(0.12, 0.6), 2.2 * i as f64 / count as f64))
        .collect();
    let mut profile = vec![DVec2::ZERO];
    let smooth = if random.chance(0.6) { smooth_curve(&points, 6) } else { points };
    profile.extend(smooth.iter().map(|p| DVec2::new(p.x.max(0.03), p.y)));
    profile.push(DVec2::new(0.0, profile[profile.len() - 1].y));
    Object::of(Role::Thing(0), Form::Mesh(revolve(&profile, SEGMENTS)))
}

/// An egg, or a drop.
fn egg(random: &mut Random) -> Object {
    let (length, point) = (random.uniform(0.9, 1.6), random.uniform(0.0, 0.45));
    let profile: Vec<DVec2> = (0..=32)
        .map(|i| {
            let theta = std::f64::consts::PI * f64::from(i) / 32.0;
            let radius = if i == 0 || i == 32 { 0.0 } else { theta.sin() };
            DVec2::new(radius * (1.0 + point * theta.cos()), length * (1.0 - theta.cos()))
        })
        .collect();
    Object::of(Role::Thing(0), Form::Mesh(revolve(&profile, SEGMENTS)))
}
