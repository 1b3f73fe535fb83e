//! Triangle meshes and the other parts of a scene.

use glam::{Vec2, Vec3};

/// An indexed triangle mesh in world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one a vertex, or none at all: then the shading normal is the geometric one.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one a vertex, or none at all: then the barycentric coordinates serve.
    pub uvs: Vec<Vec2>,
    /// Three vertex indices a triangle; counter-clockwise seen from where the geometric normal points.
    pub triangles: Vec<[u32; 3]>,
    /// Does the geometric normal point the other way than the winding says?
    pub flip_normals: bool,
}

/// One shape of a scene: it has one material, and may be one emitter.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// Triangles.
    Mesh(Mesh),
    /// A sphere; normals point outward unless flipped.
    Sphere {
        /// Its centre in world space.
        center: Vec3,
        /// Its radius, positive.
        radius: f32,
        /// Do normals point inward?
        flip_normals: bool,
    },
    /// A flat disk (or ellipse): the points `center + x·axes[0] + y·axes[1]`, `x² + y² ≤ 1`. Its normal is the direction
    /// of `axes[0] × axes[1]`. `uv` is `(r, φ/2π)`, as in Mitsuba 3.
    Disk {
        /// Its centre in world space.
        center: Vec3,
        /// The two half-axes.
        axes: [Vec3; 2],
        /// Does the normal point the other way?
        flip_normals: bool,
    },
    /// The open side of a circular cylinder from `start` to `end`; normals point outward unless flipped.
    Cylinder {
        /// Centre of one end.
        start: Vec3,
        /// Centre of the other end.
        end: Vec3,
        /// Its radius, positive.
        radius: f32,
        /// Do normals point inward?
        flip_normals: bool,
    },
}
