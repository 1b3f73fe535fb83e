//! Image textures.

use super::load::{Image, ImageError};
use crate::math::Rgb;
use glam::{Affine2, Vec2};
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What lies outside the unit square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image, mirrored in turn.
    Mirror,
    /// The colour at the nearest edge.
    Clamp,
}

/// What lies between texel centres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// The mean of the four nearest texels, by distance.
    #[default]
    Bilinear,
    /// The texel that the point is in.
    Nearest,
}

/// An image over the surface coordinates, as Mitsuba 3 places it: `(0, 0)` is the upper left corner of the upper left
/// texel and `v` grows downwards; texel centres are at half-integers.
#[derive(Clone, Debug)]
pub struct Bitmap {
    /// The image; textures of one file share it.
    pub image: Arc<Image>,
    /// Outside the unit square.
    pub wrap: Wrap,
    /// Between texel centres.
    pub filter: Filter,
    /// Applied to the surface coordinates before the lookup.
    pub to_uv: Affine2,
}

/// The two texels of a row or column whose centres a coordinate lies between.
struct Neighbours {
    first: u32,
    second: u32,
    /// 0 at the centre of `first`, 1 at that of `second`.
    weight: f32,
    /// −1 where the image is mirrored, else 1.
    direction: f32,
}

impl Neighbours {
    fn at(wrap: Wrap, coordinate: f32, size: u32) -> Self {
        let (inside, direction) = into_image(wrap, coordinate);
        let position = inside * size as f32 - 0.5;
        let below = position.floor();
        let [first, second] = match wrap {
            Wrap::Repeat if below < 0.0 => [size - 1, 0],
            Wrap::Repeat => [below as u32 % size, (below as u32 + 1) % size],
            // Conversion makes −1 zero.
            Wrap::Mirror | Wrap::Clamp => {
                [(below as u32).min(size - 1), ((below + 1.0) as u32).min(size - 1)]
            }
        };
        Self { first, second, weight: position - below, direction }
    }
}

/// The coordinate in `[0, 1]` that shows the same, and −1 where it runs backwards, else 1. Non-finite ones become 0.
fn into_image(wrap: Wrap, coordinate: f32) -> (f32, f32) {
    if !coordinate.is_finite() {
        return (0.0, 1.0);
    }
    match wrap {
        Wrap::Repeat => (coordinate - coordinate.floor(), 1.0),
        Wrap::Clamp => (coordinate.clamp(0.0, 1.0), 1.0),
        Wrap::Mirror => {
            let folded = coordinate - 2.0 * (coordinate * 0.5).floor();
            if folded > 1.0 { (2.0 - folded, -1.0) } else { (folded, 1.0) }
        }
    }
}

/// The texel that a coordinate lies in.
fn nearest(wrap: Wrap, coordinate: f32, size: u32) -> u32 {
    ((into_image(wrap, coordinate).0 * size as f32) as u32).min(size - 1)
}

impl Bitmap {
    /// The colour at `uv`.
    pub fn eval(&self, uv: Vec2) -> Rgb {
        let uv = self.to_uv.transform_point2(uv);
        match self.filter {
            Filter::Bilinear => {
                let (x, y, [a, b, c, d]) = self.quad(uv);
                a.lerp(b, x.weight).lerp(c.lerp(d, x.weight), y.weight)
            }
            Filter::Nearest => {
                let column = nearest(self.wrap, uv.x, self.image.width);
                let row = nearest(self.wrap, uv.y, self.image.height);
                self.image.texel(column, row)
            }
        }
    }

    /// The value of a grey image at `uv`, the luminance of a coloured one.
    pub fn eval_scalar(&self, uv: Vec2) -> f32 {
        self.scalar(self.eval(uv))
    }

    /// Derivatives of [`Bitmap::eval_scalar`] by `u` and `v`: those of the bilinear interpolant; zero where it is not
    /// interpolated. Mitsuba 3.9.1 scales by the resolution after `to_uv` instead of before, which differs where `to_uv`
    /// rotates an image that is not square; here is the true derivative.
    pub fn gradient(&self, uv: Vec2) -> Vec2 {
        if self.filter == Filter::Nearest {
            return Vec2::ZERO;
        }
        let (x, y, texels) = self.quad(self.to_uv.transform_point2(uv));
        let [a, b, c, d] = texels.map(|texel| self.scalar(texel));
        let by_texel = Vec2::new(
            (b - a) * (1.0 - y.weight) + (d - c) * y.weight,
            (c - a) * (1.0 - x.weight) + (d - b) * x.weight,
        );
        let size = Vec2::new(self.image.width as f32, self.image.height as f32);
        self.to_uv.matrix2.transpose() * (by_texel * size * Vec2::new(x.direction, y.direction))
    }

