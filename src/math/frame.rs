//! Orthonormal frames around a normal.

use glam::Vec3;

/// An orthonormal right-handed frame; `normal` is the local `z` axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Local `x` in world space.
    pub tangent: Vec3,
    /// Local `y` in world space.
    pub bitangent: Vec3,
    /// Local `z` in world space.
    pub normal: Vec3,
}

impl Frame {
    /// Any frame around the unit vector `normal`, without a branch and continuous but for one meridian
    /// (Duff et al. 2017, "Building an Orthonormal Basis, Revisited", listing 3).
    #[inline]
    pub fn from_normal(normal: Vec3) -> Self {
        let sign = 1.0f32.copysign(normal.z);
        let a = -1.0 / (sign + normal.z);
        let b = normal.x * normal.y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
            bitangent: Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
            normal,
        }
    }

    /// The frame around `normal` whose tangent lies as near as possible to `direction`; any frame where the two
    /// are parallel.
    pub fn from_normal_and_tangent(normal: Vec3, direction: Vec3) -> Self {
        let across = direction - normal * normal.dot(direction);
        match across.try_normalize() {
            Some(tangent) => Self { tangent, bitangent: normal.cross(tangent), normal },
            None => Self::from_normal(normal),
        }
    }

    /// World to local.
    #[inline]
    pub fn to_local(&self, world: Vec3) -> Vec3 {
        Vec3::new(self.tangent.dot(world), self.bitangent.dot(world), self.normal.dot(world))
    }

    /// Local to world.
    #[inline]
    pub fn to_world(&self, local: Vec3) -> Vec3 {
        self.tangent * local.x + self.bitangent * local.y + self.normal * local.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_orthonormal_and_inverts() {
        for normal in [
            Vec3::Z,
            -Vec3::Z,
            Vec3::X,
            -Vec3::Y,
            Vec3::new(0.3, -0.5, 0.7).normalize(),
            Vec3::new(1e-4, 0.0, -1.0).normalize(),
        ] {
            for frame in [
                Frame::from_normal(normal),
                Frame::from_normal_and_tangent(normal, Vec3::new(0.2, 0.9, 0.1)),
            ] {
                assert!((frame.tangent.cross(frame.bitangent) - frame.normal).length() < 1e-6);
                assert!(frame.tangent.dot(frame.normal).abs() < 1e-6);
                let world = Vec3::new(0.1, -0.7, 0.4);
                assert!((frame.to_world(frame.to_local(world)) - world).length() < 1e-6);
            }
        }
    }
}
