//! Kernel-predicting denoising (Bako et al. 2017, "Kernel-Predicting Convolutional Networks for Denoising Monte Carlo
//! Renderings"): networks see the noisy light, its variance and the features, and predict for each pixel the weights of
//! its neighbours.
//!
//! In order: take the layers and make them safe (`buffers`); for each tile and branch, make the network's channels
//! (`channels`, `transform`), run it (`network`), apply its kernels (`pyramid` or `kernel`); put the branches
//! together, and for the highest quality the mean over the picture in six orientations (`orientation`); mix with the
//! noisy picture where filtering harms ([`blend`](crate::blend)). A branch without light does not run.

mod buffers;
mod channels;
mod embedded;
mod head;
mod kernel;
mod library;
mod model;
mod network;
mod noise;
mod orientation;
mod picture;
mod pyramid;
mod softmax;
mod tile;
mod transform;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use buffers::Buffers;
pub use buffers::LAYERS;
pub use channels::{KERNEL, PYRAMID};
pub use kernel::apply as apply_kernel;
pub use library::{Origin, PATH_VARIABLE};
pub use model::{Entry, Model, Quality, entries};
pub use network::{Branch, Kind, Network, PROVIDER, Runtime, runtime};
use orientation::Orientation;
use picture::{Filtered, Picture, WITH_NOISE, WITHOUT_NOISE};
pub use pyramid::{
    FINEST_OUTPUTS as PYRAMID_FINEST_OUTPUTS, OUTPUTS as PYRAMID_OUTPUTS, apply as apply_pyramid,
};
use tile::Tile;
pub use transform::EPSILON;

use crate::blend::Fractions;
use crate::error::Error;
use crate::layers::{Image, LayerKind, Layers};
use crate::sanitize::Sanitised;

/// Orientations of the highest quality. With all eight, relative L2 was another half percent lower (30 views that no network
/// had seen), 1 − SSIM the same, at a third more time.
const HIGH: usize = 6;

/// A pair of networks, one for each branch.
#[derive(Clone, Debug)]
pub struct Denoiser {
    /// Of the diffuse and of the specular branch.
    models: [Model; 2],
    /// How the picture is turned: the result is the mean over all of them.
    orientations: &'static [Orientation],
    /// Whether the result is mixed with the noisy picture where filtering harms.
    mixes: bool,
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Values that had to be replaced before anything else.
    pub sanitised: Sanitised,
    /// Layers whose variance is that of the 3×3 neighbours, for want of samples to tell.
    pub spatial_variance: Vec<LayerKind>,
    /// Branches whose network ran; the others had no light.
    pub branches: Vec<Branch>,
    /// How the result was mixed with the noisy picture; `None` where it was not, for no variance tells of the noise.
    pub fractions: Option<Fractions>,
    /// Tiles that the picture was cut into.
    pub tiles: usize,
    /// In how many orientations; the result is the mean over them.
    pub orientations: usize,
    /// Time in the networks, of all threads together as the wall clock saw them.
    pub network_time: Duration,
    /// All of the time.
    pub time: Duration,
}

/// A denoised picture.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// The picture, `[3, height, width]`.
    pub image: Image,
    /// What was done.
    pub report: Report,
}

impl Denoiser {
    /// The weights of a quality that are in this program.
    ///
    /// # Errors
    /// [`Error::Model`] where there are none or they are damaged.
    pub fn embedded(quality: Quality) -> Result<Self, Error> {
        let [diffuse, specular] = Branch::ALL.map(|branch| Model::embedded(quality, branch));
        let orientations = match quality {
            Quality::High => &orientation::ALL[..HIGH],
            Quality::Fast | Quality::Balanced => &orientation::ALL[..1],
        };
        Ok(Self { models: [diffuse?, specular?], orientations, mixes: true })
    }

    /// A user's own weights, of the diffuse and the specular branch in any order.
    ///
    /// # Errors
    /// [`Error::Io`] where a file cannot be read, [`Error::OnnxRuntime`] where there is nothing to open them with,
    /// [`Error::Model`] where a file is no such network or both are of one branch or of different kinds.
    pub fn from_files(files: [&Path; 2], threads: usize) -> Result<Self, Error> {
        let open = |path| {
            let model = Model::read(path)?;
            Ok::<_, Error>((Network::of(&model, threads)?, model))
        };
        let [(first, diffuse), (second, specular)] = {
            let [a, b] = files;
            let (a, b) = (open(a)?, open(b)?);
            if a.0.branch <= b.0.branch { [a, b] } else { [b, a] }
        };
        if first.branch == second.branch {
            let found = format!("the branch '{}', as in {}", second.branch.name(), diffuse.name);
            return Err(specular.refused(found, "one file of each branch"));
        }
        if first.kind != second.kind {
            let found = format!("{:?}", second.kind);
            return Err(
                specular.refused(found, &format!("{:?} as in {}", first.kind, diffuse.name))
            );
        }
        let orientations = &orientation::ALL[..1];
        Ok(Self { models: [diffuse, specular], orientations, mixes: true })
    }

    /// The same networks, whose result is left as it is: to judge them by themselves.
    pub fn without_mixing(self) -> Self {
        Self { mixes: false, ..self }
    }

    /// The weights of the diffuse and of the specular branch.
    pub fn models(&self) -> &[Model; 2] {
        &self.models
    }

