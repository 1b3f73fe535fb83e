//! Textured properties of materials.

use super::Maker;
use crate::dataset::generator::colour;
use crate::dataset::generator::error::Error;
use crate::dataset::generator::form::Role;
use crate::dataset::generator::pattern::{Field, Pattern};
use crate::dataset::generator::picture;
use crate::dataset::generator::xml::{Element, number};
use glam::DVec3;

/// How surfaces of a role are textured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// Share of them with a colour texture.
    share: f64,
    /// Repetitions per unit of surface coordinates, least and most.
    repeats: [f64; 2],
    /// Patterns they prefer; none for any.
    patterns: &'static [Pattern],
}

impl Look {
    pub(super) fn of_role(role: Role) -> Self {
        use Pattern::{
            Bricks, Cells, Checks, Fractal, Gradient, Grain, Lettering, Marble, Noise, Spots,
            Stripes, Tiles, Weave, Wood,
        };
        match role {
            Role::Wall => Self {
                share: 0.3,
                repeats: [0.3, 2.0],
                patterns: &[
                    Tiles, Tiles, Bricks, Stripes, Noise, Fractal, Spots, Wood, Gradient, Lettering,
                ],
            },
            Role::Tiled => Self {
                share: 0.97,
                repeats: [0.5, 2.5],
                patterns: &[Tiles, Tiles, Tiles, Bricks, Checks],
            },
            Role::Coloured => Self { share: 0.1, repeats: [0.3, 2.0], patterns: &[] },
            Role::Polished => Self {
                share: 0.7,
                repeats: [0.25, 1.0],
                patterns: &[Tiles, Tiles, Checks, Wood, Wood, Marble, Marble, Cells],
            },
            Role::Ceiling => {
                Self { share: 0.1, repeats: [0.3, 1.0], patterns: &[Tiles, Wood, Noise] }
            }
            Role::Floor => Self {
                share: 0.7,
                repeats: [0.25, 2.0],
                patterns: &[
                    Tiles, Tiles, Checks, Wood, Wood, Marble, Fractal, Bricks, Cells, Weave, Grain,
                    Stripes, Spots,
                ],
            },
            Role::Furniture => Self {
                share: 0.5,
                repeats: [0.5, 3.0],
                patterns: &[Wood, Wood, Wood, Marble, Fractal, Stripes, Weave, Checks],
            },
            Role::Picture(_) => Self { share: 1.0, repeats: [0.999, 1.001], patterns: &[] },
            Role::Leaf | Role::Metal | Role::Plate(_) => Self {
                share: 0.2,
                repeats: [1.0, 6.0],
                patterns: &[Noise, Fractal, Stripes, Grain],
            },
            Role::Sheet => Self {
                share: 0.5,
                repeats: [0.5, 4.0],
                patterns: &[Stripes, Checks, Weave, Spots, Lettering, Fractal],
            },
            _ => Self { share: 0.4, repeats: [0.7, 6.0], patterns: &[] },
        }
    }
}

/// Colours of the values 0, ½ and 1.
type Palette = [DVec3; 3];

