//! Furniture made of boxes and bars, and what stands on it.

use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::random::Random;
use crate::dataset::generator::solid::{self, cuboid};
use glam::{DMat4, DVec2, DVec3};

/// A box of `size` standing on `y` around the axis through `x`, `z`.
fn board(at: DVec3, size: DVec3) -> crate::dataset::generator::mesh::Mesh {
    let half = DVec3::new(0.5 * size.x, 0.0, 0.5 * size.z);
    cuboid(at - half, at + half + DVec3::Y * size.y)
}

/// A table and the height of its top. Legs are boxes, bars, or one foot.
pub(in crate::dataset::generator) fn table(random: &mut Random, size: DVec3) -> Object {
    let mut object = Object::default();
    let thickness = random.uniform(0.02, 0.07);
    let top = DVec3::Y * (size.y - thickness);
    if random.chance(0.2) {
        let radius = 0.5 * size.x.min(size.z);
        let disc = solid::star(48, 1.0).iter().map(|p| *p * radius).collect::<Vec<DVec2>>();
        let mesh = solid::prism(&disc, thickness, 1.0, 0.0, 1);
        object.add_mesh(Role::Furniture, &mesh.transformed(&DMat4::from_translation(top)));
        let foot = Form::Cylinder { start: DVec3::ZERO, end: top, radius: 0.08 * size.x };
        object.add(Role::Metal, foot);
        return object;
    }
    object.add_mesh(Role::Furniture, &board(top, DVec3::new(size.x, thickness, size.z)));
    let leg = random.uniform(0.03, 0.09);
    let is_round = random.chance(0.4);
    for (sx, sz) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let at = DVec3::new(sx * 0.5 * (size.x - 1.3 * leg), 0.0, sz * 0.5 * (size.z - 1.3 * leg));
        if is_round {
            let end = at + DVec3::Y * (size.y - thickness);
            object.add(Role::Metal, Form::Cylinder { start: at, end, radius: 0.4 * leg });
        } else {
            object.add_mesh(Role::Furniture, &board(at, DVec3::new(leg, size.y - thickness, leg)));
        }
    }
    object
}

/// A chair of a seat, legs and a back of slats.
pub(in crate::dataset::generator) fn chair(random: &mut Random) -> Object {
    let seat =
        DVec3::new(random.uniform(0.38, 0.5), random.uniform(0.42, 0.5), random.uniform(0.38, 0.5));
    let mut object = table(random, seat);
    let (back, slats) = (random.uniform(0.35, 0.6), random.integer(2, 6));
    let z = -0.5 * seat.z + 0.02;
    for k in 0..slats {
        let x = (f64::from(k as u32) / (slats - 1) as f64 - 0.5) * (seat.x - 0.05);
        let at = DVec3::new(x, seat.y, z);
        object.add_mesh(Role::Furniture, &board(at, DVec3::new(0.035, back, 0.025)));
    }
    let rail = DVec3::new(0.0, seat.y + back, z);
    object.add_mesh(Role::Furniture, &board(rail, DVec3::new(seat.x, 0.06, 0.03)));
    object
}

/// A bench or a sofa-like row of boxes.
pub(in crate::dataset::generator) fn bench(random: &mut Random) -> Object {
    let (width, depth) = (random.uniform(1.0, 2.2), random.uniform(0.5, 0.9));
    let mut object = Object::default();
    object.add_mesh(Role::Sheet, &board(DVec3::Y * 0.08, DVec3::new(width, 0.32, depth)));
    let back = DVec3::new(0.0, 0.4, -0.5 * depth + 0.1);
    object.add_mesh(Role::Sheet, &board(back, DVec3::new(width, random.uniform(0.2, 0.5), 0.2)));
    for side in [-1.0, 1.0] {
        let at = DVec3::new(side * (0.5 * width + 0.08), 0.0, 0.0);
        object.add_mesh(Role::Furniture, &board(at, DVec3::new(0.16, 0.6, depth)));
    }
    object
}

