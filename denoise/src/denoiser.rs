//! The denoisers there are, behind one name.

use crate::error::Error;
use crate::kpcn::{self, Branch};
use crate::layers::{Image, LayerKind, Layers};
use crate::sanitize::Sanitised;
use crate::{bilateral, kpcn::Quality};
use std::path::Path;

/// What takes the noise out.
#[derive(Clone, Debug)]
pub enum Denoiser {
    /// The cross-bilateral filter.
    Bilateral {
        /// What it is told.
        parameters: bilateral::Parameters,
        /// Whether these are learned or constant, as on the command line.
        name: &'static str,
    },
    /// A pair of networks.
    Kpcn {
        /// The networks.
        networks: kpcn::Denoiser,
        /// Their quality; `None` for a user's own files.
        quality: Option<Quality>,
    },
}

/// A denoised picture and how it came about.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// The picture, `[3, height, width]`.
    pub image: Image,
    /// What denoised it, for the reader of a sentence.
    pub by: &'static str,
    /// What was done, as names and values for the metadata of the picture.
    pub details: Vec<(&'static str, String)>,
    /// Values of the layers that had to be replaced before anything else.
    pub sanitised: Sanitised,
}

impl Denoiser {
    /// The cross-bilateral filter with learned parameters.
    pub fn bilateral() -> Self {
        Self::Bilateral { parameters: bilateral::Parameters::learned(), name: "bilateral" }
    }

    /// The cross-bilateral filter with constant parameters.
    pub fn bilateral_constant() -> Self {
        let parameters = bilateral::Parameters::constant();
        Self::Bilateral { parameters, name: "bilateral-constant" }
    }

    /// The networks of a quality that are in this program.
    ///
    /// # Errors
    /// [`Error::Model`] where there are none or they are damaged, [`Error::OnnxRuntime`] where nothing is there to run them.
    pub fn embedded(quality: Quality) -> Result<Self, Error> {
        let networks = kpcn::Denoiser::embedded(quality)?;
        kpcn::runtime()?;
        Ok(Self::Kpcn { networks, quality: Some(quality) })
    }

    /// A user's own networks.
    ///
    /// # Errors
    /// As [`kpcn::Denoiser::from_files`].
    pub fn from_files(files: [&Path; 2], threads: usize) -> Result<Self, Error> {
        Ok(Self::Kpcn { networks: kpcn::Denoiser::from_files(files, threads)?, quality: None })
    }

    /// As on the command line: `bilateral`, `bilateral-constant` or `kpcn`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Bilateral { name, .. } => name,
            Self::Kpcn { .. } => "kpcn",
        }
    }

    /// Does it look at layers of that kind?
    pub fn uses(&self, kind: LayerKind) -> bool {
        const LIGHT: [LayerKind; 3] = [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Specular];
        match self {
            Self::Bilateral { .. } => LIGHT.contains(&kind) || bilateral::GROUPS.contains(&kind),
            Self::Kpcn { .. } => kpcn::LAYERS.contains(&kind),
        }
    }

    /// Denoises. `progress` hears the part that is done, in `[0, 1]`.
    ///
    /// Must not be called by one of rayon's workers, which would wait for the networks with nothing to do.
    ///
    /// # Errors
    /// As [`bilateral::denoise`] and [`kpcn::Denoiser::denoise`].
    pub fn denoise(
        &self,
        layers: &Layers,
        threads: &rayon::ThreadPool,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Denoised, Error> {
        match self {
            Self::Bilateral { parameters, name } => {
                let denoised =
                    threads.install(|| bilateral::denoise(layers, parameters, progress))?;
                let details = vec![("denoiser", (*name).to_owned())];
                let (image, sanitised) = (denoised.image, denoised.report.sanitised);
                Ok(Denoised { image, by: "the bilateral filter", details, sanitised })
            }
            Self::Kpcn { networks, quality } => {
                let denoised = networks.denoise(layers, threads, progress)?;
                let details = details(networks, *quality, &denoised.report);
                let (image, sanitised) = (denoised.image, denoised.report.sanitised);
                Ok(Denoised { image, by: "neural networks", details, sanitised })
            }
        }
    }
}

/// What the metadata of a picture says of the networks that denoised it.
fn details(
    networks: &kpcn::Denoiser,
    quality: Option<Quality>,
    report: &kpcn::Report,
) -> Vec<(&'static str, String)> {
    let mut details = vec![
        ("denoiser", "kpcn".to_owned()),
        ("denoiser.quality", quality.map_or("own files", Quality::name).to_owned()),
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
    details.push(("denoiser.orientations", report.orientations.to_string()));
    details.push(("denoiser.network_seconds", format!("{:.3}", report.network_time.as_secs_f64())));
    details.push(("denoiser.seconds", format!("{:.3}", report.time.as_secs_f64())));
    details
}

impl Denoised {
    /// For the metadata of the picture.
    pub fn facts(&self) -> impl Iterator<Item = (String, String)> {
        self.details.iter().map(|(name, value)| ((*name).to_owned(), value.clone()))
    }
}
