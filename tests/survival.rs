//! What a render has found survives: it goes on elsewhere, in parts, and with other seeds, and the picture is the same.

use crate::determinism::methods;
use crate::support::scenes::{render_finite, scene_around, settings};
use quietlight::integrator::{Integrator, PathTracing, Strategy};
use quietlight::render::{
    Average, AverageError, Budget, NotEnoughMemory, RenderSettings, Rendered, Rendering, Shard,
    State, StateError, check_memory,
};
use quietlight::scene::{FilmSettings, Scene};
use quietlight_denoise::exr::{Contents, Frame};
use quietlight_denoise::{LayerKind, Layers};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

fn scene() -> Scene {
    scene_around(
        24,
        60.0,
        6,
        r#"<shape type="sphere"><point name="center" x="0" y="0" z="-3"/><bsdf type="roughplastic"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="2" z="-3"/></transform>
        <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.3"/></emitter>"#,
    )
}

fn all_methods() -> Vec<Integrator> {
    let path = Integrator::Path(PathTracing::default());
    std::iter::once(path).chain(methods()).collect()
}

/// Passes of one sample, so that there are many.
fn of(integrator: Integrator, samples: u32) -> RenderSettings {
    RenderSettings { integrator, pass: Duration::ZERO, ..settings(samples, 5, Strategy::Mis) }
}

fn assert_same_bits(found: &Rendered, expected: &Rendered, what: &str) {
    assert_eq!(found.samples, expected.samples, "{what}");
    assert_eq!(found.report, expected.report, "{what}");
    assert_eq!(found.invalid_samples, expected.invalid_samples, "{what}");
    assert_eq!(found.layers.samples, expected.layers.samples, "{what}");
    assert_eq!(found.layers.layers.len(), expected.layers.layers.len(), "{what}");
    for (kind, layer) in &expected.layers.layers {
        let other = &found.layers.layers[kind];
        assert_eq!(layer.mean, other.mean, "{kind:?}, {what}");
        assert_eq!(layer.variance, other.variance, "variance of {kind:?}, {what}");
        assert_eq!(layer.halves, other.halves, "halves of {kind:?}, {what}");
    }
}

/// Runs until `calls` reports of progress came, or all is done; whether all is done.
fn run_for(rendering: &mut Rendering<'_>, budget: Budget, calls: u64) -> bool {
    let (stop, seen) = (AtomicBool::new(false), AtomicU64::new(0));
    let progress = |_| {
        if seen.fetch_add(1, Ordering::Relaxed) + 1 >= calls {
            stop.store(true, Ordering::Relaxed);
        }
    };
    rendering.run(budget, &progress, &stop);
    !stop.load(Ordering::Relaxed)
}

#[test]
fn a_render_that_is_ended_and_resumed_over_and_over_is_the_one_that_was_not() {
    let scene = scene();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("picture.checkpoint");
    for integrator in all_methods() {
        // Enough for several rounds of each method: 576 pixels make 576 000 mutations in rounds of 131 072, or
        // passes of 16 for each; rounds of 256 samples; rounds of 8 hits in each half.
        let samples = match integrator {
            Integrator::Path(_) => 21,
            Integrator::Bdpt(_) => 1100,
            Integrator::Visibility(_) => 64,
            _ => 1000,
        };
        let settings = of(integrator, samples);
        let whole = render_finite(&scene, &settings);
        let mut times = 0;
        let mut rendering = Rendering::new(&scene, &settings);
        // On one thread and on three, in turns.
        let pools = [1, 3].map(|threads| {
            let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
            builder.build().expect("threads")
        });
        while !pools[times % 2].install(|| run_for(&mut rendering, settings.budget, 1)) {
            rendering.state().write(&path).expect("the state is written");
            let state = State::read(&path).expect("the state is whole");
            rendering = Rendering::resume(&scene, &settings, state).expect("it is the same render");
            times += 1;
        }
        assert!(times >= 3, "{}: resumed {times} times", integrator.name());
        assert!(rendering.state().header.is_complete);
        assert_same_bits(&rendering.finish(), &whole, integrator.name());
    }
}

