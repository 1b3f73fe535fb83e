//! Mutations of paths in rooms with mirrors and glass: each alone, then all together, must leave the light where it is.

use super::flow::{Flow, Measure, labels, seeds};
use crate::support::scenes::scene_from;
use quietlight::integrator::bdpt::Workspace;
use quietlight::mcmc::mutation::{Mutation, MutationSettings};
use quietlight::sampler::IndependentSampler;
use quietlight::scene::Scene;
use quietlight::transport::{LightVertex, Path, Vertex};
use std::collections::BTreeMap;

const AREA: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.5"/>
    <translate y="1.4" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#;
const CONSTANT: &str =
    r#"<emitter type="constant"><rgb name="radiance" value="1 0.7 0.4"/></emitter>"#;
const POINT: &str = r#"<emitter type="point"><point name="position" x="0.1" y="1.3" z="-2.7"/>
    <rgb name="intensity" value="2 2 1"/></emitter>"#;
const PARALLEL: &str = r#"<emitter type="directional"><vector name="direction" x="0.2" y="-1" z="-0.4"/>
    <rgb name="irradiance" value="2"/></emitter>"#;
const LENS: &str =
    r#"<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="3"/>"#;

/// A room of diffuse and plastic walls with a mirror ball and a glass ball, open at the front and above, in the light of
/// `light`; `lens` belongs to the camera.
fn room(depth: u32, light: &str, lens: &str) -> Scene {
    let sensor = if lens.is_empty() { "perspective" } else { "thinlens" };
    let mut scene = scene_from(&format!(
        r#"<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>
        <sensor type="{sensor}"><float name="fov" value="60"/>{lens}
            <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/>
                <rfilter type="box"/></film>
        </sensor>
        <bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.2 0.1"/></bsdf></bsdf>
        <bsdf type="twosided" id="blue"><bsdf type="diffuse"><rgb name="reflectance" value="0.2 0.3 0.8"/></bsdf></bsdf>
        <bsdf type="twosided" id="plastic"><bsdf type="plastic">
            <rgb name="diffuse_reflectance" value="0.6 0.6 0.5"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/>
            <translate y="-1" z="-3"/></transform><ref id="blue"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-4.5"/></transform>
            <ref id="plastic"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><scale value="2"/>
            <translate x="-1.5" z="-3"/></transform><ref id="red"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="-90"/><scale value="2"/>
            <translate x="1.5" z="-3"/></transform><ref id="red"/></shape>
        <shape type="sphere"><point name="center" x="-0.6" y="-0.4" z="-3.2"/><float name="radius" value="0.6"/>
            <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
        <shape type="sphere"><point name="center" x="0.6" y="-0.4" z="-2.8"/><float name="radius" value="0.55"/>
            <bsdf type="dielectric"/></shape>
        {light}
        </scene>"#
    ));
    // Walks divide by the probability of surviving roulette, paths do not.
    scene.limits.rr_depth = 100;
    scene
}

/// All of one light, or all lights, through a pinhole; then a lens.
fn rooms() -> [(&'static str, Scene); 5] {
    [
        ("area", room(6, AREA, "")),
        ("environment", room(6, CONSTANT, "")),
        ("point", room(6, POINT, "")),
        ("directional", room(6, PARALLEL, "")),
        ("all, lens", room(6, &format!("{AREA}{CONSTANT}{POINT}{PARALLEL}"), LENS)),
    ]
}

/// A mutation alone, in all rooms.
fn assert_balanced_alone(mutation: Mutation, samples: u32, steps: u32) {
    let mut weights = [0.0; 4];
    weights[mutation as usize] = 1.0;
    for (what, scene) in rooms() {
        let flow = Flow::measure(&scene, Measure { weights, samples, steps });
        let kernel = flow.statistics().kernels[mutation as usize];
        assert!(kernel.accepted > 1000, "{what}: {kernel:?}");
        if std::env::var_os("SHOW").is_some() {
            eprintln!("{what}: {}", flow.statistics().lines(&Mutation::NAMES).join("\n"));
        }
        flow.assert_balanced(&format!("{mutation:?}, {what}"));
    }
}

#[test]
fn the_lens_perturbation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::Lens, 100_000, 20);
}

#[test]
fn the_caustic_perturbation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::Caustic, 100_000, 20);
}

#[test]
fn the_multi_chain_perturbation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::MultiChain, 150_000, 20);
}

#[test]
fn the_bidirectional_mutation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::Bidirectional, 150_000, 3);
}

#[test]
fn all_mutations_together_leave_light_where_it_is() {
    let scene = room(6, &format!("{AREA}{POINT}"), LENS);
    let flow = Flow::measure(&scene, Measure { weights: [1.0; 4], samples: 200_000, steps: 5 });
    flow.assert_balanced("all");
}

