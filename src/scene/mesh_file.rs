//! What a mesh file says, and how it becomes a [`Mesh`] of the scene.

use crate::geometry::Mesh;
use glam::{DMat3, DMat4, DVec3, Vec2, Vec3};
use std::path::{Path, PathBuf};

/// Why a mesh file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The content is not what the format asks for.
    #[error("{}{}: {message}", path.display(), line.map(|line| format!(":{line}")).unwrap_or_default())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1; `None` in binary files.
        line: Option<usize>,
        /// What was met and what was expected.
        message: String,
    },
}

impl MeshError {
    /// An error of the operating system at `path`.
    pub(super) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), source }
    }

    /// An error of content at `path`.
    pub(super) fn malformed(path: &Path, line: Option<usize>, message: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_path_buf(), line, message: message.into() }
    }
}

/// A triangle mesh in object space, as read from a file; every index is in range.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RawMesh {
    /// Vertex positions, in double precision, so that a mesh far from the origin keeps its shape.
    pub positions: Vec<DVec3>,
    /// One a vertex, or none at all; any length. A zero or non-finite normal stands for "none given".
    pub normals: Vec<Vec3>,
    /// One a vertex, or none at all.
    pub uvs: Vec<Vec2>,
    /// Three vertex indices a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// What the reader should know: counts of odd vertices, parts of the file without effect.
    pub warnings: Vec<String>,
}

/// What a scene says of a mesh beside its file and its transform; the defaults are all `false`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshOptions {
    /// Drop vertex normals and compute none: the mesh looks faceted.
    pub face_normals: bool,
    /// Turn all normals around.
    pub flip_normals: bool,
}

impl RawMesh {
    /// The smallest world-space box around all finite vertices: its corners; `None` when there is none.
    pub fn bounds(&self, to_world: &DMat4) -> Option<(DVec3, DVec3)> {
        self.positions
            .iter()
            .map(|&position| to_world.transform_point3(position))
            .filter(|position| position.is_finite())
            .fold(None, |bounds, p| match bounds {
                None => Some((p, p)),
                Some((low, high)) => Some((p.min(low), p.max(high))),
            })
    }

    /// The mesh in world space, with `origin` subtracted from every position before rounding to single precision.
    ///
    /// As in Mitsuba 3, vertices without a normal get the mean of the normals of their triangles, weighted by angle,
    /// unless `face_normals` is set. Where the given normals point to the other side than the winding of a triangle
    /// says (a mirroring transform does that), the winding is turned: the normals decide which side is the front.
    pub fn into_mesh(mut self, to_world: &DMat4, origin: DVec3, options: MeshOptions) -> Mesh {
        let world: Vec<DVec3> =
            self.positions.iter().map(|&p| to_world.transform_point3(p)).collect();
        self.positions = Vec::new();

        let normals = if options.face_normals {
            Vec::new()
        } else {
            let to_world_normal = DMat3::from_mat4(*to_world).inverse().transpose();
            let given: Vec<Option<Vec3>> = self
                .normals
                .iter()
                .map(|n| (to_world_normal * n.as_dvec3()).try_normalize().map(|n| n.as_vec3()))
                .collect();
            turn_to_normals(&mut self.triangles, &world, &given);
            complete_normals(&self.triangles, &world, given)
        };

        Mesh {
            positions: world.iter().map(|&p| (p - origin).as_vec3()).collect(),
            normals,
            uvs: self.uvs,
            triangles: self.triangles,
            flip_normals: options.flip_normals,
        }
    }

    /// Adds warnings that count vertices which are not finite, and makes their texture coordinates finite.
    pub(super) fn sanitise(&mut self, path: &Path) {
        let broken = self.positions.iter().filter(|p| !p.is_finite()).count();
        if broken > 0 {
            self.warnings.push(format!("{}: {broken} vertices are not finite", path.display()));
        }
        let mut broken = 0usize;
        for uv in &mut self.uvs {
            if !uv.is_finite() {
                *uv = Vec2::ZERO;
                broken += 1;
            }
        }
        if broken > 0 {
            self.warnings.push(format!(
                "{}: {broken} texture coordinates are not finite; set to 0",
                path.display()
            ));
        }
    }
}

/// Not normalised: twice the triangle's area long.
fn triangle_normal(positions: &[DVec3], triangle: [u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|index| positions[index as usize]);
    (b - a).cross(c - a)
}

fn turn_to_normals(triangles: &mut [[u32; 3]], positions: &[DVec3], normals: &[Option<Vec3>]) {
    if normals.is_empty() {
        return;
    }
    for triangle in triangles {
        let mean: Vec3 = triangle.iter().filter_map(|&index| normals[index as usize]).sum();
        if triangle_normal(positions, *triangle).dot(mean.as_dvec3()) < 0.0 {
            triangle.swap(1, 2);
        }
    }
}

