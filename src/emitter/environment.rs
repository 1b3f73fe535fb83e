//! Light from infinitely far away: the same in all directions, or an image wrapped around the scene.

use super::{EmitterSample, mean};
use crate::math::distribution::Grid;
use crate::math::rigid::rotation_and_scale;
use crate::math::{Rgb, warp};
use glam::{DMat3, Mat3, Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};
use std::f64::consts::PI;
use thiserror::Error;

/// Light that arrives from infinity.
#[derive(Clone, Debug)]
pub enum Environment {
    /// The same radiance from everywhere.
    Constant(Rgb),
    /// An image of all directions.
    Map(EnvironmentMap),
}

impl Environment {
    /// Radiance from the unit direction `direction`.
    #[inline]
    pub(super) fn radiance(&self, direction: Vec3) -> Rgb {
        match self {
            Self::Constant(colour) => *colour,
            Self::Map(map) => map.radiance(map.locate(direction)),
        }
    }

    /// Density of `direction` per steradian.
    #[inline]
    pub(super) fn pdf(&self, direction: Vec3) -> f32 {
        match self {
            Self::Constant(_) => warp::SPHERE_PDF,
            Self::Map(map) => map.pdf(map.locate(direction)),
        }
    }

    /// A direction and its radiance.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Option<EmitterSample> {
        let (direction, radiance, pdf) = match self {
            Self::Constant(colour) => (warp::square_to_sphere(u), *colour, warp::SPHERE_PDF),
            Self::Map(map) => map.sample(u)?,
        };
        Some(EmitterSample { direction, distance: f32::INFINITY, radiance, pdf, is_delta: false })
    }

    /// Radiance integrated over all directions, mean of the three colours, W/m².
    pub(super) fn fluence(&self) -> f64 {
        match self {
            Self::Constant(colour) => 4.0 * PI * mean(*colour),
            Self::Map(map) => map.fluence,
        }
    }
}

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
/// four times the solid angle, so it is positive wherever the interpolated radiance is; within the cell the density is
/// uniform in solid angle, and therefore needs no division by a sine that is 0 at the poles.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    texels: Vec<Rgb>,
    to_world: Mat3,
    to_local: Mat3,
    /// Missing when the image is black.
    cells: Option<Grid>,
    /// Cosine of the polar angle of the cells' edges, and one over the solid angle of a cell, for each row of cells.
    rows: Vec<Row>,
    fluence: f64,
    invalid_texels: usize,
}

/// A row of cells.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// Cosines of the polar angles of the upper and the lower edge. In double precision: near a pole they differ from 1
    /// by less than single precision can tell.
    cosines: [f64; 2],
    /// One over the solid angle of one of its cells.
    per_solid_angle: f32,
}

/// A place between four texels.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Column and row of the cell.
    cell: [usize; 2],
    /// How far it is from the left and the upper texels to the others, in `[0, 1]`.
    fraction: Vec2,
}

/// Largest radiance kept: products with throughputs and cosines stay finite.
const MAX_RADIANCE: f32 = 1e30;

/// Share of the samples that goes evenly to all cells that are not black. Without it, next to one texel of a million
/// times the mean the rest of the sky would be left to chance that 24-bit random numbers cannot express.
const EVEN_SHARE: f64 = 0.01;

