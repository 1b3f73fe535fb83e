//! Maps from the unit square to other domains, with their densities.
//!
//! Each `square_to_x` maps uniform points of `[0, 1)²` to points of density `x_pdf`, and keeps neighbours neighbours,
//! so that stratified points stay stratified. Densities over directions are per steradian; directions are unit
//! vectors around `z`.

use super::sine::{sine_cosine, sine_cosine_of_turns};
use glam::{DVec2, Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, PI, TAU};

/// A point of the unit disk, uniform in area (Shirley and Chiu 1997, "A Low Distortion Map Between Disk and Square":
/// squares around the centre become circles).
#[inline]
pub fn square_to_disk(u: Vec2) -> Vec2 {
    let square = 2.0 * u - Vec2::ONE;
    // Which axis is nearer nobody can predict: without a branch.
    let is_x = square.x.abs() > square.y.abs();
    let (radius, across) = if is_x { (square.x, square.y) } else { (square.y, square.x) };
    if radius == 0.0 {
        return Vec2::ZERO;
    }
    let (sine, cosine) = sine_cosine(FRAC_PI_4 * (across / radius));
    radius * if is_x { Vec2::new(cosine, sine) } else { Vec2::new(sine, cosine) }
}

/// The inverse of [`square_to_disk`], in `[0, 1)²`. In double precision, so that the point found again is right to the
/// rounding of the square's coordinates.
pub fn disk_to_square(point: DVec2) -> Vec2 {
    let radius = point.length();
    // The angle from the nearer axis, as a share of an eighth of the circle, goes along the square's side.
    let share = |side: f64, main: f64| (side / main).atan() * (4.0 * std::f64::consts::FRAC_1_PI);
    let square = if point.x.abs() > point.y.abs() {
        let x = radius.copysign(point.x);
        DVec2::new(x, x * share(point.y, point.x))
    } else if point.y != 0.0 {
        let y = radius.copysign(point.y);
        DVec2::new(y * share(point.x, point.y), y)
    } else {
        DVec2::ZERO
    };
    let last = Vec2::splat(1.0 - f32::EPSILON / 2.0);
    ((square + 1.0) * 0.5).as_vec2().clamp(Vec2::ZERO, last)
}

/// Density of [`square_to_disk`], per unit of area, inside the disk.
pub const DISK_PDF: f32 = FRAC_1_PI;

/// A direction of the upper hemisphere, of density proportional to its cosine: a point of the disk lifted to the
/// hemisphere (Malley's method).
#[inline]
pub fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let disk = square_to_disk(u);
    // The rim of the disk has cosine 0 and density 0; rounding must not make it negative or NaN.
    disk.extend((1.0 - disk.length_squared()).max(0.0).sqrt())
}

/// Density of [`square_to_cosine_hemisphere`]: `cos θ / π`, and 0 below the horizon.
#[inline]
pub fn cosine_hemisphere_pdf(direction: Vec3) -> f32 {
    direction.z.max(0.0) * FRAC_1_PI
}

/// A direction of the whole sphere, uniform.
#[inline]
pub fn square_to_sphere(u: Vec2) -> Vec3 {
    // 1 - z² with z = 1 - 2u is 4u(1 - u), which does not cancel at the poles.
    let sine = 2.0 * (u.x * (1.0 - u.x)).sqrt();
    let (sin_phi, cos_phi) = sine_cosine_of_turns(u.y);
    Vec3::new(sine * cos_phi, sine * sin_phi, 1.0 - 2.0 * u.x)
}

/// Density of [`square_to_sphere`].
pub const SPHERE_PDF: f32 = 0.25 * FRAC_1_PI;

/// A direction of the cone around `z` whose half-angle has the given `1 - cos`, uniform. Taking `1 - cos` instead of
/// the cosine keeps narrow cones exact; see [`one_minus_cosine`].
#[inline]
pub fn square_to_cone(u: Vec2, one_minus_cosine: f32) -> Vec3 {
    let height = u.x * one_minus_cosine;
    let sine = (height * (2.0 - height)).max(0.0).sqrt();
    let (sin_phi, cos_phi) = sine_cosine_of_turns(u.y);
    Vec3::new(sine * cos_phi, sine * sin_phi, 1.0 - height)
}

/// Density of [`square_to_cone`] inside the cone: one over its solid angle `2π(1 - cos)`.
#[inline]
pub fn cone_pdf(one_minus_cosine: f32) -> f32 {
    1.0 / (TAU * one_minus_cosine)
}

/// `1 - cos` of the angle below a right angle with the given squared sine, without cancellation: `sin² / (1 + cos)`.
#[inline]
pub fn one_minus_cosine(sine_squared: f32) -> f32 {
    sine_squared / (1.0 + (1.0 - sine_squared).max(0.0).sqrt())
}

