//! Mutations of paths in rooms with mirrors and glass: each alone, then all together, must leave the light where it is.

use super::flow::{Flow, Measure, labels, seeds};
use crate::support::scenes::scene_from;
use quietlight::integrator::bdpt::Workspace;
use quietlight::mcmc::LogUniform;
use quietlight::mcmc::mutation::{Mutation, MutationSettings, Mutations};
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
const WATER: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
    <translate y="0.9" z="-3"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.33"/></bsdf></shape>"#;
const MASK: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.9"/>
    <translate x="0.6" y="1" z="-3"/></transform><bsdf type="mask"><float name="opacity" value="0.9"/>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf></shape>"#;
const MIRROR: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
    <translate y="-0.9" z="-3"/></transform><bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>"#;
const LENS: &str =
    r#"<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="3"/>"#;

/// A room of diffuse and plastic walls with a mirror ball and a glass ball, open at the front and above, with `more`,
/// such as lights; `lens` belongs to the camera.
fn room(depth: u32, more: &str, lens: &str) -> Scene {
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
        {more}
        </scene>"#
    ));
    // Walks divide by the probability of surviving roulette, paths do not.
    scene.limits.rr_depth = 100;
    scene
}

/// Each kind of light alone, then all of them through a lens and, here and there, a sheet that a tenth of the light passes; one
/// picture is a part of a film, one floor a mirror, and one camera under water.
fn rooms() -> [(&'static str, Scene); 7] {
    let mut window = room(6, POINT, "");
    window.film.crop = [3, 5, 24, 22];
    [
        ("area", room(6, AREA, "")),
        ("mirror", room(6, &format!("{AREA}{MIRROR}"), "")),
        ("water", room(6, &format!("{AREA}{WATER}"), "")),
        ("environment", room(6, CONSTANT, "")),
        ("point, window", window),
        ("directional", room(6, PARALLEL, "")),
        ("all, lens", room(6, &format!("{AREA}{CONSTANT}{POINT}{PARALLEL}{MASK}"), LENS)),
    ]
}

/// A mutation alone, in all rooms.
fn assert_balanced_alone(mutation: Mutation, samples: u32, steps: u32) {
    let mut weights = [0.0; 4];
    weights[mutation as usize] = 1.0;
    let rooms = rooms().into_iter().filter(|(what, _)| {
        // Elsewhere hardly any path is of this kind.
        mutation == Mutation::MultiChain || *what != "mirror"
    });
    for (what, scene) in rooms {
        let mut settings = MutationSettings::of(&scene);
        // Turns that are large enough to change cosines.
        settings.turn = LogUniform::new(1e-3, 0.3);
        let mutations = Mutations { scene: &scene, settings, weights };
        let flow = Flow::measure(&mutations, Measure { samples, steps });
        let kernel = flow.statistics().kernels[mutation as usize];
        assert!(kernel.accepted > 1000, "{what}: {kernel:?}");
        flow.assert_balanced(&format!("{mutation:?}, {what}"));
    }
}

#[test]
fn the_lens_perturbation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::Lens, 60_000, 20);
}

#[test]
fn the_caustic_perturbation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::Caustic, 60_000, 20);
}

#[test]
fn the_multi_chain_perturbation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::MultiChain, 60_000, 20);
}

#[test]
fn the_bidirectional_mutation_leaves_light_where_it_is() {
    assert_balanced_alone(Mutation::Bidirectional, 80_000, 3);
}

/// The bidirectional mutation is chosen seldom, and the more seldom the more others are suitable for what it makes.
fn assert_balanced_together(samples: u32) {
    let scene = room(6, &format!("{AREA}{POINT}"), LENS);
    let settings = MutationSettings::of(&scene);
    let mutations = Mutations { scene: &scene, settings, weights: [1.0, 12.0, 1.0, 1.0] };
    Flow::measure(&mutations, Measure { samples, steps: 30 }).assert_balanced("all");
}

