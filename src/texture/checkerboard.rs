//! The checkerboard.

use super::Texture;
use glam::{Affine2, Vec2};

/// Two textures in turn: the first where the fractional parts of both coordinates lie in the same half of the unit
/// interval, the second elsewhere, as in Mitsuba 3.
#[derive(Clone, Debug)]
pub struct Checkerboard {
    /// The two textures; they see the coordinates before `to_uv`.
    pub textures: Box<[Texture; 2]>,
    /// Applied to the surface coordinates before choosing.
    pub to_uv: Affine2,
}

impl Checkerboard {
    /// The texture at `uv`.
    pub fn at(&self, uv: Vec2) -> &Texture {
        let uv = self.to_uv.transform_point2(uv);
        let upper = (uv - uv.floor()).cmpgt(Vec2::splat(0.5));
        &self.textures[usize::from(upper.x != upper.y)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;

    #[test]
    fn squares_agree_with_mitsuba() {
        let (red, green) = (Rgb::new(1.0, 0.0, 0.0), Rgb::new(0.0, 1.0, 0.0));
        let mut texture = Checkerboard {
            textures: Box::new([Texture::Constant(red), Texture::Constant(green)]),
            to_uv: Affine2::IDENTITY,
        };
        // Printed by Mitsuba 3.9.1.
        for (u, v, expected) in [
            (0.25, 0.25, red),
            (0.75, 0.25, green),
            (0.75, 0.75, red),
            (0.5, 0.5, red),
            (0.5, 0.75, green),
            (-0.25, 0.25, green),
        ] {
            assert_eq!(texture.at(Vec2::new(u, v)).eval(Vec2::new(u, v)), expected, "{u} {v}");
        }
        texture.to_uv = Affine2::from_scale(Vec2::new(2.0, 1.0));
        assert_eq!(texture.at(Vec2::new(0.3, 0.25)).eval(Vec2::ZERO), green);
        assert_eq!(Texture::Checkerboard(texture).mean(), Rgb::new(0.5, 0.5, 0.0));
    }
}
