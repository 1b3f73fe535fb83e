//! Correlated visibility sampling: METHODS 13.5.

mod marks;
mod resampling;

use crate::support::mean::Mean;
use crate::support::scenes::{render_finite, scene_around, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::correlated_visibility::{
    CorrelatedVisibility, PixelSums, VisibilityRendering,
};
use quietlight::integrator::{Integrator, PathTracing, Strategy};
use quietlight::render::{RenderSettings, Rendered};
use quietlight::scene::Scene;
use quietlight_denoise::{LUMINANCE, LayerKind};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A finished half.
fn rendered<'a>(
    scene: &'a Scene,
    settings: CorrelatedVisibility,
    seed: u64,
    hits: u32,
) -> VisibilityRendering<'a> {
    let mut rendering = VisibilityRendering::new(scene, settings, seed, (seed & 1) as u32);
    rendering.advance(hits);
    assert_eq!(rendering.ledger().invalid, 0, "non-finite samples");
    rendering
}

fn luminance(sums: &PixelSums) -> f64 {
    (0..3)
        .map(|c| f64::from(LUMINANCE[c]) * (sums.diffuse[c].value() + sums.specular[c].value()))
        .sum()
}

/// Means over square blocks of pixels.
fn blocks(width: usize, side: usize, pixels: &[f64]) -> Vec<f64> {
    let across = width / side;
    let mut means = vec![0.0; across * (pixels.len() / width / side)];
    for (index, value) in pixels.iter().enumerate() {
        means[index / width / side * across + index % width / side] += value / (side * side) as f64;
    }
    means
}

/// Three views of a picture's blocks: luminance of all light, its red channel, luminance of the diffuse layer. Energy is
/// exchanged as luminance, so that wrong colours only show in a channel.
type Views = [Vec<f64>; 3];

/// The views of the mean light `[diffuse, specular]` of each pixel.
fn views(width: usize, side: usize, pixels: impl Iterator<Item = [[f64; 3]; 2]>) -> Views {
    let luminance = |c: [f64; 3]| (0..3).map(|i| f64::from(LUMINANCE[i]) * c[i]).sum::<f64>();
    let mut views = Views::default();
    for [diffuse, specular] in pixels {
        views[0].push(luminance(diffuse) + luminance(specular));
        views[1].push(diffuse[0] + specular[0]);
        views[2].push(luminance(diffuse));
    }
    views.map(|view| blocks(width, side, &view))
}

/// Mean and spread of each block over many seeds.
fn replicas(count: u64, picture: impl Fn(u64) -> Views) -> [Vec<Mean>; 3] {
    let mut means = <[Vec<Mean>; 3]>::default();
    for seed in 0..count {
        for (means, blocks) in means.iter_mut().zip(picture(seed)) {
            means.resize(blocks.len(), Mean::default());
            means.iter_mut().zip(blocks).for_each(|(mean, block)| mean.add(block));
        }
    }
    means
}

fn by_exchange(
    scene: &Scene,
    settings: CorrelatedVisibility,
    hits: u32,
    seed: u64,
    side: usize,
) -> Views {
    let half = rendered(scene, settings, 1000 + seed, hits);
    let pixels = half.sums().iter().map(|sums| {
        [sums.diffuse, sums.specular].map(|part| part.map(|sum| sum.value() / f64::from(hits)))
    });
    views(scene.film.crop[2] as usize, side, pixels)
}

fn by_path_tracing(scene: &Scene, samples: u32, seed: u64, side: usize) -> Views {
    let rendered = render_finite(scene, &settings(samples, seed, Strategy::Mis));
    let [diffuse, specular] =
        [LayerKind::Diffuse, LayerKind::Specular].map(|kind| &rendered.layers.layers[&kind].mean);
    let (_, height, width) = diffuse.dim();
    let pixels = (0..height * width).map(|i| {
        [diffuse, specular]
            .map(|layer| [0, 1, 2].map(|c| f64::from(layer[[c, i / width, i % width]])))
    });
    views(width, side, pixels)
}

/// z of each block's difference.
fn scores(a: &[Mean], b: &[Mean]) -> Vec<f64> {
    a.iter()
        .zip(b)
        .map(|(a, b)| {
            let difference = a.mean() - b.mean();
            let variance = a.variance_of_mean() + b.variance_of_mean();
            // The sky seen directly is the same in every sample, up to its rounding in a film of f32.
            let is_constant =
                variance.sqrt() < 1e-6 * a.mean() && difference.abs() < 1e-6 * a.mean();
            if is_constant || difference == 0.0 { 0.0 } else { difference / variance.sqrt() }
        })
        .collect()
}

