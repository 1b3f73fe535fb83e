//! An image of all directions, looked up bilinearly and sampled in proportion to its luminance.

use crate::emitter::mean;
use crate::math::arc_tangent::arc_tangent2;
use crate::math::distribution::Grid;
use crate::math::rigid::rotation_and_scale;
use crate::math::{Rgb, warp};
use glam::{DMat3, Mat3, Vec2, Vec3, Vec4};
use quietlight_denoise::sha256::sha256;
use std::f32::consts::{FRAC_1_PI, TAU};
use std::f64::consts::PI;
use std::fmt;
use thiserror::Error;

/// Why an environment map cannot be made.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum EnvironmentError {
    /// The image is empty, or the number of texels is not width times height.
    #[error("environment map of {width}x{height} has {texels} texels")]
    Size {
        /// Texels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Texels given.
        texels: usize,
    },
    /// The transform is not a rotation, reflection or uniform scaling: densities would change with direction.
    #[error(
        "an environment map may be rotated, mirrored and scaled uniformly, but its to_world has axes {axes:?}"
    )]
    Transform {
        /// The columns of the matrix.
        axes: [[f64; 3]; 3],
    },
}

/// An image in latitude-longitude form around the scene, as Mitsuba 3's `envmap` lays it out: row 0 is the direction
/// `+y`, the last row `-y`; the middle between the columns is `-z`, and `+x` is a quarter of the width to its right. A
/// row's texels lie in the middle of their columns, but the first and the last row lie exactly at the poles. Radiance is
/// interpolated bilinearly, the columns wrapping around.
///
/// Directions are sampled by cells, a cell being the place between four texels. Its weight is the mean luminance of the
/// four times the solid angle, so it is positive wherever the interpolated radiance is. Within the cell the density is
/// bilinear too, but over equal solid angles instead of equal polar angles, and therefore needs no division by a sine
/// that is 0 at the poles.
#[derive(Clone)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    /// Radiance and its luminance, in one aligned load.
    texels: Vec<Vec4>,
    to_world: Mat3,
    to_local: Mat3,
    /// Missing when the image is black.
    cells: Option<Grid>,
    /// Cosine of the polar angle of the cells' edges, and one over the solid angle of a cell, for each row of cells.
    rows: Vec<Row>,
    /// Radiance integrated over all directions, mean of the three colours, W/m².
    pub(super) fluence: f64,
    invalid_texels: usize,
}

/// Size, orientation and a checksum of the texels, instead of millions of numbers.
impl fmt::Debug for EnvironmentMap {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = self.texels.iter().flat_map(|texel| texel.to_array());
        let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        out.debug_struct("EnvironmentMap")
            .field("width", &self.width)
            .field("height", &self.height)
            .field("to_world", &self.to_world)
            .field("sha256", &sha256(&bytes))
            .finish_non_exhaustive()
    }
}

/// A row of cells.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// 1 in the upper half of the image, -1 in the lower: which pole `heights` count from.
    pole: f32,
    /// Distance of the upper and the lower edge from the pole along the `y` axis, `1 - |cos|`. Small near the pole,
    /// where the cosine itself would have lost its digits.
    heights: [f32; 2],
    /// One over the solid angle of one of its cells.
    per_solid_angle: f32,
}

/// A place between four texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Column and row of the cell.
    cell: [usize; 2],
    /// How far it is from the left and the upper texels to the others, in `[0, 1]`: columns and polar angle.
    fraction: Vec2,
    /// Share of the cell's solid angle above it.
    above: f32,
}

/// Largest radiance kept: products with throughputs and cosines stay finite.
const MAX_RADIANCE: f32 = 1e30;

/// Share of the samples that goes evenly to all cells that are not black. Without it, next to one texel of a million
/// times the mean the rest of the sky would be left to chance that 24-bit random numbers cannot express.
const EVEN_SHARE: f64 = 0.01;

/// Share of a cell's density that does not depend on the place in it. Where bilinear radiance is 0 in a corner at a
/// pole, it grows faster from there than a density over equal solid angles; this bounds a sample's weight.
const FLAT_SHARE: f32 = 0.05;

