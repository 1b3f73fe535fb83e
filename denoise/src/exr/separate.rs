//! Layers that lie in a file each, as other denoisers take them: a colour, an albedo and a normal file.

use std::path::{Path, PathBuf};

use super::channels::Role;
use super::read::Contents;
use crate::error::Error;
use crate::layers::{Image, Layer, LayerKind};
use crate::picture;

/// One file beside the one with the noisy picture.
#[derive(Clone, Debug)]
pub struct SeparateFile {
    /// Layer that the file belongs to.
    pub kind: LayerKind,
    /// Which image of that layer it is.
    pub role: Role,
    /// EXR, PFM, HDR, PNG or JPEG; the last two are taken as sRGB.
    pub path: PathBuf,
}

/// Reads the noisy picture from `colour` and adds the images of `files`, as the triples of Intel's Open Image Denoise
/// (colour, albedo, normal) or the many files of Tungsten. A layer of `colour` that is in `files` too is replaced.
///
/// # Errors
/// Those of [`read_picture`](crate::picture::read_picture) for each file; [`Error::Shape`] where one has another size
/// than `colour`; [`Error::MissingLayer`] where a variance or a half comes without its mean, or one half without the
/// other.
pub fn read_separate(colour: &Path, files: &[SeparateFile]) -> Result<Contents, Error> {
    let mut contents = picture::read_contents(colour)?;
    for kind in LayerKind::ALL {
        let image = |role| -> Result<Option<Image>, Error> {
            let Some(file) = files.iter().find(|file| file.kind == kind && file.role == role)
            else {
                return Ok(None);
            };
            let ending = file.path.extension().unwrap_or_default().to_ascii_lowercase();
            if kind != LayerKind::Albedo
                && !kind.is_radiance()
                && ["png", "jpg", "jpeg"].iter().any(|display| ending == *display)
            {
                // Colours of a display have no sign, and the curve of its brightness bends all numbers.
                return Err(Error::Format {
                    path: file.path.clone(),
                    found: "a picture of display colours".into(),
                    expected: format!("an EXR or PFM for {}", kind.name()),
                });
            }
            let image = picture::read_picture(&file.path)?;
            // A layer of one channel comes as grey.
            Ok(Some(if kind.components().len() == 1 {
                image.slice_move(ndarray::s![..1, .., ..])
            } else {
                image
            }))
        };
        if let Some(mean) = image(Role::Mean)? {
            contents.layers.layers.insert(kind, Layer { mean, variance: None, halves: None });
        }
        let variance = image(Role::Variance)?;
        let halves = match (image(Role::A)?, image(Role::B)?) {
            (Some(a), Some(b)) => Some([a, b]),
            (None, None) => None,
            _ => {
                let missing = format!("{}.a or {}.b", kind.name(), kind.name());
                return Err(Error::MissingLayer {
                    missing,
                    found: "one half without the other".into(),
                });
            }
        };
        if variance.is_some() || halves.is_some() {
            let missing = contents.layers.missing(kind);
            let layer = contents.layers.layers.get_mut(&kind).ok_or(missing)?;
            layer.variance = variance.or(layer.variance.take());
            layer.halves = halves.or(layer.halves.take());
        }
    }
    contents.layers.check_shapes()?;
    Ok(contents)
}
