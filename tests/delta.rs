//! Delta lobes by name: they are what sampling gives, and they can be walked backwards.

use crate::support::random::Random;
use crate::support::sphere::SphereGrid;
use glam::{Vec2, Vec3};
use quietlight::bsdf::{
    Bsdf, Coat, DeltaEval, DeltaKind, DeltaLobe, Distribution, Glass, Metal, metals,
};
use quietlight::math::Rgb;

const KINDS: [DeltaKind; 3] = [DeltaKind::Reflection, DeltaKind::Refraction, DeltaKind::Pass];

fn glass(eta: f32) -> Glass {
    Glass { eta, reflectance: Rgb::new(0.9, 0.8, 0.7), transmittance: Rgb::new(0.3, 0.6, 1.0) }
}

fn gold() -> Bsdf<'static> {
    let (eta, k) = metals::complex_index("Au").expect("gold is known");
    Bsdf::conductor(Metal { eta, k, tint: Rgb::new(1.0, 0.9, 0.8) })
}

fn plastic(diffuse: f32, specular: f32) -> Bsdf<'static> {
    Bsdf::plastic(Rgb::splat(diffuse), Rgb::splat(specular), Coat::new(1.5, true))
}

/// All models with a delta lobe, mixtures of up to four of them, and models without any among them.
fn models() -> Vec<(&'static str, Bsdf<'static>)> {
    let rough = Bsdf::rough_dielectric(glass(1.4), Distribution::Ggx, Vec2::splat(0.4));
    let water = Bsdf::dielectric(glass(1.33));
    let sheet = Bsdf::thin_dielectric(glass(1.5));
    let nested = Bsdf::blend(
        0.6,
        Bsdf::blend(0.25, rough.clone(), water.clone()),
        Bsdf::blend(0.5, sheet.clone(), Bsdf::dielectric(glass(1.0))),
    );
    vec![
        ("nothing", Bsdf::Null),
        ("gold", gold()),
        ("glass", Bsdf::dielectric(glass(1.5))),
        ("glass from inside", Bsdf::dielectric(glass(1.0 / 1.5))),
        ("matched glass", Bsdf::dielectric(glass(1.0))),
        ("sheet", sheet.clone()),
        ("plastic", plastic(0.6, 0.9)),
        ("coat alone", plastic(0.0, 0.9)),
        ("base alone", plastic(0.6, 0.0)),
        ("mirror and glass", Bsdf::blend(0.3, gold(), water.clone())),
        ("two glasses", Bsdf::blend(0.8, Bsdf::dielectric(glass(1.5)), water)),
        ("sheet and plastic", Bsdf::blend(0.4, sheet, plastic(0.5, 1.0))),
        ("diffuse and mirror", Bsdf::blend(0.4, Bsdf::diffuse(Rgb::splat(0.5)), gold())),
        ("nested", nested),
        ("rough", rough),
    ]
}

/// All delta lobes that exist at `wo`.
fn lobes(bsdf: &Bsdf<'_>, wo: Vec3) -> Vec<(DeltaLobe, DeltaEval)> {
    (0..8)
        .flat_map(|leaf| KINDS.map(|kind| DeltaLobe { leaf, kind }))
        .filter_map(|lobe| Some((lobe, bsdf.delta(wo, lobe)?)))
        .collect()
}

#[test]
fn a_delta_lobe_is_what_sampling_gives() {
    let mut random = Random::new(21);
    for (name, bsdf) in models() {
        let mut compared = 0;
        for _ in 0..5000 {
            let wo = random.next_direction();
            let lobe = random.next_f32();
            let sample = bsdf.sample(wo, lobe, random.next_vec2());
            let Some((sample, lobe)) = sample.and_then(|sample| Some((sample, sample.delta?)))
            else {
                continue;
            };
            compared += 1;
            let Some(delta) = bsdf.delta(wo, lobe) else { panic!("{name} has no {lobe:?}") };
            assert_eq!(
                (delta.wi, delta.eta, delta.probability),
                (sample.wi, sample.eta, sample.pdf),
                "{name} {lobe:?}"
            );
            assert_eq!(sample.diffuse, Rgb::BLACK, "{name}");
            for channel in 0..3 {
                let (found, expected) =
                    (delta.reflectance[channel], sample.specular[channel] * sample.pdf);
                // Up to five products and quotients, each rounded by 6e-8.
                assert!((found - expected).abs() <= 3.6e-7 * expected, "{name} {lobe:?}");
            }
        }
        let has_delta = !["rough", "base alone"].contains(&name);
        assert_eq!(compared > 200, has_delta, "{name}: {compared}");
    }
}

#[test]
fn delta_lobes_are_chosen_with_their_probability() {
    const COUNT: u32 = 1 << 14;
    let mut random = Random::new(22);
    for (name, bsdf) in models() {
        for _ in 0..10 {
            let wo = random.next_direction();
            let lobes = lobes(&bsdf, wo);
            let mut counts = vec![0u32; lobes.len()];
            for i in 0..COUNT {
                let number = (i as f32 + 0.5) / COUNT as f32;
                let sample = bsdf.sample(wo, number, Vec2::splat(0.3));
                if let Some(found) = sample.and_then(|sample| sample.delta) {
                    let index = lobes.iter().position(|(lobe, _)| *lobe == found);
                    counts[index.expect("the lobe exists")] += 1;
                }
            }
            for (&(lobe, delta), &count) in lobes.iter().zip(&counts) {
                // Each lobe has one interval of numbers, which may gain or lose a number at either end.
                let expected = delta.probability * COUNT as f32;
                assert!(
                    (count as f32 - expected).abs() < 2.1,
                    "{name} {lobe:?}: {count} {expected}"
                );
            }
        }
    }
}

