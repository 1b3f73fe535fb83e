//! Energy redistribution (METHODS 13.4): a row of pixels that can be integrated by hand, then rooms.

use crate::support::batches::{Batches, assert_same, bdpt_batches, path_batches};
use crate::support::mean::{Mean, p_of_z};
use crate::support::scenes::{render_finite, scene_around, settings};
use crate::support::{LEVEL, sidak};
use glam::Vec2;
use quietlight::film::SplatFilm;
use quietlight::integrator::bdpt::{Bdpt, Workspace};
use quietlight::integrator::erpt::{Deposits, Ledger, Pass};
use quietlight::integrator::{Erpt, Mutations, Splat, Strategy};
use quietlight::mcmc::{Chain, Failure, Kernels, LogUniform, Proposal};
use quietlight::render::{RenderSettings, Rendered};
use quietlight::sampler::IndependentSampler;
use quietlight::scene::Scene;
use quietlight::transport::connect::Strategies;
use quietlight::transport::mis::Heuristic;
use quietlight_denoise::LayerKind;

/// Neighbouring pixels whose value is an integral over `[0, 1)` (Appendix I.4): smooth, and dark below an edge of each.
const PIXELS: usize = 8;

fn integrand(pixel: usize, x: f64) -> f64 {
    let edge = 0.1 * pixel as f64;
    if x < edge { 0.0 } else { (1.0 + pixel as f64 / 4.0) * x * (2.5 - x) + 0.05 }
}

/// `∫ (1 + j / 4) (2.5 x − x²) + 0.05` from the edge to 1.
fn truth(pixel: usize) -> f64 {
    let whole = |x: f64| (1.0 + pixel as f64 / 4.0) * (1.25 * x * x - x * x * x / 3.0) + 0.05 * x;
    whole(1.0) - whole(0.1 * pixel as f64)
}

/// Another place in the same pixel, near or anywhere; or the same place in the pixel beside it.
struct AlongTheRow;

impl Kernels for AlongTheRow {
    type State = (usize, f64);

    fn names(&self) -> &'static [&'static str] {
        &["near", "beside"]
    }

    fn selection(&self, kernel: usize, &(_, x): &(usize, f64)) -> f64 {
        // Depends on the state, so that the acceptance must know of it.
        if kernel == 0 { 0.3 + x } else { 1.0 }
    }

    fn propose(
        &mut self,
        kernel: usize,
        &(pixel, x): &(usize, f64),
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<(usize, f64)>, Failure> {
        let is_up = numbers.next_f64() < 0.5;
        let (to, y) = if kernel == 0 {
            let distance = LogUniform::new(1e-3, 0.3).sample(numbers.next_f64());
            (pixel, if is_up { x + distance } else { x - distance })
        } else {
            (if is_up { pixel + 1 } else { pixel.wrapping_sub(1) }, x)
        };
        if to >= PIXELS || !(0.0..1.0).contains(&y) {
            return Err(Failure::Outside);
        }
        Ok(Proposal::symmetric((to, y), [integrand(pixel, x), integrand(to, y)]))
    }
}

/// Independent pictures of one sample per pixel whose energy is spread, in deposits of `0.37 / m` or so: z of each pixel
/// against the truth, and how many paths were capped. `truncates` puts 0 in the place of the random number: a mistake to
/// be found.
fn row_of_pixels(erpt: &Erpt, pictures: u32, truncates: bool) -> (Result<(), String>, u64) {
    let deposit = 0.37 / f64::from(erpt.chain_length);
    let mut means = [Mean::default(); PIXELS];
    let mut capped = 0;
    for picture in 0..pictures {
        let mut numbers = IndependentSampler::new(41, picture, 0);
        let mut sums = [0.0; PIXELS];
        for pixel in 0..PIXELS {
            let x = numbers.next_f64();
            let u = if truncates { 0.0 } else { numbers.next_f64() };
            let share = erpt.share(integrand(pixel, x), deposit, u);
            capped += u64::from(share.is_capped);
            for _ in 0..share.chains {
                let mut chain = Chain::new((pixel, x), 2);
                let mut record =
                    |&(pixel, _): &(usize, f64), weight: f64| sums[pixel] += weight * share.deposit;
                for _ in 0..erpt.chain_length {
                    chain.step(&mut AlongTheRow, &mut numbers, &mut record);
                }
                chain.flush(&mut record);
            }
        }
        means.iter_mut().zip(sums).for_each(|(mean, sum)| mean.add(sum));
    }
    let z: Vec<f64> = (0..PIXELS)
        .map(|j| (means[j].mean() - truth(j)) / means[j].variance_of_mean().sqrt())
        .collect();
    // Of eight z that depend on each other no function but the largest has a bound.
    let largest = z.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
    let is_right = p_of_z(largest) > sidak(LEVEL, PIXELS);
    (if is_right { Ok(()) } else { Err(format!("{z:.2?}")) }, capped)
}

