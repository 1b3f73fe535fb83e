//! Walls with one opening, and what fills it.

use crate::dataset::generator::form::Form;
use crate::dataset::generator::mesh::Mesh;
use crate::dataset::generator::random::Random;
use crate::dataset::generator::solid::{cuboid, push_polygon};
use glam::{DMat4, DVec2, DVec3};

/// How thick walls are, metres.
const THICKNESS: f64 = 0.15;

/// A wall of a room. Its own coordinates run along it from its left corner seen from inside, and up; the third points
/// into the room.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    /// Metres from corner to corner.
    pub(super) width: f64,
    height: f64,
    to_room: DMat4,
}

/// A hole in a wall, in the wall's coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub(super) low: DVec2,
    pub(super) high: DVec2,
    /// Doors have a leaf and a room behind; windows have panes and a sky.
    pub(super) is_door: bool,
}

/// The room behind a door.
pub(super) struct Behind {
    pub(super) shell: Mesh,
    /// Where a lamp may be that the door's gap does not show.
    pub(super) lamp: DVec3,
}

/// A horizontal rectangle over the whole room, facing up or down; texture coordinates are metres.
pub(super) fn floor(half: DVec3, y: f64, up: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
        .map(|(x, z)| DVec3::new(x * half.x, y, z * half.z));
    let uvs = corners.map(|p| DVec2::new(p.x, p.z));
    push_polygon(&mut mesh, &corners, &uvs, up < 0.0);
    mesh
}

impl Wall {
    /// The four walls around a room: the first at the front (`+z`), then counter-clockwise seen from above.
    pub(super) fn around(size: DVec3) -> [Self; 4] {
        std::array::from_fn(|side| {
            let is_long = side % 2 == 0;
            let (width, depth) = if is_long { (size.x, size.z) } else { (size.z, size.x) };
            // The wall at the back, whose left end seen from inside is at -x, turned by quarters.
            let turn = DMat4::from_rotation_y(
                std::f64::consts::FRAC_PI_2 * side as f64 + std::f64::consts::PI,
            );
            let corner = DMat4::from_translation(DVec3::new(-0.5 * width, 0.0, -0.5 * depth));
            Self { width, height: size.y, to_room: turn * corner }
        })
    }

    fn slab(&self, low: DVec2, high: DVec2, depth: [f64; 2]) -> Mesh {
        cuboid(low.extend(depth[0]), high.extend(depth[1])).transformed(&self.to_room)
    }

    /// The wall, around the opening if there is one.
    pub(super) fn with_opening(&self, opening: Option<&Opening>) -> Mesh {
        let end = DVec2::new(self.width + THICKNESS, self.height);
        let start = DVec2::new(-THICKNESS, 0.0);
        let depth = [-THICKNESS, 0.0];
        let Some(Opening { low, high, .. }) = opening else {
            return self.slab(start, end, depth);
        };
        let mut mesh = self.slab(start, DVec2::new(low.x, end.y), depth);
        mesh.append(&self.slab(DVec2::new(high.x, 0.0), end, depth));
        mesh.append(&self.slab(DVec2::new(low.x, high.y), DVec2::new(high.x, end.y), depth));
        if low.y > 0.0 {
            mesh.append(&self.slab(DVec2::new(low.x, 0.0), DVec2::new(high.x, low.y), depth));
        }
        mesh
    }

    /// A sheet of glass in the middle of the opening.
    pub(super) fn pane(&self, opening: &Opening) -> Form {
        let (center, half) =
            (0.5 * (opening.low + opening.high), 0.5 * (opening.high - opening.low));
        self.rectangle(center, half, -0.5 * THICKNESS)
    }

    /// A rectangle that faces into the room.
    fn rectangle(&self, center: DVec2, half: DVec2, depth: f64) -> Form {
        Form::Rectangle { center: center.extend(depth), u: DVec3::X * half.x, v: DVec3::Y * half.y }
            .transformed(&self.to_room)
    }

    /// Something flat on the wall.
    pub(super) fn picture(&self, center: DVec2, half: DVec2) -> Form {
        let half = half.min(0.9 * center).min(0.9 * (DVec2::new(self.width, self.height) - center));
        self.rectangle(center, half, 0.012)
    }