impl EnvironmentMap {
    /// The map with the given texels, row by row from the top, each multiplied by `scale`; `to_world` turns its axes
    /// into those of the world. Texels that are NaN or negative become 0, those above 1e30 become that, and both are
    /// [counted](Self::invalid_texels).
    ///
    /// # Errors
    /// When `width · height` is not the number of texels, or 0, or when `to_world` does more than rotate, mirror and
    /// scale uniformly.
    pub fn new(
        [width, height]: [usize; 2],
        mut texels: Vec<Rgb>,
        scale: f32,
        to_world: DMat3,
    ) -> Result<Self, EnvironmentError> {
        if texels.is_empty() || width.checked_mul(height) != Some(texels.len()) {
            return Err(EnvironmentError::Size { width, height, texels: texels.len() });
        }
        let (rotation, _) = rotation_and_scale(to_world)
            .ok_or_else(|| EnvironmentError::Transform { axes: to_world.to_cols_array_2d() })?;
        let to_world = rotation.as_mat3();
        let mut invalid_texels = 0;
        for texel in &mut texels {
            let scaled = *texel * scale;
            *texel = scaled.map(|value| if value > 0.0 { value.min(MAX_RADIANCE) } else { 0.0 });
            invalid_texels += usize::from(*texel != scaled);
        }
        let texels =
            texels.into_iter().map(|texel| Vec3::from(texel.to_array()).extend(texel.luminance()));
        let rows: Vec<Row> = rows(width, height);
        let mut map = Self {
            width,
            height,
            texels: texels.collect(),
            to_world,
            to_local: to_world.transpose(),
            cells: None,
            rows,
            fluence: 0.0,
            invalid_texels,
        };
        map.weigh_cells();
        Ok(map)
    }

    /// The same map with its radiance multiplied by `factor`, turned around its poles by `turn` radians.
    pub fn changed(&self, factor: Rgb, turn: f64) -> Self {
        let rotation = self.to_world * Mat3::from_rotation_y(turn as f32);
        let texels = self.texels.iter().map(|&texel| {
            let changed = colour(texel) * factor;
            let limited =
                changed.map(|value| if value > 0.0 { value.min(MAX_RADIANCE) } else { 0.0 });
            Vec3::from(limited.to_array()).extend(limited.luminance())
        });
        let mut map = Self {
            texels: texels.collect(),
            to_world: rotation,
            to_local: rotation.transpose(),
            ..self.clone()
        };
        map.weigh_cells();
        map
    }

    /// Texels across and down.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// How many texels were NaN, negative or too large.
    pub fn invalid_texels(&self) -> usize {
        self.invalid_texels
    }

    /// Computes the weights of the cells, and the fluence.
    fn weigh_cells(&mut self) {
        let cell_mean = |value: &dyn Fn(Vec4) -> f64, column: usize, row: usize| {
            self.corners([column, row]).iter().map(|&texel| value(texel)).sum::<f64>() / 4.0
        };
        let cells = || {
            (0..self.rows.len()).flat_map(|row| (0..self.width).map(move |column| (column, row)))
        };
        let solid_angle = |row: usize| 1.0 / f64::from(self.rows[row].per_solid_angle);
        let luminance = |texel: Vec4| f64::from(texel.w);
        let mean = |texel: Vec4| mean(colour(texel));

        let weights: Vec<f64> =
            cells().map(|(x, y)| cell_mean(&luminance, x, y) * solid_angle(y)).collect();
        let fluence = cells().map(|(x, y)| cell_mean(&mean, x, y) * solid_angle(y)).sum();
        let even = EVEN_SHARE * weights.iter().sum::<f64>() / (4.0 * PI);
        let lifted: Vec<f64> = cells()
            .zip(&weights)
            .map(
                |((_, row), &weight)| {
                    if weight > 0.0 { weight + even * solid_angle(row) } else { 0.0 }
                },
            )
            .collect();
        (self.cells, self.fluence) = (Grid::new(self.width, &lifted), fluence);
    }

    /// The texels around a cell: upper left, upper right, lower left, lower right.
    #[inline]
    fn corners(&self, [column, row]: [usize; 2]) -> [Vec4; 4] {
        let right = if column + 1 == self.width { 0 } else { column + 1 };
        let (upper, lower) = (row * self.width, (row + 1).min(self.height - 1) * self.width);
        [
            self.texels[upper + column],
            self.texels[upper + right],
            self.texels[lower + column],
            self.texels[lower + right],
        ]
    }

    /// Where a unit vector of the world meets the image.
    #[inline]
    pub(super) fn locate(&self, direction: Vec3) -> Place {
        let Vec3 { x, y, z } = self.to_local * direction;
        // Texel centres are half a texel to the right of their columns' left edges.
        let turn = arc_tangent2(x, -z) * (1.0 / TAU) - 0.5 / self.width as f32;
        let (column, across) = split((turn - turn.floor()) * self.width as f32, self.width);
        // The arc tangent, unlike the arc cosine, is exact near the poles.
        let sine_squared = x * x + z * z;
        let polar = arc_tangent2(sine_squared.sqrt(), y) * FRAC_1_PI;
        let (row, down) = split(polar * self.rows.len() as f32, self.rows.len());
        let Row { pole, heights: [top, bottom], .. } = self.rows[row];
        let cosine = pole * y;
        // Both are 1 - cos; each form is exact on its side of the equator.
        let height = if cosine > 0.0 { sine_squared / (1.0 + cosine) } else { 1.0 - cosine };
        let above = ((height - top) / (bottom - top)).clamp(0.0, 1.0);
        Place { cell: [column, row], fraction: Vec2::new(across, down), above }
    }