#[test]
fn a_row_of_pixels_keeps_its_integrals_for_any_length_of_chains() {
    for (chain_length, pictures) in [(1, 100_000), (10, 20_000), (100, 4_000)] {
        // 0.37 goes into at most 4.2 eleven times, where there may be two chains.
        for (most_chains, is_limited) in [(1000, false), (2, true)] {
            let erpt = Erpt { chain_length, most_chains, ..Erpt::default() };
            let (outcome, capped) = row_of_pixels(&erpt, pictures, false);
            outcome.unwrap_or_else(|z| panic!("{chain_length}, at most {most_chains}: {z}"));
            assert_eq!(capped > 0, is_limited);
        }
    }
    // The test sees a number of chains that is not random.
    let erpt = Erpt { chain_length: 10, ..Erpt::default() };
    assert!(row_of_pixels(&erpt, 20_000, true).0.is_err());
}

/// A room with a mirror ball, in the light of a lamp large enough for walks from the camera.
fn room() -> Scene {
    scene_around(
        16,
        60.0,
        5,
        r#"<bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.3 0.2"/></bsdf></bsdf>
        <bsdf type="twosided" id="grey"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-3"/></transform><ref id="grey"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-5"/></transform>
            <ref id="grey"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><scale value="3"/>
            <translate x="-1.5" z="-3"/></transform><ref id="red"/></shape>
        <shape type="sphere"><point name="center" x="0.3" y="-0.4" z="-3"/><float name="radius" value="0.6"/>
            <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/>
            <translate y="1.6" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#,
    )
}

const BOTH: Mutations =
    Mutations { bidirectional: false, lens: true, caustic: true, multi_chain: false };
const LENS: Mutations = Mutations { caustic: false, ..BOTH };
const CAUSTIC: Mutations = Mutations { lens: false, ..BOTH };

/// Mean energy of a sample.
fn energy(scene: &Scene, erpt: &Erpt) -> f64 {
    (0..4096).map(|index| erpt.probe(scene, 5, index)).sum::<f64>() / 4096.0
}

/// One sample of each pixel of the crop window, spread.
fn spread(scene: &Scene, erpt: &Erpt, pass: Pass) -> Deposits {
    let mut workspace = Workspace::default();
    let mut deposits = Deposits::default();
    let [left, top, columns, rows] = scene.film.crop;
    for y in top..top + rows {
        for x in left..left + columns {
            erpt.spread(scene, [x, y], pass, &mut workspace, &mut deposits);
        }
    }
    deposits
}

fn luminance(splat: &Splat) -> f64 {
    f64::from((splat.diffuse + splat.specular).luminance())
}

/// 32 pictures of 6 samples per pixel, whose deposits are `factor` times as large as for four mutations a sample.
fn erpt_batches(scene: &Scene, erpt: &Erpt, factor: f64) -> Batches {
    let samples = 6;
    let deposit = factor * energy(scene, erpt) / 4.0;
    Batches::run(scene, 32, |batch, add| {
        for sample in 0..samples {
            let pass = Pass { seed: 900 + u64::from(batch), sample, deposit };
            for splat in spread(scene, erpt, pass).splats {
                add(0, splat.raster, luminance(&splat) / f64::from(samples));
            }
        }
    })
}

#[test]
fn spread_energy_has_the_mean_of_path_tracing() {
    let scene = room();
    let bdpt = Bdpt { strategies: Strategies::FromCamera, heuristic: Heuristic::Power };
    // Paths of three edges and more, by path tracing.
    let indirect =
        bdpt_batches(&scene, bdpt, 32, 64, |one| (one.s + one.t > 3).then_some((0, one.weight)));
    // Short chains, of which there are more: their number is what the error comes from.
    let usual = Erpt { mutations: BOTH, chain_length: 10, ..Erpt::default() };
    for (what, erpt, factor) in [
        ("small deposits", usual, 0.1),
        ("usual deposits", usual, 1.0),
        ("large deposits", usual, 10.0),
        ("all mutations", Erpt { mutations: Mutations::default(), ..usual }, 1.0),
        ("lens alone", Erpt { mutations: LENS, ..usual }, 1.0),
        ("caustic alone", Erpt { mutations: CAUSTIC, ..usual }, 1.0),
        ("seeds from the camera", Erpt { seeds: Strategies::FromCamera, ..usual }, 1.0),
        ("chains of 100", Erpt { chain_length: 100, ..usual }, 0.3),
        ("chains limited in number", Erpt { most_chains: 1, ..usual }, 1.0),
    ] {
        assert_same(&erpt_batches(&scene, &erpt, factor), 0, &indirect, 0, what);
    }
    let all = path_batches(&scene, 32, 64);
    for seeds in [Strategies::ToLens, Strategies::FromCamera] {
        let erpt = Erpt { separate_direct: false, seeds, ..usual };
        assert_same(&erpt_batches(&scene, &erpt, 1.0), 0, &all, 0, &format!("all, {seeds:?}"));
    }
}

