//! What is told of a scene before it is rendered. How long things take is not asserted: machines differ.

use quietlight::integrator::{Bdpt, Integrator, PathTracing};
use quietlight::render::probe::{self, Cost};
use quietlight::render::survey::Survey;
use quietlight::render::{Budget, RenderSettings};
use quietlight::scene::{Inventory, LoadOptions, Scene};
use quietlight_denoise::Denoiser;
use std::fs;
use std::time::Duration;
use tempfile::TempDir;

const CAMERA: &str = "<sensor type='perspective'><float name='fov' value='90'/>
    <transform name='to_world'><lookat origin='0, 0, 4' target='0, 0, 0' up='0, 1, 0'/></transform>
    <film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='24'/></film></sensor>";

fn load(content: &str) -> Scene {
    let folder = TempDir::new().expect("a temporary folder");
    for (width, height, name) in [(2, 1, "a.png"), (3, 3, "b.png")] {
        let path = folder.path().join(name);
        image::RgbImage::new(width, height).save(path).expect("an image");
    }
    let text = format!("<scene version='3.0.0'>{CAMERA}{content}</scene>");
    fs::write(folder.path().join("scene.xml"), text).expect("a file");
    Scene::load(folder.path(), &LoadOptions::default()).expect("a scene")
}

#[test]
fn an_inventory_counts_what_surfaces_have_and_no_image_twice() {
    let bitmap = |file: &str| {
        format!(
            "<texture type='bitmap' name='reflectance'><string name='filename' value='{file}'/></texture>"
        )
    };
    let (a, b) = (bitmap("a.png"), bitmap("b.png"));
    let scene = load(&format!(
        "<bsdf type='diffuse' id='wood'>{a}</bsdf>
        <shape type='cube'><ref id='wood'/></shape>
        <shape type='cube'><transform name='to_world'><translate x='10'/></transform><ref id='wood'/></shape>
        <shape type='sphere'><float name='radius' value='0.5'/><bsdf type='mask'><float name='opacity' value='0.5'/>
            <bsdf type='blendbsdf'><bsdf type='diffuse'>{b}</bsdf><bsdf type='diffuse'>{a}</bsdf></bsdf></bsdf></shape>
        <shape type='sphere'><bsdf type='dielectric'/></shape>
        <shape type='rectangle'><emitter type='area'><rgb name='radiance' value='2'/></emitter></shape>
        <emitter type='point'><rgb name='intensity' value='1'/></emitter>
        <emitter type='point'><rgb name='intensity' value='0'/></emitter>
        <emitter type='envmap'><string name='filename' value='b.png'/></emitter>"
    ));
    let inventory = Inventory::of(&scene);
    let lobes: Vec<_> = inventory.lobes.into_iter().collect();
    // The rectangle has the black material of shapes that shine and name none.
    assert_eq!(lobes, [("diffuse", 4), ("glass", 1), ("mask", 1)]);
    assert_eq!((inventory.materials, inventory.delta_materials), (4, 1));
    assert_eq!((inventory.masked_materials, inventory.relief_materials), (1, 0));
    let emitters: Vec<_> = inventory.emitters.into_iter().collect();
    assert_eq!(emitters, [("area", 1), ("environment map", 1), ("point", 2)]);
    // The square of 2×2 sends 4·2·π W, the point 4·π; a black environment and a black point nothing.
    let [low, high] = inventory.power.expect("there is light");
    let pi = std::f64::consts::PI;
    assert!((low - 4.0 * pi).abs() < 1e-5 && (high - 8.0 * pi).abs() < 1e-5, "{low} {high}");
    let images: Vec<_> = inventory.images.iter().map(|image| (image.width, image.bytes)).collect();
    assert_eq!(images, [(3, 27), (2, 6)]);
    assert_eq!(inventory.environment_map, Some([3, 3]));
    let [low, high] = inventory.bounds.expect("there are shapes");
    // Boxes of spheres are a little wider, so that no hit is missed.
    assert!((low.x + 1.0).abs() < 1e-6 && (high.x - 11.0).abs() < 1e-6, "{low} {high}");
    // The box around the sphere of radius 1/2 is the unit cube.
    let smallest = inventory.smallest_part.expect("there are shapes");
    assert!((smallest - 3f64.sqrt()).abs() < 1e-6, "{smallest}");
}