/// Shelves between two sides, with things on them. Its back is at `z = -depth/2`.
pub(in crate::dataset::generator) fn shelf(random: &mut Random) -> Object {
    let (width, height, depth) =
        (random.uniform(0.7, 1.8), random.uniform(0.9, 2.1), random.uniform(0.25, 0.4));
    let mut object = Object::default();
    let boards = random.integer(2, 5);
    let thickness = 0.025;
    for side in [-1.0, 1.0] {
        let at = DVec3::new(side * 0.5 * (width - thickness), 0.0, 0.0);
        object.add_mesh(Role::Furniture, &board(at, DVec3::new(thickness, height, depth)));
    }
    let has_back = random.chance(0.6);
    if has_back {
        let at = DVec3::new(0.0, 0.0, -0.5 * depth);
        object.add_mesh(Role::Furniture, &board(at, DVec3::new(width, height, 0.01)));
    }
    let gap = (height - thickness) / boards as f64;
    for level in 0..=boards {
        let y = gap * level as f64;
        let at = DVec3::Y * y;
        let inner = DVec3::new(width - 2.2 * thickness, thickness, depth - 0.01);
        object.add_mesh(Role::Furniture, &board(at, inner));
        if level == boards {
            break;
        }
        if random.chance(0.5) {
            let mut x = -0.5 * width + 0.06;
            let end = random.uniform(0.0, 0.5 * width - 0.1);
            while x < end {
                let (w, h) = (random.uniform(0.015, 0.05), gap * random.uniform(0.5, 0.85));
                let size = DVec3::new(w, h, depth * random.uniform(0.5, 0.8));
                let role = Role::Thing(random.integer(1, 4) as u8);
                object.add_mesh(role, &board(DVec3::new(x + 0.5 * w, y + thickness, 0.0), size));
                x += w + 0.003;
            }
        } else {
            for _ in 0..random.integer(1, 3) {
                let size = gap * random.uniform(0.3, 0.8);
                let small = super::thing(random, size.min(depth * 0.8));
                let at = DVec3::new(random.uniform(-0.35, 0.35) * width, y + thickness, 0.0);
                object.add_object(&small, &DMat4::from_translation(at));
            }
        }
    }
    object
}

/// A pile of books.
pub(super) fn books(random: &mut Random) -> Object {
    let mut object = Object::default();
    let mut y = 0.0;
    for k in 0..random.integer(2, 8) {
        let size = DVec3::new(
            random.uniform(0.5, 0.9),
            random.uniform(0.05, 0.2),
            random.uniform(0.7, 1.1),
        );
        let turn = DMat4::from_rotation_y(random.uniform(-0.3, 0.3));
        let at = DVec3::new(random.uniform(-0.05, 0.05), y, random.uniform(-0.05, 0.05));
        object.add_mesh(
            Role::Thing((k % 4) as u8),
            &board(DVec3::ZERO, size).transformed(&(DMat4::from_translation(at) * turn)),
        );
        y += size.y + 0.002;
    }
    object
}

/// An upright picture in a frame, leaning a little.
pub(super) fn panel(random: &mut Random) -> Object {
    let (width, height) = (random.uniform(0.6, 1.4), random.uniform(0.6, 1.2));
    let lean = DMat4::from_rotation_x(-random.uniform(0.0, 0.25));
    let mut object = Object::default();
    let frame = 0.04;
    object.add_mesh(
        Role::Furniture,
        &board(DVec3::ZERO, DVec3::new(width + frame, height + frame, 0.03)).transformed(&lean),
    );
    let center = lean.transform_point3(DVec3::new(0.0, 0.5 * (height + frame), 0.017));
    let u = DVec3::X * 0.5 * width;
    let v = lean.transform_vector3(DVec3::Y) * 0.5 * height;
    object.add(Role::Picture(0), Form::Rectangle { center, u, v });
    object
}

