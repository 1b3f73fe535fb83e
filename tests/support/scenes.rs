//! Scenes written in the test, rendered in memory.

use ndarray::Axis;
use quietlight::integrator::{PathTracing, Strategy};
use quietlight::render::{Budget, RenderSettings, Rendered, SamplerKind, render};
use quietlight::scene::{LoadOptions, Scene};
use quietlight_denoise::{Image, LayerKind};
use std::sync::atomic::AtomicBool;

/// Wraps the inside of a scene: a camera at the origin looking along −z with the given field of view and square film,
/// and paths of at most `max_depth` edges (−1: no limit).
pub(crate) fn scene_around(size: u32, fov: f32, max_depth: i32, inside: &str) -> Scene {
    scene_from(&format!(
        r#"<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="{max_depth}"/></integrator>
        <sensor type="perspective"><float name="fov" value="{fov}"/>
            <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="{size}"/><integer name="height" value="{size}"/>
                <rfilter type="box"/></film>
        </sensor>
        {inside}
        </scene>"#
    ))
}

/// Loads a scene given as text.
pub(crate) fn scene_from(text: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("scene.xml");
    std::fs::write(&file, text).expect("the scene is written");
    Scene::load(&file, &LoadOptions::default()).expect("the scene loads")
}

/// A small scene of a square film and paths of at most `max_depth` edges (−1: no limit), whose lengths are all multiplied by `scale`, moved by `offset` along x. A camera may not be scaled, so
/// that its transform and its clipping planes are.
pub(crate) fn scaled(size: u32, max_depth: i32, scale: f64, offset: f64) -> Scene {
    let (up, back, near, far) = (scale, 5.0 * scale, 0.01 * scale, 1e4 * scale);
    scene_from(&format!(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{max_depth}"/></integrator>
        <sensor type="perspective"><float name="fov" value="50"/>
            <float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>
            <transform name="to_world"><lookat origin="{offset},{up},{back}" target="{offset},0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="{size}"/><integer name="height" value="{size}"/>
                <rfilter type="box"/></film></sensor>
        <shape type="sphere"><transform name="to_world"><scale value="{scale}"/><translate x="{offset}"/></transform>
            <bsdf type="roughplastic"/></shape>
        <shape type="cube"><transform name="to_world"><translate x="1.5" z="-2"/><scale value="{scale}"/>
            <translate x="{offset}"/></transform><bsdf type="dielectric"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/>
            <translate y="-1"/><scale value="{scale}"/><translate x="{offset}"/></transform></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/>
            <scale value="{scale}"/><translate x="{offset}"/></transform>
            <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
        </scene>"#
    ))
}

/// Settings of a test render.
pub(crate) fn settings(samples: u32, seed: u64, strategy: Strategy) -> RenderSettings {
    RenderSettings {
        budget: Budget::Samples(samples),
        seed,
        sampler: SamplerKind::Independent,
        integrator: PathTracing { strategy, ..PathTracing::default() }.into(),
        ..RenderSettings::default()
    }
}

/// Renders; a non-finite sample fails the test.
pub(crate) fn render_finite(scene: &Scene, settings: &RenderSettings) -> Rendered {
    let rendered = render(scene, settings, &|_| {}, &AtomicBool::new(false));
    assert_eq!(rendered.invalid_samples, 0, "non-finite samples");
    rendered
}

/// Mean of one layer and its variance.
pub(crate) fn layer(rendered: &Rendered, kind: LayerKind) -> (&Image, &Image) {
    let layer = &rendered.layers.layers[&kind];
    (&layer.mean, layer.variance.as_ref().expect("the film gives variances"))
}

/// Mean over pixels and channels of the beauty, and the standard error of that mean.
pub(crate) fn mean_and_error(rendered: &Rendered) -> (f64, f64) {
    mean_and_error_of(LayerKind::Beauty, rendered)
}

