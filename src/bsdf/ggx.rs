//! The GGX (Trowbridge and Reitz 1975) distribution of microfacet normals.

use crate::math::sine::sine_cosine_of_turns;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Density of normals per steradian and unit of macroscopic area (Walter et al. 2007, equation 33, stretched by
/// two roughnesses as in Heitz 2014, "Understanding the Masking-Shadowing Function").
pub(super) fn density(alpha: Vec2, h: Vec3) -> f32 {
    let (x, y) = (h.x / alpha.x, h.y / alpha.y);
    let t = x * x + y * y + h.z * h.z;
    1.0 / (PI * alpha.x * alpha.y * t * t)
}

/// Area of all facets seen from the direction `w`, projected to it, per unit of macroscopic area: `cos (1 + Λ)`
/// (Heitz 2014). `cos ≥ 0`; `slope` is the length of `(α_x w_x, α_y w_y)`.
pub(super) fn projected_area(cos: f32, slope: f32) -> f32 {
    0.5 * (cos + (cos * cos + slope * slope).sqrt())
}

/// A normal visible from the unit vector `w`, for roughness one, not normalised
/// (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps").
pub(super) fn sample_visible(w: Vec3, u: Vec2) -> Vec3 {
    // Uniform on the cap z ≥ -w.z; 1 - z and 1 + z apart, so that their product has no cancellation near the pole.
    let below = u.y * (1.0 + w.z);
    let above = (1.0 - u.y) * (1.0 + w.z) + (1.0 - w.z);
    let (sin_phi, cos_phi) = sine_cosine_of_turns(u.x);
    let sin = (below * above).max(0.0).sqrt();
    Vec3::new(sin * cos_phi, sin * sin_phi, 1.0 - below) + w
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_one_over_pi_alpha_squared() {
        for alpha in [1.0f32, 0.1, 1e-4] {
            let peak = density(Vec2::splat(alpha), Vec3::Z);
            assert!((peak * PI * alpha * alpha - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn masking_is_the_formula_of_smith() {
        // G1 = 2 / (1 + √(1 + α² tan²)).
        let (alpha, cos) = (0.3f32, 0.4f32);
        let sin = (1.0 - cos * cos).sqrt();
        let g1 = 2.0 / (1.0 + (1.0 + (alpha * sin / cos).powi(2)).sqrt());
        assert!((cos / projected_area(cos, alpha * sin) - g1).abs() < 1e-6);
    }
}