#[test]
fn all_lobes_together_have_probability_one() {
    let mut random = Random::new(24);
    let grid = SphereGrid::uniform(Vec3::Z, 24, 48);
    for (name, bsdf) in models() {
        for cos in [1.0f32, 0.8, 0.3, -0.3, -0.8] {
            let wo = Vec3::new(0.6, 0.8, 0.0) * (1.0 - cos * cos).sqrt() + Vec3::Z * cos;
            let delta: f64 =
                lobes(&bsdf, wo).iter().map(|(_, delta)| f64::from(delta.probability)).sum();
            let smooth: f64 = grid.integrate(|wi| f64::from(bsdf.pdf(wo, wi))).iter().sum();
            // The rest is absorbed: opaque models are black from below, and facets send light to the wrong side.
            const DRAWS: u32 = 20_000;
            let mut draw = || bsdf.sample(wo, random.next_f32(), random.next_vec2());
            let absorbed = (0..DRAWS).filter(|_| draw().is_none()).count();
            let absorbed = absorbed as f64 / f64::from(DRAWS);
            // Five standard deviations of a share, and the quadrature.
            let bound = 5.0 * (absorbed * (1.0 - absorbed) / f64::from(DRAWS)).sqrt() + 1e-4;
            assert!(
                (delta + smooth + absorbed - 1.0).abs() < bound,
                "{name} {cos}: {delta}, {smooth}, {absorbed}"
            );
        }
    }
}

#[test]
fn a_delta_lobe_followed_there_and_back_returns() {
    let mut random = Random::new(23);
    for (name, bsdf) in models() {
        for _ in 0..2000 {
            let wo = random.next_direction();
            for (lobe, there) in lobes(&bsdf, wo) {
                let cosine = wo.z.abs().min(there.wi.z.abs());
                // At the rim of total reflection rounding decides whether there is a way back.
                if cosine < 0.02 {
                    continue;
                }
                let back = bsdf.delta(there.wi, lobe).expect("the way back exists");
                // Refraction into the denser medium squeezes cosines by up to η² / cos.
                let tolerance = 1e-6 / cosine;
                assert!((back.wi - wo).length() < tolerance, "{name} {lobe:?} {wo}");
                assert!((there.eta * back.eta - 1.0).abs() < 1e-6, "{name} {lobe:?}");
                // Of the energy, the same part goes either way; radiance is compressed by η². For one lobe the
                // reflectance is the same too, and so is its probability where that depends on nothing else.
                let energy = |delta: DeltaEval| delta.reflectance * (delta.eta * delta.eta);
                let difference = (energy(there) - energy(back)).map(f32::abs).max_component();
                assert!(difference < 10.0 * tolerance, "{name} {lobe:?} {wo}: {difference}");
                let difference = (there.probability - back.probability).abs();
                assert!(difference < 10.0 * tolerance, "{name} {lobe:?} {wo}: {difference}");
                let is_straight = (there.wi + wo).length() == 0.0;
                assert_eq!(is_straight, lobe.kind == DeltaKind::Pass, "{name} {lobe:?}");
                let is_reflected = there.wi.z * wo.z > 0.0;
                assert_eq!(is_reflected, lobe.kind == DeltaKind::Reflection, "{name} {lobe:?}");
            }
        }
    }
}

#[test]
fn leaves_of_a_blend_are_counted_depth_first() {
    use DeltaKind::{Pass, Reflection, Refraction};
    let nested = models().into_iter().find(|(name, _)| *name == "nested").expect("it is there").1;
    // Ground glass is leaf 0 and has no delta lobe.
    let found: Vec<_> = lobes(&nested, Vec3::new(0.6, 0.0, 0.8))
        .into_iter()
        .map(|(lobe, _)| (lobe.leaf, lobe.kind))
        .collect();
    assert_eq!(found, [(1, Reflection), (1, Refraction), (2, Reflection), (2, Pass), (3, Pass)]);
    let part = |leaf, kind, of: Bsdf<'_>, share: f32| {
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let whole = of.delta(wo, DeltaLobe { leaf: 0, kind }).expect("it exists");
        let part = nested.delta(wo, DeltaLobe { leaf, kind }).expect("it exists");
        assert!((part.probability / whole.probability - share).abs() < 1e-6, "{leaf} {kind:?}");
        assert!((part.reflectance.g / whole.reflectance.g - share).abs() < 1e-6, "{leaf} {kind:?}");
        assert_eq!((part.wi, part.eta), (whole.wi, whole.eta));
    };
    part(1, Refraction, Bsdf::dielectric(glass(1.33)), 0.4 * 0.25);
    part(2, Reflection, Bsdf::thin_dielectric(glass(1.5)), 0.6 * 0.5);
    part(3, Pass, Bsdf::dielectric(glass(1.0)), 0.6 * 0.5);
    // Without a blend there is only leaf 0.
    assert_eq!(gold().delta(Vec3::Z, DeltaLobe { leaf: 1, kind: Reflection }), None);
}

#[test]
fn total_reflection_leaves_no_refraction() {
    let wo = Vec3::new(0.96, 0.0, -0.28);
    let bsdf = Bsdf::dielectric(glass(1.5));
    let lobe = |kind| DeltaLobe { leaf: 0, kind };
    assert_eq!(bsdf.delta(wo, lobe(DeltaKind::Refraction)), None);
    let reflected = bsdf.delta(wo, lobe(DeltaKind::Reflection)).expect("all light");
    assert_eq!((reflected.probability, reflected.reflectance), (1.0, glass(1.5).reflectance));
}