/// Barycentric weights of the second and third vertex of a point of a triangle, uniform in area. The square is folded
/// along a diagonal and each half sheared onto half of the triangle (Heitz 2019, "A Low-Distortion Map Between
/// Triangle and Square"): no square root, and less distortion than with one.
#[inline]
pub fn square_to_triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let x = 0.5 * u.x;
        Vec2::new(x, u.y - x)
    } else {
        let y = 0.5 * u.y;
        Vec2::new(u.x - y, y)
    }
}

/// Density of [`square_to_triangle`] in barycentric coordinates; divide by twice the triangle's area to have it per
/// unit of that.
pub const TRIANGLE_PDF: f32 = 2.0;

/// A point of the unit square whose density is the bilinear interpolation of `corners` (at (0, 0), (1, 0), (0, 1) and
/// (1, 1); not negative, and not all zero), up to a factor: first `y` by the means of the two rows, then `x` by the
/// corners interpolated at `y`.
#[inline]
pub fn square_to_bilinear(u: Vec2, corners: [f32; 4]) -> Vec2 {
    let [a, b, c, d] = corners;
    let y = invert_linear(u.y, a + b, c + d);
    Vec2::new(invert_linear(u.x, a + (c - a) * y, b + (d - b) * y), y)
}

/// Density of [`square_to_bilinear`].
#[inline]
pub fn bilinear_pdf(point: Vec2, corners: [f32; 4]) -> f32 {
    let [a, b, c, d] = corners;
    let (upper, lower) = (a + (b - a) * point.x, c + (d - c) * point.x);
    4.0 * (upper + (lower - upper) * point.y) / (a + b + c + d)
}

/// Where the integral of the density that goes linearly from `start` to `end` over `[0, 1]` reaches the share `u`. This
/// form of the quadratic's root neither cancels nor divides by the difference of the two, which may be 0.
#[inline]
fn invert_linear(u: f32, start: f32, end: f32) -> f32 {
    let value = (start * start + (end * end - start * start) * u).max(0.0).sqrt();
    let sum = start + value;
    // Only where the density starts at 0 and u is 0.
    if sum > 0.0 { (u * (start + end) / sum).min(1.0) } else { 0.0 }
}

