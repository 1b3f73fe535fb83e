//! Same seed, same bits.

use crate::support::scenes::{layer, render_finite, scene_around, settings};
use quietlight::integrator::{
    Bdpt, CorrelatedVisibility, Erpt, Integrator, Mlt, PathTracing, PrimaryPaths, Pssmlt, Strategy,
};
use quietlight::render::{RenderSettings, Rendered, Rendering, SamplerKind, replay};
use quietlight::scene::Scene;
use quietlight_denoise::{LayerKind, bilateral};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

fn scene() -> Scene {
    scene_around(
        40,
        60.0,
        6,
        r#"<shape type="sphere"><point name="center" x="0" y="0" z="-3"/><bsdf type="roughplastic"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="2" z="-3"/></transform>
        <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.3"/></emitter>"#,
    )
}

fn on_threads(threads: usize, scene: &Scene, settings: &RenderSettings) -> Rendered {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| render_finite(scene, settings))
}

#[test]
fn one_two_and_eight_threads_give_the_same_bits() {
    let scene = scene();
    for sampler in [SamplerKind::Sobol, SamplerKind::Independent] {
        let settings = RenderSettings { sampler, ..settings(9, 5, Strategy::Mis) };
        let one = on_threads(1, &scene, &settings);
        for threads in [2, 8] {
            let many = on_threads(threads, &scene, &settings);
            for (kind, layer) in &one.layers.layers {
                let other = &many.layers.layers[kind];
                assert_eq!(layer.mean, other.mean, "{kind:?} on {threads} threads");
                assert_eq!(
                    layer.variance, other.variance,
                    "variance of {kind:?} on {threads} threads"
                );
                assert_eq!(layer.halves, other.halves, "halves of {kind:?} on {threads} threads");
            }
        }
    }
}

/// Every method that is not path tracing, with small pools of candidates.
pub(crate) fn methods() -> [Integrator; 7] {
    let pssmlt =
        |paths| Integrator::Pssmlt(Pssmlt { paths, bootstrap_samples: 3000, ..Pssmlt::default() });
    let mlt = Mlt { bootstrap_pairs: 3000, ..Mlt::default() };
    [
        Integrator::Bdpt(Bdpt::default()),
        pssmlt(PrimaryPaths::Bidirectional(Bdpt::default())),
        pssmlt(PrimaryPaths::Camera(PathTracing::default())),
        Integrator::Mlt(mlt),
        Integrator::Mlt(Mlt { separate_direct: false, ..mlt }),
        // Of both limits, whose films are merged and compared.
        Integrator::Erpt(Erpt {
            consecutive_limit: Some(9),
            proposal_limit: Some(4.0),
            ..Erpt::default()
        }),
        Integrator::Visibility(CorrelatedVisibility::default()),
    ]
}

#[test]
fn every_method_gives_the_same_bits_on_any_number_of_threads() {
    let scene = scene();
    for integrator in methods() {
        let settings = RenderSettings { integrator, ..settings(6, 5, Strategy::Mis) };
        let one = on_threads(1, &scene, &settings);
        for threads in [2, 8] {
            let many = on_threads(threads, &scene, &settings);
            let what = format!("{} on {threads} threads", integrator.name());
            for (kind, layer) in &one.layers.layers {
                let other = &many.layers.layers[kind];
                assert_eq!(layer.mean, other.mean, "{kind:?}, {what}");
                assert_eq!(layer.variance, other.variance, "variance of {kind:?}, {what}");
                assert_eq!(layer.halves, other.halves, "halves of {kind:?}, {what}");
            }
            assert_eq!(one.report, many.report, "{what}");
        }
        let other_seed = RenderSettings { seed: 6, ..settings };
        let other = on_threads(2, &scene, &other_seed);
        let [a, b] = [&one, &other].map(|rendered| &rendered.layers.layers[&LayerKind::Beauty]);
        assert_ne!(a.mean, b.mean, "{}", integrator.name());
    }
}

#[test]
fn the_filter_gives_the_same_bits_on_any_number_of_threads() {
    let rendered = on_threads(1, &scene(), &settings(9, 5, Strategy::Mis));
    let filtered = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            bilateral::denoise(&rendered.layers, &bilateral::Parameters::default(), &|_| {})
        })
        .expect("the layers are whole")
        .image
    };
    let one = filtered(1);
    assert_eq!(one, filtered(2));
    assert_eq!(one, filtered(8));
}

#[test]
fn the_length_of_a_pass_does_not_change_the_picture() {
    let scene = scene();
    let short = RenderSettings { pass: Duration::ZERO, ..settings(9, 5, Strategy::Mis) };
    let long = RenderSettings { pass: Duration::from_secs(1000), ..short };
    let (short, long) = (render_finite(&scene, &short), render_finite(&scene, &long));
    assert_eq!(layer(&short, LayerKind::Beauty), layer(&long, LayerKind::Beauty));
}

#[test]
fn a_render_that_goes_on_is_the_one_that_did_not_stop() {
    let scene = scene();
    for sampler in [SamplerKind::Sobol, SamplerKind::Independent] {
        let settings = RenderSettings { sampler, ..settings(13, 5, Strategy::Mis) };
        let whole = render_finite(&scene, &settings);
        let stop = AtomicBool::new(false);
        let mut parts = Rendering::new(&scene, &settings);
        for samples in [1, 4, 4, 9] {
            parts.advance(samples, &|_| {}, &stop);
            assert_eq!(parts.samples(), samples);
            // Looking at it on the way changes nothing.
            assert_eq!(parts.layers().width, whole.layers.width);
        }
        parts.advance(13, &|_| {}, &stop);
        let parts = parts.finish();
        assert_eq!(parts.samples, whole.samples);
        for (kind, layer) in &whole.layers.layers {
            let other = &parts.layers.layers[kind];
            assert_eq!(layer.mean, other.mean, "{kind:?}");
            assert_eq!(layer.variance, other.variance, "variance of {kind:?}");
            assert_eq!(layer.halves, other.halves, "halves of {kind:?}");
        }
    }
}

#[test]
fn another_seed_gives_another_picture() {
    let scene = scene();
    let a = render_finite(&scene, &settings(4, 1, Strategy::Mis));
    let b = render_finite(&scene, &settings(4, 2, Strategy::Mis));
    assert_ne!(layer(&a, LayerKind::Beauty).0, layer(&b, LayerKind::Beauty).0);
}

#[test]
fn a_crop_window_shows_the_same_pixels_as_the_whole_film() {
    let mut scene = scene();
    let whole = render_finite(&scene, &settings(4, 3, Strategy::Mis));
    scene.film.crop = [7, 11, 20, 13];
    let window = render_finite(&scene, &settings(4, 3, Strategy::Mis));
    let (whole, window) = (layer(&whole, LayerKind::Beauty).0, layer(&window, LayerKind::Beauty).0);
    assert_eq!(window, whole.slice(ndarray::s![.., 11..24, 7..27]));
}

#[test]
fn a_replayed_sample_is_the_one_that_was_rendered() {
    let scene = scene();
    let settings = settings(1, 9, Strategy::Mis);
    let rendered = render_finite(&scene, &settings);
    let beauty = layer(&rendered, LayerKind::Beauty).0;
    for [x, y] in [[20, 20], [3, 39], [39, 0]] {
        let mut hits = 0;
        let sample = replay(&scene, &settings, [x, y], 0, |_| hits += 1);
        assert_eq!((sample.diffuse + sample.specular).g, beauty[[1, y as usize, x as usize]]);
        assert!(hits <= 6);
    }
}
