//! Reading our own files and those of other renderers.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;

use ::exr::image::{FlatImage, FlatSamples};
use ::exr::meta::attribute::AttributeValue;
use ndarray::Axis;

use super::channels::{Meaning, Part, Role, recognise};
use super::decode::{DecodeError, decode};
use super::{ATTRIBUTE_PREFIX, Frame};
use crate::error::Error;
use crate::layers::{Image, Layer, LayerKind, Layers};

/// What a file holds.
#[derive(Clone, Debug)]
pub struct Contents {
    /// The layers that were recognised.
    pub layers: Layers,
    /// The picture `R G B`, `[3, height, width]`; `None` where the file has only layers.
    pub picture: Option<Image>,
    /// Where the pixels lie in the whole picture.
    pub frame: Frame,
    /// Names of the channels that mean nothing to a denoiser and were left out.
    pub ignored: Vec<String>,
}

/// Reads the layers of an EXR file of any renderer whose names are known (see the table in `exr/channels.rs`).
///
/// Where a file has no layer for the noisy picture, its `R G B` are the beauty layer too. The data window may be
/// anywhere: its pixels are the images, its place is [`Contents::frame`].
///
/// # Errors
/// [`Error::Io`] where the file cannot be opened; [`Error::Format`] where it is no EXR file, is damaged or cut off,
/// where a layer has not all of its channels or another size than the others, or where no channel is recognised.
pub fn read(path: &Path) -> Result<Contents, Error> {
    let parts = collect(path, open(path)?)?;
    assemble(path, parts)
}

/// A channel of the file: its name, the index of the file's part and the index in that part.
type Source = (String, usize, usize);

/// Images that were found, and what else the file says.
struct Found {
    images: BTreeMap<Part, Image>,
    frame: Frame,
    size: [usize; 2],
    metadata: BTreeMap<String, String>,
    samples_per_pixel: Option<f32>,
    ignored: Vec<String>,
}

fn format_error(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
    Error::Format { path: path.to_path_buf(), found: found.into(), expected: expected.into() }
}

/// The depth that Blender gives to pixels in which nothing is hit.
const NOT_HIT: f32 = 1e10;

fn open(path: &Path) -> Result<FlatImage, Error> {
    let io = |source| Error::Io { path: path.to_path_buf(), source };
    let length = std::fs::metadata(path).map_err(io)?.len();
    decode(|| std::fs::File::open(path), length).map_err(|error| match error {
        DecodeError::Io(source) => io(source),
        DecodeError::Damaged(found) => format_error(path, found, "a whole EXR file of flat pixels"),
    })
}

