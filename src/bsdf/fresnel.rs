//! Reflection and refraction at a perfectly smooth boundary, for unpolarised light.

use crate::math::Rgb;
use glam::Vec3;

/// Boundaries whose relative index differs from one by less than this let light through unchanged: the half vector of a
/// refraction has no digits left there, and the reflectance is below 3e-11.
pub const MATCHED: f32 = 1e-5;

/// What a boundary between two dielectrics does with light that meets it at some angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// Reflected part, in `[0, 1]`; the rest is refracted.
    pub reflectance: f32,
    /// Cosine between the normal and the refracted direction, on the other side of the boundary; 0 in total reflection.
    pub cos_refracted: f32,
}

/// The Fresnel equations: `cos` in `[0, 1]` on the side where the light is, `eta` the index of the other side over that of
/// this side (Born and Wolf 1999, "Principles of Optics", section 1.5.2; the mean of both polarisations).
pub fn dielectric(cos: f32, eta: f32) -> Interface {
    // Snell's law. In this form nothing cancels for an index near one.
    let cos2 = ((eta - 1.0) * (eta + 1.0) + cos * cos) / (eta * eta);
    if cos2 <= 0.0 {
        return Interface { reflectance: 1.0, cos_refracted: 0.0 };
    }
    let cos_refracted = cos2.sqrt();
    if cos <= 0.0 {
        return Interface { reflectance: 1.0, cos_refracted };
    }
    let perpendicular = (cos - eta * cos_refracted) / (cos + eta * cos_refracted);
    let parallel = (eta * cos - cos_refracted) / (eta * cos + cos_refracted);
    Interface {
        reflectance: 0.5 * (perpendicular * perpendicular + parallel * parallel),
        cos_refracted,
    }
}

/// Reflectance of a conductor with the complex index `eta + i k` relative to the medium outside; `cos` in `[0, 1]`
/// (Moeller 1988, "Optics", in the form Mitsuba 3 uses).
pub fn conductor(cos: f32, eta: Rgb, k: Rgb) -> Rgb {
    Rgb::new(
        conductor_channel(cos, eta.r, k.r),
        conductor_channel(cos, eta.g, k.g),
        conductor_channel(cos, eta.b, k.b),
    )
}

fn conductor_channel(cos: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos * cos;
    let sin2 = (1.0 - cos) * (1.0 + cos);
    let difference = eta * eta - k * k - sin2;
    let modulus = (difference * difference + 4.0 * eta * eta * k * k).sqrt();
    let real = (0.5 * (modulus + difference)).max(0.0).sqrt();
    let cross = 2.0 * cos * real;
    let ratio =
        |sum: f32, cross: f32| if sum + cross > 0.0 { (sum - cross) / (sum + cross) } else { 1.0 };
    let perpendicular = ratio(modulus + cos2, cross);
    let parallel = perpendicular * ratio(modulus * cos2 + sin2 * sin2, cross * sin2);
    (0.5 * (perpendicular + parallel)).clamp(0.0, 1.0)
}

/// Part of diffuse light that the boundary reflects: `∫ F(cos) 2 cos dcos`, `eta` as in [`dielectric`].
pub fn diffuse_reflectance(eta: f32) -> f32 {
    if eta < 1.0 {
        // What gets in from outside also gets out from inside, and η² more directions compete inside; so the kink at the
        // critical angle need not be integrated.
        return 1.0 - eta * eta * (1.0 - diffuse_reflectance(1.0 / eta));
    }
    // Simpson's rule in s = √cos, because near grazing F falls like 1 - O(cos).
    let steps = 256;
    let integrand = |i: i32| {
        let s = i as f32 / steps as f32;
        f64::from(dielectric(s * s, eta).reflectance) * 4.0 * f64::from(s).powi(3)
    };
    let inner: f64 = (1..steps).map(|i| f64::from(2 + 2 * (i % 2)) * integrand(i)).sum();
    ((integrand(0) + inner + integrand(steps)) / f64::from(3 * steps)) as f32
}

/// The mirror image of `w` about `normal`, both unit.
pub fn reflect(w: Vec3, normal: Vec3) -> Vec3 {
    normal * (2.0 * w.dot(normal)) - w
}

