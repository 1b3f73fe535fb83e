//! The sphere that light from infinity falls on.

use glam::Vec3;

/// A sphere around all that can be lit and seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    /// Its centre, in world space.
    pub center: Vec3,
    /// Its radius, positive.
    pub radius: f32,
}

impl Default for BoundingSphere {
    fn default() -> Self {
        Self { center: Vec3::ZERO, radius: 1.0 }
    }
}

impl BoundingSphere {
    /// Around a box, given by two opposite corners, and the eye; of radius 1 where these are one point.
    pub fn around(bounds: Option<(Vec3, Vec3)>, eye: Vec3) -> Self {
        let (low, high) = bounds.unwrap_or((eye, eye));
        let (low, high) = (low.min(eye), high.max(eye));
        let center = (low + high) * 0.5;
        // Rounding may not leave a corner outside.
        let radius = (high - center).length() * (1.0 + 1e-5);
        Self { center, radius: if radius > 0.0 { radius } else { 1.0 } }
    }

    /// A sphere with the same centre that holds `other`, too.
    pub(super) fn holding(self, other: Self) -> Self {
        let reach = self.center.distance(other.center) + other.radius;
        Self {
            radius: if reach > self.radius { reach * (1.0 + 1e-5) } else { self.radius },
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounding_sphere_holds_box_and_eye() {
        let eye = Vec3::new(0.0, 9.0, 0.0);
        let BoundingSphere { center, radius } =
            BoundingSphere::around(Some((Vec3::ZERO, Vec3::ONE)), eye);
        for point in [Vec3::ZERO, Vec3::ONE, eye] {
            assert!(point.distance(center) <= radius, "{point}");
        }
        assert!(radius < 4.6, "a sphere much too large would make the sky too likely: {radius}");
        let empty = BoundingSphere::around(None, Vec3::X);
        assert_eq!(empty, BoundingSphere { center: Vec3::X, radius: 1.0 });
    }

    #[test]
    fn a_bounding_sphere_grows_only_for_what_it_does_not_hold() {
        let sphere = BoundingSphere { center: Vec3::X, radius: 2.0 };
        let small = BoundingSphere { center: Vec3::new(1.0, 1.0, 0.0), radius: 0.5 };
        assert_eq!(sphere.holding(small), sphere);
        let lens = BoundingSphere { center: Vec3::new(1.0, 2.0, 0.0), radius: 0.5 };
        let both = sphere.holding(lens);
        assert!(both.center == Vec3::X && both.radius >= 2.5 && both.radius < 2.5001, "{both:?}");
    }
}
