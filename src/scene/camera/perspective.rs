//! What a scene file says of a perspective camera.

use glam::{DMat4, DVec2};
use thiserror::Error;

/// Which side of the film the field of view is measured along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FovAxis {
    /// The horizontal side.
    #[default]
    X,
    /// The vertical side.
    Y,
    /// The diagonal.
    Diagonal,
    /// The shorter side.
    Smaller,
    /// The longer side.
    Larger,
}

/// What a scene file says of a perspective camera. The default is Mitsuba's, with a field of view of 45° and a film of
/// 768 × 576 pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Perspective {
    /// Camera space to world space; its linear part is a rotation, which may mirror. In double precision and
    /// already without [`Scene::origin`](crate::scene::Scene::origin).
    pub to_world: DMat4,
    /// Field of view in degrees, between 0 and 180.
    pub fov: f64,
    /// Where the field of view is measured.
    pub fov_axis: FovAxis,
    /// Pixels across and down the whole film.
    pub film: [u32; 2],
    /// Where the optical axis meets the film, relative to its centre, as a share of the film's width and height; the
    /// image moves left and up as these grow, as in Mitsuba.
    pub principal_point_offset: DVec2,
    /// Nothing nearer than this along the optical axis is seen.
    pub near_clip: f64,
    /// Nothing farther than this along the optical axis is seen.
    pub far_clip: f64,
    /// Radius of the lens; 0 is a pinhole.
    pub aperture_radius: f64,
    /// Distance along the optical axis of what a lens shows sharply.
    pub focus_distance: f64,
}

impl Default for Perspective {
    fn default() -> Self {
        Self {
            to_world: DMat4::IDENTITY,
            fov: 45.0,
            fov_axis: FovAxis::X,
            film: [768, 576],
            principal_point_offset: DVec2::ZERO,
            near_clip: 1e-2,
            far_clip: 1e4,
            aperture_radius: 0.0,
            focus_distance: 1.0,
        }
    }
}

/// Why a camera cannot be made.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum CameraError {
    /// A number is outside its range.
    #[error("{name} is {found}, expected {expected}")]
    Range {
        /// The parameter, by its name in scene files.
        name: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The transform scales or shears.
    #[error(
        "a camera may be rotated, mirrored and moved, but not scaled: its to_world has axes {axes:?}"
    )]
    Transform {
        /// The first three columns of the matrix.
        axes: [[f64; 3]; 3],
    },
}

impl Perspective {
    /// Are all parameters in their ranges?
    pub(super) fn check(&self) -> Result<(), CameraError> {
        let require = |is_right: bool, name, found, expected| {
            if is_right { Ok(()) } else { Err(CameraError::Range { name, found, expected }) }
        };
        let [width, height] = self.film.map(f64::from);
        require(width > 0.0, "width", width, "at least one pixel")?;
        require(height > 0.0, "height", height, "at least one pixel")?;
        require(
            self.fov > 0.0 && self.fov < 180.0,
            "fov",
            self.fov,
            "an angle between 0 and 180 degrees",
        )?;
        let DVec2 { x, y } = self.principal_point_offset;
        require(x.is_finite(), "principal_point_offset_x", x, "a finite number")?;
        require(y.is_finite(), "principal_point_offset_y", y, "a finite number")?;
        let near = self.near_clip;
        require(near >= 0.0 && near.is_finite(), "near_clip", near, "zero or a positive distance")?;
        require(self.far_clip > near, "far_clip", self.far_clip, "a distance beyond near_clip")?;
        let (radius, focus) = (self.aperture_radius, self.focus_distance);
        require(
            radius >= 0.0 && radius.is_finite(),
            "aperture_radius",
            radius,
            "zero or a positive length",
        )?;
        let is_focused = radius == 0.0 || (focus > 0.0 && focus.is_finite());
        require(is_focused, "focus_distance", focus, "a positive distance")?;
        let center = self.to_world.w_axis.truncate();
        require(center.is_finite(), "to_world", center.length(), "a finite position")
    }

    /// Half-width and half-height of the film at distance 1.
    pub(super) fn half_size(&self) -> DVec2 {
        let [width, height] = self.film.map(f64::from);
        let tangent = (0.5 * self.fov.to_radians()).tan();
        // The size of the film in units of the side that the field of view is measured along.
        let side = match self.fov_axis {
            FovAxis::X => width,
            FovAxis::Y => height,
            FovAxis::Diagonal => width.hypot(height),
            FovAxis::Smaller => width.min(height),
            FovAxis::Larger => width.max(height),
        };
        DVec2::new(width, height) * (tangent / side)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;
    use glam::DVec3;

    #[test]
    fn parameters_out_of_range_are_named() {
        let name = |parameters: Perspective| match Camera::perspective(&parameters) {
            Err(CameraError::Range { name, .. }) => name,
            Err(CameraError::Transform { .. }) => "transform",
            Ok(_) => "accepted",
        };
        assert_eq!(name(Perspective { fov: 180.0, ..Perspective::default() }), "fov");
        assert_eq!(name(Perspective { fov: f64::NAN, ..Perspective::default() }), "fov");
        assert_eq!(name(Perspective { film: [0, 1], ..Perspective::default() }), "width");
        assert_eq!(name(Perspective { near_clip: -1.0, ..Perspective::default() }), "near_clip");
        assert_eq!(name(Perspective { far_clip: 0.001, ..Perspective::default() }), "far_clip");
        assert_eq!(
            name(Perspective {
                aperture_radius: 1.0,
                focus_distance: 0.0,
                ..Perspective::default()
            }),
            "focus_distance"
        );
        assert_eq!(
            name(Perspective {
                to_world: DMat4::from_scale(DVec3::splat(2.0)),
                ..Perspective::default()
            }),
            "transform"
        );
        assert_eq!(
            name(Perspective {
                to_world: DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
                ..Perspective::default()
            }),
            "accepted"
        );
    }
}
