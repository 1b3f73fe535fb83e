//! Transforms that keep angles.

use glam::DMat3;

/// The rotation (or rotation with a reflection) and the positive scale that make up `matrix`; `None` when it does
/// anything else, or is not finite. Deviations up to 1e-3 are taken for the few digits of a scene file and removed, by
/// the method of Gram and Schmidt.
pub fn rotation_and_scale(matrix: DMat3) -> Option<(DMat3, f64)> {
    let scale = matrix.determinant().abs().cbrt();
    let unit = matrix * (1.0 / scale);
    let deviation = (unit.transpose() * unit - DMat3::IDENTITY).to_cols_array();
    // Written so that NaN is refused.
    if !(scale > 0.0 && deviation.iter().all(|value| value.abs() < 1e-3)) {
        return None;
    }
    let x = unit.x_axis.normalize();
    let y = unit.y_axis.reject_from_normalized(x).normalize();
    let right_handed = x.cross(y);
    Some((DMat3::from_cols(x, y, right_handed * right_handed.dot(unit.z_axis).signum()), scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn a_rotation_is_found_with_its_scale_and_handedness() {
        let rotation =
            DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -2.0) / 3.0, 0.7));
        let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        for expected in [rotation, rotation * mirror] {
            for expected_scale in [1e-6, 1.0, 2.5e7] {
                let (found, scale) = rotation_and_scale(expected * expected_scale).unwrap();
                assert!((scale / expected_scale - 1.0).abs() < 1e-12);
                assert!((found - expected).to_cols_array().iter().all(|value| value.abs() < 1e-12));
            }
        }
        // Four digits are enough, and the result is orthonormal all the same.
        let rounded = DMat3::from_cols_array(
            &rotation.to_cols_array().map(|value| (value * 1e4).round() / 1e4),
        );
        let (found, _) = rotation_and_scale(rounded).unwrap();
        assert!(
            (found.transpose() * found - DMat3::IDENTITY)
                .to_cols_array()
                .iter()
                .all(|v| v.abs() < 1e-14)
        );
    }

    #[test]
    fn what_changes_angles_is_refused() {
        let stretch = DMat3::from_diagonal(DVec3::new(1.0, 1.01, 1.0));
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.01, 1.0, 0.0), DVec3::Z);
        for matrix in
            [stretch, shear, DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, f64::NAN, 1.0))]
        {
            assert_eq!(rotation_and_scale(matrix), None);
        }
    }
}
