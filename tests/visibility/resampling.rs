//! The first pass alone.

use super::{assert_same, by_exchange, by_path_tracing, luminance, rendered, replicas};
use crate::support::mean::Mean;
use crate::support::scenes::scene_around;
use crate::support::{LEVEL, sidak};
use quietlight::integrator::correlated_visibility::CorrelatedVisibility;
use quietlight::scene::Scene;

/// A Lambertian floor of reflectance 0.6 filling the picture.
fn floor(light: &str) -> Scene {
    scene_around(
        4,
        20.0,
        2,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-1"/></transform>
            <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>{light}"#
        ),
    )
}

#[test]
fn resampling_finds_the_albedo_in_constant_light_for_any_number_of_candidates() {
    let scene = floor(r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#);
    let mut variances = Vec::new();
    for [candidates, shadow_rays] in [[1, 1], [4, 1], [16, 4], [64, 16]] {
        let settings =
            CorrelatedVisibility { candidates, shadow_rays, mutations: 0, ..Default::default() };
        let hits = 64;
        let mut mean = Mean::default();
        for seed in 0..64 {
            let half = rendered(&scene, settings, seed, hits);
            mean.extend(half.sums().iter().map(|sums| luminance(sums) / f64::from(hits)));
            let most = u64::from(shadow_rays * hits) * 16;
            // Half of the light's candidates are below the horizon, a quarter of all: only with one is there often no ray.
            let fewest = if candidates == 1 { most * 5 / 8 } else { most / 2 };
            let rays = half.ledger().shadow_rays;
            assert!((fewest..=most).contains(&rays), "{rays} shadow rays, {fewest} to {most}");
            for sums in half.sums() {
                assert_eq!(sums.seen.visible, f64::from(sums.seen.of));
                assert_eq!(sums.seen.of % shadow_rays, 0);
            }
        }
        let p = mean.p_against(0.6);
        assert!(p > sidak(LEVEL, 4), "{candidates} candidates: {} p {p:.2e}", mean.mean());
        variances.push(mean.variance());
    }
    assert!(variances.is_sorted_by(|a, b| a > b), "{variances:?}");
}

#[test]
fn unoccluded_light_is_that_of_path_tracing_with_less_noise() {
    // Nothing is in the way: with as many shadow rays (32 samples of one, and one walk into the light, against 4 of 4 out of 64
    // candidates) resampling has the same mean.
    let scene = floor(
        r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><translate x="1" z="1"/></transform>
        <emitter type="area"><rgb name="radiance" value="6 5 4"/></emitter></shape>
        <shape type="sphere"><point name="center" x="-2" y="1" z="0.5"/><float name="radius" value="0.3"/>
        <emitter type="area"><rgb name="radiance" value="3 6 9"/></emitter></shape>"#,
    );
    let settings = CorrelatedVisibility { candidates: 64, mutations: 0, ..Default::default() };
    let resampled = replicas(64, |seed| by_exchange(&scene, settings, 4, seed, 1));
    let traced = replicas(64, |seed| by_path_tracing(&scene, 16, seed, 1));
    assert_same("unoccluded", &resampled, &traced);
    let variance = |means: &[Vec<Mean>; 3]| means[0].iter().map(Mean::variance).sum::<f64>();
    let (ours, theirs) = (variance(&resampled), variance(&traced));
    assert!(ours < theirs, "{ours:.2e} {theirs:.2e}");
}
