//! The Beckmann distribution of microfacet normals: a surface with normally distributed slopes.

use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

const INV_SQRT_PI: f32 = 0.564_189_6;

/// Density of normals per steradian and unit of macroscopic area (Walter et al. 2007, equation 25, stretched by
/// two roughnesses as in Heitz 2014, "Understanding the Masking-Shadowing Function").
pub(super) fn density(alpha: Vec2, h: Vec3) -> f32 {
    let (x, y) = (h.x / alpha.x, h.y / alpha.y);
    let cos2 = h.z * h.z;
    let exponent = (x * x + y * y) / cos2;
    // Below e⁻⁸⁰ nothing is left, and 0/0 threatens where the cosine underflows.
    if exponent < 80.0 {
        (-exponent).exp() * FRAC_1_PI / (alpha.x * alpha.y * cos2 * cos2)
    } else {
        0.0
    }
}

/// Area of all facets seen from the direction `w`, projected to it, per unit of macroscopic area: `cos (1 + Λ)` with
/// `Λ = (exp(-a²)/(a√π) - erfc a) / 2`, `a = cos / slope` (Heitz 2014).
/// Mitsuba has a rational approximation here that is up to 0.35 % off; the exact form keeps the density of visible
/// normals normalised and the reflected energy below one.
pub(super) fn projected_area(cos: f32, slope: f32) -> f32 {
    // From a = 4 on, Λ is below 1e-9.
    if cos >= 4.0 * slope {
        return cos;
    }
    let a = cos / slope;
    let gauss = (-a * a).exp();
    0.5 * (cos * (1.0 + erf_from_gauss(a, gauss)) + slope * gauss * INV_SQRT_PI)
}

/// A normal visible from the unit vector `w`, for roughness one, not normalised: slopes with density proportional to
/// `max(0, cos - x sin) exp(-x² - y²)` (Heitz and d'Eon 2014), `x` by inverting its distribution
/// function, which is smooth in `u` (as Jakob 2014, "An Improved Visible Normal Sampling Routine for the Beckmann
/// Distribution", asks for), `y` by the inverse error function.
pub(super) fn sample_visible(w: Vec3, u: Vec2) -> Vec3 {
    let sin = w.truncate().length();
    let x = visible_slope(w.z, sin, u.x);
    let y = erf_inverse(2.0 * u.y - 1.0);
    // The slope x runs away from the viewer's azimuth; any azimuth will do where the viewer is at the pole.
    let (cos_phi, sin_phi) = if sin > 0.0 { (w.x / sin, w.y / sin) } else { (1.0, 0.0) };
    Vec3::new(sin_phi * y - cos_phi * x, -sin_phi * x - cos_phi * y, 1.0)
}

/// Solves `cos (1 + erf x) / 2 + sin exp(-x²) / (2√π) = u · (the same at x = cos / sin)` for `x ≤ cos / sin`.
fn visible_slope(cos: f32, sin: f32, u: f32) -> f32 {
    // Beyond ±4 the distribution has less than 2e-8 of its mass.
    let (mut low, mut high) = (-4.0f32, if cos < 4.0 * sin { cos / sin } else { 4.0 });
    let target = u * projected_area(cos, sin);
    // Exact at the pole and at the horizon; between them Newton's method needs about four steps.
    let u = u.clamp(1e-7, 1.0 - 1e-7);
    let mut x =
        (cos * erf_inverse(2.0 * u - 1.0) - (1.0 - cos) * (-u.ln()).sqrt()).clamp(low, high);
    for _ in 0..24 {
        let gauss = (-x * x).exp();
        let value =
            0.5 * (cos * (1.0 + erf_from_gauss(x, gauss)) + sin * gauss * INV_SQRT_PI) - target;
        if value > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let newton = x - value / ((cos - x * sin) * gauss * INV_SQRT_PI);
        // Newton's step where it stays between the bounds, else bisection; NaN bisects too.
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let step = (next - x).abs();
        x = next;
        if step < 1e-6 {
            break;
        }
    }
    x
}