impl EnvironmentMap {
    /// The map with the given texels, row by row from the top, each multiplied by `scale`; `to_world` turns its axes into
    /// those of the world. Texels that are NaN or negative become 0, those above 1e30 become that, and both are
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
        let rows: Vec<Row> = rows(width, height);
        let mut map = Self {
            width,
            height,
            texels,
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

    /// How many texels were NaN, negative or too large.
    pub fn invalid_texels(&self) -> usize {
        self.invalid_texels
    }

    /// Computes the weights of the cells, and the fluence.
    fn weigh_cells(&mut self) {
        let cell_mean = |value: &dyn Fn(Rgb) -> f64, column: usize, row: usize| {
            self.corners([column, row]).iter().map(|&texel| value(texel)).sum::<f64>() / 4.0
        };
        let cells = || {
            (0..self.rows.len()).flat_map(|row| (0..self.width).map(move |column| (column, row)))
        };
        let solid_angle = |row: usize| 1.0 / f64::from(self.rows[row].per_solid_angle);
        let luminance = |texel: Rgb| f64::from(texel.luminance());

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
    fn corners(&self, [column, row]: [usize; 2]) -> [Rgb; 4] {
        let right = if column + 1 == self.width { 0 } else { column + 1 };
        let (upper, lower) = (row * self.width, (row + 1).min(self.height - 1) * self.width);
        [
            self.texels[upper + column],
            self.texels[upper + right],
            self.texels[lower + column],
            self.texels[lower + right],
        ]
    }

    /// Where a direction of the world, of any length, meets the image.
    #[inline]
    fn locate(&self, direction: Vec3) -> Place {
        let Vec3 { x, y, z } = self.to_local * direction;
        // Texel centres are half a texel to the right of their columns' left edges.
        let turn = x.atan2(-z) * (1.0 / TAU) - 0.5 / self.width as f32;
        let (column, across) = split((turn - turn.floor()) * self.width as f32, self.width);
        // The arc tangent, unlike the arc cosine, is exact near the poles.
        let polar = (x * x + z * z).sqrt().atan2(y) * FRAC_1_PI;
        let (row, down) = split(polar * self.rows.len() as f32, self.rows.len());
        Place { cell: [column, row], fraction: Vec2::new(across, down) }
    }

    /// Bilinear interpolation.
    #[inline]
    fn radiance(&self, Place { cell, fraction }: Place) -> Rgb {
        let [upper_left, upper_right, lower_left, lower_right] = self.corners(cell);
        let upper = upper_left.lerp(upper_right, fraction.x);
        let lower = lower_left.lerp(lower_right, fraction.x);
        upper.lerp(lower, fraction.y)
    }

    /// Per steradian.
    #[inline]
    fn pdf(&self, Place { cell, .. }: Place) -> f32 {
        self.cells
            .as_ref()
            .map_or(0.0, |cells| cells.pmf(cell) * self.rows[cell[1]].per_solid_angle)
    }

    /// A direction of the world, its radiance and its density per steradian.
    #[inline]
    fn sample(&self, u: Vec2) -> Option<(Vec3, Rgb, f32)> {
        let cell = self.cells.as_ref()?.sample(u);
        let [column, row] = cell.index;
        let [top, bottom] = self.rows[row].cosines;
        let cosine = top + (bottom - top) * f64::from(cell.position.y);
        let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt() as f32;
        let phi = (column as f32 + cell.position.x + 0.5) / self.width as f32 * TAU;
        let (sin_phi, cos_phi) = phi.sin_cos();
        let direction = self.to_world * Vec3::new(sin_phi * sine, cosine as f32, -cos_phi * sine);
        // Looked up again, so that density and radiance are bit for bit those of the direction, even on a cell's edge.
        let place = self.locate(direction);
        Some((direction, self.radiance(place), self.pdf(place)))
    }
}

/// The rows of cells of an image: between its rows of texels, or one for an image of one row.
fn rows(width: usize, height: usize) -> Vec<Row> {
    let count = (height - 1).max(1);
    let half_angle = |edge: usize| 0.5 * PI * edge as f64 / count as f64;
    // cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2), without cancellation.
    let difference = |row: usize| {
        2.0 * (half_angle(row) + half_angle(row + 1)).sin()
            * (half_angle(row + 1) - half_angle(row)).sin()
    };
    let row = |row: usize| Row {
        cosines: [(2.0 * half_angle(row)).cos(), (2.0 * half_angle(row + 1)).cos()],
        per_solid_angle: (width as f64 / (2.0 * PI * difference(row))) as f32,
    };
    (0..count).map(row).collect()
}

/// The whole part of `value`, at most `count - 1`, and the rest.
#[inline]
fn split(value: f32, count: usize) -> (usize, f32) {
    let whole = (value as usize).min(count - 1);
    (whole, (value - whole as f32).min(1.0))
}
