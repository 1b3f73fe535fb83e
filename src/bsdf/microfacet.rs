//! Rough surfaces as many small smooth facets, with the statistics of their normals.
//!
//! Masking and shadowing are Smith's, taken as independent of each other: `G = G1(wo) G1(wi)`, as Mitsuba 3 does, so
//! that pictures compare. (The height-correlated form `1 / (1 + Λo + Λi)` would be brighter at grazing angles.)

use super::{beckmann, ggx};
use glam::{Vec2, Vec3};

/// Roughness below this is none: the surface is treated as perfectly smooth (a delta lobe). In single precision a
/// half vector has an error of about 1e-7, which must stay small against the roughness.
pub const SMOOTH: f32 = 1e-4;

/// How the normals of microfacets are distributed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// Normally distributed slopes; `alpha` is √2 times their standard deviation.
    Beckmann,
    /// Long tails, as measured on ground surfaces (Trowbridge and Reitz 1975; Walter et al. 2007).
    Ggx,
}

/// A rough surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Microfacets {
    distribution: Distribution,
    /// Roughness along the local `x` and `y`, at least [`SMOOTH`].
    alpha: Vec2,
}

impl Microfacets {
    /// The surface with roughness `alpha` along the tangent and the bitangent; `None` if it is smooth both ways, below
    /// [`SMOOTH`]. If it is smooth one way only, that roughness is raised to the limit.
    pub fn new(distribution: Distribution, alpha: Vec2) -> Option<Self> {
        // Written so that NaN, too, is smooth.
        (alpha.max_element() >= SMOOTH)
            .then(|| Self { distribution, alpha: alpha.max(Vec2::splat(SMOOTH)) })
    }

    /// Density of the facet normal `h` (unit, in the upper half), per steradian, per unit of macroscopic area.
    pub(super) fn density(&self, h: Vec3) -> f32 {
        match self.distribution {
            Distribution::Beckmann => beckmann::density(self.alpha, h),
            Distribution::Ggx => ggx::density(self.alpha, h),
        }
    }

    /// Projected area of the facets that face the direction `w`, whichever side it is on, over the macroscopic area:
    /// `|cos| / G1`. Positive for every direction, so that a grazing one divides by nothing small but its own slope.
    pub(super) fn projected_area(&self, w: Vec3) -> f32 {
        let slope = (self.alpha * w.truncate()).length();
        match self.distribution {
            Distribution::Beckmann => beckmann::projected_area(w.z.abs(), slope),
            Distribution::Ggx => ggx::projected_area(w.z.abs(), slope),
        }
    }

    /// The part of the facets facing `w` that nothing hides (Smith's `G1`), in `[0, 1]`.
    pub(super) fn visibility(&self, w: Vec3) -> f32 {
        w.z.abs() / self.projected_area(w)
    }

    /// A unit normal with density `D(h) max(0, w·h) / projected_area(w)` (Heitz and d'Eon 2014); `w.z > 0`.
    pub(super) fn sample_visible(&self, w: Vec3, u: Vec2) -> Vec3 {
        let stretched = Vec3::new(self.alpha.x * w.x, self.alpha.y * w.y, w.z).normalize();
        let h = match self.distribution {
            Distribution::Beckmann => beckmann::sample_visible(stretched, u),
            Distribution::Ggx => ggx::sample_visible(stretched, u),
        };
        Vec3::new(self.alpha.x * h.x, self.alpha.y * h.y, h.z.max(1e-7)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roughness_has_a_lower_limit() {
        let new = |x, y| Microfacets::new(Distribution::Ggx, Vec2::new(x, y));
        assert_eq!(new(0.99e-4, 0.0), None);
        assert_eq!(new(f32::NAN, f32::NAN), None);
        assert_eq!(new(0.0, 0.5).map(|m| m.alpha), Some(Vec2::new(SMOOTH, 0.5)));
    }

    /// `∫ D(h) |w·h|⁺ dh` must be the projected area, and for `w` at the pole that is one.
    #[test]
    fn the_facets_cover_the_surface() {
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            for alpha in [Vec2::splat(0.2), Vec2::new(0.5, 0.1)] {
                let facets = Microfacets::new(distribution, alpha).unwrap();
                for w in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.3, 0.95, 0.1).normalize()]
                {
                    let (rows, columns) = (2000, 400);
                    let mut sum = 0.0f64;
                    for row in 0..rows {
                        // Midpoints in s = tan(θ/2), dense where the density is.
                        let s = (row as f32 + 0.5) / rows as f32;
                        let (sin, cos) = (2.0 * s / (1.0 + s * s), (1.0 - s * s) / (1.0 + s * s));
                        for column in 0..columns {
                            let phi =
                                std::f32::consts::TAU * (column as f32 + 0.5) / columns as f32;
                            let h = Vec3::new(sin * phi.cos(), sin * phi.sin(), cos);
                            let value =
                                facets.density(h) * w.dot(h).max(0.0) * sin * 2.0 / (1.0 + s * s);
                            sum += f64::from(value);
                        }
                    }
                    let area = sum * std::f64::consts::TAU / f64::from(rows * columns);
                    let expected = f64::from(facets.projected_area(w));
                    assert!(
                        (area / expected - 1.0).abs() < 3e-4,
                        "{facets:?} {w}: {area} {expected}"
                    );
                }
            }
        }
    }
}
