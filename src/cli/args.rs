//! What can be typed.

mod choices;
mod values;

pub(super) use choices::{
    Adaptive, Denoiser, Integrator, Marks, Mutation, Quality, Sampler, Strategy, Walks,
};
pub(super) use values::{Interval, time};

use crate::render::Shard;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::time::Duration;
use values::{definition, denoiser, factor, interval, noise, replay, size, stops, target};

/// Renders a scene by Monte Carlo path tracing and takes the noise out.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
pub(super) struct Arguments {
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Render a scene, denoise it, and write an EXR with all layers and a PNG
    Render(Render),
    /// Put pictures of the same scene together: renders with different seeds, or all shards of one render
    Merge(Merge),
    /// Denoise an EXR with feature buffers, of this or another renderer
    Denoise(Denoise),
    /// Score an image against a reference: relative L2, 1 - SSIM, FLIP, PSNR
    Compare(Compare),
    /// Make training pairs: noisy renders of many views, each with a converged one
    Dataset(Dataset),
    /// Measure error against seconds of integrators and denoisers on scenes, and tell what to choose
    Tradeoff(super::tradeoff::Tradeoff),
    /// Show what a scene requires, and what will therefore run
    Inspect(Inspect),
    /// Check this machine: threads, SIMD, and a small render from end to end
    Doctor,
    /// Print a completion script for a shell
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

/// Which scene, and how it is changed on loading.
#[derive(Args, Debug)]
pub(super) struct SceneArguments {
    /// Mitsuba 3 scene (.xml), plain .obj with .mtl, or a folder with a scene.xml
    pub(super) scene: PathBuf,
    /// Set a `<default>` of the scene, such as `-D max_depth=8`
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = definition)]
    pub(super) definitions: Vec<(String, String)>,
    /// Picture size, such as 640x480, instead of the scene's
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(super) size: Option<(u32, u32)>,
    /// Longest path in edges (1: emitters only, 2: direct light), instead of the scene's
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) max_depth: Option<u32>,
}

/// How the neural denoiser runs.
#[derive(Args, Debug)]
pub(super) struct Networks {
    /// Speed against accuracy of the neural denoiser
    #[arg(long, value_enum, default_value_t)]
    pub(super) quality: Quality,
    /// Weights for the neural denoiser instead of its own: give it twice, for the diffuse and the specular network
    #[arg(long = "model", value_name = "FILE.onnx")]
    pub(super) models: Vec<PathBuf>,
}

/// How the methods of Markov chains, and correlated visibility sampling, run.
#[derive(Args, Debug)]
#[command(next_help_heading = "Chains and visibility")]
pub(super) struct ChainOptions {
    /// Walks that samples of pssmlt, and seeds of erpt, are made of
    #[arg(long, value_enum, default_value_t)]
    pub(super) walks: Walks,
    /// Mutations of mlt and erpt, such as lens,caustic [default: all for mlt, all but bidirectional for erpt]
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',')]
    pub(super) mutations: Vec<Mutation>,
    /// Let the chains of mlt and erpt find light of at most one bounce, too, instead of leaving it to path tracing
    #[arg(long)]
    pub(super) chain_direct: bool,
    /// Mutations of each chain of erpt
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(super) chain_length: u32,
    /// Biased, erpt: drop what a chain deposits on one path beyond N mutations in a row; the energy lost is told
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) consecutive_limit: Option<u32>,
    /// Biased, erpt: replace pixels above FACTOR times the median of the proposals around them by it; the energy lost is told
    #[arg(long, value_name = "FACTOR", value_parser = factor)]
    pub(super) proposal_limit: Option<f32>,
    /// Where visibility gets the marks of partly lit pixels from
    #[arg(long, value_enum, default_value_t)]
    pub(super) marks: Marks,
    /// Exchange rays of visibility for each camera ray of a marked pixel, on average; 0 for resampling alone
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(..=1 << 16))]
    pub(super) exchange: u32,
}

