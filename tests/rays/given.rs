//! Numbers and meshes for the laws of rays.

use glam::{Quat, Vec3};
use quietlight::geometry::{Geometry, Hit, Mesh, Part, Ray};
use std::collections::HashMap;

/// `SplitMix64` (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators").
pub(super) struct Numbers(pub(super) u64);

impl Numbers {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In `[0, 1)`.
    pub(super) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// In the cube from -1 to 1.
    pub(super) fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    pub(super) fn direction(&mut self) -> Vec3 {
        loop {
            let point = self.cube();
            if (0.01..1.0).contains(&point.length_squared()) {
                return point.normalize();
            }
        }
    }

    /// At an angle above the plane of `normal` whose sine is log-uniform from 1e-5 to 1.
    pub(super) fn grazing(&mut self, normal: Vec3) -> Vec3 {
        let along = normal.cross(self.direction()).normalize_or(normal.any_orthonormal_vector());
        let sine = 10f32.powf(-5.0 * self.unit());
        normal * sine + along * (1.0 - sine * sine).sqrt()
    }

    pub(super) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }
}

/// Sizes and places that every law has to stand: scales from 1e-4 to 1e6, and the unit size 1e4 units from the origin.
pub(super) const PLACES: [(f32, f32); 8] = [
    (1e-4, 0.0),
    (1e-2, 0.0),
    (1.0, 0.0),
    (1e2, 0.0),
    (1e4, 0.0),
    (1e6, 0.0),
    (1.0, 1e4),
    (1e-4, 1.0),
];

/// The centre that belongs to an offset of [`PLACES`].
pub(super) fn center(offset: f32) -> Vec3 {
    Vec3::new(1.0, -0.7, 0.4) * offset
}

/// A convex closed mesh: an octahedron, each face divided in four `levels` times, vertices on a sphere and shared.
pub(super) fn ball(levels: u32, radius: f32, center: Vec3) -> Mesh {
    let mut points = vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let mut triangles = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5],
    ];
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    // Turned out of the axes, so that no edge is parallel to one.
    let turn = Quat::from_scaled_axis(Vec3::new(0.3, 0.5, -0.7));
    let positions = points.into_iter().map(|point| center + turn * point * radius).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// The cube from `low` to `high`, outside out.
pub(super) fn cube(low: Vec3, high: Vec3) -> Mesh {
    let corner =
        |i: u32| Vec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), high, low);
    let quads =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() }
}

/// Triangles that have nothing to do with each other, of all sizes, every fourth a sliver of up to 1e5 : 1.
pub(super) fn soup(numbers: &mut Numbers, count: usize) -> Mesh {
    let mut mesh = Mesh::default();
    for index in 0..count {
        let first = numbers.cube();
        let size = 10f32.powf(-3.0 * numbers.unit());
        let along = numbers.cube() * size;
        let across = if index % 4 == 0 {
            along * 0.5 + numbers.cube() * size * 1e-5
        } else {
            numbers.cube() * size
        };
        let start = mesh.positions.len() as u32;
        mesh.positions.extend([first, first + along, first + across]);
        mesh.triangles.push([start, start + 1, start + 2]);
    }
    mesh
}

/// Spheres, disks and cylinders here and there.
pub(super) fn shapes(numbers: &mut Numbers, count: usize) -> Vec<Part> {
    (0..count)
        .map(|index| {
            let center = numbers.cube();
            let radius = 0.02 + 0.1 * numbers.unit();
            let flip_normals = index % 2 == 0;
            match index % 3 {
                0 => Part::Sphere { center, radius, flip_normals },
                1 => {
                    let axes = [numbers.direction() * radius, numbers.direction() * radius];
                    Part::Disk { center, axes, flip_normals }
                }
                _ => {
                    let end = center + numbers.cube() * 0.3;
                    Part::Cylinder { start: center, end, radius, flip_normals }
                }
            }
        })
        .collect()
}

/// Every triangle of a mesh in a tree of its own, where no box is in the way.
pub(super) struct Loose(Vec<Geometry>);

impl Loose {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let one = |indices: &[u32; 3]| {
            let positions = mesh.corners(*indices).expect("indices in range").to_vec();
            Geometry::new(vec![Part::Mesh(Mesh {
                positions,
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            })])
        };
        Self(mesh.triangles.iter().map(one).collect())
    }

    /// All hits at the smallest parameter.
    pub(super) fn nearest(&self, ray: &Ray) -> Vec<Hit> {
        let mut nearest: Vec<Hit> = Vec::new();
        for (index, geometry) in self.0.iter().enumerate() {
            if let Some(hit) = geometry.intersect(ray) {
                if nearest.first().is_some_and(|first| hit.t < first.t) {
                    nearest.clear();
                }
                if nearest.first().is_none_or(|first| hit.t == first.t) {
                    nearest.push(Hit { primitive: index as u32, ..hit });
                }
            }
        }
        nearest
    }
}
