//! The layout that the training tools of Open Image Denoise read: one file of three channels for each feature of each render,
//! `train/ID_0016spp.hdr.exr`, `….alb.exr`, `….nrm.exr`, and `train/ID_ref.hdr.exr` (its documentation, "Training", section
//! "Datasets").

use super::Error;
use super::manifest::{Split, View, views};
use crate::folder::at;
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::{Image, LayerKind, Layers};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The features of that layout, by the ending of their files.
const FEATURES: [(LayerKind, &str); 3] =
    [(LayerKind::Beauty, "hdr"), (LayerKind::Albedo, "alb"), (LayerKind::Normal, "nrm")];

/// How many renders were exported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// Views.
    pub views: usize,
    /// Noisy renders and references together.
    pub renders: usize,
}

/// Writes the complete views of the data set in `folder` below `output`: those for training into `train`, those for
/// validation into `valid`. `progress` is called with the number of views done.
///
/// # Errors
/// Where a file cannot be read or written, or has not the layers that it must have.
pub fn export(folder: &Path, output: &Path, progress: &dyn Fn(u64)) -> Result<Exported, Error> {
    let views = views(folder)?;
    for split in ["train", "valid"] {
        let path = output.join(split);
        fs::create_dir_all(&path).map_err(at(&path))?;
    }
    let mut exported = Exported::default();
    for (index, view) in views.iter().enumerate() {
        exported.views += 1;
        exported.renders += export_view(folder, output, view)?;
        progress(index as u64 + 1);
    }
    Ok(exported)
}

/// Writes one view; returns how many renders of it.
fn export_view(folder: &Path, output: &Path, view: &View) -> Result<usize, Error> {
    let split = match view.identity.split {
        Split::Train => output.join("train"),
        Split::Validation => output.join("valid"),
    };
    let id = &view.identity.id;
    let source = View::folder(folder, id);
    // A name holds an image's number of samples once. Further renders of as many samples are images of their own, with the
    // same reference.
    let mut of_count: BTreeMap<u32, usize> = BTreeMap::new();
    let mut references = 1;
    for noisy in &view.noisy {
        let repeated = of_count.entry(noisy.spp).or_default();
        let name = format!("{}_{:04}spp", image_name(id, *repeated), noisy.spp);
        *repeated += 1;
        references = references.max(*repeated);
        split_layers(&source.join(&noisy.file), &split, &name)?;
    }
    for repeated in 0..references {
        let name = format!("{}_ref", image_name(id, repeated));
        split_layers(&source.join(&view.reference.file), &split, &name)?;
    }
    Ok(view.noisy.len() + references)
}

/// What the files of one image begin with; `repeated` counts the images of one view.
fn image_name(id: &str, repeated: usize) -> String {
    if repeated == 0 { id.to_owned() } else { format!("{id}-{repeated}") }
}

/// Writes each feature of an EXR with many layers into a file of its own.
fn split_layers(file: &Path, folder: &Path, name: &str) -> Result<(), Error> {
    let mut layers = exr::read(file)?.layers;
    let size = (layers.width, layers.height);
    for (kind, ending) in FEATURES {
        let layer =
            layers.layers.remove(&kind).ok_or_else(|| quietlight_denoise::Error::Format {
                path: file.to_path_buf(),
                found: format!("no layer {}", kind.name()),
                expected: "colour, albedo and normal".to_owned(),
            })?;
        write_plain(&folder.join(format!("{name}.{ending}.exr")), &layer.mean, size)?;
    }
    Ok(())
}

/// Writes a picture alone, as `R`, `G` and `B`.
fn write_plain(path: &Path, picture: &Image, (width, height): (usize, usize)) -> Result<(), Error> {
    let layers = Layers { width, height, ..Layers::default() };
    let options = WriteOptions { picture: Some(picture), ..WriteOptions::default() };
    Ok(exr::write(path, &layers, &options)?)
}