fn mean_square(scores: &[f64]) -> f64 {
    scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64
}

/// METHODS 12.1: block by block the same mean by Welch's test, and the mean of z² near 1, for each of the views.
fn assert_same(what: &str, a: &[Vec<Mean>; 3], b: &[Vec<Mean>; 3]) {
    for (view, (a, b)) in ["light", "red", "diffuse"].into_iter().zip(a.iter().zip(b)) {
        let scores = scores(a, b);
        let square = mean_square(&scores);
        let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
        // Blocks that share chains are correlated: METHODS has n / 4 for the effective number.
        let bound = 1.0 + 4.0 * (2.0 * 4.0 / scores.len() as f64).sqrt();
        let what = format!("{what}, {view}");
        assert!(square < bound, "{what}: mean z² {square:.2} of {scores:.1?}, bound {bound:.2}");
        // Student's t of 63 and more degrees of freedom, the level shared by the blocks.
        let t = StudentsT::new(0.0, 1.0, 63.0).expect("degrees are positive");
        let limit = t.inverse_cdf(1.0 - 0.5 * sidak(LEVEL, scores.len()));
        assert!(largest < limit, "{what}: |z| {largest:.2}, limit {limit:.2}, z {scores:.1?}");
    }
}

/// A slab and a ball over a floor, under a rectangle lamp and a sky, or one of them.
fn blockers(max_depth: i32, light: &str) -> Scene {
    scene_around(
        16,
        50.0,
        max_depth,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-45"/><scale value="6"/>
            <translate y="-1" z="-4"/></transform><bsdf type="roughplastic"><float name="alpha" value="0.2"/>
            <rgb name="diffuse_reflectance" value="0.6 0.5 0.3"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale x="0.7" y="0.2"/>
            <translate x="-0.3" y="0.2" z="-3.4"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="sphere"><point name="center" x="0.6" y="-0.2" z="-3.5"/><float name="radius" value="0.4"/>
            <bsdf type="roughconductor"><string name="material" value="Au"/><float name="alpha" value="0.15"/></bsdf>
            </shape>
        <shape type="sphere"><point name="center" x="-0.9" y="-0.3" z="-3"/><float name="radius" value="0.3"/>
            <bsdf type="plastic"/></shape>
        {light}"#
        ),
    )
}

const LAMPS: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/>
    <scale value="0.5"/><translate x="0.3" y="2" z="-3"/></transform>
    <emitter type="area"><rgb name="radiance" value="6 5 4"/></emitter></shape>
    <shape type="sphere"><point name="center" x="-2" y="1" z="-2"/><float name="radius" value="0.3"/>
    <emitter type="area"><rgb name="radiance" value="3 6 9"/></emitter></shape>"#;

const SKY: &str =
    r#"<emitter type="constant"><rgb name="radiance" value="0.2 0.3 0.4"/></emitter>"#;

/// A floor 4 in front of the camera, a lamp 2 behind it, |x| < 0.2, and a half plane x < 0 that covers it from 1 behind the
/// camera. From `x` on the floor the lamp's point `l` is seen over `x + (l - x) 5/6` on the half plane: light from all of
/// the lamp arrives where `x > 1`, none where `x < -1`.
fn penumbra(more: &str) -> Scene {
    scene_around(
        24,
        60.0,
        2,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-4"/></transform>
            <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><scale x="20" y="40"/><translate x="-20" z="1"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale x="0.2" y="1"/>
            <translate z="2"/></transform><emitter type="area"><rgb name="radiance" value="20"/></emitter></shape>{more}"#
        ),
    )
}

fn same_as_path_tracing(what: &str, scene: &Scene, settings: CorrelatedVisibility) {
    let exchanged = replicas(64, |seed| by_exchange(scene, settings, 4, seed, 2));
    let traced = replicas(64, |seed| by_path_tracing(scene, 32, seed, 2));
    assert_same(what, &exchanged, &traced);
}