/// Where `w` continues behind the boundary with `normal` on its side: `eta` as in [`dielectric`], `cos_refracted` from it.
pub fn refract(w: Vec3, normal: Vec3, eta: f32, cos_refracted: f32) -> Vec3 {
    (normal * (w.dot(normal) / eta - cos_refracted) - w / eta).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_incidence_is_the_textbook_formula() {
        for eta in [0.5f32, 1.0 / 1.5, 1.0, 1.33, 1.5, 2.419] {
            let expected = ((eta - 1.0) / (eta + 1.0)).powi(2);
            assert!((dielectric(1.0, eta).reflectance - expected).abs() < 1e-7);
        }
        // Gold in red light: ((n-1)² + k²) / ((n+1)² + k²).
        let (n, k) = (0.143_04f32, 3.983);
        let expected = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
        assert!((conductor(1.0, Rgb::splat(n), Rgb::splat(k)).r - expected).abs() < 1e-6);
    }

    #[test]
    fn at_brewsters_angle_only_one_polarisation_is_reflected() {
        let eta = 1.5f32;
        let cos = (1.0 / (1.0 + eta * eta)).sqrt();
        // There the perpendicular amplitude is (1 - η²) / (1 + η²).
        let expected = 0.5 * ((1.0 - eta * eta) / (1.0 + eta * eta)).powi(2);
        assert!((dielectric(cos, eta).reflectance - expected).abs() < 1e-6);
    }

    #[test]
    fn beyond_the_critical_angle_everything_is_reflected() {
        let eta = 1.0 / 1.5f32;
        let critical = (1.0 - eta * eta).sqrt();
        assert_eq!(
            dielectric(critical * 0.999, eta),
            Interface { reflectance: 1.0, cos_refracted: 0.0 }
        );
        assert!(dielectric(critical * 1.001, eta).reflectance < 1.0);
    }

    #[test]
    fn both_sides_of_a_boundary_reflect_alike() {
        for i in 1..=100 {
            let cos = i as f32 / 100.0;
            let there = dielectric(cos, 1.5);
            let back = dielectric(there.cos_refracted, 1.0 / 1.5);
            // The way back magnifies the rounding of the refracted cosine by η²/cos, and F falls up to six times as fast.
            assert!((there.reflectance - back.reflectance).abs() < 2e-6 / cos);
            assert!((back.cos_refracted - cos).abs() < 2e-6 / cos);
        }
    }

    #[test]
    fn a_conductor_without_absorption_is_a_dielectric() {
        for i in 0..=100 {
            let cos = i as f32 / 100.0;
            let metal = conductor(cos, Rgb::splat(1.5), Rgb::BLACK).r;
            assert!((metal - dielectric(cos, 1.5).reflectance).abs() < 2e-6, "{cos}");
        }
    }

    #[test]
    fn the_ideal_mirror_and_odd_indices_stay_in_range() {
        for i in 0..=100 {
            let cos = i as f32 / 100.0;
            assert_eq!(conductor(cos, Rgb::BLACK, Rgb::WHITE), Rgb::WHITE);
            for (eta, k) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1e-8), (1e3, 1e3)] {
                let reflectance = conductor(cos, Rgb::splat(eta), Rgb::splat(k)).r;
                assert!((0.0..=1.0).contains(&reflectance), "{cos} {eta} {k}: {reflectance}");
            }
        }
    }

    #[test]
    fn diffuse_reflectance_matches_published_values() {
        // Gauss-Legendre quadrature with 2000 points in double precision, made with numpy.
        for (eta, expected) in
            [(1.1, 0.194_344_92f32), (1.33, 0.471_949_15), (1.5, 0.596_345_8), (2.419, 0.865_407_4)]
        {
            assert!((diffuse_reflectance(1.0 / eta) - expected).abs() < 1e-5, "{eta}");
        }
    }

    #[test]
    fn refraction_obeys_snells_law() {
        let normal = Vec3::new(0.3, -0.2, 0.8).normalize();
        let w = Vec3::new(-0.4, 0.5, 0.6).normalize();
        for eta in [0.97f32, 1.33, 2.4] {
            let t = refract(w, normal, eta, dielectric(w.dot(normal), eta).cos_refracted);
            assert!((t.cross(normal) * eta + w.cross(normal)).length() < 1e-6);
            assert!(t.dot(normal) < 0.0);
        }
    }
}
