//! Emitters: what is sampled has the density that is claimed, and carries the right amount of light.

mod analytic;
mod density;
mod extremes;
mod places;
mod walks;

use glam::{Vec2, Vec3};
use quietlight::emitter::{BoundingSphere, Emitter, EmitterId, Emitters};
use quietlight::geometry::{Geometry, Interaction, Mesh, Part, Ray};
use quietlight::math::Rgb;
use quietlight::texture::Texture;

/// A part that shines with radiance `colour`.
fn area(part: Part, colour: Rgb) -> Emitter {
    Emitter::Area { part, radiance: Texture::Constant(colour) }
}

/// Emitters with a scene sphere of radius 10 around the origin.
fn emitters(list: Vec<Emitter>) -> Emitters {
    Emitters::new(list, BoundingSphere { center: Vec3::ZERO, radius: 10.0 })
}

/// A quadrilateral of two triangles, its normal by the right hand.
fn quad(corners: [Vec3; 4]) -> Part {
    Part::Mesh(Mesh {
        positions: corners.to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    })
}

/// A horizontal rectangle at height 2 that shines downward.
fn rectangle() -> Part {
    quad([
        Vec3::new(-1.0, -0.5, 2.0),
        Vec3::new(-1.0, 1.5, 2.0),
        Vec3::new(0.5, 1.5, 2.0),
        Vec3::new(0.5, -0.5, 2.0),
    ])
}

/// A bent quadrilateral of two triangles, which is no parallelogram.
fn bent() -> Part {
    quad([
        Vec3::new(-1.0, -0.5, 2.0),
        Vec3::new(-0.8, 1.5, 1.6),
        Vec3::new(0.5, 1.0, 2.0),
        Vec3::new(0.9, -0.7, 2.5),
    ])
}

/// An octahedron with outward normals: from anywhere some of its triangles are seen from behind.
fn octahedron(center: Vec3, radius: f32) -> Part {
    let positions = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z]
        .map(|axis| center + axis * radius);
    let triangles = vec![
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];
    Part::Mesh(Mesh { positions: positions.to_vec(), triangles, ..Mesh::default() })
}

/// One of each kind of part, all seen from the origin.
fn parts() -> Vec<(&'static str, Part)> {
    let center = Vec3::new(0.3, -0.4, 1.5);
    let axes = [Vec3::new(0.5, 0.1, 0.0), Vec3::new(0.1, -0.9, 0.2)];
    let (start, end) = (Vec3::new(-1.0, 0.2, 1.2), Vec3::new(0.8, 0.5, 1.6));
    vec![
        ("rectangle", rectangle()),
        ("bent quadrilateral", bent()),
        ("octahedron", octahedron(center, 0.8)),
        ("sphere from outside", Part::Sphere { center, radius: 0.8, flip_normals: false }),
        ("sphere from inside", Part::Sphere { center, radius: 2.0, flip_normals: true }),
        ("disk", Part::Disk { center, axes, flip_normals: false }),
        ("cylinder from outside", Part::Cylinder { start, end, radius: 0.4, flip_normals: false }),
        (
            "cylinder from inside",
            Part::Cylinder {
                start: start - Vec3::Z * 1.2,
                end: end - Vec3::Z * 1.2,
                radius: 1.0,
                flip_normals: true,
            },
        ),
    ]
}

/// What a ray from `from` meets first.
fn meet(geometry: &Geometry, from: Vec3, direction: Vec3) -> Option<Interaction> {
    let ray = Ray::new(from, direction);
    geometry.intersect(&ray).map(|hit| geometry.interaction(&ray, &hit))
}

const FIRST: EmitterId = EmitterId(0);

/// Irradiance on a surface at `at`, one sample: red.
fn irradiance(emitters: &Emitters, at: Vec3, normal: Vec3, selection: f32, u: Vec2) -> f64 {
    emitters.sample(at, selection, u).map_or(0.0, |sample| {
        f64::from(sample.radiance.r) * f64::from(normal.dot(sample.direction).max(0.0))
            / f64::from(sample.pdf)
    })
}
