//! METHODS 12.3 (a): the exchange's mutations keep the distribution of weighted seeds.

use super::exchange::{Mutation, State};
use super::*;
use crate::scene::LoadOptions;

/// Lamps, a sky and blockers over a glossy floor: 12 × 12 pixels.
fn scene() -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.xml");
    std::fs::write(
        &file,
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"><float name="fov" value="50"/>
            <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="12"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-45"/><scale value="6"/>
            <translate y="-1" z="-4"/></transform><bsdf type="roughplastic"><float name="alpha" value="0.2"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale x="0.7" y="0.2"/>
            <translate x="-0.3" y="0.2" z="-3.4"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.5"/>
            <translate x="0.3" y="1" z="-3"/></transform>
            <emitter type="area"><rgb name="radiance" value="6 5 4"/></emitter></shape>
        <shape type="sphere"><point name="center" x="-1" y="0.2" z="-3"/><float name="radius" value="0.3"/>
            <emitter type="area"><rgb name="radiance" value="3 6 9"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.4 0.3 0.2"/></emitter></scene>"#,
    )
    .unwrap();
    Scene::load(&file, &LoadOptions::default()).unwrap()
}

/// Features of a state: its block of 3 × 3 pixels, and which light it has from which of eight directions.
fn features(state: &State, pixels: &[u32], hits: u32) -> [usize; 2] {
    let pixel = pixels[(state.receiver / hits) as usize];
    let direction = state.direction;
    let octant = [direction.x, direction.y, direction.z + 0.5]
        .iter()
        .fold(0, |sum, &value| 2 * sum + usize::from(value > 0.0));
    let light = match state.light {
        light::Light::Environment(_) => 0,
        light::Light::Area { id, .. } => 1 + id.0 as usize,
    };
    [(pixel / 12 / 3 * 4 + pixel % 12 / 3) as usize, 16 + 8 * light + octant]
}

const FEATURES: usize = 16 + 3 * 8;

#[test]
#[ignore = "not yet seen to pass: its first run stopped at a threshold that was set too high"]
fn every_mutation_keeps_the_distribution_of_weighted_seeds() {
    let scene = scene();
    let hits = 2;
    // Marks with ragged edges, which a move that passes over unmarked pixels would favour.
    let marks = Marks::new([12, 12], 0, |pixel| hash::key(1, pixel as u32, 0) % 5 < 2);
    let pixels: Vec<u32> = marks.pixels().map(|pixel| pixel as u32).collect();
    let replicas = 150;
    for kind in [Mutation::Pixel, Mutation::Direction, Mutation::Both, Mutation::Independence] {
        let (mut sum, mut squares, mut moved) = ([0.0; FEATURES], [0.0; FEATURES], 0u32);
        for seed in 0..replicas {
            let rendering =
                VisibilityRendering::new(&scene, CorrelatedVisibility::default(), seed, 0);
            let rows: Vec<Row<'_>> =
                (0..12).map(|row| rendering.gather_row(row, hits, &marks)).collect();
            let seeds: Vec<Seed> = rows.iter().flat_map(|row| row.seeds.clone()).collect();
            let receivers: Vec<Option<Receiver<'_>>> =
                rows.into_iter().flat_map(|row| row.receivers).collect();
            let brightness = vec![1.0; pixels.len()];
            let exchange = Exchange {
                scene: &scene,
                lights: &rendering.lights,
                marks: &marks,
                pixels: &pixels,
                receivers: &receivers,
                brightness: &brightness,
                hits,
            };
            let mut change = [0.0; FEATURES];
            for (index, seed) in seeds.iter().enumerate() {
                let mut sampler = rendering.chain_sampler(Stream::Chains, index as u32);
                let Some(start) = exchange.start(seed) else { continue };
                let mut state = start;
                for _ in 0..8 {
                    let next = Move { kind, ..Move::sample(2, hits, &mut sampler) };
                    if let Some((to, acceptance)) = exchange.mutate(&state, &next, &mut sampler)
                        && f64::from(sampler.next_1d()) < acceptance
                    {
                        state = to;
                        moved += 1;
                    }
                }
                for (feature, sign) in features(&state, &pixels, hits)
                    .map(|feature| (feature, 1.0))
                    .into_iter()
                    .chain(features(&start, &pixels, hits).map(|feature| (feature, -1.0)))
                {
                    change[feature] += sign * seed.energy;
                }
            }
            for ((sum, squares), change) in sum.iter_mut().zip(&mut squares).zip(change) {
                *sum += change;
                *squares += change * change;
            }
        }
        assert!(moved > 20_000, "{kind:?}: only {moved} moves");
        let n = f64::from(replicas as u32);
        let scores: Vec<f64> = (0..FEATURES)
            .filter(|&feature| squares[feature] > 0.0)
            .map(|feature| {
                let mean = sum[feature] / n;
                mean / ((squares[feature] / n - mean * mean) / (n - 1.0)).sqrt()
            })
            .collect();
        let square = scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64;
        let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
        // METHODS 12.1 with a quarter of the features as the effective number; 40 two-sided tests of level 10⁻⁴ together
        // are 4.9 of Student's t with 149 degrees of freedom.
        let bound = 1.0 + 4.0 * (8.0 / scores.len() as f64).sqrt();
        assert!(
            square < bound && largest < 4.9,
            "{kind:?}: {moved} moves, mean z² {square:.2} {scores:.1?}"
        );
    }
}
