//! Variances and halves.

use super::*;

/// Renders of the same small film with different seeds; of four samples a pixel, so that n − 1 is far from n.
fn replicas(sampler: SamplerKind) -> Vec<Rendered> {
    // No wider than the window over which variances are compared with halves, so that the window is the film.
    let scene = still_life(11);
    (0..256)
        .map(|seed| render_finite(&scene, &RenderSettings { sampler, ..settings(4, seed, Mis) }))
        .collect()
}

/// For each replica the sum over pixels and channels of `difference(pixel's deviations, index, replica)`, where
/// deviations are those of the halves A and B from their means over all replicas.
fn over_replicas(
    replicas: &[Rendered],
    kind: LayerKind,
    each: impl Fn(f64, f64, f64) -> f64,
) -> Mean {
    let count = replicas.len() as f64;
    let halves =
        |r: &Rendered| r.layers.layers[&kind].halves.clone().expect("the film gives halves");
    let all: Vec<_> = replicas.iter().map(halves).collect();
    let zero = ndarray::Array3::<f64>::zeros(all[0][0].dim());
    let means = [0, 1].map(|half| {
        all.iter().fold(zero.clone(), |sum, halves| sum + halves[half].mapv(f64::from)) / count
    });
    replicas
        .iter()
        .zip(&all)
        .map(|(rendered, halves)| {
            let variance = layer(rendered, kind).1;
            let deviation = |half: usize, at| f64::from(halves[half][at]) - means[half][at];
            ndarray::indices(variance.dim())
                .into_iter()
                .map(|(c, y, x)| {
                    let at = [c, y, x];
                    each(deviation(0, at), deviation(1, at), f64::from(variance[at]))
                })
                .sum()
        })
        .collect()
}

#[test]
fn the_reported_variance_is_that_of_the_mean() {
    // Over R replicas Σ (x − x̄)² R / (R − 1) − Σ σ² has the expectation 0; the sums over a picture are nearly normal.
    for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
        let replicas = replicas(sampler);
        let unbiased = replicas.len() as f64 / (replicas.len() - 1) as f64;
        for kind in [
            LayerKind::Beauty,
            LayerKind::Diffuse,
            LayerKind::Specular,
            LayerKind::Albedo,
            LayerKind::Visibility,
        ] {
            let squared = |a: f64, b: f64| 0.25 * (a + b) * (a + b) * unbiased;
            let difference =
                over_replicas(&replicas, kind, |a, b, variance| squared(a, b) - variance);
            let found = over_replicas(&replicas, kind, |a, b, _| squared(a, b)).mean();
            let what = format!("{sampler:?} {kind:?}");
            let error = difference.variance_of_mean().sqrt() / found;
            assert!(error < 0.1, "{what}: an error of {error:.3} of the variance sees nothing");
            let p = difference.p_against(0.0);
            assert!(
                p > LEVEL,
                "{what}: {:.3} of the variance too little, p {p:.1e}",
                difference.mean() / found
            );
        }
    }
}

#[test]
fn stratified_samples_have_less_variance_and_say_so() {
    // Direct light of a large emitter on a floor: two smooth integrals over two numbers each.
    let scene = scene_around(
        11,
        40.0,
        2,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-2"/></transform>
        <bsdf type="diffuse"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><scale value="2"/>
        <translate x="1" z="1"/></transform><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>"#,
    );
    let sum = |sampler| -> f64 {
        let rendered = render_finite(&scene, &RenderSettings { sampler, ..settings(64, 14, Mis) });
        layer(&rendered, LayerKind::Diffuse).1.iter().map(|&value| f64::from(value)).sum()
    };
    // Points of a (0, 2)-sequence integrate it at n^-3 instead of n^-1; at half of 64 that is far more than the half.
    let (sobol, independent) = (sum(SamplerKind::Sobol), sum(SamplerKind::Independent));
    assert!(sobol < 0.5 * independent, "{sobol} and {independent}");
}

#[test]
fn halves_are_independent_and_average_to_the_mean() {
    for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
        let replicas = replicas(sampler);
        for kind in [LayerKind::Beauty, LayerKind::Visibility, LayerKind::Albedo] {
            for rendered in &replicas[..4] {
                let layer = &rendered.layers.layers[&kind];
                let [a, b] = layer.halves.as_ref().expect("the film gives halves");
                for ((&mean, &a), &b) in layer.mean.iter().zip(a).zip(b) {
                    // Each is rounded once; of the sums the larger half bounds the rounding.
                    assert!(
                        (0.5 * (a + b) - mean).abs() <= 4e-7 * a.abs().max(b.abs()),
                        "{a} {b} {mean}"
                    );
                }
            }
            let covariance = over_replicas(&replicas, kind, |a, b, _| a * b);
            let variance = over_replicas(&replicas, kind, |a, b, _| 0.5 * (a * a + b * b)).mean();
            let what = format!("{sampler:?} {kind:?}");
            let error = covariance.variance_of_mean().sqrt() / variance;
            assert!(error < 0.1, "{what}: an error of {error:.3} of the variance sees nothing");
            let p = covariance.p_against(0.0);
            assert!(
                p > LEVEL,
                "{what}: correlation {:.3}, p {p:.1e}",
                covariance.mean() / variance
            );
        }
    }
}