/// The solid angle of the whole sphere.
pub const SPHERE_SOLID_ANGLE: f32 = 4.0 * PI;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{IndependentSampler, Sampler};

    /// χ² of `count` samples over cells of equal probability must be below the quantile of 1 - 1e-5 (Wilson and
    /// Hilferty's approximation, 4.265 standard deviations).
    fn assert_uniform(name: &str, cells: usize, count: usize, mut cell: impl FnMut(Vec2) -> usize) {
        let mut sampler = IndependentSampler::new(1, 2, 3);
        let mut counts = vec![0u32; cells];
        (0..count).for_each(|_| counts[cell(sampler.next_2d())] += 1);
        let expected = count as f64 / cells as f64;
        assert!(expected >= 50.0);
        let chi_squared: f64 =
            counts.iter().map(|&n| (f64::from(n) - expected).powi(2) / expected).sum();
        let freedom = (cells - 1) as f64;
        let spread = 2.0 / (9.0 * freedom);
        let bound = freedom * (1.0 - spread + 4.265 * spread.sqrt()).powi(3);
        assert!(chi_squared < bound, "{name}: χ² {chi_squared}, bound {bound}");
    }

    /// The cell, of `n` × `n`, of two coordinates in `[0, 1]`.
    fn cell(n: usize, x: f32, y: f32) -> usize {
        let index = |value: f32| ((value * n as f32) as usize).min(n - 1);
        index(x) * n + index(y)
    }

    fn turn(direction: Vec2) -> f32 {
        (direction.y.atan2(direction.x) / TAU).rem_euclid(1.0)
    }

    #[test]
    fn samples_have_the_density_that_is_claimed() {
        // Cells of equal probability under the claimed densities: r² of a disk, sin² of the cosine hemisphere, z of
        // the sphere, and the height of a cone's cap are uniform, and so are the angles around them.
        const N: usize = 32;
        const COUNT: usize = 1 << 18;
        assert_uniform("disk", N * N, COUNT, |u| {
            let disk = square_to_disk(u);
            cell(N, disk.length_squared(), turn(disk))
        });
        assert_uniform("cosine hemisphere", N * N, COUNT, |u| {
            let direction = square_to_cosine_hemisphere(u);
            cell(N, 1.0 - direction.z * direction.z, turn(direction.truncate()))
        });
        assert_uniform("sphere", N * N, COUNT, |u| {
            let direction = square_to_sphere(u);
            cell(N, 0.5 * (direction.z + 1.0), turn(direction.truncate()))
        });
        for cap in [0.3, 1.0, 1.7] {
            assert_uniform("cone", N * N, COUNT, |u| {
                let direction = square_to_cone(u, cap);
                cell(N, (1.0 - direction.z) / cap, turn(direction.truncate()))
            });
        }
        // Of the triangle, s = (1 - b)² and c / (1 - b) are uniform for the weights b and c.
        assert_uniform("triangle", N * N, COUNT, |u| {
            let Vec2 { x, y } = square_to_triangle(u);
            assert!(x >= 0.0 && y >= 0.0 && x + y <= 1.0);
            cell(N, (1.0 - x) * (1.0 - x), y / (1.0 - x))
        });
        // Of a bilinear density, by its two cumulative distributions: of y, and of x at that y.
        for [a, b, c, d] in
            [[1.0, 2.0, 3.0, 0.5], [0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 1.0, 0.0]]
        {
            let share = |at: f32, start: f32, end: f32| {
                at * (2.0 * start + (end - start) * at) / (start + end)
            };
            assert_uniform("bilinear", N * N, COUNT, |u| {
                let Vec2 { x, y } = square_to_bilinear(u, [a, b, c, d]);
                cell(N, share(x, a + (c - a) * y, b + (d - b) * y), share(y, a + b, c + d))
            });
        }
    }

    #[test]
    fn densities_integrate_to_one() {
        // Midpoints in z: the cosine is linear in it, so the sum is exact up to rounding.
        let n = 1000;
        let cosines = (0..2 * n).map(|i| (i as f32 + 0.5) / n as f32 - 1.0);
        let total: f32 =
            cosines.map(|z| cosine_hemisphere_pdf(Vec3::new(0.0, 0.0, z)) * TAU / n as f32).sum();
        assert!((total - 1.0).abs() < 1e-5, "{total}");
        let corners = [1.0, 2.0, 3.0, 0.5];
        let centers = (0..100 * 100)
            .map(|i| Vec2::new((i % 100) as f32 + 0.5, (i / 100) as f32 + 0.5) / 100.0);
        let total: f32 = centers.map(|point| bilinear_pdf(point, corners) / 1e4).sum();
        assert!((total - 1.0).abs() < 1e-4, "{total}");
        // Twice as high at a corner of twice the weight; the mean of the corners is 1.625.
        assert!((bilinear_pdf(Vec2::X, corners) - 2.0 / 1.625).abs() < 1e-6);
        assert!((SPHERE_PDF * SPHERE_SOLID_ANGLE - 1.0).abs() < 1e-6);
        assert!((cone_pdf(2.0) - SPHERE_PDF).abs() < 1e-8);
    }

    #[test]
    fn the_way_back_from_the_disk_is_exact() {
        for i in 0..100_000u32 {
            let u = Vec2::new((i % 317) as f32 / 317.0, (i / 317) as f32 / 317.0);
            let back = disk_to_square(square_to_disk(u).as_dvec2());
            // A disk point is rounded by 1e-7; the corners of the square are stretched least.
            assert!((back - u).length() < 4e-7, "{u} {back}");
        }
        for point in [DVec2::ZERO, DVec2::X, -DVec2::X, DVec2::Y, -DVec2::Y] {
            let u = disk_to_square(point);
            assert!(u.cmpge(Vec2::ZERO).all() && u.cmplt(Vec2::ONE).all(), "{point} {u}");
            assert!((square_to_disk(u).as_dvec2() - point).length() < 1e-6, "{point} {u}");
        }
    }

    #[test]
    fn a_narrow_cone_keeps_its_width() {
        // sin = 1e-6: the cosine rounds to 1 in single precision, and 1 - cos is 5e-13.
        let cap = one_minus_cosine(1e-12);
        assert!((cap / 5e-13 - 1.0).abs() < 1e-6);
        let rim = square_to_cone(Vec2::new(1.0, 0.25), cap);
        assert!((rim.truncate().length() / 1e-6 - 1.0).abs() < 1e-6);
        assert_eq!(one_minus_cosine(0.0), 0.0);
        assert_eq!(one_minus_cosine(1.0), 1.0);
    }

    #[test]
    fn corners_are_finite_unit_vectors() {
        let last = 1.0 - f32::EPSILON / 2.0;
        for u in
            [0.0, 0.5, last].into_iter().flat_map(|x| [0.0, 0.5, last].map(|y| Vec2::new(x, y)))
        {
            let directions = [
                square_to_cosine_hemisphere(u),
                square_to_sphere(u),
                square_to_cone(u, 2.0),
                square_to_cone(u, 0.0),
            ];
            for direction in directions {
                assert!((direction.length() - 1.0).abs() < 1e-6, "{u} gives {direction}");
            }
            assert!(square_to_disk(u).length() <= 1.0 + 1e-6);
        }
    }
}
