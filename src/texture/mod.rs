//! Functions of the surface coordinates: constants, images, checks.

pub mod bitmap;
pub mod checkerboard;
pub mod load;

pub use bitmap::{Bitmap, Filter, ImageCache, Wrap};
pub use checkerboard::Checkerboard;
pub use load::{Image, ImageError};

use crate::math::Rgb;
use glam::Vec2;

/// A colour at every point of a surface.
#[derive(Clone, Debug)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
    /// An image.
    Bitmap(Bitmap),
    /// Two textures in turn.
    Checkerboard(Checkerboard),
}

impl Texture {
    /// The colour at `uv`.
    #[inline]
    pub fn eval(&self, uv: Vec2) -> Rgb {
        match self {
            Self::Constant(colour) => *colour,
            Self::Bitmap(bitmap) => bitmap.eval(uv),
            Self::Checkerboard(board) => board.at(uv).eval(uv),
        }
    }

    /// One number at `uv`: the value of a grey texture; of a coloured one the luminance, of a constant the mean, as in Mitsuba 3.
    #[inline]
    pub fn eval_scalar(&self, uv: Vec2) -> f32 {
        match self {
            Self::Constant(colour) => colour.mean(),
            Self::Bitmap(bitmap) => bitmap.eval_scalar(uv),
            Self::Checkerboard(board) => board.at(uv).eval_scalar(uv),
        }
    }

    /// Derivatives of [`Texture::eval_scalar`] by `u` and `v`, for bump mapping; zero within the squares of a checkerboard
    /// of constants, whose edges are ignored.
    pub fn gradient(&self, uv: Vec2) -> Vec2 {
        match self {
            Self::Constant(_) => Vec2::ZERO,
            Self::Bitmap(bitmap) => bitmap.gradient(uv),
            Self::Checkerboard(board) => board.at(uv).gradient(uv),
        }
    }

    /// Mean colour over the unit square; of images the mean texel, whatever their transform.
    pub fn mean(&self) -> Rgb {
        match self {
            Self::Constant(colour) => *colour,
            Self::Bitmap(bitmap) => bitmap.image.mean(),
            Self::Checkerboard(board) => {
                let [first, second] = board.textures.as_ref();
                first.mean().lerp(second.mean(), 0.5)
            }
        }
    }

    /// The colour, where it is the same everywhere.
    pub fn constant(&self) -> Option<Rgb> {
        match self {
            Self::Constant(colour) => Some(*colour),
            Self::Bitmap(_) | Self::Checkerboard(_) => None,
        }
    }
}

impl From<Rgb> for Texture {
    fn from(colour: Rgb) -> Self {
        Self::Constant(colour)
    }
}

impl From<f32> for Texture {
    fn from(value: f32) -> Self {
        Self::Constant(Rgb::splat(value))
    }
}
