//! `quietlight doctor`: is this machine fit, and does everything work from end to end?

use super::Failure;
use super::render::thread_pool;
use crate::integrator::{PathTracing, Strategy};
use crate::render::{Budget, RenderSettings, render};
use crate::scene::{LoadOptions, Scene};
use anyhow::{Context, anyhow, ensure};
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::{LayerKind, bilateral, kpcn};
use std::sync::atomic::AtomicBool;

/// A sphere that reflects all light, in light of radiance 1 from everywhere: every pixel must be 1.
const FURNACE: &str = r#"<scene version="3.0.0">
    <sensor type="perspective"><float name="fov" value="30"/>
        <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film></sensor>
    <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
</scene>"#;

pub(super) fn run() -> Result<(), Failure> {
    println!("quietlight  {}", env!("CARGO_PKG_VERSION"));
    println!("threads     {}", rayon::current_num_threads());
    println!("SIMD        {}", crate::geometry::simd_name());
    let has_networks = describe_networks();
    check(has_networks).context("the self-test failed")?;
    println!(
        "self-test   a white furnace was rendered, denoised, written and read back: every pixel is 1"
    );
    Ok(())
}

/// Tells of onnxruntime and of the weights; true where the neural denoiser can run.
fn describe_networks() -> bool {
    let runs = match kpcn::runtime() {
        Ok(runtime) => {
            println!("onnxruntime {}, {}", runtime.origin, kpcn::PROVIDER);
            println!("            {}", runtime.build);
            true
        }
        Err(error) => {
            println!("onnxruntime none: the bilateral filter denoises instead");
            println!("            {error}");
            false
        }
    };
    let entries = kpcn::entries().unwrap_or_default();
    if entries.is_empty() {
        println!("models      none: the bilateral filter denoises instead");
    }
    let mut are_whole = true;
    for (index, entry) in entries.iter().enumerate() {
        let head = if index == 0 { "models" } else { "" };
        match kpcn::Model::of_entry(entry) {
            Ok(model) => println!("{head:<11} {}: intact, SHA-256 {}", model.name, model.sha256),
            Err(error) => {
                println!("{head:<11} {error}");
                are_whole = false;
            }
        }
    }
    runs && are_whole && !entries.is_empty()
}

/// Renders the furnace, denoises it by every denoiser that can run, and passes it through a file.
fn check(has_networks: bool) -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let file = folder.path().join("scene.xml");
    std::fs::write(&file, FURNACE)?;
    let scene = Scene::load(&file, &LoadOptions::default())?;
    // Only by walking into the light: then every sample is a product of ones.
    let integrator = PathTracing { strategy: Strategy::Bsdf, ..PathTracing::default() }.into();
    let budget = Budget::Samples(16);
    let settings = RenderSettings { budget, integrator, ..RenderSettings::default() };
    let rendered = render(&scene, &settings, &|_| {}, &AtomicBool::new(false));
    ensure!(rendered.invalid_samples == 0, "{} samples were not finite", rendered.invalid_samples);
    let filtered =
        bilateral::denoise(&rendered.layers, &bilateral::Parameters::default(), &|_| {})?.image;
    let mut pictures = vec![("filtered", filtered)];
    if has_networks {
        let threads = thread_pool(None).map_err(|_| anyhow!("cannot start threads"))?;
        let denoiser = kpcn::Denoiser::embedded(kpcn::Quality::default())?;
        pictures.push(("denoised", denoiser.denoise(&rendered.layers, &threads, &|_| {})?.image));
    }
    let picture = folder.path().join("furnace.exr");
    exr::write(
        &picture,
        &rendered.layers,
        &WriteOptions { picture: Some(&pictures[0].1), halves: true, frame: None },
    )?;
    let noisy = exr::read(&picture)?.layers.layers[&LayerKind::Beauty].mean.clone();
    pictures.push(("rendered", noisy));
    for (name, image) in &pictures {
        let worst = image.iter().map(|value| (value - 1.0).abs()).fold(0.0, f32::max);
        ensure!(worst < 1e-4, "a {name} pixel is off by {worst}");
    }
    Ok(())
}
