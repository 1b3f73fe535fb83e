//! Chains at their extremes.

use super::*;

#[test]
fn chains_that_cannot_move_have_the_mean_of_their_seeds_and_tell() {
    let scene = room(5, GREY);
    let expected = by_path(&scene, 64);
    let mutations =
        Mutations { bidirectional: false, lens: false, caustic: false, multi_chain: false };
    let mlt = Mlt { mutations, bootstrap_pairs: 1000, separate_direct: false };
    let found = replicas(&scene, Integrator::Mlt(mlt), 2 * REPLICAS, 16);
    assert_same_mean(&found, &expected, "stuck mlt");
    // 64 chains of 36 mutations for 144 pixels.
    let told = rendered(&scene, Integrator::Mlt(mlt), 16, 1);
    assert_eq!(fact(&told, "chains"), "64 of 36 mutations");
    assert_eq!(fact(&told, "longest_stay"), "36 mutations");
    let erpt = Erpt { mutations, ..Erpt::default() };
    let found = replicas(&scene, Integrator::Erpt(erpt), REPLICAS, 16);
    assert_same_mean(&found, &expected, "stuck erpt");
}

#[test]
fn chains_of_one_mutation_that_share_a_few_seeds_are_right_on_average() {
    let mut scene = room(4, GREY);
    scene.film.crop = [2, 4, 8, 8];
    let expected = by_path(&scene, 64);
    // 64 chains of one mutation each, from eight pairs of walks a half. The means of such small pools are far from normal,
    // but 500 of them are not.
    let few = Mlt { bootstrap_pairs: 16, separate_direct: false, ..Mlt::default() };
    let one = rendered(&scene, Integrator::Mlt(few), 1, 3);
    assert_eq!(fact(&one, "chains"), "64 of 1 mutations");
    let found = replicas(&scene, Integrator::Mlt(few), 500, 1);
    assert_same_mean(&found, &expected, "mlt");
    let few = Pssmlt { bootstrap_samples: 16, ..Pssmlt::default() };
    let found = replicas(&scene, Integrator::Pssmlt(few), 500, 1);
    assert_same_mean(&found, &expected, "pssmlt");
}

#[test]
fn two_seeds_of_mlt_agree_within_the_errors_that_they_tell() {
    let scene = room(5, r#"<bsdf type="plastic"/>"#);
    let mlt = Mlt { bootstrap_pairs: 20_000, separate_direct: false, ..Mlt::default() };
    let [a, b] = [1, 2].map(|seed| rendered(&scene, Integrator::Mlt(mlt), 500, seed));
    // The mean luminance is the normalisation, to rounding: that is all the error that it has.
    let [of_a, of_b] = [&a, &b].map(|rendered| {
        let (mean, error) = fact(rendered, "normalisation").split_once(" ± ").expect("an error");
        let (mean, error): (f64, f64) = (mean.parse().expect("b"), error.parse().expect("error"));
        let found = luminance(rendered);
        assert!((found / mean - 1.0).abs() < 1e-5, "{found}, normalisation {mean}");
        assert!(error > 0.0 && error < 0.03 * mean, "{mean} ± {error}");
        (mean, error)
    });
    // Two-sided 10⁻⁴.
    let z = (of_a.0 - of_b.0) / of_a.1.hypot(of_b.1);
    assert!(z.abs() < 3.9, "{of_a:?} and {of_b:?}");
    // Pixel by pixel, by the variances of the layers: they depend on each other, which counts as a quarter of them.
    let ((mean_a, variance_a), (mean_b, variance_b)) =
        (layer(&a, LayerKind::Beauty), layer(&b, LayerKind::Beauty));
    let (mut squares, mut count) = (0.0, 0.0);
    for (at, a) in mean_a.indexed_iter() {
        let variance = f64::from(variance_a[at]) + f64::from(variance_b[at]);
        if variance > 0.0 {
            squares += f64::from(a - mean_b[at]).powi(2) / variance;
            count += 1.0;
        }
    }
    let (mean_square, pixels) = (squares / count, count / 3.0);
    let bound = 1.0 + 4.0 * (2.0 / (pixels / 4.0)).sqrt();
    assert!(mean_square < bound, "mean z² {mean_square:.2} of {pixels} pixels, bound {bound:.2}");
}
