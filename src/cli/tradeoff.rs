//! `quietlight tradeoff`: error against seconds of integrators, sample counts and denoisers.

use super::progress::Progress;
use super::render::{STOP, heed_ctrl_c, thread_pool};
use super::{BadInput, Failure};
use crate::dataset::Shard;
use crate::tradeoff::merge::{Merged, merge};
use crate::tradeoff::{
    CSV, Error, Filter, JSON, Job, Method, PAGE, Plan, ReferenceBudget, Request, Scores, page,
};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// What stands in the table, for `--help`.
const COLUMNS: &str = "\
Columns of scores.csv, a row for each scene, integrator, denoiser and sample count; low and high are the ends of 95 % \
confidence intervals over seeds, and what is not known is empty:
  scene, width, height, integrator, denoiser, samples, seeds
  render_seconds, denoise_seconds, seconds (both), seconds_low, seconds_high: wall time; cpu_seconds: of all threads
  relative_l2, relative_l2_low, relative_l2_high: error, the noise of the reference taken out
  bias2, variance: its parts
  reference_noise: relative L2 of the reference; is_known: is the error above it?
  is_on_front: does no other row of the scene beat this one in both seconds and relative_l2?
  one_minus_ssim, psnr (dB), flip: against the mean of the reference's halves
  invalid_samples: non-finite samples dropped

Every measured picture is kept, 12 bytes a pixel before compression: choose --width accordingly.";

#[derive(Args, Debug)]
#[command(after_long_help = COLUMNS)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Tradeoff {
    #[command(subcommand)]
    verb: Option<Verb>,
    /// Scenes to measure: .xml, .obj, or folders with one
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Folder of the measurement: made, or continued where it was left
    #[arg(short, long, value_name = "DIR", required = true)]
    output: Option<PathBuf>,
    /// Ways to find light
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "path,bdpt,pssmlt,mlt,erpt,visibility"
    )]
    integrators: Vec<Method>,
    /// What is done with the noise; what cannot run is said and left out
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "none,bilateral,kpcn-fast,kpcn-balanced,kpcn-high"
    )]
    denoisers: Vec<Filter>,
    /// Samples or mutations per pixel
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1,2,4,8,16,32,64", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    samples: Vec<u32>,
    /// Replicates of each render: three or more tell how sure the figures are
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    seeds: u32,
    /// Seed of the first replicate; the next ones follow
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Pixels across of every picture, the height following [default: as the scenes say]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    width: Option<u32>,
    /// Samples per pixel of a reference [default: 32 times the largest of --samples]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1 << 24))]
    reference_samples: Option<u32>,
    /// Render each reference for this long instead, such as 60s or 5m
    #[arg(long, value_name = "TIME", value_parser = super::args::time, conflicts_with = "reference_samples")]
    reference_time: Option<Duration>,
    /// Make only every N-th part, from part I on: for machine I of N, counted from 0
    #[arg(long, value_name = "I/N", default_value = "0/1")]
    shard: Shard,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Print the outcome as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Put the shards of several machines together, and write the page of all
    Merge {
        /// Measurement to make or to add to
        #[arg(value_name = "OUT")]
        output: PathBuf,
        /// Measurements of the same settings
        #[arg(required = true, value_name = "DIR")]
        inputs: Vec<PathBuf>,
    },
}