    /// Denoises the light of `layers`: diffuse and specular where both are there, else the beauty layer as if it were
    /// diffuse. `threads` runs what is not the networks; these get as many threads of their own, in turn. `progress` hears
    /// the part that is done, in `[0, 1]`.
    ///
    /// Must not be called by one of rayon's workers, which would wait for the networks with nothing to do.
    ///
    /// # Errors
    /// [`Error::MissingLayer`] where there is no light, [`Error::Shape`] where an image has not the size of the picture or
    /// the picture has no pixel, [`Error::OnnxRuntime`] and [`Error::Model`] where a network cannot be loaded,
    /// [`Error::Inference`] where it fails or gives no number.
    pub fn denoise(
        &self,
        layers: &Layers,
        threads: &rayon::ThreadPool,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Denoised, Error> {
        let start = Instant::now();
        let buffers = threads.install(|| Buffers::new(layers))?;
        let mut networks = Vec::new();
        for (branch, model) in Branch::ALL.into_iter().zip(&self.models) {
            if threads.install(|| buffers.needs(branch)) {
                let network = Network::of(model, threads.current_num_threads())?;
                if network.branch != branch {
                    let found = format!("the branch '{}'", network.branch.name());
                    return Err(model.refused(found, branch.name()));
                }
                networks.push(network);
            }
        }
        let grid = match networks.first().map(|network| network.kind) {
            Some(Kind::Kernel { .. }) => kernel::GRID,
            _ => pyramid::GRID,
        };
        let count = self.orientations.len();
        let cut = |buffers: &Buffers<'_>| grid.tiles(buffers.width, buffers.height);
        let after = |done: usize| move |part: f32| progress((done as f32 + part) / count as f32);
        let tiles = cut(&buffers);
        let (mut picture, mut network_time) =
            reconstruct(&buffers, &networks, &tiles, threads, &after(0))?;
        for (done, orientation) in self.orientations.iter().enumerate().skip(1) {
            let turned = threads.install(|| buffers.turned(*orientation));
            let (turned, time) =
                reconstruct(&turned, &networks, &cut(&turned), threads, &after(done))?;
            threads.install(|| picture.average(done, &turned));
            network_time += time;
        }
        let (image, fractions) = threads.install(|| match self.mixes {
            true => picture.finish(),
            false => (picture.denoised(), None),
        });
        if let Some(((channel, y, x), _)) =
            image.indexed_iter().find(|(_, value)| !value.is_finite())
        {
            let reason = format!("channel {channel} of pixel ({x}, {y}) is not finite");
            return Err(Error::Inference { model: self.models[0].name.clone(), reason });
        }
        let report = Report {
            sanitised: buffers.sanitised,
            spatial_variance: buffers.spatial_variance.clone(),
            branches: networks.iter().map(|network| network.branch).collect(),
            fractions,
            tiles: tiles.len(),
            orientations: count,
            network_time,
            time: start.elapsed(),
        };
        Ok(Denoised { image, report })
    }
}

/// Filters all tiles by all networks, and adds what is not filtered. Returns the picture, not yet mixed with the noisy one,
/// and the time in the networks.
fn reconstruct<'a>(
    buffers: &'a Buffers<'a>,
    networks: &[Arc<Network>],
    tiles: &[Tile],
    threads: &rayon::ThreadPool,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<(Picture<'a>, Duration), Error> {
    let mut picture = threads.install(|| Picture::new(buffers));
    let mut network_time = Duration::ZERO;
    let steps = (tiles.len() * networks.len()) as f32;
    let mut done = 0.0;
    for network in networks {
        for tile in tiles {
            let (filtered, time) = filter_tile(network, &picture, tile, threads)?;
            network_time += time;
            threads.install(|| picture.add(tile, &filtered));
            done += 1.0;
            progress(done / steps);
        }
        let most = tiles.iter().map(|tile| tile.padded[0] * tile.padded[1]).max();
        network.release_memory(most.unwrap_or(0));
    }
    for branch in Branch::ALL {
        if networks.iter().all(|network| network.branch != branch) {
            threads.install(|| picture.add_noisy(branch));
        }
    }
    Ok((picture, network_time))
}

/// Runs a network over a tile and applies its kernels. Returns the filtered signal and the time in the network.
fn filter_tile(
    network: &Network,
    picture: &Picture<'_>,
    tile: &Tile,
    threads: &rayon::ThreadPool,
) -> Result<(Filtered, Duration), Error> {
    let (branch, kind) = (network.branch, network.kind);
    let input = threads.install(|| match kind {
        Kind::KernelPyramid => channels::pyramid(picture.buffers, branch, tile),
        Kind::Kernel { .. } => channels::kernel(picture.buffers, branch, tile),
    });
    let start = Instant::now();
    network.run(input, tile.padded, |outputs| {
        let time = start.elapsed();
        let signal = threads.install(|| {
            let signal = picture.signal(branch, kind, tile);
            if picture.has_noise() {
                apply::<WITH_NOISE>(kind, outputs, tile, &signal)
            } else {
                apply::<WITHOUT_NOISE>(kind, outputs, tile, &signal)
            }
        });
        (Filtered { branch, kind, signal }, time)
    })
}

fn apply<const C: usize>(kind: Kind, outputs: &[&[f32]], tile: &Tile, signal: &[f32]) -> Vec<f32> {
    match kind {
        Kind::KernelPyramid => {
            pyramid::apply::<C>(outputs, tile.padded, tile.size(), &tile.core(), signal)
        }
        Kind::Kernel { size } => kernel::apply::<C>(outputs[0], tile.size(), size, signal),
    }
}

#[cfg(test)]
mod tests;
