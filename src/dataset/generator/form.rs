//! Shapes of a scene, and objects made of them.

use super::mesh::Mesh;
use super::xml::Element;
use glam::{DMat3, DMat4, DVec3};

/// The shape of a surface.
#[derive(Clone, Debug)]
pub(super) enum Form {
    /// Triangles.
    Mesh(Mesh),
    /// A whole sphere.
    Sphere { center: DVec3, radius: f64 },
    /// A cylinder without ends.
    Cylinder { start: DVec3, end: DVec3, radius: f64 },
    /// A disc, facing along the normal.
    Disk { center: DVec3, normal: DVec3, radius: f64 },
    /// A rectangle with these half-axes, facing along their cross product.
    Rectangle { center: DVec3, u: DVec3, v: DVec3 },
}

impl Form {
    /// Moved by a rotation, a uniform scaling and a translation.
    pub(super) fn transformed(&self, matrix: &DMat4) -> Self {
        let point = |p: &DVec3| matrix.transform_point3(*p);
        let vector = |v: &DVec3| matrix.transform_vector3(*v);
        let scale = matrix.transform_vector3(DVec3::X).length();
        match self {
            Self::Mesh(mesh) => Self::Mesh(mesh.transformed(matrix)),
            Self::Sphere { center, radius } => {
                Self::Sphere { center: point(center), radius: radius * scale }
            }
            Self::Cylinder { start, end, radius } => {
                Self::Cylinder { start: point(start), end: point(end), radius: radius * scale }
            }
            Self::Disk { center, normal, radius } => Self::Disk {
                center: point(center),
                normal: vector(normal).normalize(),
                radius: radius * scale,
            },
            Self::Rectangle { center, u, v } => {
                Self::Rectangle { center: point(center), u: vector(u), v: vector(v) }
            }
        }
    }

    /// A box around it.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            Self::Mesh(mesh) => mesh.bounds(),
            Self::Sphere { center, radius } | Self::Disk { center, radius, .. } => {
                (*center - *radius, *center + *radius)
            }
            Self::Cylinder { start, end, radius } => {
                (start.min(*end) - *radius, start.max(*end) + *radius)
            }
            Self::Rectangle { center, u, v } => {
                let half = u.abs() + v.abs();
                (*center - half, *center + half)
            }
        }
    }

    /// The `<shape>` of anything but a mesh, which needs a file; `None` then.
    pub(super) fn element(&self) -> Option<Element> {
        Some(match self {
            Self::Mesh(_) => return None,
            Self::Sphere { center, radius } => {
                Element::plugin("shape", "sphere").point("center", *center).float("radius", *radius)
            }
            Self::Cylinder { start, end, radius } => Element::plugin("shape", "cylinder")
                .point("p0", *start)
                .point("p1", *end)
                .float("radius", *radius),
            Self::Disk { center, normal, radius } => {
                let axes = frame(*normal) * *radius;
                let matrix = DMat4::from_translation(*center) * DMat4::from_mat3(axes);
                Element::plugin("shape", "disk").matrix("to_world", &matrix)
            }
            Self::Rectangle { center, u, v } => {
                let axes = DMat3::from_cols(*u, *v, u.cross(*v).normalize());
                let matrix = DMat4::from_translation(*center) * DMat4::from_mat3(axes);
                Element::plugin("shape", "rectangle").matrix("to_world", &matrix)
            }
        })
    }
}

/// A right-handed frame whose third axis is the unit vector `normal`.
pub(super) fn frame(normal: DVec3) -> DMat3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    DMat3::from_cols(tangent, bitangent, normal)
}

/// What a part of an object is for: parts of one role share a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// The inside of a room.
    Wall,
    /// A wall of tiles.
    Tiled,
    /// A wall of a strong colour.
    Coloured,
    /// Above.
    Ceiling,
    /// Below; in metres of texture, often tiled, often glossy.
    Floor,
    /// A glossy floor.
    Polished,
    /// Furniture and fittings.
    Furniture,
    /// Anything closed; numbers keep several materials of one object apart.
    Thing(u8),
    /// A sheet without an inside.
    Sheet,
    /// Leaves and blades.
    Leaf,
    /// Bars, frames, tools.
    Metal,
    /// Closed and clear.
    Glass,
    /// A sheet of glass.
    Pane,
    /// A liquid's surface, seen from above.
    Water,
    /// A perfect mirror.
    Mirror,
    /// A plate of metal or lacquer, more or less rough.
    Plate(u8),
    /// Printed or painted.
    Picture(u8),
}

/// Something to put down: it stands on `y = 0` around the axis `x = z = 0`.
#[derive(Clone, Debug, Default)]
pub(super) struct Object {
    /// Shapes and what they are for.
    pub(super) parts: Vec<(Role, Form)>,
    /// What it shows, for the tags of the scene.
    pub(super) tag: Option<&'static str>,
}

impl Object {
    /// An object of one shape.
    pub(super) fn of(role: Role, form: Form) -> Self {
        Self { parts: vec![(role, form)], tag: None }
    }

    /// With a tag.
    pub(super) fn tagged(mut self, tag: &'static str) -> Self {
        self.tag = Some(tag);
        self
    }

    /// Adds a mesh to what there is of this role, so that a role has one mesh.
    pub(super) fn add_mesh(&mut self, role: Role, mesh: &Mesh) {
        for (other, form) in &mut self.parts {
            if let (true, Form::Mesh(existing)) = (*other == role, form) {
                existing.append(mesh);
                return;
            }
        }
        self.parts.push((role, Form::Mesh(mesh.clone())));
    }

    /// Adds a shape.
    pub(super) fn add(&mut self, role: Role, form: Form) {
        match form {
            Form::Mesh(mesh) => self.add_mesh(role, &mesh),
            form => self.parts.push((role, form)),
        }
    }

    /// Adds all of another object, moved.
    pub(super) fn add_object(&mut self, other: &Self, matrix: &DMat4) {
        for (role, form) in &other.parts {
            self.add(*role, form.transformed(matrix));
        }
    }

    /// With `to` in place of whatever role `is_meant`.
    pub(super) fn recast(mut self, is_meant: impl Fn(Role) -> bool, to: Role) -> Self {
        self.parts.iter_mut().filter(|(role, _)| is_meant(*role)).for_each(|part| part.0 = to);
        self
    }

    /// Moved by a rotation, a uniform scaling and a translation.
    pub(super) fn transformed(&self, matrix: &DMat4) -> Self {
        let parts = self.parts.iter().map(|(role, form)| (*role, form.transformed(matrix)));
        Self { parts: parts.collect(), tag: self.tag }
    }

    /// A box around it; a point for an object of no parts.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let boxes = self.parts.iter().map(|(_, form)| form.bounds());
        boxes.reduce(|(a, b), (c, d)| (a.min(c), b.max(d))).unwrap_or_default()
    }

    /// Scaled and moved so that it stands on `y = 0` and neither its height nor its footprint's diameter exceed `size`.
    pub(super) fn fitted(&self, size: f64) -> Self {
        let (low, high) = self.bounds();
        let extent = high - low;
        let diameter = extent.x.hypot(extent.z).max(1e-6);
        let scale = size / extent.y.max(0.8 * diameter);
        let base = DVec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z));
        let matrix = DMat4::from_scale(DVec3::splat(scale)) * DMat4::from_translation(-base);
        self.transformed(&matrix)
    }
}
