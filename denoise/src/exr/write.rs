//! Writing our own files.

use std::path::Path;

use ::exr::image as pixels;
use ::exr::meta::attribute::{AttributeValue, IntegerBounds, Text};
use ::exr::meta::header::{ImageAttributes, LayerAttributes};
use ::exr::prelude::{Compression, LineOrder, WritableImage};
use ndarray::Axis;

use super::channels::{Part, Role, name};
use super::{ATTRIBUTE_PREFIX, Frame};
use crate::error::Error;
use crate::layers::{Image, LayerKind, Layers};

/// What [`write()`] puts into a file beside the layers.
#[derive(Clone, Copy, Debug, Default)]
pub struct WriteOptions<'a> {
    /// The picture, `[3, height, width]`, for instance denoised; `None` writes the mean of the beauty layer.
    pub picture: Option<&'a Image>,
    /// Whether to write the halves A and B of the layers that have them.
    pub halves: bool,
    /// Where the pixels lie in the whole picture; `None`: they are the whole picture.
    pub frame: Option<Frame>,
}

/// Writes `layers` and the picture to `path`, whole or not at all.
///
/// # Errors
/// [`Error::Shape`] where an image has not the size of `layers`; [`Error::MissingLayer`] where there is neither a
/// picture nor a beauty layer; [`Error::Io`] and [`Error::Format`] where the file cannot be written.
pub fn write(path: &Path, layers: &Layers, options: &WriteOptions<'_>) -> Result<(), Error> {
    layers.check_shapes()?;
    let image = image(path, layers, options)?;
    crate::atomic::write(path, |file| {
        image.write().to_buffered(file).map_err(|error| match error {
            ::exr::error::Error::Io(source) => Error::Io { path: path.to_path_buf(), source },
            error => Error::Format {
                path: path.to_path_buf(),
                found: format!("layers that an EXR file cannot hold ({error})"),
                expected: "at least one pixel and unique names".into(),
            },
        })
    })
}

fn image(
    path: &Path,
    layers: &Layers,
    options: &WriteOptions<'_>,
) -> Result<pixels::Image<pixels::Layer<pixels::AnyChannels<pixels::FlatSamples>>>, Error> {
    let beauty = layers.layers.get(&LayerKind::Beauty).map(|layer| &layer.mean);
    let picture = options.picture.or(beauty).ok_or_else(|| layers.missing(LayerKind::Beauty))?;
    if picture.dim() != (3, layers.height, layers.width) {
        let (channels, height, width) = picture.dim();
        return Err(Error::Shape {
            what: "picture".into(),
            found: [channels, height, width],
            expected: [3, layers.height, layers.width],
        });
    }

    let mut parts = vec![(Part::Picture, picture)];
    for (&kind, layer) in &layers.layers {
        parts.push((Part::Layer(kind, Role::Mean), &layer.mean));
        parts.extend(layer.variance.iter().map(|image| (Part::Layer(kind, Role::Variance), image)));
        if let (true, Some([a, b])) = (options.halves, &layer.halves) {
            parts.extend([(Part::Layer(kind, Role::A), a), (Part::Layer(kind, Role::B), b)]);
        }
    }
    parts.extend(layers.samples.iter().map(|image| (Part::Samples, image)));
    parts.extend(layers.invalid.iter().map(|image| (Part::Invalid, image)));
    let channels = parts.into_iter().flat_map(|(part, image)| {
        image.axis_iter(Axis(0)).enumerate().map(move |(component, plane)| {
            let samples = pixels::FlatSamples::F32(plane.iter().copied().collect());
            pixels::AnyChannel::new(Text::new_or_panic(name(part, component)), samples)
        })
    });

    let frame = options.frame.unwrap_or(Frame::whole(layers.width, layers.height));
    let mut attributes =
        LayerAttributes { layer_position: frame.offset.into(), ..Default::default() };
    for (key, value) in &layers.metadata {
        let key = text(&format!("{ATTRIBUTE_PREFIX}{key}"));
        if key.bytes().len() > 255 || key.bytes().contains(&0) {
            return Err(Error::Format {
                path: path.to_path_buf(),
                found: format!("the metadata key {key}"),
                expected: "at most 255 bytes without NUL".into(),
            });
        }
        attributes.other.insert(key, AttributeValue::Text(text(value)));
    }
    let encoding = pixels::Encoding {
        compression: Compression::ZIP16,
        blocks: pixels::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = pixels::Layer::new(
        (layers.width, layers.height),
        attributes,
        encoding,
        pixels::AnyChannels::sort(channels.collect()),
    );
    let display = IntegerBounds::new(frame.display_offset, frame.display);
    Ok(pixels::Image::new(ImageAttributes::new(display), layer))
}

/// EXR text is bytes; since OpenEXR 2.0 they are UTF-8.
fn text(string: &str) -> Text {
    Text::from_slice_unchecked(string.as_bytes())
}
