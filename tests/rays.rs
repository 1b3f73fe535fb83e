//! Laws of rays: what is hit does not depend on the tree, no ray slips through an edge, none meets the surface it left.

use glam::{Quat, Vec3};
use quietlight::geometry::{Geometry, Hit, Mesh, Part, Ray};

/// SplitMix64 (Steele, Lea and Flood 2014): numbers for tests.
struct Numbers(u64);

impl Numbers {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In `[0, 1)`.
    fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// In the cube from -1 to 1.
    fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let point = self.cube();
            if (0.01..1.0).contains(&point.length_squared()) {
                return point.normalize();
            }
        }
    }

    fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }
}

/// A sphere of triangles: `rings` from pole to pole, twice as many around; watertight, vertices shared.
fn globe(rings: u32, radius: f32, center: Vec3) -> Mesh {
    let around = 2 * rings;
    let mut positions = vec![Vec3::Z, Vec3::NEG_Z];
    for ring in 1..rings {
        let (sin_theta, cos_theta) = (std::f32::consts::PI * ring as f32 / rings as f32).sin_cos();
        for step in 0..around {
            let (sin_phi, cos_phi) =
                (std::f32::consts::TAU * step as f32 / around as f32).sin_cos();
            positions.push(Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta));
        }
    }
    let at = |ring: u32, step: u32| 2 + (ring - 1) * around + step % around;
    let mut triangles = Vec::new();
    for step in 0..around {
        triangles.push([0, at(1, step), at(1, step + 1)]);
        for ring in 1..rings - 1 {
            triangles.push([at(ring, step), at(ring + 1, step), at(ring + 1, step + 1)]);
            triangles.push([at(ring, step), at(ring + 1, step + 1), at(ring, step + 1)]);
        }
        triangles.push([at(rings - 1, step), 1, at(rings - 1, step + 1)]);
    }
    // Turned out of the axes, so that no edge is parallel to one.
    let turn = Quat::from_scaled_axis(Vec3::new(0.3, 0.5, -0.7));
    let positions =
        positions.into_iter().map(|position| center + turn * position * radius).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// Triangles that have nothing to do with each other, of all sizes, every fourth a sliver.
fn soup(numbers: &mut Numbers, count: usize) -> Mesh {
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

/// Every triangle by itself, each in a tree of its own.
struct Loose(Vec<Geometry>);

impl Loose {
    fn new(mesh: &Mesh) -> Self {
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

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let hits = self.0.iter().enumerate().filter_map(|(index, geometry)| {
            geometry.intersect(ray).map(|hit| Hit { primitive: index as u32, ..hit })
        });
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }
}

#[test]
fn the_nearest_of_all_triangles_is_hit() {
    let mut numbers = Numbers(1);
    let mesh = soup(&mut numbers, 2000);
    let loose = Loose::new(&mesh);
    let geometry = Geometry::new(vec![Part::Mesh(mesh)]);
    let mut hits = 0;
    for _ in 0..5000 {
        let ray = Ray::new(numbers.cube() * 2.0, numbers.direction());
        let expected = loose.intersect(&ray);
        assert_eq!(geometry.intersect(&ray), expected, "{ray:?}");
        assert_eq!(geometry.occluded(&ray), expected.is_some(), "{ray:?}");
        hits += usize::from(expected.is_some());
    }
    assert!((1000..4900).contains(&hits), "{hits} hits say little");
}
