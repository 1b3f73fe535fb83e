//! Which method a command asks for.

use super::args::{self, ChainOptions, Marks, Render, Walks};
use crate::integrator::correlated_visibility::MarkSource;
use crate::integrator::{
    Bdpt, Choice, CorrelatedVisibility, Effort, Erpt, Integrator, Mlt, Mutations, PathTracing,
    PrimaryPaths, Pssmlt, Purpose, Strategy,
};
use crate::scene::Scene;
use crate::transport::connect::Strategies;

/// The method asked for; `auto` looks at the scene, at what may be spent on so many `threads`, and at what becomes of the noise.
pub(super) fn of(arguments: &Render, scene: &Scene, threads: usize) -> Integrator {
    let strategy = match arguments.strategy {
        args::Strategy::Mis => Strategy::Mis,
        args::Strategy::Light => Strategy::Light,
        args::Strategy::Bsdf => Strategy::Bsdf,
    };
    let path_tracing = PathTracing { strategy, ..PathTracing::default() };
    let options = &arguments.chains;
    match arguments.integrator {
        // A strategy of path tracing, or one of its samples, is asked of path tracing.
        args::Integrator::Auto if strategy == Strategy::default() && arguments.replay.is_none() => {
            Choice::of(scene, purpose(arguments, scene, threads)).integrator
        }
        args::Integrator::Auto | args::Integrator::Path => path_tracing.into(),
        args::Integrator::Bdpt => Integrator::Bdpt(Bdpt::default()),
        args::Integrator::Pssmlt => Integrator::Pssmlt(Pssmlt {
            paths: match options.walks {
                Walks::Both => PrimaryPaths::Bidirectional(Bdpt::default()),
                Walks::Camera => PrimaryPaths::Camera(path_tracing),
            },
            ..Pssmlt::default()
        }),
        args::Integrator::Mlt => Integrator::Mlt(Mlt {
            mutations: mutations(options).unwrap_or_default(),
            separate_direct: !options.chain_direct,
            ..Mlt::default()
        }),
        args::Integrator::Erpt => Integrator::Erpt(erpt(options)),
        args::Integrator::Visibility => Integrator::Visibility(CorrelatedVisibility {
            marks: match options.marks {
                Marks::Pilot => MarkSource::Pilot,
                Marks::Same => MarkSource::Same,
            },
            mutations: options.exchange,
            ..CorrelatedVisibility::default()
        }),
    }
}

/// Seconds of one thread that there are for each pixel of a picture with a budget of time.
pub(super) fn seconds_per_pixel(arguments: &Render, scene: &Scene, threads: usize) -> Option<f64> {
    let pixels = scene.film.crop_pixels() as f64;
    arguments.time.map(|time| time.as_secs_f64() * threads as f64 / pixels)
}

fn purpose(arguments: &Render, scene: &Scene, threads: usize) -> Purpose {
    let effort = match (seconds_per_pixel(arguments, scene, threads), arguments.target_error) {
        (Some(seconds), _) => Some(Effort::Seconds(seconds)),
        (None, Some(_)) => None,
        (None, None) => Some(Effort::Samples(arguments.spp.unwrap_or(scene.samples))),
    };
    Purpose { is_denoised: arguments.denoiser != args::Denoiser::None, effort }
}

fn erpt(options: &ChainOptions) -> Erpt {
    let usual = Erpt::default();
    Erpt {
        seeds: match options.walks {
            Walks::Both => Strategies::ToLens,
            Walks::Camera => Strategies::FromCamera,
        },
        mutations: mutations(options).unwrap_or(usual.mutations),
        chain_length: options.chain_length,
        separate_direct: !options.chain_direct,
        consecutive_limit: options.consecutive_limit,
        proposal_limit: options.proposal_limit,
        ..usual
    }
}

/// The mutations listed; `None` where none are.
fn mutations(options: &ChainOptions) -> Option<Mutations> {
    let has = |mutation| options.mutations.contains(&mutation);
    (!options.mutations.is_empty()).then(|| Mutations {
        bidirectional: has(args::Mutation::Bidirectional),
        lens: has(args::Mutation::Lens),
        caustic: has(args::Mutation::Caustic),
        multi_chain: has(args::Mutation::MultiChain),
    })
}