    /// A rectangle beyond the opening, larger than it, that shines in.
    pub(super) fn outside(&self, opening: &Opening, distance: f64) -> Form {
        let half = 0.5 * (opening.high - opening.low);
        self.rectangle(0.5 * (opening.low + opening.high), half, -THICKNESS - distance)
    }

    /// The lower part of the wall, standing out a little.
    pub(super) fn panel(&self, height: f64, depth: f64) -> Mesh {
        self.slab(DVec2::ZERO, DVec2::new(self.width, height), [0.0, depth])
    }

    /// Bars that divide a window in this many panes more, across and down, and a frame.
    pub(super) fn bars(&self, opening: &Opening, counts: [usize; 2]) -> Mesh {
        let (low, high) = (opening.low, opening.high);
        let (thick, depth) = (0.025, [-0.5 * THICKNESS - 0.03, -0.5 * THICKNESS + 0.03]);
        let mut mesh = Mesh::default();
        for k in 0..=counts[0] + 1 {
            let x = low.x + (high.x - low.x) * k as f64 / (counts[0] + 1) as f64;
            mesh.append(&self.slab(
                DVec2::new(x - thick, low.y),
                DVec2::new(x + thick, high.y),
                depth,
            ));
        }
        for k in 0..=counts[1] + 1 {
            let y = low.y + (high.y - low.y) * k as f64 / (counts[1] + 1) as f64;
            mesh.append(&self.slab(
                DVec2::new(low.x, y - thick),
                DVec2::new(high.x, y + thick),
                depth,
            ));
        }
        mesh
    }

    /// Slats across a window, all tilted alike.
    pub(super) fn blinds(&self, opening: &Opening, random: &mut Random) -> Mesh {
        let (low, high) = (opening.low, opening.high);
        let gap = random.uniform(0.035, 0.09);
        let tilt = random.uniform(-0.9, 0.9);
        let half = DVec3::new(0.5 * (high.x - low.x), 0.002, 0.45 * gap);
        let slat = cuboid(-half, half);
        let mut mesh = Mesh::default();
        let count = ((high.y - low.y) / gap) as usize;
        for k in 0..count {
            let center = DVec3::new(
                0.5 * (low.x + high.x),
                low.y + gap * (k as f64 + 0.5),
                -0.5 * THICKNESS,
            );
            let place = DMat4::from_translation(center) * DMat4::from_rotation_x(tilt);
            mesh.append(&slat.transformed(&(self.to_room * place)));
        }
        mesh
    }

    /// The leaf of a door, turned out of its frame by `angle` radians, away from the room.
    pub(super) fn door(&self, opening: &Opening, angle: f64) -> Mesh {
        let size = opening.high - opening.low;
        let leaf =
            cuboid(DVec3::new(0.0, 0.01, -0.04), DVec3::new(size.x - 0.01, size.y - 0.01, 0.0));
        let hinge = DVec3::new(opening.low.x, 0.0, -THICKNESS);
        let place = DMat4::from_translation(hinge) * DMat4::from_rotation_y(angle);
        leaf.transformed(&(self.to_room * place))
    }

