//! `quietlight inspect`: what a scene requires, and what will therefore run.

use super::Failure;
use super::args::Inspect;
use super::render::load;
use crate::film::Film;
use crate::geometry::Part;
use crate::integrator::Choice;
use crate::scene::Requirements;
use quietlight_denoise::LayerKind;
use quietlight_denoise::kpcn::{self, Branch};

pub(super) fn run(arguments: &Inspect) -> Result<(), Failure> {
    let scene = load(&arguments.scene)?;
    let requirements = Requirements::of(&scene);
    let parts = scene.geometry.parts();
    let triangles: usize = parts
        .iter()
        .map(|part| if let Part::Mesh(mesh) = part { mesh.triangles.len() } else { 0 })
        .sum();
    let analytic = parts.iter().filter(|part| !matches!(part, Part::Mesh(_))).count();
    let layers: Vec<&str> = LayerKind::ALL
        .into_iter()
        .filter(|&layer| requirements.needs(layer))
        .map(LayerKind::name)
        .collect();
    let [_, _, width, height] = scene.film.crop;
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    let choice = Choice::of(&scene);
    let film = megabytes(Film::bytes(scene.film, &requirements));
    let tree = megabytes(scene.geometry.bytes() as u64);
    if arguments.json {
        let json = serde_json::json!({
            "width": width,
            "height": height,
            "samples": scene.samples,
            "max_depth": scene.limits.max_depth,
            "rr_depth": scene.limits.rr_depth,
            "parts": parts.len(),
            "triangles": triangles,
            "analytic_shapes": analytic,
            "materials": scene.materials.len(),
            "emitters": scene.emitters.len(),
            "has_specular": requirements.has_specular,
            "has_delta": requirements.has_delta,
            "has_masks": requirements.has_masks,
            "has_defocus": requirements.has_defocus,
            "layers": layers,
            "networks": networks(&requirements),
            "integrator": choice.integrator.name(),
            "integrator_reason": choice.reason,
            "film_megabytes": film,
            "tree_megabytes": tree,
            "warnings": scene.warnings,
        });
        println!("{json:#}");
        return Ok(());
    }
    let depth = scene
        .limits
        .max_depth
        .map_or("without limit".to_owned(), |depth| format!("up to {depth} edges"));
    println!("picture     {width}x{height}, {} samples per pixel, paths {depth}", scene.samples);
    println!(
        "geometry    {} parts: {triangles} triangles, {analytic} analytic shapes; {tree:.1} MB",
        parts.len()
    );
    println!(
        "materials   {}{}",
        scene.materials.len(),
        if requirements.has_delta { ", some delta" } else { "" }
    );
    println!("emitters    {}", scene.emitters.len());
    println!("integrator  {}: {}", choice.integrator.name(), choice.reason);
    println!("layers      {} ({film:.1} MB)", layers.join(", "));
    println!("denoiser    {}", plan(&requirements));
    for line in requirements.left_out() {
        println!("left out    {line}");
    }
    Ok(())
}

/// The networks that `--denoiser kpcn` will run.
fn networks(requirements: &Requirements) -> Vec<&'static str> {
    let mut branches = vec![Branch::Diffuse];
    if requirements.needs(LayerKind::Specular) {
        branches.push(Branch::Specular);
    }
    branches.into_iter().map(Branch::name).collect()
}

/// What will take the noise out.
fn plan(requirements: &Requirements) -> String {
    match kpcn::Denoiser::embedded(kpcn::Quality::default()) {
        Ok(_) => format!(
            "neural networks, {} quality: {}",
            kpcn::Quality::default().name(),
            networks(requirements).join(" and ")
        ),
        Err(_) => "cross-bilateral filter: there are no weights for the neural networks".to_owned(),
    }
}