#[test]
fn all_mutations_together_leave_light_where_it_is() {
    assert_balanced_together(60_000);
}

#[test]
#[ignore = "minutes"]
fn a_million_paths_of_each_room_stay_where_they_are() {
    for (mutation, steps) in Mutation::ALL.into_iter().zip([3, 20, 20, 20]) {
        assert_balanced_alone(mutation, 1_000_000, steps);
    }
    assert_balanced_together(1_000_000);
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

/// Cosines at both ends of the edge from `x_i` to `x_{i+1}`, and its length.
fn geometry(path: &Path<'_>, i: usize) -> ([f64; 2], f64) {
    let ((a, normal_a), (b, normal_b)) =
        (place(&path.vertices()[i]), place(&path.vertices()[i + 1]));
    let (length, direction) = ((b - a).length(), (b - a).normalize());
    ([normal_a, normal_b].map(|normal| normal.dot(direction).abs()), length)
}

/// The part of the scene that a vertex lies on, where that is diffuse: not the back wall, which has a coat.
fn diffuse_part(path: &Path<'_>, i: usize) -> Option<u32> {
    match &path.vertices()[i] {
        Vertex::Surface(surface) if surface.at.normal.z.abs() < 0.5 => Some(surface.at.part),
        _ => None,
    }
}

/// Is it on the floor of the room with a mirror?
fn is_plane_mirror(vertex: &Vertex<'_>) -> bool {
    let (position, normal) = place(vertex);
    (position.y + 0.9).abs() < 1e-4 && normal.y.abs() > 0.999
}

#[test]
fn acceptance_is_that_of_the_worked_examples() {
    // METHODS D.2: paths L D E, which the lens and the caustic perturbation change, and L D S D E with a plane mirror.
    let lens = |path: &Path<'_>| {
        let ([light, wall], length) = geometry(path, 0);
        light * wall / (length * length)
    };
    let caustic = |path: &Path<'_>| {
        let ([light, _], _) = geometry(path, 0);
        let ([wall, axis], length) = geometry(path, 1);
        light * wall / (length * length * axis.powi(3))
    };
    let multi_chain = |path: &Path<'_>| {
        let ([_, wall], _) = geometry(path, 2);
        lens(path) * wall
    };
    let scene = room(4, &format!("{AREA}{MIRROR}"), "");
    let settings =
        MutationSettings { turn: LogUniform::new(1e-3, 0.3), ..MutationSettings::of(&scene) };
    type Value<'a> = &'a dyn Fn(&Path<'_>) -> f64;
    let examples: [(Mutation, &str, Value<'_>); 3] = [
        (Mutation::Lens, "LDE", &lens),
        (Mutation::Caustic, "LDE", &caustic),
        (Mutation::MultiChain, "LDSDE", &multi_chain),
    ];
    let mut compared = [0; 3];
    for_each_path(&scene, 6000, |path, sampler| {
        for (index, (mutation, kind, value)) in examples.iter().enumerate() {
            if labels(path) != *kind {
                continue;
            }
            let Ok(proposal) = mutation.propose(&scene, &settings, path, sampler) else { continue };
            let new = &proposal.state;
            let parts = |path: &Path<'_>| [1, path.k() - 1].map(|i| diffuse_part(path, i));
            let same_parts = parts(path) == parts(new) && parts(new).iter().all(Option::is_some);
            // The plane mirror reflects everything; glass does not.
            let is_mirror = |path: &Path<'_>| path.k() < 4 || is_plane_mirror(&path.vertices()[2]);
            if same_parts && is_mirror(path) && is_mirror(new) {
                let found = proposal.forward - proposal.backward;
                let expected = (value(new) / value(path)).ln();
                // Directions are of single precision, and cosines as small as 0.01.
                assert!((found - expected).abs() < 1e-4, "{mutation:?}: {found}, {expected}");
                compared[index] += 1;
            }
        }
    });
    assert!(compared.iter().all(|&compared| compared > 100), "{compared:?}");
}