#[test]
fn a_survey_counts_mirrors_in_a_row_at_any_number_of_threads() {
    // From the camera at 4 to a mirror at the origin, back past the camera to one at 5, and so on, to the end of the path.
    let mirrors = load(
        "<integrator type='path'><integer name='max_depth' value='6'/></integrator>
        <bsdf type='twosided' id='m'><bsdf type='conductor'/></bsdf>
        <shape type='rectangle'><transform name='to_world'><scale value='1000'/></transform><ref id='m'/></shape>
        <shape type='rectangle'><transform name='to_world'><scale value='1000'/><translate z='5'/></transform>
        <ref id='m'/></shape><emitter type='constant'/>",
    );
    let survey = |scene: &Scene, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| Survey::of(scene, &RenderSettings::default()))
    };
    let found = survey(&mirrors, 1);
    assert_eq!(found, survey(&mirrors, 3));
    assert_eq!((found.delta_hits, found.longest_delta_chain, found.background), (1.0, 6, 0.0));

    // With a wall in the second one's place no two mirrors follow each other.
    let mirror_and_wall = load(
        "<integrator type='path'><integer name='max_depth' value='6'/></integrator>
        <shape type='rectangle'><transform name='to_world'><scale value='1000'/></transform>
            <bsdf type='conductor'/></shape>
        <shape type='rectangle'><transform name='to_world'><scale value='1000'/><rotate y='1' angle='180'/>
            <translate z='5'/></transform><bsdf type='diffuse'><rgb name='reflectance' value='1'/></bsdf></shape>
        <emitter type='constant'/>",
    );
    let found = survey(&mirror_and_wall, 2);
    assert!(found.hits > 2.5 && found.longest_delta_chain == 1, "{found:?}");

    // A white furnace: radiance 1 everywhere, whatever is hit; with nothing to hit all of it is background.
    let empty = survey(&load("<emitter type='constant'/>"), 2);
    assert_eq!((empty.hits, empty.background, empty.invalid), (0.0, 1.0, 0));
    assert!((empty.mean - 1.0).abs() < 1e-6 && (empty.brightest_sample - 1.0).abs() < 1e-6);
    let [low, high] = empty.cells.expect("there is light");
    assert!((low - 1.0).abs() < 1e-6 && (high - 1.0).abs() < 1e-6);
    assert_eq!(survey(&load("<shape type='cube'/>"), 2).cells, None);
}

#[test]
fn a_predicted_cost_grows_with_samples_pixels_and_layers() {
    let length = Duration::from_millis(5);
    let cost = |content: &str, integrator: Integrator| {
        let budget = Budget::Samples(64);
        let settings = RenderSettings { integrator, budget, ..RenderSettings::default() };
        probe::cost(&load(content), &settings, length)
    };
    let check = |cost: Cost| {
        assert_eq!(cost.pixels, 40 * 24);
        assert!(cost.seconds_per_sample_per_pixel > 0.0 && cost.fixed_seconds >= 0.0, "{cost:?}");
        assert!(cost.uncertainty >= 0.1 && cost.bytes > cost.layer_bytes, "{cost:?}");
        assert!(cost.seconds(1) < cost.seconds(2) && cost.seconds(16) < cost.seconds(17));
        cost
    };
    let diffuse = "<shape type='cube'/><emitter type='point'/>";
    let glossy = "<shape type='cube'><bsdf type='plastic'/></shape><emitter type='point'/>";
    let without_specular = check(cost(diffuse, PathTracing::default().into()));
    let with_specular = check(cost(glossy, PathTracing::default().into()));
    assert!(with_specular.bytes > without_specular.bytes, "{with_specular:?}");
    assert!(with_specular.layer_bytes > without_specular.layer_bytes);
    assert_eq!(with_specular.seconds_per_feature_per_pixel, 0.0);

    let bidirectional = check(cost(glossy, Integrator::Bdpt(Bdpt::default())));
    assert!(bidirectional.bytes > with_specular.bytes);
    assert!(bidirectional.seconds_per_feature_per_pixel > 0.0);

    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let (scene, settings) = (load(diffuse), RenderSettings::default());
    let denoising = probe::denoising(&scene, &settings, &Denoiser::bilateral(), &pool);
    let denoising = denoising.expect("a filter that runs");
    assert!(denoising.seconds(1000) >= denoising.seconds(10) && denoising.bytes > 0);
}
