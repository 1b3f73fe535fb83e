//! The transfer curve of sRGB (IEC 61966-2-1): linear light to display values and back.

/// Display value in `[0, 1]` of linear light, which is clamped to `[0, 1]` first; NaN becomes 0.
pub fn encode(linear: f32) -> f32 {
    encode_f64(f64::from(linear)) as f32
}

/// Linear light of a display value.
pub fn decode(display: f32) -> f32 {
    decode_f64(f64::from(display)) as f32
}

/// [`encode`] in double precision, for the metrics.
pub(crate) fn encode_f64(linear: f64) -> f64 {
    // `max` takes the number where the other side is NaN; `clamp` would keep NaN.
    let linear = linear.max(0.0);
    let linear = if linear > 1.0 { 1.0 } else { linear };
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

fn decode_f64(display: f64) -> f64 {
    if display <= 0.040_45 { display / 12.92 } else { ((display + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_and_its_inverse_undo_each_other() {
        for byte in 0..=255 {
            let display = byte as f32 / 255.0;
            assert!((encode(decode(display)) - display).abs() < 1e-6, "{byte}");
        }
        // Middle grey of the standard: 18 % of the light shows as 46 %.
        assert!((encode(0.18) - 0.461_356).abs() < 1e-5);
    }

    #[test]
    fn light_out_of_range_is_clamped() {
        assert_eq!(
            [encode(-1.0), encode(2.0), encode(f32::INFINITY), encode(f32::NAN)],
            [0.0, 1.0, 1.0, 0.0]
        );
    }
}
