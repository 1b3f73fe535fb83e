//! METHODS 14, the extremes: for each row of its table, every method and every denoiser that it names is finite, does not panic,
//! and has the property that the row states. What each row is tested by, in [`path_tracing`] against closed forms, in the other
//! modules for all methods against path tracing or a closed form:
//!
//! | extreme | tests |
//! |---|---|
//! | roughness 1 … 0 | `roughness_goes_to_zero_without_a_break`, `rough_glass_…`, `delta` and `bidirectional` |
//! | mirror facing mirror | `walks_between_perfect_mirrors_end`, `mirrors_that_face_each_other_…` |
//! | emitters 1e8 next to 1e-8 | `a_light_of_1e_minus_8_survives_…`, `a_dim_light_behind_a_wall_…`, `consistency` |
//! | emitter area 1e-12 and 1e6 | `a_speck_of_a_light_…`, `emission::extremes` |
//! | scale and offset | `a_scene_is_as_bright_at_every_scale_…`, `rays` |
//! | grazing light | `light_in_the_plane_of_its_receiver_…`, `emission::extremes` |
//! | degenerate triangles | `degenerate_triangles_…`, `rays`, `emission::extremes`, `scene::mistakes` |
//! | 500 bounces, albedo 1e-12 | `five_hundred_…`, `nearly_black_…` |
//! | coincident connection points | `walls_that_meet_in_a_wedge_…`, `sheets_that_coincide_…` |
//! | darkness | `darkness_stays_dark_and_is_told`, `visibility` |
//! | smallest images | `pictures_of_few_pixels_…`, `denoisers::the_smallest_pictures_…`, `metrics`, `mutation::lens` |
//! | 1 spp | `one_sample_a_pixel_…` |
//! | NaN, infinite, negative buffers | `denoisers::broken_numbers_…`, unit tests of both denoisers |
//! | colour 1e30 | `denoisers::a_firefly_…`, unit tests of both denoisers |
//! | constant or missing features | `denoisers::features_…` |
//! | environment maps | `environments_of_few_texels_…`, `emission::extremes` |
//! | camera inside | `cameras_inside_…` |
//! | lens of radius 0 | `a_lens_of_radius_zero_is_a_pinhole` |
//! | shortest and longest paths | `paths_are_as_long_…`, `bidirectional` |
//! | stuck chains | `chains_that_cannot_move_…`, `redistribution` |
//! | few candidates, one mutation | `chains_of_one_mutation_…`, `markov` |
//! | huge energies | `redistribution`, `visibility` |
//! | 65 536 columns, many mutations | `a_picture_65536_wide_…`, `more_mutations_than_32_bits_…` |
//!
//! [`sweep`] goes through the ranges value by value and writes a table of what it finds.

mod chains;
mod denoisers;
mod lights;
mod path_tracing;
mod pictures;
mod places;
mod surfaces;
mod sweep;