/// Mean over pixels and channels of a layer, and the standard error of that mean.
pub(crate) fn mean_and_error_of(kind: LayerKind, rendered: &Rendered) -> (f64, f64) {
    let (mean, variance) = layer(rendered, kind);
    let n = mean.len() as f64;
    let total: f64 = mean.iter().map(|&value| f64::from(value)).sum();
    // The channels of a pixel share their randomness: their errors add up, not their variances.
    let error: f64 = variance
        .map_axis(Axis(0), |pixel| {
            pixel.iter().map(|&value| f64::from(value).sqrt()).sum::<f64>().powi(2)
        })
        .sum();
    (total / n, error.sqrt() / n)
}

/// Asserts that a mean with its standard error agrees with the truth: |z| < 4.4 (two-sided 10⁻⁵) and an error that can
/// see a difference of `resolution`, relative.
pub(crate) fn assert_mean((mean, error): (f64, f64), truth: f64, resolution: f64, what: &str) {
    // A constant estimate has no variance but rounding, of which f32 pixels have 1e-6 relative.
    let error = error.max(1e-6 * truth.abs());
    assert!(
        error < resolution * truth.abs(),
        "{what}: the error {error} of mean {mean} is too large to see anything"
    );
    let z = (mean - truth) / error;
    assert!(z.abs() < 4.4, "{what}: mean {mean} ± {error}, expected {truth}: z = {z:.2}");
}

/// z of the difference of a layer of two renders in each block of 8×8 pixels, of the channels' mean.
fn block_z(kind: LayerKind, a: &Rendered, b: &Rendered) -> Vec<f64> {
    let ((mean_a, variance_a), (mean_b, variance_b)) = (layer(a, kind), layer(b, kind));
    let (channels, height, width) = mean_a.dim();
    let mut scores = Vec::new();
    for top in (0..height).step_by(8) {
        for left in (0..width).step_by(8) {
            let (mut difference, mut variance) = (0.0f64, 0.0f64);
            for y in top..(top + 8).min(height) {
                for x in left..(left + 8).min(width) {
                    let (mut deviation_a, mut deviation_b) = (0.0, 0.0);
                    for channel in 0..channels {
                        let at = [channel, y, x];
                        difference += f64::from(mean_a[at]) - f64::from(mean_b[at]);
                        deviation_a += f64::from(variance_a[at]).sqrt();
                        deviation_b += f64::from(variance_b[at]).sqrt();
                    }
                    variance += deviation_a * deviation_a + deviation_b * deviation_b;
                }
            }
            if variance > 0.0 {
                scores.push(difference / variance.sqrt());
            }
        }
    }
    scores
}

/// METHODS 12.1: the mean of z² lies within `1 ± 4 sqrt(2 / n)` — one-sided here, since adding up the deviations of the
/// channels overstates the variance — and the largest |z| within a Šidák bound for level 10⁻⁴.
pub(crate) fn assert_equal_energy(a: &Rendered, b: &Rendered, what: &str) {
    assert_equal_energy_of(LayerKind::Beauty, a, b, what);
}

/// The same for any layer.
pub(crate) fn assert_equal_energy_of(kind: LayerKind, a: &Rendered, b: &Rendered, what: &str) {
    let scores = block_z(kind, a, b);
    let n = scores.len() as f64;
    assert!(n >= 16.0, "{what}: only {n} blocks with noise");
    let mean_square = scores.iter().map(|z| z * z).sum::<f64>() / n;
    let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
    let bound = 1.0 + 4.0 * (2.0 / n).sqrt();
    assert!(
        mean_square < bound,
        "{what}: mean z² {mean_square:.2} over {n} blocks, bound {bound:.2}"
    );
    // For up to 400 blocks a two-sided level of 10⁻⁴ / 400 is |z| = 5.2.
    assert!(largest < 5.2, "{what}: largest |z| {largest:.2} over {n} blocks");
}
