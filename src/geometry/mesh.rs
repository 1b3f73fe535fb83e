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

impl Mesh {
    /// Memory of its vertices and indices, in bytes.
    pub fn bytes(&self) -> u64 {
        let vertices = size_of_val(&*self.positions) + size_of_val(&*self.normals);
        (vertices + size_of_val(&*self.uvs) + size_of_val(&*self.triangles)) as u64
    }

    /// The positions at three vertex indices; `None` where one is out of range.
    pub fn corners(&self, indices: [u32; 3]) -> Option<[Vec3; 3]> {
        let corner = |index: u32| self.positions.get(index as usize).copied();
        Some([corner(indices[0])?, corner(indices[1])?, corner(indices[2])?])
    }
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

impl Part {
    /// The mesh, if it is one.
    pub fn mesh(&self) -> Option<&Mesh> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            _ => None,
        }
    }

    /// Are all its coordinates and sizes finite?
    pub fn is_finite(&self) -> bool {
        match self {
            Self::Mesh(mesh) => mesh.positions.iter().all(|position| position.is_finite()),
            Self::Sphere { center, radius, .. } => center.is_finite() && radius.is_finite(),
            Self::Disk { center, axes, .. } => {
                center.is_finite() && axes.iter().all(|axis| axis.is_finite())
            }
            Self::Cylinder { start, end, radius, .. } => {
                start.is_finite() && end.is_finite() && radius.is_finite()
            }
        }
    }
}
