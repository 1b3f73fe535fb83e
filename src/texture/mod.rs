//! Functions of the surface coordinates: constants, images, checks.

use crate::math::Rgb;
use glam::Vec2;

/// A colour at every point of a surface.
#[derive(Clone, Debug)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
}

impl Texture {
    /// The colour at `uv`.
    pub fn eval(&self, _uv: Vec2) -> Rgb {
        todo!()
    }

    /// One number at `uv`: the luminance of a coloured texture, the value of a grey one.
    pub fn eval_scalar(&self, _uv: Vec2) -> f32 {
        todo!()
    }

    /// Derivatives of [`Texture::eval_scalar`] by `u` and `v`, for bump mapping.
    pub fn gradient(&self, _uv: Vec2) -> Vec2 {
        todo!()
    }

    /// Mean colour over the unit square.
    pub fn mean(&self) -> Rgb {
        todo!()
    }
}