impl Maker<'_> {
    /// A reflectance named `name`: a colour or a texture.
    pub(super) fn colour(&mut self, role: Role, name: &str) -> Result<Element, Error> {
        let look = Look::of_role(role);
        if !self.random.chance(look.share) {
            let value = self.one_colour(role);
            return Ok(Element::new("rgb")
                .attribute("name", name)
                .attribute("value", crate::dataset::generator::xml::triple(value)));
        }
        let pattern = self.pattern(look);
        let palette = self.palette(role, pattern);
        self.colours_of(pattern, look, name, &palette)
    }

    /// A tint of specular light named `name`; a third of them textured.
    pub(super) fn specular_tint(&mut self, role: Role, name: &str) -> Result<Element, Error> {
        if self.random.chance(0.35) {
            self.stage.tag("specular-texture");
            let look = Look::of_role(role);
            let pattern = self.pattern(look);
            let (low, high) = (colour::tint(self.random) * 0.5, colour::tint(self.random));
            return self.colours_of(pattern, look, name, &[low, 0.5 * (low + high), high]);
        }
        let tint = colour::tint(self.random);
        Ok(Element::new("rgb")
            .attribute("name", name)
            .attribute("value", crate::dataset::generator::xml::triple(tint)))
    }

    /// A texture of numbers in a range, named `name`.
    pub(super) fn numbers(
        &mut self,
        look: Look,
        name: &str,
        range: [f64; 2],
    ) -> Result<Element, Error> {
        let pattern = self.pattern(look);
        self.numbers_of(pattern, look, name, range)
    }

    /// As [`Maker::numbers`], of this pattern.
    pub(super) fn numbers_of(
        &mut self,
        pattern: Pattern,
        look: Look,
        name: &str,
        [low, high]: [f64; 2],
    ) -> Result<Element, Error> {
        let field = self.field(pattern);
        let (file, path) = self.stage.file("numbers", "png");
        picture::write_numbers(&path, &field, low, high)?;
        Ok(self.bitmap(&file, true, look).named(name))
    }

    /// Heights for a bump map, and their scale: slopes of about a fifth to one, whatever the size of the surface.
    pub(super) fn bump(&mut self, look: Look) -> Result<(Element, f64), Error> {
        let pattern = self.relief_pattern();
        let field = self.field(pattern);
        let (file, path) = self.stage.file("heights", "png");
        picture::write_numbers(&path, &field, 0.0, 1.0)?;
        let scale = self.random.log_uniform(0.003, 0.03) / look.repeats[0];
        Ok((self.bitmap(&file, true, look), scale))
    }

    /// A normal map.
    pub(super) fn normals(&mut self, look: Look) -> Result<Element, Error> {
        let pattern = self.relief_pattern();
        let field = self.field(pattern);
        let (file, path) = self.stage.file("normals", "png");
        let height = self.random.log_uniform(0.01, 0.06);
        picture::write_normals(&path, &field, height)?;
        Ok(self.bitmap(&file, true, look))
    }

    fn relief_pattern(&mut self) -> Pattern {
        self.random.pick(&[
            Pattern::Noise,
            Pattern::Fractal,
            Pattern::Tiles,
            Pattern::Bricks,
            Pattern::Weave,
            Pattern::Spots,
            Pattern::Cells,
            Pattern::Stripes,
        ])
    }

    fn one_colour(&mut self, role: Role) -> DVec3 {
        match role {
            Role::Wall | Role::Ceiling if self.random.chance(0.7) => colour::pale(self.random),
            Role::Coloured => {
                let (saturation, value) =
                    (self.random.uniform(0.5, 0.95), self.random.uniform(0.3, 0.8));
                colour::hsv(self.random.unit(), saturation, value)
            }
            Role::Tiled if self.random.chance(0.7) => colour::pale(self.random),
            Role::Floor | Role::Polished if self.random.chance(0.6) => colour::earthen(self.random),
            Role::Furniture if self.random.chance(0.5) => colour::earthen(self.random),
            Role::Leaf => {
                let (hue, value) =
                    (self.random.uniform(0.17, 0.38), self.random.log_uniform(0.08, 0.5));
                colour::hsv(hue, self.random.uniform(0.4, 0.9), value)
            }
            _ => colour::albedo(self.random),
        }
    }

    fn palette(&mut self, role: Role, pattern: Pattern) -> Palette {
        let random = &mut *self.random;
        match pattern {
            Pattern::Wood => {
                let light = colour::earthen(random).max(DVec3::splat(0.03));
                let dark = light * random.uniform(0.15, 0.6);
                [dark * 0.5, dark, light]
            }
            Pattern::Lettering if random.chance(0.6) => {
                let (ink, paper) = (random.uniform(0.01, 0.1), random.uniform(0.6, 0.92));
                [DVec3::splat(ink), DVec3::splat(0.5 * (ink + paper)), DVec3::splat(paper)]
            }
            _ => {
                let first = self.one_colour(role);
                let second = match self.random.integer(0, 3) {
                    // A shade of the first.
                    0 | 1 => first * self.random.uniform(0.1, 0.8),
                    2 => self.one_colour(role),
                    _ => colour::albedo(self.random),
                };
                let middle = if self.random.chance(0.25) {
                    colour::albedo(self.random)
                } else {
                    0.5 * (first + second)
                };
                [second, middle, first]
            }
        }
    }

    fn colours_of(
        &mut self,
        pattern: Pattern,
        look: Look,
        name: &str,
        palette: &Palette,
    ) -> Result<Element, Error> {
        let field = self.field(pattern);
        let (file, path) = self.stage.file("colours", "png");
        let [low, middle, high] = *palette;
        picture::write_colours(&path, &field, |value| {
            if value < 0.5 {
                low.lerp(middle, 2.0 * value)
            } else {
                middle.lerp(high, 2.0 * value - 1.0)
            }
        })?;
        Ok(self.bitmap(&file, false, look).named(name))
    }

    fn pattern(&mut self, look: Look) -> Pattern {
        if look.patterns.is_empty() || self.random.chance(0.12) {
            self.random.pick(&Pattern::ALL)
        } else {
            self.random.pick(look.patterns)
        }
    }

    fn field(&mut self, pattern: Pattern) -> Field {
        self.stage.tag(pattern.tag());
        // Print needs texels; bricks do not.
        let size = match pattern {
            Pattern::Lettering => 512,
            Pattern::Gradient | Pattern::Checks => 128,
            _ => self.random.pick(&[128, 256, 256, 384]),
        };
        pattern.field(size, self.random)
    }

    /// The `<texture>` of an image.
    fn bitmap(&mut self, file: &str, raw: bool, look: Look) -> Element {
        let [least, most] = look.repeats;
        let repeats = self.random.log_uniform(least, most);
        let turn: f64 = match self.random.integer(0, 5) {
            _ if least > 0.9 && most < 1.1 => 0.0,
            0 => 90.0,
            1 => 45.0,
            _ => 0.0,
        };
        let scale =
            Element::new("scale").attribute("x", number(repeats)).attribute("y", number(repeats));
        let mut transform = Element::new("transform").attribute("name", "to_uv").child(scale);
        if turn != 0.0 {
            let axis = Element::new("rotate").attribute("z", "1").attribute("angle", number(turn));
            transform = transform.child(axis);
        }
        let mut texture = Element::plugin("texture", "bitmap").string("filename", file);
        if raw {
            texture = texture.boolean("raw", true);
        }
        if self.random.chance(0.1) {
            texture = texture.string("filter_type", "nearest");
        }
        texture.child(transform)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::generator::random::Random;

    #[test]
    fn pictures_are_shown_whole() {
        let look = Look::of_role(Role::Picture(0));
        let mut random = Random::new(3, 0);
        let repeats = random.log_uniform(look.repeats[0], look.repeats[1]);
        assert!((repeats - 1.0).abs() < 2e-3 && look.share == 1.0);
    }
}
