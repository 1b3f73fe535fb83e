//! Triangle meshes and their files.

use super::error::Error;
use glam::{DMat4, DVec2, DVec3};
use std::path::Path;

/// A triangle mesh. Texture coordinates are in metres along the surface where it is flat, and turns or shares of a length
/// where it is round.
#[derive(Clone, Debug, Default)]
pub(super) struct Mesh {
    /// Vertices, metres.
    pub(super) positions: Vec<DVec3>,
    /// One a vertex, or none at all: then the mesh is faceted or flat.
    pub(super) normals: Vec<DVec3>,
    /// One a vertex.
    pub(super) uvs: Vec<DVec2>,
    /// Counter-clockwise seen from outside.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A grid of `columns × rows` cells over `[0, 1]²`, each vertex where `place` puts it with its texture coordinates.
    /// Seen from outside the derivative along the first coordinate, the derivative along the second and the normal are
    /// right-handed. Normals are those of the grid, averaged at vertices, and joined where the grid's edges meet.
    pub(super) fn grid(
        columns: usize,
        rows: usize,
        place: impl Fn(f64, f64) -> (DVec3, DVec2),
    ) -> Self {
        let mut mesh = Self::default();
        for row in 0..=rows {
            for column in 0..=columns {
                let (position, uv) =
                    place(column as f64 / columns as f64, row as f64 / rows as f64);
                mesh.positions.push(position);
                mesh.uvs.push(uv);
            }
        }
        let at = |column: usize, row: usize| (row * (columns + 1) + column) as u32;
        for row in 0..rows {
            for column in 0..columns {
                let corners = [
                    at(column, row),
                    at(column + 1, row),
                    at(column + 1, row + 1),
                    at(column, row + 1),
                ];
                mesh.push_triangle([corners[0], corners[1], corners[2]]);
                mesh.push_triangle([corners[0], corners[2], corners[3]]);
            }
        }
        mesh.smooth();
        mesh
    }

    /// Adds a triangle unless two of its corners coincide, as at the poles of a grid.
    pub(super) fn push_triangle(&mut self, triangle: [u32; 3]) {
        let [a, b, c] = triangle.map(|index| self.positions[index as usize]);
        let size = (b - a).length().max((c - a).length());
        if (b - a).cross(c - a).length() > 1e-7 * size * size && size > 1e-7 {
            self.triangles.push(triangle);
        }
    }

    /// Computes normals as means over the triangles around a place, weighted by area; vertices at the same place share them.
    pub(super) fn smooth(&mut self) {
        let key = |p: DVec3| (p * 1e5).round().as_i64vec3().to_array();
        let mut sums: std::collections::HashMap<[i64; 3], DVec3> = std::collections::HashMap::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|index| self.positions[index as usize]);
            let normal = (b - a).cross(c - a);
            for corner in [a, b, c] {
                *sums.entry(key(corner)).or_default() += normal;
            }
        }
        let normal = |p: &DVec3| sums.get(&key(*p)).copied().unwrap_or(DVec3::Y);
        self.normals = self.positions.iter().map(|p| normal(p).normalize_or(DVec3::Y)).collect();
    }

    /// The same triangles, each with its own corners and no normals.
    pub(super) fn faceted(&self) -> Self {
        let mut mesh = Self::default();
        for triangle in &self.triangles {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(triangle.map(|index| self.positions[index as usize]));
            mesh.uvs.extend(triangle.map(|index| self.uvs[index as usize]));
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        mesh
    }

    /// Adds another mesh; one without normals makes both lose them, so that flat faces come as split vertices.
    pub(super) fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        if self.positions.is_empty() {
            *self = other.clone();
            return;
        }
        if self.normals.is_empty() != other.normals.is_empty() {
            self.give_normals();
            let mut other = other.clone();
            other.give_normals();
            self.normals.extend(other.normals);
        } else {
            self.normals.extend(&other.normals);
        }
        self.positions.extend(&other.positions);
        self.uvs.extend(&other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|index| index + first)));
    }

    /// Flat normals where there are none. Vertices shared by faces of different planes are split for it.
    fn give_normals(&mut self) {
        if self.normals.is_empty() {
            *self = self.faceted();
            self.normals = vec![DVec3::Y; self.positions.len()];
            for triangle in &self.triangles {
                let [a, b, c] = triangle.map(|index| self.positions[index as usize]);
                let normal = (b - a).cross(c - a).normalize_or(DVec3::Y);
                for index in triangle {
                    self.normals[*index as usize] = normal;
                }
            }
        }
    }

    /// Moved by a rotation, a scaling and a translation.
    pub(super) fn transformed(&self, matrix: &DMat4) -> Self {
        let normal_matrix = glam::DMat3::from_mat4(*matrix).inverse().transpose();
        let mut mesh = self.clone();
        mesh.positions.iter_mut().for_each(|p| *p = matrix.transform_point3(*p));
        mesh.normals.iter_mut().for_each(|n| *n = (normal_matrix * *n).normalize_or(DVec3::Y));
        mesh
    }

    /// The smallest box around it.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        self.positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &p| {
            (low.min(p), high.max(p))
        })
    }

    /// Is the triangle more than a line once its corners are rounded to single precision?
    fn has_area(&self, triangle: &[u32; 3]) -> bool {
        let [a, b, c] = triangle.map(|index| self.positions[index as usize]);
        let size = (b - a).length().max((c - a).length()).max((c - b).length());
        let height = (b - a).cross(c - a).length() / size;
        // Rounding moves a corner by 6e-8 of its coordinates, here and again when the scene is centred.
        let reach = a.abs().max(b.abs()).max(c.abs()).max_element();
        height > 1e-6 * reach
    }

    /// Writes the mesh as a binary PLY file, without triangles that are lines in single precision.
    ///
    /// # Errors
    /// The file system refuses.
    pub(super) fn write(&self, path: &Path) -> Result<(), Error> {
        let triangles: Vec<_> = self.triangles.iter().filter(|t| self.has_area(t)).collect();
        let has_normals = !self.normals.is_empty();
        let normals = if has_normals {
            "property float nx\nproperty float ny\nproperty float nz\n"
        } else {
            ""
        };
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
             property float z\n{normals}property float u\nproperty float v\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n",
            self.positions.len(),
            triangles.len()
        )
        .into_bytes();
        let mut floats = |values: &[f64]| {
            values.iter().for_each(|value| bytes.extend((*value as f32).to_le_bytes()));
        };
        for (index, position) in self.positions.iter().enumerate() {
            floats(&position.to_array());
            if has_normals {
                floats(&self.normals[index].to_array());
            }
            floats(&self.uvs[index].to_array());
        }
        for triangle in triangles {
            bytes.push(3);
            triangle.iter().for_each(|index| bytes.extend(index.to_le_bytes()));
        }
        std::fs::write(path, bytes).map_err(|source| Error::io(path, source))
    }
}