/// The error function, given also `exp(-x²)`; absolute error below 6e-7: 1.5e-7 of the formula
/// (Abramowitz and Stegun 1964, 7.1.26), the rest rounding.
fn erf_from_gauss(x: f32, gauss: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let polynomial = t
        * (0.254_829_6
            + t * (-0.284_496_74 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4))));
    (1.0 - polynomial * gauss).copysign(x)
}

/// The inverse error function, relative error about 1e-6; the argument is limited so that the result is finite
/// (Giles 2012, "Approximating the erfinv Function", single precision).
fn erf_inverse(x: f32) -> f32 {
    let x = x.clamp(-1.0 + f32::EPSILON, 1.0 - f32::EPSILON);
    let w = -((1.0 - x) * (1.0 + x)).ln();
    let (w, coefficients) = if w < 5.0 {
        const CENTRE: [f32; 9] = [
            2.810_226_4e-8,
            3.432_739_4e-7,
            -3.523_387_7e-6,
            -4.391_506_5e-6,
            2.185_808_7e-4,
            -1.253_725e-3,
            -4.177_681_6e-3,
            0.246_640_73,
            1.501_409_4,
        ];
        (w - 2.5, CENTRE)
    } else {
        const TAIL: [f32; 9] = [
            -2.002_142_6e-4,
            1.009_505_6e-4,
            1.349_343_2e-3,
            -3.673_428_4e-3,
            5.739_507_7e-3,
            -7.622_461_3e-3,
            9.438_870_5e-3,
            1.001_674,
            2.832_976_8,
        ];
        (w.sqrt() - 3.0, TAIL)
    };
    x * coefficients.into_iter().reduce(|sum, next| sum * w + next).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::function::erf::{erf, erf_inv};
    use std::f32::consts::PI;

    #[test]
    fn the_error_function_and_its_inverse_are_as_exact_as_said() {
        for i in -4000..=4000 {
            let x = i as f32 / 1000.0;
            let value = erf_from_gauss(x, (-x * x).exp());
            assert!((f64::from(value) - erf(f64::from(x))).abs() < 6e-7, "{x}");
        }
        for i in -9999..=9999 {
            let x = i as f32 / 10_000.0;
            let expected = erf_inv(f64::from(x));
            assert!(
                (f64::from(erf_inverse(x)) - expected).abs() <= 2e-6 * expected.abs().max(1e-3),
                "{x}"
            );
        }
        assert!(erf_inverse(1.0).is_finite() && erf_inverse(-1.0).is_finite());
    }

    #[test]
    fn the_slope_inverts_its_distribution() {
        for cos in [1.0f32, 0.99, 0.5, 0.1, 1e-3, 1e-8] {
            let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
            let (c, s) = (f64::from(cos), f64::from(sin));
            let distribution = |x: f64| {
                0.5 * (c * (1.0 + erf(x)) + s * (-x * x).exp() / std::f64::consts::PI.sqrt())
            };
            let all = if s > 0.0 { distribution(c / s) } else { c };
            for i in 0..=1000 {
                let u = i as f32 / 1000.0;
                let x = visible_slope(cos, sin, u);
                // Twice the error of the error function, and what 4e-8 beyond the limits lacks.
                assert!(
                    (distribution(f64::from(x)) / all - f64::from(u)).abs() < 2e-6,
                    "{cos} {u} {x}"
                );
            }
        }
    }

    #[test]
    fn the_peak_is_one_over_pi_alpha_squared_and_the_rim_is_zero() {
        for alpha in [1.0f32, 0.1, 1e-4] {
            assert!((density(Vec2::splat(alpha), Vec3::Z) * PI * alpha * alpha - 1.0).abs() < 1e-5);
            assert_eq!(density(Vec2::splat(alpha), Vec3::X), 0.0);
        }
    }
}
