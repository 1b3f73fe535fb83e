//! Shapes and rays; knows nothing of materials or light.
//!
//! A [`Geometry`] owns every part of a scene. `intersect` gives the nearest [`Hit`]; `interaction` turns a hit into
//! the point, its rounding-error bound, its normals and its surface coordinates.

pub mod interaction;
pub mod mesh;
pub mod ray;

pub use interaction::Interaction;
pub use mesh::{Mesh, Part};
pub use ray::{Hit, Ray};

use glam::Vec3;

/// All shapes of a scene in one tree.
#[derive(Debug, Default)]
pub struct Geometry {}

impl Geometry {
    /// Builds the tree over all parts. Triangles without area or with non-finite vertices are left out and counted.
    pub fn new(_parts: Vec<Part>) -> Self {
        todo!()
    }

    /// The parts, in the order given to [`Geometry::new`].
    pub fn parts(&self) -> &[Part] {
        todo!()
    }

    /// The smallest box around everything: its corners; `None` when there is nothing.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        todo!()
    }

    /// The nearest hit.
    pub fn intersect(&self, _ray: &Ray) -> Option<Hit> {
        todo!()
    }

    /// Is there any hit?
    pub fn occluded(&self, _ray: &Ray) -> bool {
        todo!()
    }

    /// What there is to know about the surface at a hit of `ray`.
    pub fn interaction(&self, _ray: &Ray, _hit: &Hit) -> Interaction {
        todo!()
    }
}