pub(super) fn run(arguments: &Tradeoff) -> Result<(), Failure> {
    let threads = thread_pool(arguments.threads)?;
    if let Some(Verb::Merge { output, inputs }) = &arguments.verb {
        let Merged { copied, already_there } = merge(output, inputs).map_err(sorted)?;
        println!("{}: {copied} parts copied, {already_there} were there before", output.display());
        let scores = tell(output, &threads)?;
        return say(&scores, output, false);
    }
    let Some(folder) = arguments.output.clone() else {
        return Err(anyhow::anyhow!("the folder of the measurement is missing: -o DIR"))
            .bad_input();
    };
    let reference = match (arguments.reference_samples, arguments.reference_time) {
        (_, Some(time)) => Some(ReferenceBudget::Seconds(time.as_secs_f64())),
        (samples, None) => samples.map(ReferenceBudget::Samples),
    };
    let request = Request {
        scenes: arguments.scenes.clone(),
        width: arguments.width,
        integrators: arguments.integrators.clone(),
        denoisers: arguments.denoisers.clone(),
        samples: arguments.samples.clone(),
        seeds: arguments.seeds,
        seed: arguments.seed,
        reference,
    };
    let job = Job { folder: folder.clone(), request, shard: arguments.shard };
    let plan = job.plan().map_err(sorted)?;
    announce(&plan, &folder);
    heed_ctrl_c(
        "dropping the part under way, then telling of what there is; the same command goes on later",
    )?;
    let progress = Progress::new("tradeoff", "samples", plan.work());
    let outcome = plan.run(&threads, &|done| progress.at(done), &STOP);
    progress.finish();
    let outcome = outcome.map_err(sorted)?;
    let scores = tell(&folder, &threads)?;
    say(&scores, &folder, arguments.json)?;
    if outcome.is_interrupted { Err(Failure::Interrupted) } else { Ok(()) }
}

/// Errors of the user's own doing are told apart from those of the machine.
fn sorted(error: Error) -> Failure {
    match error {
        Error::Folder(ref reason) if reason.is_of_the_user() => Failure::BadInput(error.into()),
        Error::Scene(_) | Error::Nothing(_) => Failure::BadInput(error.into()),
        error => Failure::Failed(error.into()),
    }
}

/// What will be done, before it is begun.
fn announce(plan: &Plan, folder: &Path) {
    for (denoiser, why) in &plan.left_out {
        eprintln!("left out: {}: {why}", denoiser.name());
    }
    eprintln!(
        "{}: {} parts to measure (references, and one seed of one integrator each), {} are there",
        folder.display(),
        plan.len(),
        plan.complete
    );
}

/// Judges what there is and writes the files that tell of it.
fn tell(folder: &Path, threads: &rayon::ThreadPool) -> Result<Scores, Failure> {
    let start = Instant::now();
    // Made once it is known how many pictures there are.
    let progress: Mutex<Option<Progress>> = Mutex::new(None);
    let heard = |done: u64, total: u64| {
        if let Ok(mut bar) = progress.lock() {
            bar.get_or_insert_with(|| Progress::new("judge", "pictures", total)).at(done);
        }
    };
    let scores = threads.install(|| -> Result<Scores, Error> {
        let scores = Scores::of(folder, &heard)?;
        scores.write_json(folder)?;
        scores.write_csv(folder)?;
        page::write(folder, &scores)?;
        Ok(scores)
    });
    if let Ok(Some(bar)) = progress.into_inner() {
        bar.finish();
    }
    let scores = scores.map_err(sorted)?;
    eprintln!("judged and written in {:.1} s", start.elapsed().as_secs_f64());
    Ok(scores)
}

fn say(scores: &Scores, folder: &Path, as_json: bool) -> Result<(), Failure> {
    let [there, asked] = scores.units;
    if as_json {
        let verdicts: serde_json::Map<String, serde_json::Value> = scores
            .scenes
            .iter()
            .map(|scene| (scene.name.clone(), serde_json::json!(scene.verdict)))
            .collect();
        let json = serde_json::json!({
            "page": folder.join(PAGE),
            "csv": folder.join(CSV),
            "json": folder.join(JSON),
            "parts": there,
            "parts_of_all": asked,
            "left_out": scores.left_out,
            "verdicts": verdicts,
        });
        println!("{json:#}");
        return Ok(());
    }
    for scene in &scores.scenes {
        println!("{}: {} {}", scene.name, scene.verdict.headline, scene.verdict.auto);
    }
    if there < asked {
        println!("{there} of {asked} parts are there");
    }
    println!("{}, beside it {CSV} and {JSON}", folder.join(PAGE).display());
    Ok(())
}