    fn scalar(&self, colour: Rgb) -> f32 {
        if self.image.is_gray() { colour.r } else { colour.luminance() }
    }

    /// The four texels around a point of the image: upper left, upper right, lower left, lower right.
    fn quad(&self, uv: Vec2) -> (Neighbours, Neighbours, [Rgb; 4]) {
        let x = Neighbours::at(self.wrap, uv.x, self.image.width);
        let y = Neighbours::at(self.wrap, uv.y, self.image.height);
        let texels =
            [(x.first, y.first), (x.second, y.first), (x.first, y.second), (x.second, y.second)]
                .map(|(column, row)| self.image.texel(column, row));
        (x, y, texels)
    }
}

/// The images of a scene: each file is read once for each meaning of its values.
#[derive(Debug, Default)]
pub struct ImageCache {
    images: HashMap<(PathBuf, bool), Arc<Image>>,
    /// The files that were read.
    pub files: BTreeSet<PathBuf>,
    /// Counts of texels that were not finite.
    pub warnings: Vec<String>,
}

impl ImageCache {
    /// The image in a file; see [`Image::load`].
    ///
    /// # Errors
    /// Those of [`Image::load`].
    pub fn load(&mut self, path: &Path, raw: bool) -> Result<Arc<Image>, ImageError> {
        // Two names of one file are one file; a file that does not exist has only the name that was asked for.
        let name = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        if let Some(image) = self.images.get(&(name.clone(), raw)) {
            return Ok(Arc::clone(image));
        }
        let image = Arc::new(self.load_once(path, raw)?);
        if image.broken > 0 {
            let message =
                format!("{}: {} texels are not finite; set to 0", path.display(), image.broken);
            self.warnings.push(message);
        }
        self.images.insert((name, raw), Arc::clone(&image));
        Ok(image)
    }