/// Sum of the luminance of splats.
fn total(splats: &[Splat]) -> f64 {
    splats.iter().map(luminance).sum()
}

/// Splats are of f32: each is a product of three rounded numbers, and luminance a sum of three, at 6e-8 each.
const ROUNDING: f64 = 1e-6;

#[test]
fn all_energy_of_chains_comes_to_the_film() {
    let mut scene = room();
    scene.film.crop = [3, 2, 9, 11];
    for (what, erpt) in [
        ("usual", Erpt::default()),
        ("from the camera", Erpt { seeds: Strategies::FromCamera, ..Erpt::default() }),
        ("direct, too", Erpt { separate_direct: false, ..Erpt::default() }),
        ("limited", Erpt { consecutive_limit: Some(2), ..Erpt::default() }),
    ] {
        let deposit = energy(&scene, &erpt) / 100.0;
        let mut whole = Ledger::default();
        let mut film = SplatFilm::new(scene.film);
        let mut splat_sum = 0.0;
        for sample in 0..4 {
            let deposits = spread(&scene, &erpt, Pass { seed: 1, sample, deposit });
            for splat in &deposits.splats {
                assert!(scene.film.crop_pixel(splat.raster).is_some(), "{what}: {splat:?}");
                film.add(0, splat);
            }
            splat_sum += total(&deposits.splats);
            whole.merge(&deposits.ledger);
        }
        let Ledger { started, deposited, lost, chains, capped, invalid, .. } = whole;
        assert!(chains > 100 && invalid == 0, "{what}: {whole:?}");
        assert_eq!(capped, 0, "{what}");
        let expected = chains as f64 * f64::from(erpt.chain_length) * deposit;
        assert!((started / expected - 1.0).abs() < 1e-9, "{what}: {started}, not {expected}");
        assert!(((deposited + lost) / started - 1.0).abs() < 1e-9, "{what}: {whole:?}");
        assert_eq!(lost > 0.0, erpt.consecutive_limit.is_some(), "{what}: {lost}");
        assert!((splat_sum / deposited - 1.0).abs() < ROUNDING, "{what}: {splat_sum}, {whole:?}");
        // Sum of colours of the film, against that of the splats: nothing fell beside it.
        let of_splats = film.total();
        assert!(of_splats > 0.0 && film.invalid_splats() == 0, "{what}");
    }
}

#[test]
fn limits_are_off_unless_asked_for() {
    assert_eq!(Erpt::default().consecutive_limit, None);
    assert_eq!(Erpt::default().proposal_limit, None);
}

#[test]
fn the_limit_of_consecutive_deposits_tells_what_it_takes() {
    let scene = room();
    let (all, limited) = (Erpt::default(), Erpt { consecutive_limit: Some(3), ..Erpt::default() });
    let pass = Pass { seed: 2, sample: 0, deposit: energy(&scene, &all) / 16.0 };
    let (all, limited) = (spread(&scene, &all, pass), spread(&scene, &limited, pass));
    // The same chains, but for what they leave.
    assert_eq!(all.ledger.statistics, limited.ledger.statistics);
    assert_eq!((all.ledger.lost, all.ledger.started), (0.0, limited.ledger.started));
    let missing = total(&all.splats) - total(&limited.splats);
    let lost = limited.ledger.lost;
    assert!(
        lost > 0.0 && (missing - lost).abs() < ROUNDING * limited.ledger.started,
        "{missing} {lost}"
    );
}

/// A render of all light by chains.
fn rendered(scene: &Scene, erpt: Erpt) -> Rendered {
    let erpt = Erpt { separate_direct: false, ..erpt };
    let settings = RenderSettings {
        integrator: quietlight::integrator::Integrator::Erpt(erpt),
        ..settings(4, 3, Strategy::Mis)
    };
    render_finite(scene, &settings)
}

