//! What can be typed.

use crate::render::Shard;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;

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
    /// these is worst. Not kept from time to time
    #[arg(long, conflicts_with_all = ["target_error", "resume", "shard", "replay"])]
    pub(super) adaptive: bool,
    /// What takes the noise out
    #[arg(long, value_enum, default_value_t)]
    pub(super) denoiser: Denoiser,
    #[command(flatten)]
    pub(super) networks: Networks,
    /// Same seed, same bits, at any number of threads
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
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
    /// Do not estimate the error of the denoised picture: that takes twice the time of denoising
    #[arg(long)]
    pub(super) no_estimate: bool,
    /// Brighten the PNG by this many stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(super) exposure: f32,
    /// Run one sample again and print its path: column, row, sample index
    #[arg(long, value_name = "X,Y,SAMPLE", value_parser = replay)]
    pub(super) replay: Option<[u32; 3]>,
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
    #[arg(required = true, value_name = "IN")]
    pub(super) inputs: Vec<PathBuf>,
    /// What takes the noise out
    #[arg(long, value_enum, default_value_t)]
    pub(super) denoiser: Denoiser,
    #[command(flatten)]
    pub(super) networks: Networks,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
    /// Also write the two independent halves of every layer
    #[arg(long)]
    pub(super) halves: bool,
    /// Do not estimate the error of the denoised picture: that takes twice the time of denoising
    #[arg(long)]
    pub(super) no_estimate: bool,
    /// Brighten the PNG by this many stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(super) exposure: f32,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(super) json: bool,
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
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
    /// Do not estimate the error of the picture from the halves in the file: that takes twice the time of denoising
    #[arg(long)]
    pub(super) no_estimate: bool,
    /// Brighten the PNG by this many stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(super) exposure: f32,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(super) json: bool,
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

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Denoiser {
    /// The best there is: `kpcn`, or `bilateral` where the networks cannot run
    #[default]
    Auto,
    /// Leave the noise in
    None,
    /// Cross-bilateral filter with learned parameters
    Bilateral,
    /// The same filter with constant parameters
    BilateralConstant,
    /// Kernel-predicting neural networks, run by onnxruntime
    Kpcn,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Quality {
    /// The smallest networks: at most a second of CPU a megapixel
    Fast,
    /// At most three seconds of CPU a megapixel
    #[default]
    Balanced,
    /// The largest networks: at most twenty seconds of CPU a megapixel
    High,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Integrator {
    /// The best for the scene, as `inspect` tells
    #[default]
    Auto,
    /// Path tracing: walks from the camera
    Path,
    /// Bidirectional path tracing: walks from the camera and from emitters, joined in every way
    Bdpt,
    /// Metropolis sampling in primary sample space (Kelemen et al.)
    Pssmlt,
    /// Metropolis light transport: mutations of whole paths (Veach and Guibas)
    Mlt,
    /// Energy redistribution path tracing: short chains from path-traced seeds (Cline et al.)
    Erpt,
    /// Correlated visibility sampling of direct light, path tracing of all other light
    Visibility,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Mutation {
    /// Another piece of another length: reaches every path
    Bidirectional,
    /// Another place on the film
    Lens,
    /// Another direction of light before its last smooth surface
    Caustic,
    /// Another place on the film, and other directions between mirrors
    MultiChain,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Marks {
    /// Camera rays of their own: unbiased
    #[default]
    Pilot,
    /// The camera rays that they mark: costs nothing, and is biased, less so with more rays
    Same,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Walks {
    /// From the camera and from emitters, as bidirectional path tracing
    #[default]
    Both,
    /// From the camera, as path tracing
    Camera,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Sampler {
    /// Owen-scrambled Sobol points
    #[default]
    Sobol,
    /// Independent random numbers
    Independent,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Strategy {
    /// Choosing points on emitters and walking into them, weighted
    #[default]
    Mis,
    /// Only choosing points on emitters
    Light,
    /// Only walking into emitters
    Bsdf,
}

/// Reads a [`Denoiser`] that takes noise out.
fn denoiser() -> impl clap::builder::TypedValueParser<Value = Denoiser> {
    use clap::builder::{PossibleValuesParser, TypedValueParser};

    PossibleValuesParser::new(["auto", "bilateral", "bilateral-constant", "kpcn"])
        .try_map(|name| Denoiser::from_str(&name, false))
}

/// How often something is done; `None` is never.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Interval(pub(super) Option<Duration>);

/// Reads a time, or `off`.
fn interval(text: &str) -> Result<Interval, String> {
    if text == "off" { Ok(Interval(None)) } else { time(text).map(|time| Interval(Some(time))) }
}

/// Reads a time with its unit; seconds where there is none.
pub(super) fn time(text: &str) -> Result<Duration, String> {
    let units = [("ms", 1e-3), ("s", 1.0), ("m", 60.0), ("h", 3600.0)];
    let (number, seconds) = units
        .iter()
        .find_map(|&(unit, seconds)| Some((text.strip_suffix(unit)?, seconds)))
        .unwrap_or((text, 1.0));
    let expected = || format!("expected a time such as 30s, 2.5m or 1h, not {text:?}");
    let number: f64 = number.trim().parse().map_err(|_| expected())?;
    let time = Duration::try_from_secs_f64(number * seconds).map_err(|_| expected())?;
    if time.is_zero() { Err(expected()) } else { Ok(time) }
}

fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("expected NAME=VALUE".to_owned()),
    }
}

fn noise(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|noise: &f64| *noise >= 0.0 && noise.is_finite())
        .ok_or_else(|| "expected zero or a positive number, such as 0.001".to_owned())
}

fn target(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|error: &f64| *error > 0.0 && error.is_finite())
        .ok_or_else(|| "expected a positive number, such as 0.005".to_owned())
}

fn factor(text: &str) -> Result<f32, String> {
    text.parse()
        .ok()
        .filter(|factor: &f32| *factor >= 1.0 && factor.is_finite())
        .ok_or_else(|| "expected a number of at least 1, such as 3".to_owned())
}

fn size(text: &str) -> Result<(u32, u32), String> {
    text.split_once('x')
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)))
        .filter(|&(width, height)| width > 0 && height > 0)
        .ok_or_else(|| "expected WIDTHxHEIGHT in pixels, such as 640x480".to_owned())
}

fn replay(text: &str) -> Result<[u32; 3], String> {
    let numbers: Vec<u32> =
        text.split(',').map_while(|number| number.trim().parse().ok()).collect();
    numbers.try_into().map_err(|_| "expected three whole numbers: column,row,sample".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_well_formed() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn values_that_do_not_parse_are_refused() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        assert!(size("0x4").is_err() && size("640").is_err());
        assert_eq!(definition("a=b=c"), Ok(("a".to_owned(), "b=c".to_owned())));
        assert!(definition("=1").is_err() && definition("a").is_err());
        assert_eq!(replay("1, 2,3"), Ok([1, 2, 3]));
        assert!(replay("1,2").is_err() && replay("1,2,x").is_err());
    }
}