    /// The image in a file of which nobody else needs the pixels: they are not kept here.
    ///
    /// # Errors
    /// Those of [`Image::load`].
    pub fn load_once(&mut self, path: &Path, raw: bool) -> Result<Image, ImageError> {
        let image = Image::load(path, raw)?;
        self.files.insert(path.to_path_buf());
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::super::load::Texels;
    use super::*;

    /// The image that the values in the tests were printed for by Mitsuba 3.9.1: two columns, three rows.
    fn bitmap(raw: bool, wrap: Wrap, filter: Filter) -> Bitmap {
        let texels = vec![
            [255, 0, 0],
            [0, 255, 0],
            [0, 0, 255],
            [255, 255, 255],
            [128, 128, 128],
            [10, 20, 30],
        ];
        let image = Arc::new(Image::new(2, 3, Texels::Rgb8(texels), raw));
        Bitmap { image, wrap, filter, to_uv: Affine2::IDENTITY }
    }

    fn assert_near(found: Rgb, expected: [f32; 3]) {
        let difference = (found - Rgb::from(expected)).map(f32::abs).max_component();
        // Mitsuba keeps linear values in half precision.
        assert!(difference < 5e-4, "found {found:?}, expected {expected:?}");
    }

    #[test]
    fn lookups_agree_with_mitsuba() {
        use Filter::{Bilinear, Nearest};
        use Wrap::{Clamp, Mirror, Repeat};
        for (wrap, filter, u, v, expected) in [
            (Repeat, Bilinear, 0.25, 1.0 / 6.0, [1.0, 0.0, 0.0]),
            (Repeat, Bilinear, 0.75, 1.0 / 6.0, [0.0, 1.0, 0.0]),
            (Repeat, Bilinear, 0.25, 0.5, [0.0, 0.0, 1.0]),
            (Repeat, Bilinear, 0.5, 0.5, [0.5, 0.5, 1.0]),
            (Repeat, Bilinear, 0.0, 0.0, [0.304_724, 0.305_714, 0.057_211]),
            (Repeat, Bilinear, -0.1, 1.3, [0.46, 0.7, 0.4]),
            (Repeat, Bilinear, 1.3, 0.9, [0.335_662, 0.175_979, 0.156_458]),
            (Repeat, Bilinear, 2.6, -1.4, [0.510_065, 0.510_896, 0.722_154]),
            (Repeat, Nearest, -0.1, 1.3, [0.0, 1.0, 0.0]),
            (Repeat, Nearest, 1.3, 0.9, [0.215_860, 0.215_860, 0.215_860]),
            (Repeat, Nearest, 1.0, 1.0, [1.0, 0.0, 0.0]),
            (Mirror, Bilinear, 0.0, 0.0, [1.0, 0.0, 0.0]),
            (Mirror, Bilinear, -0.1, 1.3, [0.129_516, 0.129_516, 0.529_516]),
            (Mirror, Bilinear, 1.3, 0.9, [0.024_318, 0.027_882, 0.033_271]),
            (Mirror, Nearest, -0.1, 1.3, [0.215_860, 0.215_860, 0.215_860]),
            (Mirror, Nearest, 2.6, -1.4, [1.0, 1.0, 1.0]),
            (Mirror, Nearest, 1.0, 1.0, [0.003_035, 0.006_995, 0.012_983]),
            (Clamp, Bilinear, -0.1, 1.3, [0.215_860, 0.215_860, 0.215_860]),
            (Clamp, Bilinear, 1.3, 0.9, [0.003_035, 0.006_995, 0.012_983]),
            (Clamp, Bilinear, 2.6, -1.4, [0.0, 1.0, 0.0]),
            (Clamp, Nearest, 1.0, 1.0, [0.003_035, 0.006_995, 0.012_983]),
        ] {
            assert_near(bitmap(false, wrap, filter).eval(Vec2::new(u, v)), expected);
        }
    }

    #[test]
    fn scalars_gradients_and_transforms_agree_with_mitsuba() {
        let at = Vec2::new(0.3, 0.7);
        let mut bitmap = bitmap(true, Wrap::Repeat, Filter::Bilinear);
        assert!((bitmap.eval_scalar(at) - 0.341_415).abs() < 1e-4);
        assert!((bitmap.gradient(at) - Vec2::new(0.227_418, 0.882_314)).length() < 5e-3);
        // scale(2, 3), then rotate(30°), then translate(0.1, 0.2).
        bitmap.to_uv = Affine2::from_scale_angle_translation(
            Vec2::ONE,
            30f32.to_radians(),
            Vec2::new(0.1, 0.2),
        ) * Affine2::from_scale(Vec2::new(2.0, 3.0));
        assert_near(bitmap.eval(at), [0.487_737, 0.639_23, 0.455_96]);
    }

    #[test]
    fn the_gradient_is_the_derivative() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let mut bitmap = bitmap(true, wrap, Filter::Bilinear);
            bitmap.to_uv = Affine2::from_angle(0.5) * Affine2::from_scale(Vec2::new(1.5, 0.7));
            for (u, v) in [(0.31, 0.17), (-0.4, 0.6), (1.15, -0.33), (1.9, 1.3)] {
                let (at, step) = (Vec2::new(u, v), 1e-3);
                let along = |axis: Vec2| {
                    (bitmap.eval_scalar(at + axis * step) - bitmap.eval_scalar(at - axis * step))
                        / (2.0 * step)
                };
                let expected = Vec2::new(along(Vec2::X), along(Vec2::Y));
                assert!((bitmap.gradient(at) - expected).length() < 2e-3, "{wrap:?} {at}");
            }
        }
        assert_eq!(
            bitmap(true, Wrap::Repeat, Filter::Nearest).gradient(Vec2::splat(0.3)),
            Vec2::ZERO
        );
    }

    #[test]
    fn extreme_coordinates_and_single_texels_stay_inside() {
        let one = Arc::new(Image::new(1, 1, Texels::Gray(vec![0.25]), true));
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for filter in [Filter::Bilinear, Filter::Nearest] {
                for value in [0.0, 1.0, -1e-9, 1e9, -1e30, f32::MAX, f32::NAN, f32::INFINITY] {
                    let at = Vec2::new(value, -value);
                    assert!(bitmap(false, wrap, filter).eval(at).is_finite());
                    let single =
                        Bitmap { image: Arc::clone(&one), wrap, filter, to_uv: Affine2::IDENTITY };
                    assert_eq!(single.eval(at), Rgb::splat(0.25));
                    assert_eq!(single.gradient(at), Vec2::ZERO);
                }
            }
        }
    }

    #[test]
    fn a_file_is_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grey.png");
        image::GrayImage::from_pixel(2, 2, image::Luma([77])).save(&path).unwrap();
        let mut cache = ImageCache::default();
        let first = cache.load(&path, false).unwrap();
        let again = cache.load(&folder.path().join(".").join("grey.png"), false).unwrap();
        assert!(Arc::ptr_eq(&first, &again));
        assert!(!Arc::ptr_eq(&first, &cache.load(&path, true).unwrap()));
        assert!(cache.load(&folder.path().join("none.png"), false).is_err());
    }
}