/// Sum over the picture, of the colour channels with these weights.
fn sum(rendered: &Rendered, weights: [f64; 3]) -> f64 {
    let beauty = &rendered.layers.layers[&LayerKind::Beauty].mean;
    beauty.indexed_iter().map(|((channel, ..), &value)| weights[channel] * f64::from(value)).sum()
}

fn fact<'a>(rendered: &'a Rendered, name: &str) -> Option<&'a str> {
    let found = rendered.report.facts.iter().find(|(fact, _)| fact == name);
    found.map(|(_, value)| value.as_str())
}

/// The number in percent that a fact begins with, as a part of 1.
fn part(rendered: &Rendered, name: &str) -> f64 {
    let value = fact(rendered, name).expect("the fact is told");
    value.split(' ').next().expect("a number").parse::<f64>().expect("a number") / 100.0
}

#[test]
fn pictures_are_darker_by_what_their_limits_report() {
    let scene = room();
    let plain = rendered(&scene, Erpt::default());
    assert_eq!(fact(&plain, "energy_lost"), None);
    assert_eq!(fact(&plain, "energy_lost_to_medians"), None);
    // Told to 0.001 %: half of that, and rounding to f32.
    let precision = 0.5e-5 + ROUNDING;

    let limited = rendered(&scene, Erpt { consecutive_limit: Some(3), ..Erpt::default() });
    let rec_709 = quietlight_denoise::LUMINANCE.map(f64::from);
    let darker = 1.0 - sum(&limited, rec_709) / sum(&plain, rec_709);
    let lost = part(&limited, "energy_lost");
    assert!(lost > 1e-4 && (darker - lost).abs() < precision, "{darker}, told {lost}");

    let limited = rendered(&scene, Erpt { proposal_limit: Some(1.5), ..Erpt::default() });
    let darker = 1.0 - sum(&limited, [1.0; 3]) / sum(&plain, [1.0; 3]);
    let lost = part(&limited, "energy_lost_to_medians");
    assert!(lost > 1e-4 && (darker - lost).abs() < precision, "{darker}, told {lost}");
}

#[test]
fn a_path_of_enormous_energy_starts_no_more_chains_than_allowed_and_keeps_it_all() {
    let scene = room();
    let erpt = Erpt { chain_length: 10, most_chains: 5, ..Erpt::default() };
    // Each path would want some 1e12 chains.
    let deposit = 1e-13 * energy(&scene, &erpt);
    let ledger = spread(&scene, &erpt, Pass { seed: 4, sample: 0, deposit }).ledger;
    assert!(ledger.capped > 100);
    assert_eq!(ledger.chains, 5 * ledger.capped);
    assert!((ledger.started / ledger.found - 1.0).abs() < 1e-9, "{ledger:?}");
    assert!((ledger.deposited / ledger.found - 1.0).abs() < 1e-9, "{ledger:?}");
}

#[test]
fn chains_that_cannot_move_leave_their_energy_where_it_was_found() {
    let scene = room();
    let stuck = Mutations { bidirectional: false, lens: false, caustic: false, multi_chain: false };
    let erpt = Erpt { mutations: stuck, ..Erpt::default() };
    let deposit = energy(&scene, &erpt) / 100.0;
    let Deposits { splats, ledger, .. } =
        spread(&scene, &erpt, Pass { seed: 5, sample: 0, deposit });
    let steps = ledger.chains * u64::from(erpt.chain_length);
    assert_eq!((ledger.statistics.idle, splats.len() as u64), (steps, ledger.chains));
    assert_eq!(ledger.statistics.longest_stay, u64::from(erpt.chain_length));
    for splat in &splats {
        let energy = luminance(splat) / (f64::from(erpt.chain_length) * deposit);
        assert!((energy - 1.0).abs() < ROUNDING, "{energy}");
    }
    // Where it was found: a walk from the camera finds it in the pixel of its sample.
    let erpt = Erpt { seeds: Strategies::FromCamera, ..erpt };
    for [x, y] in [[8, 9], [3, 12], [11, 4]] {
        let mut deposits = Deposits::default();
        for sample in 0..16 {
            let pass = Pass { seed: 6, sample, deposit };
            erpt.spread(&scene, [x, y], pass, &mut Workspace::default(), &mut deposits);
        }
        assert!(!deposits.splats.is_empty());
        for splat in &deposits.splats {
            assert_eq!(splat.raster.floor(), Vec2::new(x as f32, y as f32));
        }
    }
}