#[derive(Args, Debug)]
pub(super) struct Render {
    #[command(flatten)]
    pub(super) scene: SceneArguments,
    /// EXR to write [default: the scene's name in the current folder]; a PNG is written beside it
    #[arg(short, long, value_name = "FILE.exr")]
    pub(super) output: Option<PathBuf>,
    /// How light is found
    #[arg(long, value_enum, default_value_t)]
    pub(super) integrator: Integrator,
    /// Samples per pixel, instead of the scene's: paths, or mutations of Markov chains
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(super) spp: Option<u32>,
    /// Be done after this long, denoising and writing included, such as 30s, 2.5m or 1h
    #[arg(long, value_name = "TIME", value_parser = time, conflicts_with = "spp")]
    pub(super) time: Option<Duration>,
    /// Stop when the estimated relative L2 of the picture, denoised if it is, is at most this; --spp or --time are then the
    /// most that is spent [default: 65536 samples per pixel]
    #[arg(long, value_name = "ERROR", value_parser = target, conflicts_with = "no_estimate")]
    pub(super) target_error: Option<f64>,
    /// Keep what there is this often, such as 5m or 30s, in a file beside the output from which --resume goes on; or off
    #[arg(long, value_name = "TIME", default_value = "5m", value_parser = interval)]
    pub(super) checkpoint: Interval,
    /// Go on from what an earlier run of the same command kept when it was ended; begin anew where there is nothing
    #[arg(long)]
    pub(super) resume: bool,
    /// Take only every N-th sample or chain, from number I on: for machine I of N, counted from 0. `merge` makes the picture
    #[arg(long, value_name = "I/N", default_value = "0/1", conflicts_with_all = ["time", "target_error", "strategies", "replay"])]
    pub(super) shard: Shard,
    /// With path tracing and a denoiser: take a quarter of the samples evenly, and the rest where the denoised picture of
    /// these is worst
    #[arg(long, value_enum, default_value_t, num_args = 0..=1, require_equals = true, default_missing_value = "on", conflicts_with_all = ["target_error", "shard", "replay"])]
    pub(super) adaptive: Adaptive,
    /// What takes the noise out
    #[arg(long, value_enum, default_value_t)]
    pub(super) denoiser: Denoiser,
    #[command(flatten)]
    pub(super) networks: Networks,
    /// Same seed, same bits, at any number of threads
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Where random numbers come from
    #[arg(long, value_enum, default_value_t)]
    pub(super) sampler: Sampler,
    #[command(flatten)]
    pub(super) chains: ChainOptions,
    /// With bdpt: write what each strategy finds, with its weight and without, and a sheet of each; a second render
    #[arg(long, value_name = "DIR")]
    pub(super) strategies: Option<PathBuf>,
    /// How path tracing finds direct light
    #[arg(long, value_enum, default_value_t)]
    pub(super) strategy: Strategy,
    /// Also write the two independent halves of every layer
    #[arg(long)]
    pub(super) halves: bool,
    /// Run one sample again and print its path: column, row, sample index
    #[arg(long, value_name = "X,Y,SAMPLE", value_parser = replay)]
    pub(super) replay: Option<[u32; 3]>,
    #[command(flatten)]
    pub(super) finish: Finish,
}

/// How a picture is finished and told of.
#[derive(Args, Debug)]
pub(super) struct Finish {
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
    /// Do not estimate the error of the denoised picture from its halves: that takes twice the time of denoising
    #[arg(long)]
    pub(super) no_estimate: bool,
    /// Brighten the PNG by this many stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = stops)]
    pub(super) exposure: f32,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Args, Debug)]
pub(super) struct Merge {
    /// EXR to write; a PNG is written beside it
    #[arg(value_name = "OUT.exr")]
    pub(super) output: PathBuf,
    /// EXRs of renders with different seeds, or the files that all shards of one render wrote
    #[arg(required = true, num_args = 2.., value_name = "IN")]
    pub(super) inputs: Vec<PathBuf>,
    /// What takes the noise out
    #[arg(long, value_enum, default_value_t)]
    pub(super) denoiser: Denoiser,
    #[command(flatten)]
    pub(super) networks: Networks,
    /// Also write the two independent halves of every layer
    #[arg(long)]
    pub(super) halves: bool,
    #[command(flatten)]
    pub(super) finish: Finish,
}