/// Sorts the channels of all parts of the file into images.
fn collect(path: &Path, mut file: FlatImage) -> Result<Found, Error> {
    let multipart = file.layer_data.len() > 1;
    let mut metadata = BTreeMap::new();
    let mut samples_per_pixel = None;
    let mut ignored = Vec::new();
    // By part and rank, then by component.
    let mut candidates: BTreeMap<(Part, u8), BTreeMap<usize, Source>> = BTreeMap::new();

    for (part_index, part) in file.layer_data.iter().enumerate() {
        for (key, value) in file.attributes.other.iter().chain(&part.attributes.other) {
            let key = String::from_utf8_lossy(key.bytes()).into_owned();
            match value {
                AttributeValue::Text(text) => {
                    let key = key.strip_prefix(ATTRIBUTE_PREFIX).unwrap_or(&key).to_owned();
                    metadata.insert(key, String::from_utf8_lossy(text.bytes()).into_owned());
                }
                AttributeValue::I32(samples) if key == "samplesPerPixel" => {
                    samples_per_pixel = Some(*samples as f32);
                }
                _ => {}
            }
        }
        let part_name =
            part.attributes.layer_name.as_ref().map(|name| String::from_utf8_lossy(name.bytes()));
        for (channel_index, channel) in part.channel_data.list.iter().enumerate() {
            let plain = String::from_utf8_lossy(channel.name.bytes()).into_owned();
            match meaning(&plain, part_name.as_deref().filter(|_| multipart)) {
                Some(Meaning { part, component, rank }) => {
                    let components = candidates.entry((part, rank)).or_default();
                    match components.entry(component) {
                        Entry::Vacant(entry) => {
                            entry.insert((plain, part_index, channel_index));
                        }
                        Entry::Occupied(_) => ignored.push(plain),
                    }
                }
                None => ignored.push(plain),
            }
        }
    }

    // Of each part, the best name that has all its channels.
    let mut chosen: BTreeMap<Part, Vec<Source>> = BTreeMap::new();
    let mut incomplete: BTreeMap<Part, Vec<String>> = BTreeMap::new();
    for ((part, _), components) in candidates {
        let names = components.values().map(|(name, ..)| name.clone());
        match chosen.entry(part) {
            Entry::Occupied(_) => ignored.extend(names),
            Entry::Vacant(_) if components.len() < part.components().len() => {
                incomplete.entry(part).or_default().extend(names);
            }
            Entry::Vacant(entry) => {
                entry.insert(components.into_values().collect());
            }
        }
    }
    for (part, names) in incomplete {
        if !chosen.contains_key(&part) {
            let components = part.components().join(", ");
            return Err(format_error(
                path,
                format!("only {} of a layer", names.join(", ")),
                format!("all of {components}"),
            ));
        }
        ignored.extend(names);
    }
    let Some(&(_, first, _)) = chosen.values().flatten().next() else {
        let found = if ignored.is_empty() {
            "no flat pixels".into()
        } else {
            format!("the channels {}", ignored.join(", "))
        };
        return Err(format_error(path, found, "R, G, B or the layers of a renderer"));
    };

    let bounds = file.layer_data[first].absolute_bounds();
    let mut images = BTreeMap::new();
    for (part, channels) in chosen {
        let mut image = Image::zeros((channels.len(), bounds.size.height(), bounds.size.width()));
        for ((name, part_index, channel_index), mut plane) in
            channels.into_iter().zip(image.axis_iter_mut(Axis(0)))
        {
            let source = &mut file.layer_data[part_index];
            let window = source.absolute_bounds();
            // Taken, so that the memory of each channel is free for the next image.
            let samples = &mut source.channel_data.list[channel_index].sample_data;
            let samples = std::mem::replace(samples, FlatSamples::F32(Vec::new()));
            if window != bounds || samples.len() != plane.len() {
                return Err(format_error(
                    path,
                    format!("{name} with the window {window:?}"),
                    format!("{bounds:?}, as the other layers have, without subsampling"),
                ));
            }
            plane.iter_mut().zip(samples.values_as_f32()).for_each(|(pixel, value)| *pixel = value);
        }
        images.insert(part, image);
    }
    let display = file.attributes.display_window;
    let frame = Frame {
        offset: (bounds.position.x(), bounds.position.y()),
        display_offset: (display.position.x(), display.position.y()),
        display: (display.size.width(), display.size.height()),
    };
    let size = [bounds.size.width(), bounds.size.height()];
    Ok(Found { images, frame, size, metadata, samples_per_pixel, ignored })
}

/// Meaning of a channel. In a file of several parts the part's name stands before the channel's, unless the channel's
/// own name says enough; where neither says anything, plain `R G B` are the picture, whatever the part is called.
fn meaning(name: &str, part_name: Option<&str>) -> Option<Meaning> {
    let own = recognise(name);
    match (own, part_name) {
        (own, None) => own,
        (Some(meaning), _) if name.contains('.') => Some(meaning),
        (own, Some(part_name)) => recognise(&format!("{part_name}.{name}")).or(own),
    }
}

/// Turns images into layers: a variance per sample becomes one of the mean, the picture becomes the beauty layer where
/// there is no other.
fn assemble(path: &Path, found: Found) -> Result<Contents, Error> {
    let Found { mut images, frame, size: [width, height], metadata, samples_per_pixel, ignored } =
        found;
    let picture = images.remove(&Part::Picture);
    let mut layers = Layers {
        width,
        height,
        samples: images.remove(&Part::Samples),
        invalid: images.remove(&Part::Invalid),
        error: images.remove(&Part::Error),
        metadata,
        ..Default::default()
    };
    for kind in LayerKind::ALL {
        let mut take = |role| images.remove(&Part::Layer(kind, role));
        let mean =
            take(Role::Mean).or_else(|| picture.clone().filter(|_| kind == LayerKind::Beauty));
        // Without the number of samples a variance per sample says nothing about the mean.
        let per_sample =
            take(Role::SampleVariance).zip(samples_per_pixel).map(|(image, n)| image / n.max(1.0));
        let variance = take(Role::Variance).or(per_sample);
        let halves = take(Role::A).zip(take(Role::B)).map(|(a, b)| [a, b]);
        match mean {
            Some(mut mean) => {
                if kind == LayerKind::Depth {
                    // Blender's depth of what is not hit; ours is 0.
                    mean.mapv_inplace(|depth| if depth >= NOT_HIT { 0.0 } else { depth });
                }
                layers.layers.insert(kind, Layer { mean, variance, halves });
            }
            None if variance.is_some() || halves.is_some() => {
                let name = kind.name();
                return Err(format_error(
                    path,
                    format!("the variance or the halves of {name} alone"),
                    format!("{name} too"),
                ));
            }
            None => {}
        }
    }
    layers.check_shapes()?;
    Ok(Contents { layers, picture, frame, ignored })
}