#[test]
fn exchange_with_pilot_marks_has_the_mean_of_path_tracing() {
    let settings = CorrelatedVisibility::default();
    same_as_path_tracing("lamps", &blockers(2, LAMPS), settings);
    same_as_path_tracing("sky", &blockers(2, SKY), settings);
    same_as_path_tracing("both", &blockers(2, &format!("{LAMPS}{SKY}")), settings);
    same_as_path_tracing("penumbra", &penumbra(""), settings);
}

#[test]
fn all_other_light_is_that_of_path_tracing() {
    let lights = format!(
        r#"{LAMPS}{SKY}<emitter type="point"><point name="position" x="1" y="1" z="-2"/>
        <rgb name="intensity" value="2"/></emitter>
        <shape type="sphere"><point name="center" x="0.1" y="-0.5" z="-2.5"/><float name="radius" value="0.25"/>
        <bsdf type="dielectric"/></shape>"#
    );
    same_as_path_tracing("all", &blockers(6, &lights), CorrelatedVisibility::default());
}

#[test]
fn chains_of_any_length_and_number_have_the_mean_of_path_tracing() {
    let scene = blockers(2, &format!("{LAMPS}{SKY}"));
    let default = CorrelatedVisibility::default();
    let traced = replicas(64, |seed| by_path_tracing(&scene, 32, seed, 2));
    for settings in [
        // Equal deposition as in METHODS 7.3: long chains, as many as the energy asks for.
        CorrelatedVisibility { steps: 16, mutations: 16, ..default },
        // Much energy in few chains, which makes up for their number.
        CorrelatedVisibility { mutations: 32, max_chains: 1, ..default },
        CorrelatedVisibility { candidates: 1, shadow_rays: 1, dilation: 0, hits: 3, ..default },
    ] {
        let exchanged = replicas(64, |seed| by_exchange(&scene, settings, 4, seed, 2));
        assert_same(&format!("{settings:?}"), &exchanged, &traced);
    }
}

#[test]
fn what_chains_are_given_is_what_they_deposit() {
    let scene = blockers(2, &format!("{LAMPS}{SKY}"));
    let default = CorrelatedVisibility::default();
    let mut balance = Mean::default();
    for (seed, settings) in [
        default,
        CorrelatedVisibility { steps: 16, mutations: 16, ..default },
        CorrelatedVisibility { max_chains: 1, mutations: 100, ..default },
    ]
    .into_iter()
    .cycle()
    .take(48)
    .enumerate()
    {
        let half = rendered(&scene, settings, seed as u64, 4);
        let ledger = half.ledger();
        assert!(ledger.found > 0.0 && ledger.chains > 0);
        let lost = (ledger.deposited / ledger.given - 1.0).abs();
        assert!(lost < 1e-9, "{settings:?}: {ledger:?}");
        balance.add(ledger.given / ledger.found);
    }
    let p = balance.p_against(1.0);
    assert!(p > LEVEL, "given / found {} p {p:.2e}", balance.mean());
}

#[test]
fn the_exchange_has_the_same_bits_on_any_number_of_threads() {
    let scene = blockers(4, &format!("{LAMPS}{SKY}"));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let half = rendered(&scene, CorrelatedVisibility::default(), 3, 12);
            (half.sums().to_vec(), *half.ledger())
        })
    };
    let one = on(1);
    assert_eq!(one, on(2));
    assert_eq!(one, on(8));
}

#[test]
fn extremes_stay_finite_and_dark_stays_dark() {
    let default = CorrelatedVisibility::default();
    let black = [
        String::new(),
        r#"<emitter type="constant"><rgb name="radiance" value="0"/></emitter>"#.to_owned(),
    ];
    for light in black {
        let scene = blockers(2, &light);
        let half = rendered(&scene, default, 1, 4);
        assert!(half.sums().iter().all(|sums| luminance(sums) == 0.0));
        assert!(half.marks().is_some_and(|marks| marks.is_empty()));
    }
    // One pixel has no neighbour to exchange with; all pixels marked, or none, is no special case.
    let mut scene = blockers(2, LAMPS);
    for crop in [[8, 8, 1, 1], [0, 9, 16, 1], [9, 0, 1, 16], [7, 9, 2, 2]] {
        scene.film.crop = crop;
        for dilation in [0, 100] {
            let half = rendered(&scene, CorrelatedVisibility { dilation, ..default }, 1, 4);
            assert!(half.sums().iter().all(|sums| luminance(sums).is_finite()));
        }
    }
    // Energies that differ by 10¹⁶, and more chains asked for than are allowed.
    let lamps = LAMPS.replace("6 5 4", "1e8 1e8 1e8").replace("3 6 9", "1e-8 1e-8 1e-8");
    let scene = blockers(2, &lamps);
    let many = CorrelatedVisibility { mutations: 1 << 20, max_chains: 3, ..default };
    for settings in [default, many] {
        let half = rendered(&scene, settings, 1, 2);
        let ledger = half.ledger();
        assert!((ledger.deposited / ledger.given - 1.0).abs() < 1e-9, "{ledger:?}");
        assert!((ledger.given / ledger.found - 1.0).abs() < 0.1, "{ledger:?}");
        assert!(half.sums().iter().all(|sums| luminance(sums).is_finite()));
    }
}