#[test]
fn an_adaptive_render_that_is_ended_in_its_pilot_and_after_it_is_the_one_that_was_not() {
    let scene = scene();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("picture.checkpoint");
    let settings = RenderSettings { is_adaptive: true, ..of(PathTracing::default().into(), 83) };
    let spread = |rendering: &mut Rendering<'_>| {
        let pilot = &rendering.layers().layers[&LayerKind::Beauty].mean;
        let brightness = pilot.slice(ndarray::s![0..1, .., ..]).to_owned();
        rendering.spread(Some(&brightness));
    };
    let mut whole = Rendering::new(&scene, &settings);
    whole.run(settings.budget, &|_| {}, &AtomicBool::new(false));
    assert!(whole.is_pilot() && whole.samples() == 20 && !whole.state().header.is_complete);
    spread(&mut whole);
    whole.run(settings.budget, &|_| {}, &AtomicBool::new(false));
    assert!(whole.state().header.is_complete);
    let whole = whole.finish();

    let mut rendering = Rendering::new(&scene, &settings);
    let (mut in_pilot, mut after) = (0, 0);
    while !rendering.state().header.is_complete {
        if run_for(&mut rendering, settings.budget, 5) && rendering.is_pilot() {
            spread(&mut rendering);
        }
        rendering.state().write(&path).expect("the state is written");
        let state = State::read(&path).expect("the state is whole");
        rendering = Rendering::resume(&scene, &settings, state).expect("it is the same render");
        if rendering.is_pilot() { in_pilot += 1 } else { after += 1 }
    }
    assert!(in_pilot >= 3 && after >= 3, "resumed {in_pilot} and {after} times");
    assert_same_bits(&rendering.finish(), &whole, "adaptive");
    // Even samples do not go on from it, nor it from a longer one.
    for other in [
        RenderSettings { is_adaptive: false, ..settings },
        RenderSettings { budget: Budget::Samples(84), ..settings },
    ] {
        let state = State::read(&path).expect("the state is whole");
        assert!(Rendering::resume(&scene, &other, state).is_err(), "{other:?}");
    }
}

/// Renders all shards, each on another number of threads, into files.
fn shards(scene: &Scene, settings: &RenderSettings, count: u32, folder: &Path) -> Vec<PathBuf> {
    let render = |index: u32| {
        let shard: Shard = format!("{index}/{count}").parse().expect("a shard");
        let mut rendering = Rendering::new(scene, &RenderSettings { shard, ..*settings });
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1 + index as usize % 3).build();
        pool.expect("threads").install(|| {
            rendering.run(settings.budget, &|_| {}, &AtomicBool::new(false));
        });
        let path = folder.join(format!("{index}-of-{count}"));
        rendering.state().write(&path).expect("the state is written");
        path
    };
    (0..count).map(render).collect()
}

#[test]
fn the_parts_of_several_machines_are_the_picture_of_one_to_the_last_bit() {
    let scene = scene();
    let folder = tempfile::tempdir().expect("a temporary folder");
    for integrator in all_methods() {
        // Chains are of few mutations then, so that each part has some.
        let settings = of(integrator, 37);
        let whole = render_finite(&scene, &settings);
        for count in [1, 2, 5] {
            let mut paths = shards(&scene, &settings, count, folder.path());
            paths.rotate_left(1);
            paths.reverse();
            let merged = State::merged(&paths).expect("all parts are there").finish();
            assert_same_bits(&merged, &whole, &format!("{} in {count}", integrator.name()));
        }
    }
}

