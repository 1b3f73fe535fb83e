//! `quietlight dataset`: training pairs, made, merged, exported and looked at.

use super::args::{Dataset, DatasetVerb};
use super::progress::Progress;
use super::render::{STOP, heed_ctrl_c};
use super::{BadInput, Failure, output};
use crate::dataset::export::{Exported, export};
use crate::dataset::merge::{Merged, merge};
use crate::dataset::{Error, Job, Outcome, Plan, Settings, contact_sheet, manifest};
use crate::scene::{LoadOptions, Scene};
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Instant;

pub(super) fn run(arguments: &Dataset) -> Result<(), Failure> {
    match &arguments.verb {
        None => make(arguments),
        Some(DatasetVerb::Merge { output, inputs }) => {
            let Merged { copied, already_there } = merge(output, inputs).map_err(sorted)?;
            println!(
                "{}: {copied} views copied, {already_there} were there before",
                output.display()
            );
            Ok(())
        }
        Some(DatasetVerb::Export { folder, output }) => {
            let total = manifest::views(folder).map_err(|error| sorted(error.into()))?.len() as u64;
            let progress = Progress::new("export", "views", total);
            let exported = export(folder, output, &|done| progress.at(done));
            progress.finish();
            let Exported { views, renders } = exported.map_err(sorted)?;
            println!("{}: {renders} renders of {views} views", output.display());
            Ok(())
        }
        Some(DatasetVerb::Sheet { folder, output, views }) => {
            output::check(output, "png")?;
            let ids = contact_sheet::write(folder, usize::from(*views), output).map_err(sorted)?;
            println!("{}: views {}", output.display(), ids.join(" "));
            Ok(())
        }
    }
}

/// Errors of the user's own doing are told apart from those of the machine.
fn sorted(error: Error) -> Failure {
    match error {
        Error::Folder(ref reason) if reason.is_of_the_user() => Failure::BadInput(error.into()),
        Error::Conflict { .. } | Error::Space { .. } => Failure::BadInput(error.into()),
        error => Failure::Failed(error.into()),
    }
}

fn make(arguments: &Dataset) -> Result<(), Failure> {
    let Some(folder) = arguments.folder.clone() else {
        return Err(anyhow::anyhow!("the folder of the data set is missing")).bad_input();
    };
    if arguments.min_spp > arguments.max_spp {
        let (least, most) = (arguments.min_spp, arguments.max_spp);
        return Err(anyhow::anyhow!("--min-spp {least} is more than --max-spp {most}")).bad_input();
    }
    for scene in &arguments.scenes {
        Scene::load(scene, &LoadOptions::default()).bad_input()?;
    }
    let threads = match arguments.threads {
        Some(threads) => usize::from(threads),
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let settings = Settings {
        seed: arguments.seed,
        scenes: arguments.scenes.clone(),
        crop: arguments.crop,
        noisy: arguments.noisy,
        min_spp: arguments.min_spp,
        max_spp: arguments.max_spp,
        reference_spp: arguments.reference_spp,
        reference_noise: arguments.reference_noise,
    };
    let job = Job {
        folder: folder.clone(),
        settings,
        views: arguments.views,
        shard: arguments.shard,
        threads,
        keep_scenes: arguments.keep_scenes,
    };
    let plan = job.plan().map_err(sorted)?;
    announce(&plan, &folder);

    heed_ctrl_c("dropping the views under way; the same command goes on later")?;
    let start = Instant::now();
    let progress = Progress::new("dataset", "views", plan.len() as u64);
    let outcome = plan.run(&|done| progress.at(done), &STOP);
    progress.finish();
    let outcome = outcome.map_err(sorted)?;
    let seconds = start.elapsed().as_secs_f64();
    if arguments.json {
        let json = serde_json::json!({
            "folder": folder,
            "rendered": outcome.rendered,
            "skipped": outcome.skipped,
            "complete_before": plan.complete,
            "interrupted": outcome.is_interrupted,
            "seconds": seconds,
        });
        println!("{json:#}");
    } else {
        tell(&outcome, &plan, &folder, seconds);
    }
    if STOP.load(Ordering::Relaxed) && outcome.is_interrupted {
        return Err(Failure::Interrupted);
    }
    Ok(())
}

/// What will be done and what it takes, before it is begun.
fn announce(plan: &Plan, folder: &Path) {
    let gigabytes = |bytes: u64| bytes as f64 / 1e9;
    let free = plan
        .free
        .map_or("an unknown amount is".to_owned(), |free| format!("{:.1} GB are", gigabytes(free)));
    eprintln!(
        "{}: {} views to make, {} are there; they take about {:.2} GB, {free} free",
        folder.display(),
        plan.len(),
        plan.complete,
        gigabytes(plan.needed),
    );
}

fn tell(outcome: &Outcome, plan: &Plan, folder: &Path, seconds: f64) {
    let made = outcome.rendered + outcome.skipped;
    println!(
        "{}: {} views rendered in {seconds:.1} s ({:.2} s each), {} skipped, {} were there before",
        folder.display(),
        outcome.rendered,
        seconds / made.max(1) as f64,
        outcome.skipped,
        plan.complete,
    );
}