use crate::support::mean::Mean;
use crate::support::scenes::{layer, render_finite, scaled, scene_around, scene_from, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::{
    Bdpt, CorrelatedVisibility, Erpt, Integrator, Mlt, Mutations, PathTracing, PrimaryPaths,
    Pssmlt, Strategy,
};
use quietlight::render::{RenderSettings, Rendered};
use quietlight::scene::{LoadOptions, Scene};
use quietlight::transport::connect::Strategies;
use quietlight_denoise::{LUMINANCE, LayerKind};
use rayon::prelude::*;

/// Comparisons of means in these tests, at most: they share [`LEVEL`].
const COMPARISONS: usize = 1000;

/// Independent renders that a mean and its error come from.
const REPLICAS: u64 = 16;

/// All methods but path tracing, those of Markov chains with small pools of candidates.
fn methods() -> [(&'static str, Integrator); 8] {
    let pssmlt =
        |paths| Integrator::Pssmlt(Pssmlt { paths, bootstrap_samples: 1000, ..Pssmlt::default() });
    let mlt = |separate_direct| {
        Integrator::Mlt(Mlt { separate_direct, bootstrap_pairs: 1000, ..Mlt::default() })
    };
    let erpt = |seeds, separate_direct| {
        Integrator::Erpt(Erpt { seeds, separate_direct, ..Erpt::default() })
    };
    [
        ("bdpt", Integrator::Bdpt(Bdpt::default())),
        ("visibility", Integrator::Visibility(CorrelatedVisibility::default())),
        ("pssmlt of both walks", pssmlt(PrimaryPaths::Bidirectional(Bdpt::default()))),
        ("pssmlt of the camera", pssmlt(PrimaryPaths::Camera(PathTracing::default()))),
        ("mlt", mlt(true)),
        ("mlt with direct light", mlt(false)),
        ("erpt", erpt(Strategies::ToLens, true)),
        ("erpt from the camera, with direct light", erpt(Strategies::FromCamera, false)),
    ]
}

/// The same method with so few candidates for its seeds.
fn with_few_candidates(integrator: Integrator, count: u32) -> Integrator {
    match integrator {
        Integrator::Mlt(mlt) => Integrator::Mlt(Mlt { bootstrap_pairs: count, ..mlt }),
        Integrator::Pssmlt(method) => {
            Integrator::Pssmlt(Pssmlt { bootstrap_samples: count, ..method })
        }
        other => other,
    }
}

fn rendered(scene: &Scene, integrator: Integrator, samples: u32, seed: u64) -> Rendered {
    let settings = RenderSettings { integrator, ..settings(samples, seed, Strategy::Mis) };
    let rendered = render_finite(scene, &settings);
    for (kind, layer) in &rendered.layers.layers {
        let halves = layer.halves.iter().flatten();
        for image in halves.chain([&layer.mean]).chain(&layer.variance) {
            assert!(image.iter().all(|value| value.is_finite()), "{kind:?} of {integrator:?}");
        }
    }
    rendered
}

/// Luminances of a picture: of all of it, of its upper half and of its left half. Chains have the first from their
/// normalisation alone; the others tell whether they also are where the light is.
fn parts(rendered: &Rendered) -> [f64; 3] {
    let beauty = layer(rendered, LayerKind::Beauty).0;
    let (_, height, width) = beauty.dim();
    let mut sums = [0.0; 3];
    for ((channel, y, x), &value) in beauty.indexed_iter() {
        let light = f64::from(LUMINANCE[channel] * value) * 3.0 / beauty.len() as f64;
        let belongs = [true, 2 * y < height, 2 * x < width];
        let counts = sums.iter_mut().zip(belongs).filter(|&(_, belongs)| belongs);
        counts.for_each(|(sum, _)| *sum += light);
    }
    sums
}

/// Mean luminance of the picture.
fn luminance(rendered: &Rendered) -> f64 {
    parts(rendered)[0]
}

/// Means of the [`parts`] of independent renders.
fn replicas(scene: &Scene, integrator: Integrator, count: u64, samples: u32) -> [Mean; 3] {
    let render = |seed| parts(&rendered(scene, integrator, samples, 100 + seed));
    let found: Vec<[f64; 3]> = (0..count).into_par_iter().map(render).collect();
    [0, 1, 2].map(|part| found.iter().map(|parts| parts[part]).collect())
}

/// Means agree, where errors of f32 count as none.
fn assert_same_mean(found: &[Mean; 3], expected: &[Mean; 3], what: &str) {
    for (part, (found, expected)) in found.iter().zip(expected).enumerate() {
        let (a, b) = (found.mean(), expected.mean());
        let is_equal = (a - b).abs() <= 1e-5 * b.abs();
        let p = if is_equal { 1.0 } else { found.p_same_as(expected) };
        let error = |mean: &Mean| mean.variance_of_mean().sqrt();
        assert!(
            p > sidak(LEVEL, COMPARISONS),
            "{what}, part {part}: {a} ± {}, expected {b} ± {}",
            error(found),
            error(expected)
        );
    }
}

/// The means of path tracing.
fn by_path(scene: &Scene, samples: u32) -> [Mean; 3] {
    replicas(scene, PathTracing::default().into(), REPLICAS, samples)
}

/// All methods have the means of path tracing, of 8 samples or mutations per pixel.
fn assert_like_path(scene: &Scene, what: &str) {
    let expected = by_path(scene, 64);
    for (name, integrator) in methods() {
        let found = replicas(scene, integrator, REPLICAS, 8);
        assert_same_mean(&found, &expected, &format!("{what}, {name}"));
    }
}

fn fact<'a>(rendered: &'a Rendered, name: &str) -> &'a str {
    let found = rendered.report.facts.iter().find(|(fact, _)| fact == name);
    found.map_or_else(|| panic!("no fact {name}"), |(_, value)| value)
}

const GREY: &str = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf>"#;

/// A room of two walls and a ball of `bsdf` under a lamp.
fn room(depth: i32, bsdf: &str) -> Scene {
    scene_around(
        12,
        60.0,
        depth,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-3"/></transform>{GREY}</shape>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-5"/></transform>{GREY}</shape>
        <shape type="sphere"><point name="center" x="0.3" y="-0.3" z="-3.4"/><float name="radius" value="0.7"/>{bsdf}</shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="1.5"/>
            <translate y="1.6" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#
        ),
    )
}

/// An area of 2⁻³⁸ = 3.6e-12 with radiance 1e12, and one of 1e6 with radiance 1e-6, over a white plane that a camera of this
/// angle sees; and the radiance of the plane. By the point-source limit of Lambert's formula the speck gives `L A cos² / d² / π` with
/// `d² = 5` and `cos² = 4/5` (its half-side of 2⁻²⁰ at a distance of 1 is exact in f32); the sheet covers nearly the whole
/// sky: 1e-6.
fn speck_and_sheet(fov: f32) -> (Scene, f64) {
    let scene = scene_around(
        4,
        fov,
        2,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-1"/></transform>
            <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="9.5367431640625e-7"/><rotate x="1" angle="180"/>
            <translate x="1" z="1"/></transform><emitter type="area"><rgb name="radiance" value="1e12"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="500"/><rotate x="1" angle="180"/>
            <translate z="3"/></transform><emitter type="area"><rgb name="radiance" value="1e-6"/></emitter></shape>"#,
    );
    (scene, 1e12 * 0.5f64.powi(38) * 0.8 / 5.0 / std::f64::consts::PI + 1e-6)
}
