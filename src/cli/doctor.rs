//! `quietlight doctor`: is this machine fit, and does everything work from end to end?

use super::Failure;
use crate::integrator::{PathTracing, Strategy};
use crate::render::{RenderSettings, render};
use crate::scene::{LoadOptions, Scene};
use anyhow::{Context, ensure};
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::{LayerKind, bilateral};
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
    check().context("the self-test failed")?;
    println!(
        "self-test   a white furnace was rendered, denoised, written and read back: every pixel is 1"
    );
    Ok(())
}

/// Renders the furnace, denoises it, and passes it through a file.
fn check() -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let file = folder.path().join("scene.xml");
    std::fs::write(&file, FURNACE)?;
    let scene = Scene::load(&file, &LoadOptions::default())?;
    // Only by walking into the light: then every sample is a product of ones.
    let integrator = PathTracing { strategy: Strategy::Bsdf };
    let settings = RenderSettings { samples: 16, integrator, ..RenderSettings::default() };
    let rendered = render(&scene, &settings, &|_| {}, &AtomicBool::new(false));
    ensure!(rendered.invalid_samples == 0, "{} samples were not finite", rendered.invalid_samples);
    let denoised =
        bilateral::denoise(&rendered.layers, &bilateral::Parameters::default(), &|_| {})?;
    let picture = folder.path().join("furnace.exr");
    exr::write(
        &picture,
        &rendered.layers,
        &WriteOptions { picture: Some(&denoised.image), halves: true, frame: None },
    )?;
    let noisy = &exr::read(&picture)?.layers.layers[&LayerKind::Beauty].mean;
    for (name, image) in [("rendered", noisy), ("denoised", &denoised.image)] {
        let worst = image.iter().map(|value| (value - 1.0).abs()).fold(0.0, f32::max);
        ensure!(worst < 1e-4, "a {name} pixel is off by {worst}");
    }
    Ok(())
}
