//! METHODS 12.3 (a): the exchange's mutations keep the distribution of weighted seeds.

use super::exchange::{Exchange, Seed, State};
use super::moves::{Move, Mutation};
use super::*;
use crate::integrator::receiver::Receiver;
use crate::sampler::Sampler;
use crate::scene::LoadOptions;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Lamps and a blocker close over a glossy floor, so that what a lamp sends changes from pixel to pixel, and a wide lamp before
/// the sky, so that many directions of the sky lead to a lamp.
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
            <translate x="-0.3" y="-0.9" z="-3.7"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.3"/>
            <translate x="0.5" y="-0.3" z="-3.9"/></transform>
            <emitter type="area"><rgb name="radiance" value="20 16 12"/></emitter></shape>
        <shape type="sphere"><point name="center" x="-0.7" y="-0.5" z="-3.8"/><float name="radius" value="0.15"/>
            <emitter type="area"><rgb name="radiance" value="20 40 60"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="3"/>
            <translate y="3" z="-4"/></transform>
            <emitter type="area"><rgb name="radiance" value="0.6 0.6 0.6"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.4 0.3 0.2"/></emitter></scene>"#,
    )
    .unwrap();
    Scene::load(&file, &LoadOptions::default()).unwrap()
}

/// Features of a state: which light it has in which block of 3 × 3 pixels, and from which of eight directions.
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
    let block = (pixel / 12 / 3 * 4 + pixel % 12 / 3) as usize;
    [16 * light + block, 16 * 4 + 8 * light + octant]
}

const FEATURES: usize = 4 * (16 + 8);

/// What the steps of chains did to the sums of energy over features, a replica of the first pass at a time.
struct Changes {
    sum: [f64; FEATURES],
    squares: [f64; FEATURES],
    /// Chains that entered or left each feature.
    moved: [u32; FEATURES],
}

impl Changes {
    fn add(&mut self, change: [f64; FEATURES]) {
        for (feature, change) in change.into_iter().enumerate() {
            self.sum[feature] += change;
            self.squares[feature] += change * change;
        }
    }

    /// z of each feature's mean change; METHODS 12.1 wants 200 contributions.
    fn scores(&self, replicas: f64) -> Vec<f64> {
        (0..FEATURES)
            .filter(|&feature| self.moved[feature] >= 200)
            .map(|feature| {
                let mean = self.sum[feature] / replicas;
                let variance = self.squares[feature] / replicas - mean * mean;
                mean / (variance / (replicas - 1.0)).sqrt()
            })
            .collect()
    }
}

#[test]
fn every_mutation_keeps_the_distribution_of_weighted_seeds() {
    let scene = scene();
    let hits = 2;
    // Marks with ragged edges, which a move that passes over unmarked pixels would favour.
    let marks = Marks::new([12, 12], 0, |pixel| hash::key(1, pixel as u32, 0) % 5 < 2);
    let pixels: Vec<u32> = marks.pixels().map(|pixel| pixel as u32).collect();
    let kinds = [Mutation::Pixel, Mutation::Direction, Mutation::Both, Mutation::Independence];
    let mut changes: [Changes; 4] = std::array::from_fn(|_| Changes {
        sum: [0.0; FEATURES],
        squares: [0.0; FEATURES],
        moved: [0; FEATURES],
    });
    let replicas = 600;
    for seed in 0..replicas {
        let rendering = VisibilityRendering::new(&scene, CorrelatedVisibility::default(), seed, 0);
        let rows: Vec<Row<'_>> =
            (0..12).map(|row| rendering.gather_row(row, hits, &marks)).collect();
        let seeds: Vec<Seed> = rows.iter().flat_map(|row| row.seeds.clone()).collect();
        let receivers: Vec<Option<Receiver<'_>>> =
            rows.into_iter().flat_map(|row| row.receivers).collect();
        let exchange = Exchange {
            scene: &scene,
            lights: &rendering.lights,
            marks: &marks,
            pixels: &pixels,
            receivers: &receivers,
            hits,
            window: 2,
        };
        for (kind, changes) in kinds.into_iter().zip(&mut changes) {
            let mut change = [0.0; FEATURES];
            for (index, seed) in seeds.iter().enumerate() {
                let mut sampler =
                    rendering.chain_sampler(Stream::Chains, 4 * index as u32 + kind as u32);
                let Some(start) = exchange.start(seed) else { continue };
                let mut state = start;
                for _ in 0..4 {
                    let next = Move { kind, ..Move::sample(2, hits, &mut sampler) };
                    if let Some((to, acceptance)) = exchange.mutate(&state, &next, &mut sampler)
                        && f64::from(sampler.next_1d()) < acceptance
                    {
                        state = to;
                    }
                }
                let [before, after] = [&start, &state].map(|state| features(state, &pixels, hits));
                for (before, after) in before.into_iter().zip(after) {
                    if before != after {
                        change[before] -= seed.energy;
                        change[after] += seed.energy;
                        changes.moved[before] += 1;
                        changes.moved[after] += 1;
                    }
                }
            }
            changes.add(change);
        }
    }
    let t = StudentsT::new(0.0, 1.0, replicas as f64 - 1.0).unwrap();
    let limit = t.inverse_cdf(1.0 - 0.5 * 1e-4 / (4.0 * FEATURES as f64));
    for (kind, changes) in kinds.into_iter().zip(&changes) {
        let scores = changes.scores(replicas as f64);
        // A jump of five degrees at most, as no other mutation, leaves the blocks of pixels alone.
        let fewest = if kind == Mutation::Direction { 4 } else { 8 };
        assert!(scores.len() >= fewest, "{kind:?}: chains move between {} features", scores.len());
        let square = scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64;
        let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
        // METHODS 12.1 with a quarter of the features as the effective number, and the level 10⁻⁴ shared by two-sided tests
        // of all features of four mutations.
        let bound = 1.0 + 4.0 * (8.0 / scores.len() as f64).sqrt();
        assert!(
            square < bound && largest < limit,
            "{kind:?}: mean z² {square:.2}, bound {bound:.2}: {scores:.1?}"
        );
    }
}
