//! Shapes and rays; knows nothing of materials or light.
//!
//! A [`Geometry`] owns every part of a scene. `intersect` gives the nearest [`Hit`]; `interaction` turns a hit into
//! the point, its rounding-error bound, its normals and its surface coordinates.

mod bvh;
pub mod interaction;
pub mod mesh;
pub mod ray;
mod shape;
mod triangle;

pub use interaction::Interaction;
pub use mesh::{Mesh, Part};
pub use ray::{Hit, Ray};

use bvh::{Aabb, Bvh, Query};
use glam::Vec3;
use shape::Shape;

/// How rays are traced on this machine, in words.
pub fn simd_name() -> &'static str {
    bvh::simd_name()
}

/// All shapes of a scene in one tree.
#[derive(Debug, Default)]
pub struct Geometry {
    parts: Vec<Part>,
    /// Which part each primitive belongs to.
    primitive_parts: Vec<u32>,
    /// The first primitive of each part.
    first_primitives: Vec<u32>,
    /// The shape of each primitive after the last triangle; `None` where it was rejected.
    shapes: Vec<Option<Shape>>,
    triangle_count: u32,
    bounds: Option<Aabb>,
    bvh: Bvh,
    rejected: Rejected,
}

/// What was left out of the tree, because no ray can meet it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejected {
    /// Triangles with a vertex index beyond the vertices.
    pub out_of_range: usize,
    /// Triangles and other shapes with a coordinate or size that is infinite or not a number.
    pub non_finite: usize,
    /// Triangles and other shapes without area.
    pub without_area: usize,
}

impl Rejected {
    /// All of them.
    pub fn total(&self) -> usize {
        self.out_of_range + self.non_finite + self.without_area
    }
}

impl Geometry {
    /// Builds the tree over all parts. Triangles without area or with non-finite vertices are left out and counted.
    ///
    /// # Panics
    /// With 2^32 primitives or more.
    pub fn new(parts: Vec<Part>) -> Self {
        let mut geometry = Self { first_primitives: vec![0; parts.len()], ..Self::default() };
        let mut triangles = Vec::new();
        for (part, mesh) in
            parts.iter().enumerate().filter_map(|(i, part)| part.mesh().map(|mesh| (i, mesh)))
        {
            geometry.first_primitives[part] = geometry.next_primitive();
            for indices in &mesh.triangles {
                if let Some(corners) = geometry.accept(mesh, *indices) {
                    triangles.push((geometry.next_primitive(), corners));
                }
                geometry.primitive_parts.push(part as u32);
            }
        }
        geometry.triangle_count = geometry.next_primitive();
        let mut shapes = Vec::new();
        for (part, other) in parts.iter().enumerate().filter(|(_, part)| part.mesh().is_none()) {
            geometry.first_primitives[part] = geometry.next_primitive();
            let shape = Shape::new(other);
            match shape {
                Some(shape) => shapes.push((geometry.next_primitive(), shape)),
                None if other.is_finite() => geometry.rejected.without_area += 1,
                None => geometry.rejected.non_finite += 1,
            }
            geometry.shapes.push(shape);
            geometry.primitive_parts.push(part as u32);
        }
        let corners = triangles
            .iter()
            .flat_map(|(_, corners)| corners)
            .map(|&corner| Aabb { min: corner, max: corner });
        geometry.bounds = corners
            .chain(shapes.iter().map(|(_, shape)| shape.bounds()))
            .reduce(|all, one| all.union(&one));
        geometry.bvh = Bvh::new(&triangles, shapes);
        geometry.parts = parts;
        geometry
    }

    fn next_primitive(&self) -> u32 {
        u32::try_from(self.primitive_parts.len()).expect("a scene has fewer than 2^32 primitives")
    }

    /// The corners of a triangle that can be hit; others are counted.
    fn accept(&mut self, mesh: &Mesh, indices: [u32; 3]) -> Option<[Vec3; 3]> {
        let Some(corners) = mesh.corners(indices) else {
            self.rejected.out_of_range += 1;
            return None;
        };
        if !corners.iter().all(|corner| corner.is_finite()) {
            self.rejected.non_finite += 1;
            return None;
        }
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        if (b - a).cross(c - a) == glam::DVec3::ZERO {
            self.rejected.without_area += 1;
            return None;
        }
        Some(corners)
    }

    /// The parts, in the order given to [`Geometry::new`].
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The smallest box around everything: its corners; `None` when there is nothing.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.bounds.map(|bounds| (bounds.min, bounds.max))
    }

    /// What was left out.
    pub fn rejected(&self) -> Rejected {
        self.rejected
    }

    /// Triangles given, rejected ones included: the primitive index of the first other shape.
    pub fn triangle_count(&self) -> usize {
        self.triangle_count as usize
    }

    /// Memory of the tree, its triangles and the table of parts, in bytes; the parts themselves not included.
    pub fn bytes(&self) -> usize {
        self.bvh.bytes() + size_of_val(&*self.primitive_parts) + size_of_val(&*self.shapes)
    }

    /// The same geometry traversed without SIMD, to compare.
    pub fn without_simd(mut self) -> Self {
        self.bvh.use_portable();
        self
    }

    /// The nearest hit.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.bvh.intersect(&Query::new(ray)?)
    }

    /// Is there any hit?
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        Query::new(ray).is_some_and(|query| self.bvh.is_occluded(&query))
    }

    /// What there is to know about the surface at a hit of `ray`.
    ///
    /// # Panics
    /// If `hit` is not one that [`Geometry::intersect`] gave for this geometry.
    #[inline]
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> Interaction {
        let mut at = Interaction::default();
        self.interact(ray, hit, &mut at);
        at
    }

    /// [`Geometry::interaction`], written into its place.
    #[inline(always)]
    pub(crate) fn interact(&self, ray: &Ray, hit: &Hit, at: &mut Interaction) {
        let part = self.primitive_parts[hit.primitive as usize];
        let local = (hit.primitive - self.first_primitives[part as usize]) as usize;
        match &self.parts[part as usize] {
            Part::Mesh(mesh) => *at = Interaction::on_triangle(part, mesh, local, hit.u, hit.v),
            _ => {
                *at = self.shapes[(hit.primitive - self.triangle_count) as usize]
                    .expect("a shape that was hit was not rejected")
                    .interaction(part, ray, hit.t);
            }
        }
    }
}
