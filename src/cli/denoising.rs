//! Which denoiser runs, and what it tells of itself.

use super::args::{Denoiser, Networks, Quality};
use super::progress::Progress;
use super::{BadInput, Failure};
use anyhow::anyhow;
use quietlight_denoise::bilateral;
use quietlight_denoise::kpcn::{self, Branch};
use quietlight_denoise::sanitize::Sanitised;
use quietlight_denoise::{Error, Image, Layers};

/// A denoiser that is ready to run.
pub(super) enum Denoising {
    /// The cross-bilateral filter, with learned or constant parameters.
    Bilateral {
        /// What it is told.
        parameters: bilateral::Parameters,
        /// As on the command line.
        name: &'static str,
    },
    /// A pair of networks.
    Kpcn {
        /// The networks.
        networks: kpcn::Denoiser,
        /// Their quality; `None` for a user's own files.
        quality: Option<kpcn::Quality>,
    },
}

/// A denoised picture and how it came about.
pub(super) struct Denoised {
    /// The picture.
    pub(super) image: Image,
    /// What denoised it.
    pub(super) name: &'static str,
    /// More of it, as names and values.
    details: Vec<(&'static str, String)>,
}

impl Denoising {
    /// What the arguments ask for; `None` for no denoiser. `auto` falls back on the bilateral filter, with a warning, where
    /// the networks cannot run.
    pub(super) fn choose(
        denoiser: Denoiser,
        networks: &Networks,
        threads: &rayon::ThreadPool,
    ) -> Result<Option<Self>, Failure> {
        let has_models = !networks.models.is_empty();
        match denoiser {
            Denoiser::None | Denoiser::Bilateral | Denoiser::BilateralConstant if has_models => {
                Err(anyhow!("--model is for --denoiser kpcn or auto")).bad_input()
            }
            Denoiser::None => Ok(None),
            Denoiser::Bilateral => Ok(Some(Self::learned_bilateral())),
            Denoiser::BilateralConstant => {
                let parameters = bilateral::Parameters::constant();
                Ok(Some(Self::Bilateral { parameters, name: "bilateral-constant" }))
            }
            Denoiser::Auto | Denoiser::Kpcn if has_models => {
                let [first, second] = &networks.models[..] else {
                    return Err(anyhow!(
                        "--model was given {} times; two files are needed, one for each branch",
                        networks.models.len()
                    ))
                    .bad_input();
                };
                let networks =
                    kpcn::Denoiser::from_files([first, second], threads.current_num_threads());
                let networks = networks.map_err(|error| match error {
                    Error::OnnxRuntime(_) => Failure::Failed(error.into()),
                    _ => Failure::BadInput(error.into()),
                })?;
                Ok(Some(Self::Kpcn { networks, quality: None }))
            }
            Denoiser::Kpcn => match embedded(networks.quality) {
                Ok(denoising) => Ok(Some(denoising)),
                Err(error) => Err(Failure::Failed(error.into())),
            },
            Denoiser::Auto => match embedded(networks.quality) {
                Ok(denoising) => Ok(Some(denoising)),
                Err(error) => {
                    eprintln!(
                        "warning: the bilateral filter is used, for the networks cannot run: {error}"
                    );
                    Ok(Some(Self::learned_bilateral()))
                }
            },
        }
    }

    fn learned_bilateral() -> Self {
        Self::Bilateral { parameters: bilateral::Parameters::learned(), name: "bilateral" }
    }

    /// Denoises with a progress bar; what had to be mended is told. To be called outside of the threads of the pool.
    pub(super) fn run(
        &self,
        layers: &Layers,
        threads: &rayon::ThreadPool,
    ) -> anyhow::Result<Denoised> {
        let progress = Progress::new("denoise", "steps", 1000);
        let heard = |part: f32| progress.at((part * 1000.0) as u64);
        let outcome = match self {
            Self::Bilateral { parameters, name } => {
                threads.install(|| bilateral::denoise(layers, parameters, &heard)).map(|denoised| {
                    let denoised_by = Denoised {
                        image: denoised.image,
                        name: "the bilateral filter",
                        details: vec![("denoiser", (*name).into())],
                    };
                    (denoised_by, denoised.report.sanitised)
                })
            }
            Self::Kpcn { networks, quality } => {
                networks.denoise(layers, threads, &heard).map(|denoised| {
                    let details = details(networks, *quality, &denoised.report);
                    let name = "neural networks";
                    (Denoised { image: denoised.image, name, details }, denoised.report.sanitised)
                })
            }
        };
        progress.finish();
        let (denoised, mended): (Denoised, Sanitised) = outcome?;
        if mended.total() > 0 {
            eprintln!(
                "warning: {} values of the layers were not usable and were replaced",
                mended.total()
            );
        }
        Ok(denoised)
    }
}

/// The networks of a quality that are in this program, if onnxruntime is there to run them.
fn embedded(quality: Quality) -> Result<Denoising, Error> {
    let quality = match quality {
        Quality::Fast => kpcn::Quality::Fast,
        Quality::Balanced => kpcn::Quality::Balanced,
        Quality::High => kpcn::Quality::High,
    };
    let networks = kpcn::Denoiser::embedded(quality)?;
    kpcn::runtime()?;
    Ok(Denoising::Kpcn { networks, quality: Some(quality) })
}

/// What the metadata of a picture says of the networks that denoised it.
fn details(
    networks: &kpcn::Denoiser,
    quality: Option<kpcn::Quality>,
    report: &kpcn::Report,
) -> Vec<(&'static str, String)> {
    let mut details = vec![
        ("denoiser", "kpcn".to_owned()),
        ("denoiser.quality", quality.map_or("own files", kpcn::Quality::name).to_owned()),
    ];
    for (branch, model) in Branch::ALL.into_iter().zip(networks.models()) {
        let (run, sha256) = match branch {
            Branch::Diffuse => ("denoiser.diffuse", "denoiser.diffuse.sha256"),
            Branch::Specular => ("denoiser.specular", "denoiser.specular.sha256"),
        };
        if report.branches.contains(&branch) {
            details.push((run, model.name.clone()));
            details.push((sha256, model.sha256.clone()));
        } else {
            details.push((run, "not needed: no such light".to_owned()));
        }
    }
    let mixture = match report.fractions {
        Some(fractions) => format!(
            "{:.4} denoised on average, {:.4} of the pixels mostly noisy",
            fractions.mean, fractions.mostly_noisy
        ),
        None => "not mixed with the noisy picture: its noise is not known".to_owned(),
    };
    details.push(("denoiser.mixture", mixture));
    details.push(("denoiser.tiles", report.tiles.to_string()));
    details.push(("denoiser.network_seconds", format!("{:.3}", report.network_time.as_secs_f64())));
    details.push(("denoiser.seconds", format!("{:.3}", report.time.as_secs_f64())));
    details
}

impl Denoised {
    /// For the metadata of the picture.
    pub(super) fn facts(&self) -> impl Iterator<Item = (String, String)> {
        self.details.iter().map(|(name, value)| ((*name).to_owned(), value.clone()))
    }

    /// For the outcome as JSON.
    pub(super) fn json(&self) -> serde_json::Value {
        self.facts().map(|(name, value)| (name, serde_json::Value::from(value))).collect()
    }
}