/// A basin on a foot, or a tub, with a tap over it.
pub(in crate::dataset::generator) fn basin(random: &mut Random) -> Object {
    let (radius, height) = (random.uniform(0.22, 0.4), random.uniform(0.5, 0.85));
    let (depth, wall) = (random.uniform(0.1, 0.25), 0.025);
    let foot = radius * random.uniform(0.3, 0.9);
    let profile = [
        DVec2::ZERO,
        DVec2::new(foot, 0.0),
        DVec2::new(0.8 * foot, height - depth - wall),
        DVec2::new(0.75 * radius, height - 0.8 * depth),
        DVec2::new(radius, height),
        DVec2::new(radius - wall, height),
        DVec2::new(0.65 * radius, height - 0.8 * depth),
        DVec2::new(0.0, height - depth),
    ];
    let smooth = solid::smooth_curve(&profile, 6);
    let smooth: Vec<DVec2> = smooth.iter().map(|p| p.max(DVec2::ZERO)).collect();
    let mut object = Object::of(Role::Plate(0), Form::Mesh(solid::revolve(&smooth, 64)));
    let tap = [(0.9, 0.0), (0.9, 0.2), (0.7, 0.3), (0.4, 0.28), (0.3, 0.18)]
        .map(|(x, y)| DVec3::new(x * radius, height + y, 0.0));
    let tube = solid::tube(&solid::smooth_curve(&tap, 6), |_| 0.014, 12, false);
    object.add_mesh(Role::Metal, &tube);
    object
}

/// A pedestal of this height.
pub(in crate::dataset::generator) fn pedestal(random: &mut Random, height: f64) -> Object {
    let corners = random.pick(&[4, 4, 6, 8, 48]);
    let radius = random.uniform(0.25, 0.6);
    let outline: Vec<DVec2> = solid::star(corners, 1.0).iter().map(|p| *p * radius).collect();
    let mesh = solid::prism(&outline, height, random.uniform(0.8, 1.0), 0.0, 1);
    Object::of(Role::Furniture, Form::Mesh(mesh))
}

/// Steps that climb along -z from `z = 0`; `width` across.
pub(in crate::dataset::generator) fn stairs(
    random: &mut Random,
    width: f64,
    steps: usize,
) -> Object {
    let (rise, tread) = (random.uniform(0.14, 0.2), random.uniform(0.24, 0.34));
    let mut object = Object::default();
    let is_open = random.chance(0.4);
    for step in 0..steps {
        let (y, z) = (rise * (step + 1) as f64, -tread * (step as f64 + 0.5));
        let bottom = if is_open { y - 0.05 } else { 0.0 };
        let at = DVec3::new(0.0, bottom, z);
        object.add_mesh(Role::Furniture, &board(at, DVec3::new(width, y - bottom, tread)));
        let side = 0.5 * width - 0.04;
        let foot = DVec3::new(side, y, z);
        object.add(
            Role::Metal,
            Form::Cylinder { start: foot, end: foot + DVec3::Y * 0.85, radius: 0.012 },
        );
    }
    let (first, last) =
        (DVec3::new(0.5 * width - 0.04, rise + 0.85, -0.5 * tread), steps as f64 - 1.0);
    let end = first + DVec3::new(0.0, rise * last, -tread * last);
    object.add(Role::Metal, Form::Cylinder { start: first, end, radius: 0.025 });
    object.tagged("stairs")
}

/// An open cone around a bulb at the origin: light leaves above and below. The shade alone, its middle at the origin.
pub(in crate::dataset::generator) fn lampshade(random: &mut Random, size: f64) -> Object {
    let (top, bottom) = (size * random.uniform(0.3, 0.9), size * random.uniform(0.7, 1.1));
    let half = size * random.uniform(0.4, 0.8);
    let profile = [DVec2::new(bottom, -half), DVec2::new(top, half)];
    Object::of(Role::Sheet, Form::Mesh(solid::revolve(&profile, 48))).tagged("lampshade")
}