#[test]
fn the_driver_renders_it_as_it_does_path_tracing() {
    let scene = blockers(4, &format!("{LAMPS}{SKY}"));
    let with = |integrator: Integrator, seed| {
        let settings = RenderSettings { integrator, ..settings(65, seed, Strategy::Mis) };
        render_finite(&scene, &settings)
    };
    let exchanged = with(Integrator::Visibility(CorrelatedVisibility::default()), 1);
    let traced = with(PathTracing::default().into(), 2);
    assert_eq!(exchanged.samples, 65);
    for kind in [LayerKind::Diffuse, LayerKind::Specular] {
        let mean = |rendered: &Rendered| {
            let mean = &rendered.layers.layers[&kind].mean;
            mean.iter().map(|&value| f64::from(value)).sum::<f64>() / mean.len() as f64
        };
        // 16 × 16 pixels of 65 samples know the mean of the picture to about 1 %.
        let (ours, theirs) = (mean(&exchanged), mean(&traced));
        assert!((ours / theirs - 1.0).abs() < 0.05, "{kind:?}: {ours} {theirs}");
    }
}

#[test]
fn the_variance_is_where_the_noise_is() {
    // A lamp of 100 in view, whose edge is noisy, over a floor: what is around the edge is not, and must not be said to be.
    // 24 pictures of 16 camera rays: the scatter of the pixels against the variance that is told, both over (r² + 0.01).
    let scene = scene_around(
        24,
        60.0,
        4,
        r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/>
            <translate y="-1" z="-4"/></transform><bsdf type="diffuse"/></shape>
        <shape type="sphere"><point name="center" x="0" y="0.6" z="-4"/><float name="radius" value="0.5"/>
            <emitter type="area"><rgb name="radiance" value="100"/></emitter></shape>"#,
    );
    let integrator = Integrator::Visibility(CorrelatedVisibility::default());
    let pictures: Vec<Rendered> = (0..24)
        .map(|seed| {
            let settings = settings(16, seed, Strategy::Mis);
            render_finite(&scene, &RenderSettings { integrator, ..settings })
        })
        .collect();
    let count = pictures.len() as f64;
    let beauty = |picture: &Rendered| picture.layers.layers[&LayerKind::Beauty].clone();
    let layers: Vec<_> = pictures.iter().map(beauty).collect();
    let (mut told, mut is) = ([0.0; 2], [0.0; 2]);
    for (index, _) in layers[0].mean.indexed_iter() {
        let values: Vec<f64> = layers.iter().map(|layer| f64::from(layer.mean[index])).collect();
        let mean = values.iter().sum::<f64>() / count;
        let scatter = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (count - 1.0);
        let variance = |layer: &quietlight_denoise::Layer| {
            layer.variance.as_ref().map_or(0.0, |variance| f64::from(variance[index]))
        };
        let variance = layers.iter().map(variance).sum::<f64>() / count;
        // The floor in the lower half of the picture, and all of it.
        let weight = 1.0 / (mean * mean + 0.01);
        let parts = if index.1 >= 15 { 0..2 } else { 1..2 };
        for part in parts {
            told[part] += weight * variance;
            is[part] += weight * scatter;
        }
    }
    // The scatter of 24 is off by √(2/23) of itself in a pixel and by a hundredth over all of them; the box of 21 pixels over which
    // the halves are compared takes the edge's noise for that of the floor, where the shape of the variance is off: a
    // factor of three is for that. Without the shape it was ten thousand.
    for (told, is) in told.into_iter().zip(is) {
        assert!(told < 3.0 * is && is < 3.0 * told, "{told} told, and {is}");
    }
}