/// Some paths that the walks in `scene` find.
fn for_each_path(
    scene: &Scene,
    samples: u32,
    mut see: impl FnMut(&Path<'_>, &mut IndependentSampler),
) {
    for index in 0..samples {
        let mut sampler = IndependentSampler::new(12, index, 0);
        for (path, _) in seeds(scene, &mut sampler, &mut Workspace::default(), &|_| true) {
            see(&path, &mut sampler);
        }
    }
}

#[test]
fn mutations_are_suitable_for_the_paths_of_the_golden_table() {
    // METHODS 5.7: lens, caustic, multi-chain.
    let golden = [
        ("LE", [true, false, false]),
        ("LDE", [true, true, false]),
        ("LSE", [true, false, false]),
        ("LDDE", [true, true, false]),
        ("LSDE", [false, true, false]),
        ("LDSE", [true, false, false]),
        ("LSSE", [true, false, false]),
        ("LDDDE", [true, true, false]),
        ("LDDSE", [true, false, false]),
        ("LDSDE", [false, true, true]),
        ("LSDDE", [true, true, false]),
        ("LSDSE", [false, false, false]),
        ("LDSSE", [true, false, false]),
        ("LSSDE", [false, true, false]),
        ("LDSDSE", [false, false, true]),
        ("LDSDDE", [true, true, false]),
        ("LDDSDE", [false, true, true]),
        ("LDSDSDE", [false, true, true]),
    ];
    let scene = room(7, &format!("{AREA}{POINT}"), "");
    let mut seen: BTreeMap<String, [bool; 3]> = BTreeMap::new();
    for_each_path(&scene, 20_000, |path, _| {
        let suitable = [Mutation::Lens, Mutation::Caustic, Mutation::MultiChain]
            .map(|mutation| mutation.is_suitable(path));
        let known = seen.entry(labels(path)).or_insert(suitable);
        assert_eq!(*known, suitable);
        assert!(Mutation::Bidirectional.is_suitable(path));
    });
    let mut found = 0;
    for (labels, expected) in golden {
        if let Some(&suitable) = seen.get(labels) {
            assert_eq!(suitable, expected, "{labels}");
            found += 1;
        }
    }
    assert!(found >= 16, "{found} of {:?}", seen.keys());
}

#[test]
fn what_a_mutation_makes_is_what_its_vertices_say() {
    // A proposal's numbers belong to the path that is left when it is stored.
    for (what, scene) in rooms() {
        let settings = MutationSettings::of(&scene);
        let mut compared = 0;
        for_each_path(&scene, 300, |path, sampler| {
            for mutation in Mutation::ALL.into_iter().filter(|mutation| mutation.is_suitable(path))
            {
                let Ok(proposal) = mutation.propose(&scene, &settings, path, sampler) else {
                    continue;
                };
                let new = &proposal.state;
                let (vertices, events) = (new.vertices().to_vec(), new.events().to_vec());
                let again = Path::new(&scene, vertices, events).expect("a path");
                let is_close = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-12 * a.abs().max(1.0);
                assert!(is_close(new.ln_value(), again.ln_value()), "{what}");
                for s in 0..=new.k() {
                    assert!(is_close(new.ln_contribution(s), again.ln_contribution(s)), "{what}");
                }
                if mutation != Mutation::Bidirectional {
                    assert_eq!(labels(path), labels(new), "{what}");
                }
                assert!(Mutation::is_suitable(mutation, new));
                compared += 1;
            }
        });
        assert!(compared > 300, "{what}: {compared}");
    }
}

/// Position and, but for the lens, unit normal.
fn place(vertex: &Vertex<'_>) -> (glam::DVec3, glam::DVec3) {
    match vertex {
        Vertex::Surface(surface) => (surface.at.position.as_dvec3(), surface.at.normal.as_dvec3()),
        Vertex::Light(LightVertex {
            point: quietlight::emitter::LightPoint::Surface { position, normal, .. },
            ..
        }) => (position.as_dvec3(), normal.as_dvec3()),
        Vertex::Lens { position, .. } => (position.as_dvec3(), glam::DVec3::NEG_Z),
        Vertex::Light(_) => panic!("an area light"),
    }
}

#[test]
fn acceptance_is_that_of_the_worked_examples() {
    // METHODS D.2, examples 1 and 2: paths L D E on one diffuse wall, whose value does not depend on directions.
    let mut scene = room(2, AREA, "");
    scene.limits.max_depth = Some(2);
    let settings = MutationSettings::of(&scene);
    let geometry = |path: &Path<'_>, i: usize| {
        let ((a, normal_a), (b, normal_b)) =
            (place(&path.vertices()[i]), place(&path.vertices()[i + 1]));
        let (length, direction) = ((b - a).length(), (b - a).normalize());
        let cosines = [normal_a, normal_b].map(|normal| normal.dot(direction).abs());
        (cosines, length)
    };
    let lens = |path: &Path<'_>| {
        let ([light, wall], length) = geometry(path, 0);
        light * wall / (length * length)
    };
    let caustic = |path: &Path<'_>| {
        let ([light, _], _) = geometry(path, 0);
        let ([wall, axis], length) = geometry(path, 1);
        light * wall / (length * length * axis.powi(3))
    };
    let examples: [(Mutation, &dyn Fn(&Path<'_>) -> f64); 2] =
        [(Mutation::Lens, &lens), (Mutation::Caustic, &caustic)];
    let mut compared = [0, 0];
    for_each_path(&scene, 3000, |path, sampler| {
        // The floor, which is diffuse throughout.
        let is_floor = |path: &Path<'_>| place(&path.vertices()[1]).1.y > 0.999;
        if labels(path) != "LDE" || !is_floor(path) {
            return;
        }
        for (index, (mutation, expected)) in examples.iter().enumerate() {
            let Ok(proposal) = mutation.propose(&scene, &settings, path, sampler) else { continue };
            if !is_floor(&proposal.state) {
                continue;
            }
            let found = proposal.forward - proposal.backward;
            let expected = (expected(&proposal.state) / expected(path)).ln();
            // Directions are of single precision, and cosines as small as 0.01.
            assert!((found - expected).abs() < 1e-4, "{mutation:?}: {found}, {expected}");
            compared[index] += 1;
        }
    });
    assert!(compared.iter().all(|&compared| compared > 300), "{compared:?}");
}
