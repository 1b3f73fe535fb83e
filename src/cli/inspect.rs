//! `quietlight inspect`: what a scene requires, what will therefore run, what it will cost, and what is left out.

mod cost;
mod facts;

use super::args::{Denoiser, Inspect};
use super::render::{load, thread_pool};
use super::{Failure, denoising};
use cost::Costs;
use facts::Facts;
use std::time::Instant;

pub(super) fn run(arguments: &Inspect) -> Result<(), Failure> {
    let start = Instant::now();
    let scene = load(&arguments.scene)?;
    let loading = start.elapsed().as_secs_f64();
    let threads = thread_pool(arguments.threads)?;
    let facts = threads.install(|| Facts::of(&scene, arguments.denoiser != Denoiser::None));
    let denoiser = denoising::choose(arguments.denoiser, &arguments.networks, &threads)?;
    let costs = match arguments.no_probe {
        true => None,
        false => Some(Costs::of(&scene, &facts, denoiser.as_ref(), &threads, loading)?),
    };
    if arguments.json {
        let mut json = facts.json(&scene, denoiser.as_ref());
        if let Some(costs) = &costs {
            json["cost"] = costs.json();
        }
        println!("{json:#}");
    } else {
        facts.print(&scene, denoiser.as_ref());
        if let Some(costs) = &costs {
            costs.print();
        }
        for line in facts.requirements.left_out() {
            say("left out", line);
        }
    }
    Ok(())
}

/// A line of a table: what it is about, and what there is to say.
fn say(about: &str, text: impl std::fmt::Display) {
    println!("{about:<12}{text}");
}

/// Bytes for people: `1.5 MB`.
fn megabytes(bytes: u64) -> String {
    match bytes as f64 {
        bytes if bytes >= 1e9 => format!("{:.2} GB", bytes / 1e9),
        bytes if bytes >= 1e5 => format!("{:.1} MB", bytes / 1e6),
        bytes => format!("{:.1} kB", bytes / 1e3),
    }
}
