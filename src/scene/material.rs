//! Materials: what a scene file says of a surface, with textures still to look up.

use crate::bsdf::Bsdf;
use crate::geometry::Interaction;
use crate::math::Frame;

/// Index of a material in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MaterialId(pub u32);

/// A material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Does the surface look the same from behind? Then the frame is turned to the viewer before shading.
    pub two_sided: bool,
}

impl Material {
    /// The scattering at a point.
    pub fn bsdf(&self, _at: &Interaction) -> Bsdf<'_> {
        todo!()
    }

    /// The shading frame at a point, with bump or normal map applied; its normal is not turned to the viewer.
    pub fn frame(&self, _at: &Interaction) -> Frame {
        todo!()
    }

    /// How opaque the surface is at a point, in `[0, 1]`: light passes unscattered with the rest.
    pub fn opacity(&self, _at: &Interaction) -> f32 {
        todo!()
    }
}
