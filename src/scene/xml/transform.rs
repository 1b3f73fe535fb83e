//! The steps of a `<transform>`, each a matrix in double precision.

use super::value;
use crate::scene::error::{Location, SceneError};
use glam::{DMat3, DMat4, DVec3, DVec4};

/// One step of a transform, with its attributes as text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// By `x y z` or `value`.
    Translate,
    /// By `angle` degrees around `x y z` or `value`.
    Rotate,
    /// By `x y z` or `value`, one or three numbers.
    Scale,
    /// From `origin` to `target`, with `up` upward: the camera looks along +z, +y is up and +x is to the *left*.
    LookAt,
    /// Nine or sixteen numbers of `value`, row by row.
    Matrix,
}

impl Step {
    /// The step that an element means.
    pub(super) fn from_element(name: &str) -> Option<Self> {
        match name {
            "translate" => Some(Self::Translate),
            "rotate" => Some(Self::Rotate),
            "scale" => Some(Self::Scale),
            "lookat" | "lookAt" | "look_at" => Some(Self::LookAt),
            "matrix" => Some(Self::Matrix),
            _ => None,
        }
    }

    /// Attributes that must be there, and attributes that may.
    pub(super) fn attributes(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Translate | Self::Scale => (&[], &["x", "y", "z", "value"]),
            Self::Rotate => (&["angle"], &["x", "y", "z", "value"]),
            Self::LookAt => (&["origin", "target"], &["up"]),
            Self::Matrix => (&["value"], &[]),
        }
    }

    /// The matrix; `attribute` gives an attribute's text if it is there.
    ///
    /// # Errors
    /// [`SceneError::Value`] when a number is none, there are too many or few, an axis has no length, or a matrix is no
    /// affine map.
    pub(super) fn matrix<'a>(
        self,
        attribute: impl Fn(&str) -> Option<&'a str>,
        location: &Location,
    ) -> Result<DMat4, SceneError> {
        let vector = |default| vector(&attribute, default, location);
        let text = |name: &str| attribute(name).unwrap_or_default();
        match self {
            Self::Translate => Ok(DMat4::from_translation(vector(0.0)?)),
            Self::Scale => Ok(DMat4::from_scale(vector(1.0)?)),
            Self::Rotate => {
                let angle = value::number(text("angle"), "angle", location)?;
                let axis = vector(0.0)?;
                let axis = axis.try_normalize().ok_or_else(|| {
                    SceneError::value(
                        location,
                        "the axis of rotation",
                        axis.to_string(),
                        "a vector with a length",
                    )
                })?;
                Ok(DMat4::from_axis_angle(axis, angle.to_radians()))
            }
            Self::LookAt => {
                let origin = value::triple(text("origin"), "origin", location)?;
                let target = value::triple(text("target"), "target", location)?;
                let up = attribute("up").map(|up| value::triple(up, "up", location)).transpose()?;
                look_at(origin, target, up, location)
            }
            Self::Matrix => matrix_from_rows(text("value"), location),
        }
    }
}

/// `value` (one or three numbers) or `x`, `y`, `z`, each `default` where it is left out.
///
/// # Errors
/// [`SceneError::Value`] for another count, or for what is no number.
pub(super) fn vector<'a>(
    attribute: &impl Fn(&str) -> Option<&'a str>,
    default: f64,
    location: &Location,
) -> Result<DVec3, SceneError> {
    let components = ["x", "y", "z"].map(attribute);
    if let Some(text) = attribute("value") {
        if components.iter().any(Option::is_some) {
            return Err(SceneError::value(
                location,
                "a vector",
                "both \"value\" and x, y, z",
                "one of them",
            ));
        }
        return match value::numbers(text, "value", location)?[..] {
            [same] => Ok(DVec3::splat(same)),
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            _ => Err(SceneError::value(
                location,
                "value",
                format!("\"{text}\""),
                "one or three numbers",
            )),
        };
    }
    let mut vector = DVec3::splat(default);
    for (axis, (name, text)) in ["x", "y", "z"].into_iter().zip(components).enumerate() {
        if let Some(text) = text {
            vector[axis] = value::number(text, name, location)?;
        }
    }
    Ok(vector)
}

fn look_at(
    origin: DVec3,
    target: DVec3,
    up: Option<DVec3>,
    location: &Location,
) -> Result<DMat4, SceneError> {
    let forward = (target - origin).try_normalize().ok_or_else(|| {
        SceneError::value(location, "target", target.to_string(), "another point than the origin")
    })?;
    let up = up.filter(|up| *up != DVec3::ZERO).unwrap_or_else(|| forward.any_orthonormal_vector());
    let left = up.cross(forward).try_normalize().ok_or_else(|| {
        SceneError::value(
            location,
            "up",
            up.to_string(),
            "a direction across the direction of view",
        )
    })?;
    let up = forward.cross(left);
    Ok(DMat4::from_cols(left.extend(0.0), up.extend(0.0), forward.extend(0.0), origin.extend(1.0)))
}