/// Computes the normals that are missing: the mean over the triangles around a vertex, weighted by their angle there
/// (Thürmer and Wüthrich 1998, "Computing Vertex Normals from Polygonal Facets"). A vertex without any triangle of
/// positive area gets `+z`.
fn complete_normals(
    triangles: &[[u32; 3]],
    positions: &[DVec3],
    mut given: Vec<Option<Vec3>>,
) -> Vec<Vec3> {
    given.resize(positions.len(), None);
    if given.iter().all(Option::is_some) {
        return given.into_iter().flatten().collect();
    }
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for &triangle in triangles {
        let Some(normal) = triangle_normal(positions, triangle).try_normalize() else { continue };
        for corner in 0..3 {
            let [here, next, last] =
                [0, 1, 2].map(|k| positions[triangle[(corner + k) % 3] as usize]);
            sums[triangle[corner] as usize] += normal * (next - here).angle_between(last - here);
        }
    }
    given
        .into_iter()
        .zip(sums)
        .map(|(given, sum)| given.unwrap_or_else(|| sum.normalize_or(DVec3::Z).as_vec3()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> RawMesh {
        RawMesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            ..RawMesh::default()
        }
    }

    #[test]
    fn missing_normals_are_weighted_by_angle() {
        // A quarter of the xy-plane in two triangles of 45° each, and one triangle of 90° in the yz-plane: by count the
        // normal at the origin would lean to z, by angle it is the diagonal.
        let mut mesh = corner();
        mesh.positions.extend([DVec3::new(1.0, 1.0, 0.0), DVec3::Z]);
        mesh.triangles = vec![[0, 1, 3], [0, 3, 2], [0, 2, 4]];
        let mesh = mesh.into_mesh(&DMat4::IDENTITY, DVec3::ZERO, MeshOptions::default());
        let expected = Vec3::new(1.0, 0.0, 1.0).normalize();
        assert!((mesh.normals[0] - expected).length() < 1e-6, "{}", mesh.normals[0]);
        assert!((mesh.normals[3] - Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn normals_follow_the_inverse_transpose() {
        let mut mesh = corner();
        mesh.normals = vec![Vec3::new(1.0, 0.0, 1.0); 3];
        let to_world = DMat4::from_scale(DVec3::new(2.0, 1.0, 1.0));
        let mesh = mesh.into_mesh(&to_world, DVec3::ZERO, MeshOptions::default());
        assert!((mesh.normals[0] - Vec3::new(0.5, 0.0, 1.0).normalize()).length() < 1e-6);
    }

    #[test]
    fn a_mirror_turns_the_winding_where_normals_are_given() {
        let to_world = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let mut mesh = corner();
        mesh.normals = vec![Vec3::Z; 3];
        let mesh = mesh.into_mesh(&to_world, DVec3::ZERO, MeshOptions::default());
        assert_eq!(mesh.triangles, [[0, 2, 1]]);
        let mesh = corner().into_mesh(&to_world, DVec3::ZERO, MeshOptions::default());
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert_eq!(mesh.normals, [-Vec3::Z; 3]);
    }

    #[test]
    fn far_from_the_origin_the_shape_is_kept() {
        let offset = DVec3::splat(1e7);
        let mut mesh = corner();
        for position in &mut mesh.positions {
            *position = *position * 1e-3 + offset;
        }
        let mesh = mesh.into_mesh(&DMat4::IDENTITY, offset, MeshOptions::default());
        assert!((mesh.positions[1] - Vec3::new(1e-3, 0.0, 0.0)).length() < 1e-8);
    }

    #[test]
    fn broken_normals_and_singular_transforms_give_unit_normals() {
        let mut mesh = corner();
        mesh.normals = vec![Vec3::NAN, Vec3::ZERO, Vec3::Z];
        for to_world in [DMat4::IDENTITY, DMat4::ZERO, DMat4::from_scale(DVec3::new(1.0, 1.0, 0.0))]
        {
            let mesh = mesh.clone().into_mesh(&to_world, DVec3::ZERO, MeshOptions::default());
            for normal in mesh.normals {
                assert!((normal.length() - 1.0).abs() < 1e-5, "{normal}");
            }
        }
        let options = MeshOptions { face_normals: true, ..MeshOptions::default() };
        assert!(mesh.into_mesh(&DMat4::IDENTITY, DVec3::ZERO, options).normals.is_empty());
    }
}