#[test]
fn parts_that_are_missing_doubled_unfinished_or_of_something_else_are_refused() {
    let scene = scene();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let settings = of(PathTracing::default().into(), 4);
    let paths = shards(&scene, &settings, 3, folder.path());
    let refused = |paths: &[PathBuf], expected: &str| {
        let error = State::merged(paths).expect_err("it does not fit").to_string();
        assert!(error.contains(expected), "{error} should tell {expected}");
    };
    let pick = |indices: &[usize]| indices.iter().map(|&i| paths[i].clone()).collect::<Vec<_>>();
    refused(&pick(&[0, 2]), "part 1 of 3 is missing");
    refused(&pick(&[0, 1, 2, 1]), "are both part 1 of 3");
    refused(&[], "none");
    let other = |name: &str, change: RenderSettings, samples: u32| {
        let shard = "1/3".parse().expect("a shard");
        let mut rendering = Rendering::new(&scene, &RenderSettings { shard, ..change });
        rendering.advance(samples, &|_| {}, &AtomicBool::new(false));
        let path = folder.path().join(name);
        rendering.state().write(&path).expect("the state is written");
        vec![paths[0].clone(), path, paths[2].clone()]
    };
    let seed = RenderSettings { seed: 6, ..settings };
    refused(&other("seed", seed, 4), "seed 6 and not 5");
    let more = RenderSettings { budget: Budget::Samples(8), ..settings };
    refused(&other("more", more, 8), "8 samples per pixel and not 4");
    refused(&other("unfinished", settings, 1), "is not done");
    let method = RenderSettings { integrator: methods()[0], ..settings };
    refused(&other("method", method, 4), "integrator bdpt and not path");
    let mut brighter = scene_around(24, 60.0, 6, r#"<emitter type="constant"/>"#);
    let shard = "1/3".parse().expect("a shard");
    let state = |scene: &Scene| {
        let rendering = Rendering::new(scene, &RenderSettings { shard, ..settings });
        rendering.state().header.plan.scene
    };
    assert_ne!(state(&brighter), state(&scene));
    let before = state(&brighter);
    brighter.limits.max_depth = Some(3);
    assert_ne!(state(&brighter), before);
}

#[test]
fn a_checkpoint_of_another_render_is_not_gone_on_from() {
    let scene = scene();
    let settings = of(PathTracing::default().into(), 4);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("state");
    let checkpoint = |settings: &RenderSettings| {
        let mut rendering = Rendering::new(&scene, settings);
        rendering.advance(2, &|_| {}, &AtomicBool::new(false));
        rendering.state().write(&path).expect("the state is written");
    };
    let resumed = |settings: &RenderSettings| {
        let state = State::read(&path).expect("the state is whole");
        Rendering::resume(&scene, settings, state).map(|_| ()).map_err(|error| error.to_string())
    };
    checkpoint(&settings);
    // Path tracing may go on to more samples than it was begun for.
    let more = RenderSettings { budget: Budget::Samples(9), ..settings };
    assert_eq!(resumed(&more), Ok(()));
    let error = resumed(&RenderSettings { seed: 1, ..settings }).expect_err("another seed");
    assert!(error.contains("seed 5 and not 1"), "{error}");
    let error = resumed(&RenderSettings { shard: "0/2".parse().expect("a shard"), ..settings });
    assert!(error.expect_err("another shard").contains("shard 0/1 and not 0/2"));
    // The chains of more mutations would be others.
    let mlt = of(methods()[3], 4);
    checkpoint(&mlt);
    let error = resumed(&RenderSettings { budget: Budget::Samples(9), ..mlt });
    let error = error.expect_err("another budget");
    assert!(error.contains("4 samples per pixel and not 9"), "{error}");
}

#[test]
fn a_file_that_is_damaged_anywhere_or_cut_off_is_refused() {
    let scene = scene();
    let settings = of(methods()[3], 2);
    let mut rendering = Rendering::new(&scene, &settings);
    rendering.advance(2, &|_| {}, &AtomicBool::new(false));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("state");
    rendering.state().write(&path).expect("the state is written");
    let whole = std::fs::read(&path).expect("the state is there");
    assert!(State::read(&path).is_ok());
    let steps = 97;
    let is_refused = |bytes: &[u8], what: &str| {
        std::fs::write(&path, bytes).expect("a file");
        let read = State::read(&path);
        assert!(matches!(read, Err(StateError::Broken { .. })), "{what}");
    };
    for step in 0..=steps {
        let at = step * (whole.len() - 1) / steps;
        let mut broken = whole.clone();
        broken[at] ^= 1 << (step % 8);
        is_refused(&broken, &format!("one bit of byte {at} is wrong"));
        is_refused(&whole[..at], &format!("{at} bytes are left"));
    }
    is_refused(&[&whole[..], b"more"].concat(), "more behind it");
    let missing = State::read(&folder.path().join("missing"));
    assert!(matches!(missing, Err(StateError::Io { .. })));
}

/// A picture as it would be read from its file.
fn written(rendered: Rendered, seed: &str) -> Contents {
    let mut layers = rendered.layers;
    let facts = [
        ("seed", seed.to_owned()),
        ("samples", rendered.samples.to_string()),
        ("invalid_samples", "0".to_owned()),
        ("seconds", "1.5".to_owned()),
        ("integrator", "path".to_owned()),
        ("integrator_settings", "usual".to_owned()),
        ("strategy", "Mis".to_owned()),
        ("version", "0".to_owned()),
        ("scene_identity", "0".to_owned()),
        ("denoiser", "none".to_owned()),
    ];
    layers.metadata.extend(facts.map(|(name, value)| (name.to_owned(), value)));
    let frame = Frame::whole(layers.width, layers.height);
    Contents { layers, picture: None, frame, ignored: Vec::new() }
}

/// Pictures of so many samples, with seeds from 1 on.
fn pictures(scene: &Scene, samples: &[u32]) -> Vec<Contents> {
    let one = |(&samples, seed): (&u32, u64)| {
        written(render_finite(scene, &settings(samples, seed, Strategy::Mis)), &seed.to_string())
    };
    samples.iter().zip(1..).map(one).collect()
}

fn average(pictures: Vec<Contents>) -> Layers {
    let mut pictures = pictures.into_iter();
    let mut average = Average::new("1", pictures.next().expect("a picture")).expect("known");
    pictures.for_each(|picture| average.add("next", picture).expect("of the same render"));
    average.finish().0
}

#[test]
fn pictures_of_other_seeds_average_by_their_samples() {
    let scene = scene();
    let parts = pictures(&scene, &[5, 11]);
    let found = average(parts.clone());
    assert_eq!(found.metadata["seed"], "1, 2");
    assert_eq!((&*found.metadata["samples"], &*found.metadata["seconds"]), ("16", "3.000"));
    assert!(!found.metadata.contains_key("denoiser"));
    assert!(found.samples.as_ref().is_some_and(|n| n.iter().all(|&n| n == 16.0)));
    let [a, b] = [0, 1].map(|part: usize| &parts[part].layers.layers);
    for (kind, layer) in &found.layers {
        let check = |found: f32, expected: f64, what: &str| {
            let error = (f64::from(found) - expected).abs();
            assert!(
                error <= 1e-6 * expected.abs() + 1e-12,
                "{what} of {kind:?}: {found} {expected}"
            );
        };
        let (a, b) = (&a[kind], &b[kind]);
        let [va, vb] = [a, b].map(|layer| layer.variance.as_ref().expect("a variance"));
        let [ha, hb] = [a, b].map(|layer| layer.halves.as_ref().expect("halves"));
        for (at, &mean) in layer.mean.indexed_iter() {
            let of =
                |x: f32, y: f32, [m, n]: [f64; 2]| (m * f64::from(x) + n * f64::from(y)) / (m + n);
            check(mean, of(a.mean[at], b.mean[at], [5.0, 11.0]), "mean");
            let halves = layer.halves.as_ref().expect("halves");
            // Of five samples three are of even index.
            check(halves[0][at], of(ha[0][at], hb[0][at], [3.0, 6.0]), "half A");
            check(halves[1][at], of(ha[1][at], hb[1][at], [2.0, 5.0]), "half B");
            let variance = 25.0 * f64::from(va[at]) + 121.0 * f64::from(vb[at]);
            check(layer.variance.as_ref().expect("a variance")[at], variance / 256.0, "variance");
        }
    }
}

/// Sixteen pictures of four samples against one of 64, in error and in what both say of it.
#[test]
fn pictures_of_other_seeds_are_as_good_as_one_longer_render_and_say_so() {
    let scene = scene();
    let reference = render_finite(&scene, &settings(4096, 99, Strategy::Mis));
    let reference = &reference.layers.layers[&LayerKind::Beauty].mean;
    let judge = |layers: &Layers| {
        let layer = &layers.layers[&LayerKind::Beauty];
        let squared: f64 =
            layer.mean.iter().zip(reference).map(|(x, r)| f64::from((x - r) * (x - r))).sum();
        let told: f64 =
            layer.variance.as_ref().expect("a variance").iter().map(|&v| f64::from(v)).sum();
        let halves = layer.halves.as_ref().expect("halves");
        let by_halves: f64 = halves[0]
            .iter()
            .zip(&halves[1])
            .map(|(a, b)| 0.25 * f64::from((a - b) * (a - b)))
            .sum();
        [squared, told, by_halves]
    };
    let merged = judge(&average(pictures(&scene, &[4; 16])));
    let longer = judge(&render_finite(&scene, &settings(64, 50, Strategy::Mis)).layers);
    // Each is a sum over 1728 squared errors, dependent in threes; a single one's relative standard deviation is below 3 for
    // this scene's mildly skewed pixels: 3 / √576 = 0.125 of each sum, and five of that for a ratio of two is 0.88.
    for (what, ratio) in [
        ("error", merged[0] / longer[0]),
        ("variance told", merged[1] / longer[1]),
        ("variance told against error", merged[1] / merged[0]),
        ("variance by the halves", merged[2] / merged[1]),
    ] {
        assert!((1.0 / 1.88..1.88).contains(&ratio), "{what}: {ratio}; {merged:?} {longer:?}");
    }
}

#[test]
fn pictures_of_the_same_seed_or_of_something_else_are_refused() {
    let scene = scene();
    let [first, second] = <[Contents; 2]>::try_from(pictures(&scene, &[2, 2])).expect("two");
    let added = |change: &dyn Fn(&mut Contents)| {
        let mut other = second.clone();
        change(&mut other);
        let mut average = Average::new("a.exr", first.clone()).expect("known");
        average.add("b.exr", other).expect_err("it does not fit")
    };
    let set = |name: &'static str, value: &'static str| {
        move |contents: &mut Contents| {
            contents.layers.metadata.insert(name.to_owned(), value.to_owned());
        }
    };
    let same =
        AverageError::SameSeed { name: "b.exr".into(), other: "a.exr".into(), seed: "1".into() };
    assert_eq!(added(&set("seed", "7, 1")), same);
    for fact in ["scene_identity", "integrator_settings", "strategy", "integrator", "version"] {
        let error = added(&set(fact, "other")).to_string();
        assert!(error.contains(fact) && error.contains("b.exr"), "{error}");
    }
    let error = added(&|contents| contents.frame.offset = (3, 0)).to_string();
    assert!(error.contains("size is 24x24 at 3,0"), "{error}");
    let error = added(&|contents| {
        contents.layers.metadata.remove("seed");
    });
    assert_eq!(error, AverageError::Unknown { name: "b.exr".into(), fact: "seed" });
    // One sample tells nothing of its own error.
    let found = average(pictures(&scene, &[1, 8]));
    assert!(found.layers.values().all(|layer| layer.variance.is_none() && layer.halves.is_none()));
}

#[test]
fn a_picture_that_cannot_be_held_is_refused_with_its_size() {
    let huge = |size: u32| {
        let mut scene = scene_around(16, 60.0, 6, r#"<emitter type="constant"/>"#);
        scene.film = FilmSettings { width: size, height: size, crop: [0, 0, size, size] };
        scene
    };
    for integrator in all_methods() {
        let settings = of(integrator, 1);
        let error = check_memory(&huge(60_000), &settings).expect_err("terabytes");
        assert!(matches!(error, NotEnoughMemory::Picture { needed, .. } if needed > 1 << 40));
        assert!(error.to_string().contains("60000x60000 pixels takes about"), "{error}");
        assert_eq!(check_memory(&huge(16), &settings), Ok(()));
    }
    let mut cropped = huge(1_000_000);
    cropped.film.crop = [0, 0, 16, 16];
    let error = check_memory(&cropped, &of(PathTracing::default().into(), 1));
    assert!(matches!(error, Err(NotEnoughMemory::Film { .. })), "{error:?}");
}
