//! Correlated visibility sampling: METHODS 13.5.

use crate::support::mean::Mean;
use crate::support::scenes::{render_finite, scene_around, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::correlated_visibility::{
    CorrelatedVisibility, MarkSource, PixelSums, VisibilityRendering,
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
    (0..3).map(|c| f64::from(LUMINANCE[c]) * (sums.diffuse[c] + sums.specular[c])).sum()
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
        [sums.diffuse, sums.specular].map(|part| part.map(|value| value / f64::from(hits)))
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
    // The left half of the picture is a mirror on the floor. Seen in it are the half plane's lit side, of which all pixels see
    // the whole lamp behind it or nothing of it, or nothing at all (METHODS 7.5: no smooth lobe, no mark).
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
