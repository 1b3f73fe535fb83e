//! How two scenes are told apart.

use super::Scene;
use crate::geometry::{Mesh, Part};
use sha2::{Digest, Sha256};
use std::fmt::{self, Write};

/// What is written, as a checksum of it.
struct Text(Sha256);

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text);
        Ok(())
    }
}

impl Scene {
    /// 64 hexadecimal digits that are the same for scenes that make the same picture, and different where anything that may
    /// show in it is: shapes, materials, texels, light, camera, size, path lengths. Where the files are, and what they are
    /// called, does not count.
    ///
    /// # Panics
    /// Never: a checksum takes all that is written.
    pub fn identity(&self) -> String {
        let mut text = Text(Sha256::new());
        let Self { surfaces, materials, emitters, camera, film, limits, has_masks, origin, .. } =
            self;
        write!(
            text,
            "{surfaces:?} {materials:?} {emitters:?} {camera:?} {film:?} {limits:?} {has_masks} {origin:?}"
        )
        .expect("a checksum takes all that is written");
        for part in self.geometry.parts() {
            match part {
                Part::Mesh(mesh) => add(&mut text.0, mesh),
                other => write!(text, "{other:?}").expect("a checksum takes all that is written"),
            }
        }
        text.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Adds a mesh by the bits of its numbers: its text would be long.
fn add(sha256: &mut Sha256, mesh: &Mesh) {
    let Mesh { positions, normals, uvs, triangles, flip_normals } = mesh;
    for count in [positions.len(), normals.len(), uvs.len(), triangles.len()] {
        sha256.update((count as u64).to_le_bytes());
    }
    for number in positions.iter().chain(normals).flat_map(|v| v.to_array()) {
        sha256.update(number.to_le_bytes());
    }
    for number in uvs.iter().flat_map(|uv| uv.to_array()) {
        sha256.update(number.to_le_bytes());
    }
    for index in triangles.as_flattened() {
        sha256.update(index.to_le_bytes());
    }
    sha256.update([u8::from(*flip_normals)]);
}