    /// A closed room of this depth behind a door, wider than it.
    pub(super) fn behind(&self, opening: &Opening, depth: f64, height: f64) -> Behind {
        let (left, right) = (opening.low.x - 0.8, opening.high.x + 0.8);
        let (back, front) = (-THICKNESS - depth, -THICKNESS);
        let t = 0.05;
        let slabs = [
            (DVec3::new(left, 0.0, back - t), DVec3::new(right, height, back)),
            (DVec3::new(left - t, 0.0, back), DVec3::new(left, height, front)),
            (DVec3::new(right, 0.0, back), DVec3::new(right + t, height, front)),
            (DVec3::new(left, -t, back), DVec3::new(right, 0.0, front + THICKNESS)),
            (DVec3::new(left, height, back), DVec3::new(right, height + t, front)),
        ];
        let mut shell = Mesh::default();
        for (low, high) in slabs {
            shell.append(&cuboid(low, high).transformed(&self.to_room));
        }
        let lamp = DVec3::new(right - 0.35, 0.75 * height, 0.5 * (back + front));
        Behind { shell, lamp: self.to_room.transform_point3(lamp) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Geometry, Part, Ray};
    use glam::Vec3;

    /// A mesh as the loader would make it.
    fn part(mesh: &Mesh) -> Part {
        Part::Mesh(crate::geometry::Mesh {
            positions: mesh.positions.iter().map(|p| p.as_vec3()).collect(),
            triangles: mesh.triangles.clone(),
            ..crate::geometry::Mesh::default()
        })
    }

    /// The directions, of many from one metre above the middle of the floor, that leave the room.
    fn escapes(meshes: &[Mesh]) -> Vec<DVec3> {
        let geometry = Geometry::new(meshes.iter().map(part).collect());
        let mut random = Random::new(3, 0);
        let directions = (0..4000).map(|_| random.direction());
        let escapes = |d: &DVec3| geometry.intersect(&Ray::new(Vec3::Y, d.as_vec3())).is_none();
        directions.filter(escapes).collect()
    }

    fn room(opening: Option<&Opening>) -> (Vec<Mesh>, [Wall; 4]) {
        let size = DVec3::new(3.0, 2.5, 4.0);
        let half = DVec3::new(1.5, 2.5, 2.0);
        let walls = Wall::around(size);
        let mut meshes = vec![floor(half, 0.0, 1.0), floor(half, 2.5, -1.0)];
        let with = |(side, wall): (usize, &Wall)| wall.with_opening(opening.filter(|_| side == 1));
        meshes.extend(walls.iter().enumerate().map(with));
        (meshes, walls)
    }

    #[test]
    fn only_windows_let_light_into_a_room() {
        assert_eq!(escapes(&room(None).0), []);
        let window =
            Opening { low: DVec2::new(1.0, 0.8), high: DVec2::new(3.0, 2.0), is_door: false };
        let (meshes, walls) = room(Some(&window));
        let escapes = escapes(&meshes);
        // The far edge of the window, 1.65 m away, spans [-1, 1] × [-0.2, 1] m: with atan(ab / (d √(a² + b² + d²))) for
        // each quarter that is 0.669 sr, and of 4000 directions 213 with a standard deviation of 14.2.
        assert!((escapes.len() as f64 - 213.0).abs() < 4.0 * 14.2, "{}", escapes.len());
        let to_wall = walls[1].to_room.inverse();
        for direction in escapes {
            let (from, along) =
                (to_wall.transform_point3(DVec3::Y), to_wall.transform_vector3(direction));
            let at = (from - along * (from.z / along.z)).truncate();
            assert!(at.cmpge(window.low).all() && at.cmple(window.high).all(), "{at}");
        }
    }

    #[test]
    fn the_room_behind_a_door_is_closed() {
        let door = Opening { low: DVec2::new(1.0, 0.0), high: DVec2::new(1.9, 2.0), is_door: true };
        let (mut meshes, walls) = room(Some(&door));
        assert!(escapes(&meshes).len() > 50);
        let behind = walls[1].behind(&door, 1.5, 2.5);
        assert!(behind.lamp.x.abs() > 1.5, "outside the first room: {}", behind.lamp);
        meshes.push(behind.shell);
        assert_eq!(escapes(&meshes), []);
    }

    #[test]
    fn walls_stand_where_they_are_said_to() {
        let walls = Wall::around(DVec3::new(3.0, 2.5, 4.0));
        let side =
            |wall: &Wall| wall.to_room.transform_point3(DVec3::new(0.5 * wall.width, 1.0, 0.0));
        let middles = [DVec3::Z * 2.0, DVec3::X * 1.5, DVec3::Z * -2.0, DVec3::X * -1.5];
        for (wall, middle) in walls.iter().zip(middles) {
            assert!((side(wall) - (middle + DVec3::Y)).length() < 1e-9, "{}", side(wall));
            let inward = wall.to_room.transform_vector3(DVec3::Z);
            assert!(inward.dot(middle) < 0.0);
        }
    }
}
