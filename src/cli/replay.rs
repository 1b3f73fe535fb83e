//! `quietlight render --replay x,y,sample`: one sample again, hit by hit.

use super::{BadInput, Failure};
use crate::render::{RenderSettings, replay};
use crate::scene::Scene;

pub(super) fn run(
    scene: &Scene,
    settings: &RenderSettings,
    pixel: [u32; 2],
    sample: u32,
) -> Result<(), Failure> {
    let [x, y] = pixel;
    let (width, height) = (scene.film.width, scene.film.height);
    if x >= width || y >= height {
        return Err(anyhow::anyhow!("pixel {x},{y} is outside of the {width}x{height} picture"))
            .bad_input();
    }
    println!(
        "depth  part  position                                  throughput                      added"
    );
    let found = replay(scene, settings, pixel, sample, |vertex| {
        let position = vertex.at.position.as_dvec3() + scene.origin;
        println!(
            "{:>5}  {:>4}  {:<40}  {:<30}  {}",
            vertex.depth,
            vertex.at.part,
            triple(position.to_array()),
            triple(vertex.throughput.to_array().map(f64::from)),
            triple(vertex.added.to_array().map(f64::from)),
        );
    });
    println!("diffuse  {}", triple(found.diffuse.to_array().map(f64::from)));
    println!("specular {}", triple(found.specular.to_array().map(f64::from)));
    println!("finite   {}", if found.is_finite() { "yes" } else { "no: this sample is dropped" });
    Ok(())
}

fn triple([x, y, z]: [f64; 3]) -> String {
    format!("{x:.6e} {y:.6e} {z:.6e}")
}