    /// Radiance from a unit vector of the world.
    #[inline]
    pub(super) fn radiance(&self, direction: Vec3) -> Rgb {
        let place = self.locate(direction);
        interpolate(self.corners(place.cell), place.fraction)
    }

    /// Radiance from a unit vector of the world, and its density per steradian.
    #[inline]
    pub(super) fn radiance_and_pdf(&self, direction: Vec3) -> (Rgb, f32) {
        let place = self.locate(direction);
        let corners = self.corners(place.cell);
        let pmf = self.cells.as_ref().map_or(0.0, |cells| cells.pmf(place.cell));
        (
            interpolate(corners, place.fraction),
            self.density(place, pmf, relative_densities(corners)),
        )
    }

    /// Density per steradian at a place in a cell of probability `pmf`.
    #[inline]
    fn density(&self, place: Place, pmf: f32, corners: [f32; 4]) -> f32 {
        let within = warp::bilinear_pdf(Vec2::new(place.fraction.x, place.above), corners);
        pmf * self.rows[place.cell[1]].per_solid_angle * within
    }

    /// A direction of the world, its radiance and its density per steradian.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Option<(Vec3, Rgb, f32)> {
        let cell = self.cells.as_ref()?.sample(u);
        let [column, row] = cell.index;
        let corners = self.corners(cell.index);
        let densities = relative_densities(corners);
        let within = warp::square_to_bilinear(cell.position, densities);
        let Row { pole, heights: [top, bottom], .. } = self.rows[row];
        let height = top + (bottom - top) * within.y;
        let sine = (height * (2.0 - height)).max(0.0).sqrt();
        let phi = (column as f32 + within.x + 0.5) / self.width as f32 * TAU;
        let (sin_phi, cos_phi) = phi.sin_cos();
        let direction =
            self.to_world * Vec3::new(sin_phi * sine, pole * (1.0 - height), -cos_phi * sine);
        // Located again, so that density and radiance are bit for bit those of the direction. Only at the edge of a cell
        // does rounding lead to another cell than the one already at hand.
        let place = self.locate(direction);
        let (radiance, pdf) = if place.cell == cell.index {
            (interpolate(corners, place.fraction), self.density(place, cell.pmf, densities))
        } else {
            self.radiance_and_pdf(direction)
        };
        Some((direction, radiance, pdf))
    }
}

/// The colour of a texel.
#[inline]
fn colour(texel: Vec4) -> Rgb {
    Rgb::new(texel.x, texel.y, texel.z)
}

/// Bilinear interpolation between the corners of a cell.
#[inline]
fn interpolate(
    [upper_left, upper_right, lower_left, lower_right]: [Vec4; 4],
    fraction: Vec2,
) -> Rgb {
    let lerp = |from: Vec4, to: Vec4, t: f32| from * (1.0 - t) + to * t;
    let upper = lerp(upper_left, upper_right, fraction.x);
    let lower = lerp(lower_left, lower_right, fraction.x);
    colour(lerp(upper, lower, fraction.y))
}

/// Relative densities at the corners of a cell; their mean is about 1.
#[inline]
fn relative_densities(corners: [Vec4; 4]) -> [f32; 4] {
    let luminances = corners.map(|texel| texel.w);
    let reciprocal = 4.0 / luminances.iter().sum::<f32>();
    // A black cell is never chosen; in one so dark that the reciprocal overflows all places are equal.
    if reciprocal.is_finite() {
        luminances.map(|luminance| luminance * reciprocal + FLAT_SHARE)
    } else {
        [1.0; 4]
    }
}

/// The rows of cells of an image: between its rows of texels, or one for an image of one row.
fn rows(width: usize, height: usize) -> Vec<Row> {
    let count = (height - 1).max(1);
    let half_angle = |edge: usize| 0.5 * PI * edge as f64 / count as f64;
    let row = |row: usize| {
        let [top, bottom] = [row, row + 1].map(half_angle);
        // cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2), 1 - cos a = 2 sin²(a / 2) and 1 + cos a = 2 cos²(a / 2), all
        // without cancellation.
        let difference = 2.0 * (top + bottom).sin() * (bottom - top).sin();
        let is_upper = 2 * row < count;
        let distance = |half: f64| 2.0 * if is_upper { half.sin() } else { half.cos() }.powi(2);
        Row {
            pole: if is_upper { 1.0 } else { -1.0 },
            heights: [distance(top) as f32, distance(bottom) as f32],
            per_solid_angle: (width as f64 / (2.0 * PI * difference)) as f32,
        }
    };
    (0..count).map(row).collect()
}

/// The whole part of `value`, at most `count - 1`, and the rest.
#[inline]
fn split(value: f32, count: usize) -> (usize, f32) {
    let whole = (value as usize).min(count - 1);
    (whole, (value - whole as f32).min(1.0))
}

#[cfg(test)]
mod tests;