fn matrix_from_rows(text: &str, location: &Location) -> Result<DMat4, SceneError> {
    let numbers = value::numbers(text, "matrix", location)?;
    match numbers.len() {
        9 => {
            let rows: [f64; 9] = numbers.try_into().expect("there are nine");
            Ok(DMat4::from_mat3(DMat3::from_cols_array(&rows).transpose()))
        }
        16 => {
            let rows: [f64; 16] = numbers.try_into().expect("there are sixteen");
            let matrix = DMat4::from_cols_array(&rows).transpose();
            if matrix.row(3) != DVec4::W {
                let found = matrix.row(3).to_string();
                return Err(SceneError::value(
                    location,
                    "the last row of the matrix",
                    found,
                    "0 0 0 1",
                ));
            }
            Ok(matrix)
        }
        count => Err(SceneError::value(
            location,
            "matrix",
            format!("{count} numbers"),
            "9 or 16 numbers",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn here() -> Location {
        Location { file: Path::new("scene.xml").into(), line: 1, column: 1 }
    }

    fn matrix(step: Step, attributes: &[(&str, &str)]) -> Result<DMat4, SceneError> {
        let find =
            |name: &str| attributes.iter().find(|(known, _)| *known == name).map(|(_, text)| *text);
        step.matrix(find, &here())
    }

    #[test]
    fn a_rotation_turns_counter_clockwise_by_degrees() {
        let turn = matrix(Step::Rotate, &[("z", "2"), ("angle", "90")]).unwrap();
        assert!((turn.transform_vector3(DVec3::X) - DVec3::Y).length() < 1e-15);
        assert!(matrix(Step::Rotate, &[("angle", "90")]).is_err());
    }

    #[test]
    fn a_scale_left_out_is_one_and_a_translation_left_out_is_zero() {
        let scale = matrix(Step::Scale, &[("y", "3")]).unwrap();
        assert_eq!(scale.transform_vector3(DVec3::ONE), DVec3::new(1.0, 3.0, 1.0));
        assert_eq!(
            matrix(Step::Scale, &[("value", "2")]).unwrap(),
            DMat4::from_scale(DVec3::splat(2.0))
        );
        let translate = matrix(Step::Translate, &[("value", "1, 2, 3")]).unwrap();
        assert_eq!(translate.transform_point3(DVec3::ZERO), DVec3::new(1.0, 2.0, 3.0));
        assert!(matrix(Step::Scale, &[("value", "2"), ("x", "1")]).is_err());
        assert!(matrix(Step::Scale, &[("value", "2 3")]).is_err());
    }

    #[test]
    fn look_at_looks_along_z_with_x_to_the_left() {
        let attributes = [("origin", "0 0 4"), ("target", "0 0 0"), ("up", "0 1 0")];
        let look = matrix(Step::LookAt, &attributes).unwrap();
        assert_eq!(look.transform_point3(DVec3::ZERO), DVec3::new(0.0, 0.0, 4.0));
        assert_eq!(look.transform_vector3(DVec3::Z), -DVec3::Z);
        assert_eq!(look.transform_vector3(DVec3::Y), DVec3::Y);
        // Looking along -z with y up, the left hand points to -x.
        assert_eq!(look.transform_vector3(DVec3::X), -DVec3::X);
        assert!(matrix(Step::LookAt, &[("origin", "1 1 1"), ("target", "1 1 1")]).is_err());
        assert!(
            matrix(Step::LookAt, &[("origin", "0 0 0"), ("target", "0 0 2"), ("up", "0 0 1")])
                .is_err()
        );
        assert!(matrix(Step::LookAt, &[("origin", "0 0 0"), ("target", "0 0 2")]).is_ok());
    }

    #[test]
    fn a_matrix_is_written_row_by_row() {
        let rows = "1 2 3 10 4 5 6 20 7 8 0 30 0 0 0 1";
        let full = matrix(Step::Matrix, &[("value", rows)]).unwrap();
        assert_eq!(full.transform_point3(DVec3::X), DVec3::new(11.0, 24.0, 37.0));
        let small = matrix(Step::Matrix, &[("value", "1 2 3 4 5 6 7 8 0")]).unwrap();
        assert_eq!(small.transform_point3(DVec3::X), DVec3::new(1.0, 4.0, 7.0));
        assert!(matrix(Step::Matrix, &[("value", "1 2 3")]).is_err());
        assert!(matrix(Step::Matrix, &[("value", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0")]).is_err());
    }
}
