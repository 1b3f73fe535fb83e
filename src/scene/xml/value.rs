//! Numbers, vectors and colours as text.

use crate::scene::error::{Location, SceneError};
use glam::DVec3;

/// Numbers with spaces and commas between them, all finite.
///
/// # Errors
/// [`SceneError::Value`] that names the first thing that is no finite number.
pub(super) fn numbers(text: &str, what: &str, location: &Location) -> Result<Vec<f64>, SceneError> {
    text.split(|letter: char| letter == ',' || letter.is_whitespace())
        .filter(|word| !word.is_empty())
        .map(|word| number(word, what, location))
        .collect()
}

/// One finite number.
///
/// # Errors
/// [`SceneError::Value`] when it is not.
pub(super) fn number(text: &str, what: &str, location: &Location) -> Result<f64, SceneError> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(SceneError::value(location, what, format!("\"{text}\""), "a finite number")),
    }
}

/// Exactly three numbers.
///
/// # Errors
/// [`SceneError::Value`] for another count, or for what is no number.
pub(super) fn triple(text: &str, what: &str, location: &Location) -> Result<DVec3, SceneError> {
    match numbers(text, what, location)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(SceneError::value(location, what, format!("\"{text}\""), "three numbers")),
    }
}

/// `true` or `false`, in any case.
///
/// # Errors
/// [`SceneError::Value`] for anything else.
pub(super) fn boolean(text: &str, what: &str, location: &Location) -> Result<bool, SceneError> {
    match text.trim().to_ascii_lowercase().as_str() {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err(SceneError::value(location, what, format!("\"{text}\""), "true or false")),
    }
}

/// A whole number.
///
/// # Errors
/// [`SceneError::Value`] for anything else.
pub(super) fn integer(text: &str, what: &str, location: &Location) -> Result<i64, SceneError> {
    let parsed = text.trim().parse();
    parsed.map_err(|_| SceneError::value(location, what, format!("\"{text}\""), "a whole number"))
}

/// Linear Rec. 709 from an `<rgb>` (linear), an `<srgb>` (encoded), or `#rrggbb`: one number is grey.
///
/// `#rrggbb` is taken as encoded in both, as it is in every paint program; Mitsuba 0.6 took it as linear in `<rgb>`, and
/// Mitsuba 3 knows no such form.
///
/// # Errors
/// [`SceneError::Value`] when the text is none of these.
pub(super) fn color(
    text: &str,
    encoding: Encoding,
    what: &str,
    location: &Location,
) -> Result<DVec3, SceneError> {
    if let Some(digits) = text.trim().strip_prefix('#') {
        let wrong = || SceneError::value(location, what, format!("\"{text}\""), "#rrggbb");
        if digits.len() != 6 || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return Err(wrong());
        }
        let packed = u32::from_str_radix(digits, 16).map_err(|_| wrong())?;
        let channel = |shift: u32| decode_srgb(f64::from((packed >> shift) & 0xff) / 255.0);
        return Ok(DVec3::new(channel(16), channel(8), channel(0)));
    }
    let color = match numbers(text, what, location)?[..] {
        [grey] => DVec3::splat(grey),
        [r, g, b] => DVec3::new(r, g, b),
        _ => {
            return Err(SceneError::value(
                location,
                what,
                format!("\"{text}\""),
                "one or three numbers, or #rrggbb",
            ));
        }
    };
    Ok(match encoding {
        Encoding::Linear => color,
        Encoding::Srgb => {
            DVec3::new(decode_srgb(color.x), decode_srgb(color.y), decode_srgb(color.z))
        }
    })
}

/// How colour values stand for light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Proportional to it.
    Linear,
    /// By the sRGB transfer curve (IEC 61966-2-1).
    Srgb,
}

/// Encoded to linear, IEC 61966-2-1.
fn decode_srgb(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn here() -> Location {
        Location { file: Path::new("scene.xml").into(), line: 4, column: 2 }
    }

    #[test]
    fn numbers_are_separated_by_spaces_commas_or_both() {
        assert_eq!(
            numbers(" 1,2 , 3\t-4.5e-008\n", "n", &here()).unwrap(),
            [1.0, 2.0, 3.0, -4.5e-8]
        );
        assert_eq!(numbers("  ", "n", &here()).unwrap(), [0.0; 0]);
    }

    #[test]
    fn what_is_no_finite_number_is_told_with_its_place() {
        for text in ["nan", "inf", "-infinity", "1e999", "1.5f", "one", "1..2", "0x10", "--1"] {
            let error = numbers(text, "alpha", &here()).unwrap_err().to_string();
            assert!(
                error.starts_with("scene.xml:4:2: alpha is ") && error.contains(text),
                "{error}"
            );
        }
    }

    #[test]
    fn colors_have_one_or_three_values_or_are_hexadecimal() {
        let linear = |text| color(text, Encoding::Linear, "c", &here());
        assert_eq!(linear("0.25").unwrap(), DVec3::splat(0.25));
        assert_eq!(linear("1, 2 3").unwrap(), DVec3::new(1.0, 2.0, 3.0));
        // 0x80 / 255 = 0.50196 decodes to 0.215861 (IEC 61966-2-1).
        let hexadecimal = linear("#ff8000").unwrap();
        assert!((hexadecimal - DVec3::new(1.0, 0.215_861, 0.0)).length() < 1e-6, "{hexadecimal}");
        let encoded = color("0.5 0.02 1", Encoding::Srgb, "c", &here()).unwrap();
        assert!((encoded - DVec3::new(0.214_041, 0.02 / 12.92, 1.0)).length() < 1e-6, "{encoded}");
        for text in ["1 2", "", "1 2 3 4", "#12345", "#12345g", "#é1234", "red"] {
            assert!(linear(text).is_err(), "{text}");
        }
    }

    #[test]
    fn booleans_and_integers_are_strict() {
        assert!(boolean(" True", "b", &here()).unwrap());
        assert!(boolean("1", "b", &here()).is_err());
        assert_eq!(integer("-7 ", "i", &here()).unwrap(), -7);
        assert!(integer("1.5", "i", &here()).is_err());
        assert!(integer("99999999999999999999", "i", &here()).is_err());
    }
}
