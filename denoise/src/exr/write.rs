//! Writing our own files.

use std::path::Path;

use ::exr::block::lines::LineRefMut;
use ::exr::image as pixels;
use ::exr::image::write::samples::{SamplesWriter, WritableSamples};
use ::exr::math::RoundingMode;
use ::exr::meta::attribute::{AttributeValue, IntegerBounds, LevelMode, SampleType, Text};
use ::exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use ::exr::prelude::{Compression, LineOrder, WritableImage};
use ndarray::{ArrayView2, Axis};

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

/// A channel that is written from where it lies: a copy of all would double the memory of a large picture.
struct Plane<'a>(ArrayView2<'a, f32>);

impl<'a> WritableSamples<'a> for Plane<'_> {
    type Writer = Plane<'a>;

    fn sample_type(&self) -> SampleType {
        SampleType::F32
    }

    fn infer_level_modes(&self) -> (LevelMode, RoundingMode) {
        (LevelMode::Singular, RoundingMode::Down)
    }

    fn create_samples_writer(&'a self, _: &Header) -> Self::Writer {
        Plane(self.0.view())
    }
}

impl SamplesWriter for Plane<'_> {
    fn extract_line(&self, line: LineRefMut<'_>) {
        let [x, y] = [line.location.position.x(), line.location.position.y()];
        line.write_samples(|index| self.0[[y, x + index]])
            .expect("a line in memory takes as many samples as it has room for");
    }
}

type File<'a> = pixels::Image<pixels::Layer<pixels::AnyChannels<Plane<'a>>>>;

fn image<'a>(
    path: &Path,
    layers: &'a Layers,
    options: &WriteOptions<'a>,
) -> Result<File<'a>, Error> {
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
    parts.extend(layers.error.iter().map(|image| (Part::Error, image)));
    let channels = parts.into_iter().flat_map(|(part, image)| {
        image.axis_iter(Axis(0)).enumerate().map(move |(component, plane)| {
            pixels::AnyChannel::new(Text::new_or_panic(name(part, component)), Plane(plane))
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
