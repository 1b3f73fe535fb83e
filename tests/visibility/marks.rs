//! Which pixels exchange energy, and what that does to the mean.

use super::{luminance, penumbra, rendered};
use crate::support::mean::Mean;
use crate::support::{LEVEL, sidak};
use quietlight::integrator::correlated_visibility::{CorrelatedVisibility, MarkSource};

/// Columns of the penumbra scene's picture, as x on the floor.
fn column_range(column: usize) -> [f64; 2] {
    let half = 4.0 * 30f64.to_radians().tan();
    [column, column + 1].map(|edge| (edge as f64 / 12.0 - 1.0) * half)
}

#[test]
fn only_pixels_of_the_penumbra_are_marked_and_all_of_them_with_many_shadow_rays() {
    let scene = penumbra("");
    let mut shares = Vec::new();
    for shadow_rays in [1, 2, 4, 16] {
        let settings = CorrelatedVisibility {
            shadow_rays,
            candidates: 8 * shadow_rays,
            dilation: 0,
            pilot_hits: 2,
            ..Default::default()
        };
        let half = rendered(&scene, settings, 7, 1);
        let marks = half.marks().expect("there was a pilot");
        let (mut marked, mut inside) = (0, 0);
        for pixel in 0..24 * 24 {
            let [low, high] = column_range(pixel % 24);
            if low > 1.0 || high < -1.0 {
                assert_eq!(marks.slot(pixel), None, "column {} is not in the penumbra", pixel % 24);
            } else if low > -0.8 && high < 0.8 {
                inside += 1;
                marked += usize::from(marks.slot(pixel).is_some());
            }
        }
        shares.push(marked as f64 / inside as f64);
    }
    assert!(shares.is_sorted_by(|a, b| a < b) && shares[3] > 0.97, "{shares:.3?}");
}

#[test]
fn a_mirror_is_marked_for_what_is_seen_in_it() {
    // The left half of the picture is a mirror on the floor, in which the half plane is seen. The side of it that is seen has
    // no light at all, so that there is nothing to exchange (METHODS 7.5), though the lamp is half covered above the mirror.
    let scene = penumbra(
        r#"<shape type="rectangle"><transform name="to_world"><scale x="10" y="10"/><translate x="-9.9" z="-3.9"/></transform>
        <bsdf type="conductor"/></shape>"#,
    );
    let settings =
        CorrelatedVisibility { shadow_rays: 16, candidates: 64, dilation: 0, ..Default::default() };
    let half = rendered(&scene, settings, 5, 1);
    let marks = half.marks().expect("there was a pilot");
    for pixel in 0..24 * 24 {
        // Columns of the mirror's plane: its edge x = 0.1 at 3.9 is in column 12.
        if pixel % 24 < 12 {
            assert_eq!(marks.slot(pixel), None, "column {}", pixel % 24);
        }
    }
    assert!(!marks.is_empty());
}

#[test]
fn marks_of_the_same_samples_are_biased_the_less_the_more_shadow_rays() {
    // In the penumbra, with a part v of the lamp visible, N samples mark a pixel with P = 1 - vᴺ - (1 - v)ᴺ, and what is seen
    // from the dark side is seen from the lit side, too. So of two pixels v < w the darker one gives
    // P(w) (v - vᴺ) and gets P(v) (w - wᴺ) v/w: the difference is v w (w - v) for N = 2, and positive for all N. Same marks
    // move light from the dark side (columns 0 to 11) to the lit one; where mixing is complete, by v (1 - v) (2v - 1) of the
    // full light for N = 2, 0.1 at most. The sum over the five columns of the penumbra is then near 0.3 of a lit pixel, a
    // half or a third of that after a step or two, and less than half of it for N = 8.
    let mut scene = penumbra("");
    scene.film.crop = [5, 0, 14, 24];
    let of = |shadow_rays: u32, marks, mutations, first: u64| -> Mean {
        let settings = CorrelatedVisibility {
            shadow_rays,
            candidates: 8 * shadow_rays,
            dilation: 0,
            marks,
            pilot_hits: 1,
            mutations,
            ..Default::default()
        };
        let tilt = |seed| {
            let half = rendered(&scene, settings, first + seed, 1);
            let side = |pixel: usize| if pixel % 14 < 7 { -1.0 } else { 1.0 };
            let pixels = half.sums().iter().enumerate();
            pixels.map(|(pixel, sums)| side(pixel) * luminance(sums)).sum::<f64>()
        };
        (0..600).map(tilt).collect()
    };
    let mut biases = Vec::new();
    for (shadow_rays, first) in [(2, 10_000), (8, 20_000)] {
        let plain = of(shadow_rays, MarkSource::Pilot, 0, first);
        let pilot = of(shadow_rays, MarkSource::Pilot, 8 * shadow_rays, first + 1000);
        let same = of(shadow_rays, MarkSource::Same, 8 * shadow_rays, first + 2000);
        let p = pilot.p_same_as(&plain);
        assert!(p > sidak(LEVEL, 2), "pilot marks with {shadow_rays} shadow rays: p {p:.2e}");
        let variance = same.variance_of_mean() + plain.variance_of_mean();
        biases.push((same.mean() - plain.mean(), variance));
    }
    let [(two, two_variance), (eight, eight_variance)] = biases[..] else { unreachable!() };
    // 3.72 of a normal number is its one-sided level of 10⁻⁴.
    assert!(two > 3.72 * two_variance.sqrt(), "no bias seen: {biases:?}");
    assert!(two - eight > 3.72 * (two_variance + eight_variance).sqrt(), "{biases:?}");
}