#[derive(Args, Debug)]
pub(super) struct Denoise {
    /// EXR with colour, and albedo, normal, position, variance where there are any
    pub(super) input: PathBuf,
    /// EXR to write; a PNG is written beside it
    #[arg(short, long, value_name = "FILE.exr")]
    pub(super) output: PathBuf,
    /// What takes the noise out: auto, bilateral or kpcn
    #[arg(long, value_name = "DENOISER", default_value = "auto", value_parser = denoiser())]
    pub(super) denoiser: Denoiser,
    #[command(flatten)]
    pub(super) networks: Networks,
    /// Albedo in a file of its own
    #[arg(long, value_name = "FILE")]
    pub(super) albedo: Option<PathBuf>,
    /// Normal in a file of its own
    #[arg(long, value_name = "FILE")]
    pub(super) normal: Option<PathBuf>,
    #[command(flatten)]
    pub(super) finish: Finish,
}

#[derive(Args, Debug)]
pub(super) struct Compare {
    /// Image to judge
    pub(super) image: PathBuf,
    /// What it should be; it is the denominator of the relative error
    pub(super) reference: PathBuf,
    /// Which layer of the image to judge, such as `noisy` [default: the picture]
    #[arg(long, value_name = "NAME")]
    pub(super) layer: Option<String>,
    /// Write the FLIP error of every pixel as a PNG, in false colour from black (0) to pale yellow (1)
    #[arg(long, value_name = "FILE.png")]
    pub(super) map: Option<PathBuf>,
    /// Print the scores as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Args, Debug)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Dataset {
    #[command(subcommand)]
    pub(super) verb: Option<DatasetVerb>,
    /// Folder of the data set: made, or continued where it was left
    #[arg(required = true, value_name = "DIR")]
    pub(super) folder: Option<PathBuf>,
    /// Scenes to vary: their cameras, lights and materials [default: scenes from the generator]
    #[arg(value_name = "SCENE")]
    pub(super) scenes: Vec<PathBuf>,
    /// Views of the whole set; more than before lets it grow
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=999_999))]
    pub(super) views: u32,
    /// Same seed, same views, on any machine
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Side of the square rendered of each view, in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..=1024))]
    pub(super) crop: u32,
    /// Noisy renders of each view
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(super) noisy: u32,
    /// Fewest samples per pixel of a noisy render
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(super) min_spp: u32,
    /// Most samples per pixel of a noisy render
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(super) max_spp: u32,
    /// Most samples per pixel of a reference
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(super) reference_spp: u32,
    /// Noise at which a reference is converged: estimated relative L2, of dark pictures after brightening
    #[arg(long, value_name = "ERROR", default_value_t = 1e-3, allow_negative_numbers = true, value_parser = noise)]
    pub(super) reference_noise: f64,
    /// Make only every N-th view, from view I on: for machine I of N, counted from 0
    #[arg(long, value_name = "I/N", default_value = "0/1")]
    pub(super) shard: Shard,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
    /// Keep the generated scenes in DIR/scenes
    #[arg(long)]
    pub(super) keep_scenes: bool,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Subcommand)]
pub(super) enum DatasetVerb {
    /// Put the shards of several machines together
    Merge {
        /// Data set to make or to add to
        #[arg(value_name = "OUT")]
        output: PathBuf,
        /// Data sets of the same settings
        #[arg(required = true, value_name = "DIR")]
        inputs: Vec<PathBuf>,
    },
    /// Write the files that the training tools of Open Image Denoise read, into OUT/train and OUT/valid
    Export {
        /// Data set
        #[arg(value_name = "DIR")]
        folder: PathBuf,
        /// Folder to make
        #[arg(value_name = "OUT")]
        output: PathBuf,
    },
    /// Show many views on one picture: of each a noisy render and the reference
    Sheet {
        /// Data set
        #[arg(value_name = "DIR")]
        folder: PathBuf,
        /// PNG to write
        #[arg(short, long, value_name = "FILE.png", default_value = "sheet.png")]
        output: PathBuf,
        /// Most views shown, evenly spread over all
        #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..))]
        views: u16,
    },
}

#[derive(Args, Debug)]
pub(super) struct Inspect {
    #[command(flatten)]
    pub(super) scene: SceneArguments,
    /// Leave out what the render will cost, which takes a second or a few to find out
    #[arg(long)]
    pub(super) no_probe: bool,
    /// The denoiser whose cost is told
    #[arg(long, value_enum, default_value_t)]
    pub(super) denoiser: Denoiser,
    #[command(flatten)]
    pub(super) networks: Networks,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
    /// Print the facts as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_well_formed() {
        Arguments::command().debug_assert();
    }
}
