//! Image files: PNG, JPEG and HDR by `image`, EXR by `exr`; linear Rec. 709 out of all of them.

use crate::math::Rgb;
use exr::image::{AnyChannel, FlatSamples};
use quietlight_denoise::exr::decode;
use quietlight_denoise::picture::check_promise;
use quietlight_denoise::sha256::sha256;
use std::fmt;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Why an image could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct ImageError {
    /// The file.
    pub path: PathBuf,
    /// What was met, and what was expected.
    pub reason: String,
}

/// More texels than this are refused: 2²⁷ of them take 1.6 GB as floats, and a damaged header easily asks for more.
pub const MAX_TEXELS: u64 = 1 << 27;

/// The sRGB transfer curve: a stored value in `[0, 1]` to a linear one (IEC 61966-2-1).
pub fn srgb_to_linear(stored: f32) -> f32 {
    if stored <= 0.04045 { stored / 12.92 } else { ((stored + 0.055) / 1.055).powf(2.4) }
}

/// What the 256 values of an 8-bit channel mean.
pub(super) type Decoding = [f32; 256];

static SRGB: LazyLock<Decoding> =
    LazyLock::new(|| std::array::from_fn(|value| srgb_to_linear(value as f32 / 255.0)));
static LINEAR: LazyLock<Decoding> =
    LazyLock::new(|| std::array::from_fn(|value| value as f32 / 255.0));

/// Texels, row by row from the top. Eight-bit files stay eight-bit: they are most of a scene's memory.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// One stored value a texel.
    Gray8(Vec<u8>),
    /// Three stored values a texel.
    Rgb8(Vec<[u8; 3]>),
    /// One linear value a texel.
    Gray(Vec<f32>),
    /// Three linear values a texel.
    Rgb(Vec<Rgb>),
}

/// A decoded image. Alpha is dropped, as Mitsuba 3 does.
#[derive(Clone)]
pub struct Image {
    /// Texels across; at least 1.
    pub width: u32,
    /// Texels down; at least 1.
    pub height: u32,
    /// Values, not finite nowhere.
    texels: Texels,
    decoding: &'static Decoding,
    /// How many texels were not finite and were set to 0.
    pub broken: usize,
}

/// Size and a checksum of the texels, instead of millions of numbers.
impl fmt::Debug for Image {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, bytes) = match &self.texels {
            Texels::Gray8(values) => ("gray, 8 bits", values.clone()),
            Texels::Rgb8(values) => ("RGB, 8 bits", values.as_flattened().to_vec()),
            Texels::Gray(values) => {
                ("gray", values.iter().flat_map(|value| value.to_le_bytes()).collect())
            }
            Texels::Rgb(values) => {
                let numbers = values.iter().flat_map(|value| value.to_array());
                ("RGB", numbers.flat_map(f32::to_le_bytes).collect())
            }
        };
        out.debug_struct("Image")
            .field("width", &self.width)
            .field("height", &self.height)
            .field("kind", &kind)
            .field("is_linear", &(self.decoding == &*LINEAR))
            .field("sha256", &sha256(&bytes))
            .finish_non_exhaustive()
    }
}

impl Image {
    /// Reads a file. Integer formats are taken as sRGB unless `raw`: then stored values are divided by their maximum.
    /// Floating-point formats are linear in either case.
    ///
    /// # Errors
    /// The file cannot be read, is truncated or corrupt, is of an unknown format, or has more than [`MAX_TEXELS`].
    pub fn load(path: &Path, raw: bool) -> Result<Self, ImageError> {
        let fail = |reason: String| ImageError { path: path.to_path_buf(), reason };
        let bytes = std::fs::read(path).map_err(|error| fail(error.to_string()))?;
        Self::decode(&bytes, raw).map_err(fail)
    }

    /// The image of these texels.
    ///
    /// # Panics
    /// When there are not `width × height` texels, or none.
    pub fn new(width: u32, height: u32, texels: Texels, raw: bool) -> Self {
        let count = match &texels {
            Texels::Gray8(values) => values.len(),
            Texels::Rgb8(values) => values.len(),
            Texels::Gray(values) => values.len(),
            Texels::Rgb(values) => values.len(),
        };
        assert!(
            count > 0 && count == width as usize * height as usize,
            "{width}×{height} has {count} texels"
        );
        let mut image =
            Self { width, height, texels, decoding: if raw { &LINEAR } else { &SRGB }, broken: 0 };
        match &mut image.texels {
            Texels::Gray(values) => {
                for value in values.iter_mut().filter(|value| !value.is_finite()) {
                    *value = 0.0;
                    image.broken += 1;
                }
            }
            Texels::Rgb(values) => {
                for value in values.iter_mut().filter(|value| !value.is_finite()) {
                    *value = Rgb::BLACK;
                    image.broken += 1;
                }
            }
            Texels::Gray8(_) | Texels::Rgb8(_) => {}
        }
        image
    }

    fn decode(bytes: &[u8], raw: bool) -> Result<Self, String> {
        if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            return Self::decode_exr(bytes);
        }
        if bytes.starts_with(b"#?") {
            // Some writers sign with "#?RGBE": the reader need not look.
            let decoder = image::codecs::hdr::HdrDecoder::new_nonstrict(Cursor::new(bytes))
                .map_err(|error| error.to_string())?;
            return Self::decode_pixels(decoder, bytes.len(), raw);
        }
        if bytes.starts_with(&[0xff, 0xd8]) && !has_jpeg_end(bytes) {
            return Err("the JPEG file is truncated: it has no end mark".to_owned());
        }
        let reader = image::ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|error| error.to_string())?;
        if reader.format().is_none() {
            return Err("unknown image format; PNG, JPEG, HDR and EXR are known".to_owned());
        }
        let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
        Self::decode_pixels(decoder, bytes.len(), raw)
    }

    /// `length` is that of the file, in bytes.
    fn decode_pixels(
        decoder: impl image::ImageDecoder,
        length: usize,
        raw: bool,
    ) -> Result<Self, String> {
        use image::DynamicImage;

        let (width, height) = decoder.dimensions();
        check_size(u64::from(width), u64::from(height))?;
        check_promise(width, height, length)?;
        let pixels = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?;
        let linear = |stored: u16| {
            let stored = f32::from(stored) / 65535.0;
            if raw { stored } else { srgb_to_linear(stored) }
        };
        let texels = match pixels {
            DynamicImage::ImageLuma8(_) | DynamicImage::ImageLumaA8(_) => {
                Texels::Gray8(pixels.into_luma8().into_raw())
            }
            DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_) => {
                Texels::Gray(pixels.into_luma16().into_raw().into_iter().map(linear).collect())
            }
            DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_) => Texels::Rgb(
                pixels.into_rgb16().pixels().map(|pixel| Rgb::from(pixel.0.map(linear))).collect(),
            ),
            DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
                Texels::Rgb(pixels.into_rgb32f().pixels().map(|pixel| Rgb::from(pixel.0)).collect())
            }
            _ => Texels::Rgb8(pixels.into_rgb8().pixels().map(|pixel| pixel.0).collect()),
        };
        Ok(Self::new(width, height, texels, raw))
    }

    /// The first flat layer: its channels `R G B`, or else `Y`, or else its only channel. Its size is that of the data
    /// window.
    fn decode_exr(bytes: &[u8]) -> Result<Self, String> {
        let image = decode(|| Ok(Cursor::new(bytes)), bytes.len() as u64)
            .map_err(|error| error.to_string())?;
        let Some(layer) = image.layer_data.first() else {
            return Err("expected an image of flat pixels, found none".to_owned());
        };
        let (width, height) = (layer.size.width(), layer.size.height());
        check_size(width as u64, height as u64)?;
        let channels = &layer.channel_data.list;
        let full = |channel: &&AnyChannel<FlatSamples>| channel.sampling == exr::math::Vec2(1, 1);
        let channel = |name: &str| {
            let channel = channels.iter().filter(full).find(|channel| channel.name.eq(name))?;
            Some(channel.sample_data.values_as_f32())
        };
        let texels = if let (Some(r), Some(g), Some(b)) = (channel("R"), channel("G"), channel("B"))
        {
            Texels::Rgb(r.zip(g).zip(b).map(|((r, g), b)| Rgb::new(r, g, b)).collect())
        } else if let Some(y) = channel("Y") {
            Texels::Gray(y.collect())
        } else if let [only] = channels.as_slice()
            && full(&only)
        {
            Texels::Gray(only.sample_data.values_as_f32().collect())
        } else {
            let names: Vec<String> =
                channels.iter().map(|channel| channel.name.to_string()).collect();
            return Err(format!("expected the channels R, G and B, or Y, found {names:?}"));
        };
        Ok(Self::new(width as u32, height as u32, texels, true))
    }

    /// Memory of its texels, in bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = match &self.texels {
            Texels::Gray8(values) => size_of_val(&**values),
            Texels::Rgb8(values) => size_of_val(&**values),
            Texels::Gray(values) => size_of_val(&**values),
            Texels::Rgb(values) => size_of_val(&**values),
        };
        bytes as u64
    }

    /// Has each texel one value only?
    pub fn is_gray(&self) -> bool {
        matches!(self.texels, Texels::Gray8(_) | Texels::Gray(_))
    }

    /// The linear colour of a texel; row 0 is the top.
    pub fn texel(&self, column: u32, row: u32) -> Rgb {
        let index = row as usize * self.width as usize + column as usize;
        match &self.texels {
            Texels::Rgb8(values) => {
                let [r, g, b] = values[index].map(|value| self.decoding[usize::from(value)]);
                Rgb::new(r, g, b)
            }
            Texels::Rgb(values) => values[index],
            Texels::Gray8(values) => Rgb::splat(self.decoding[usize::from(values[index])]),
            Texels::Gray(values) => Rgb::splat(values[index]),
        }
    }

    /// All linear colours, row by row from the top.
    pub fn into_linear(self) -> Vec<Rgb> {
        match self.texels {
            Texels::Rgb(values) => values,
            _ => (0..self.height)
                .flat_map(|row| (0..self.width).map(move |column| (column, row)))
                .map(|(column, row)| self.texel(column, row))
                .collect(),
        }
    }

    /// Mean linear colour of all texels.
    pub fn mean(&self) -> Rgb {
        let mut sum = [0.0f64; 3];
        for row in 0..self.height {
            for column in 0..self.width {
                let texel = self.texel(column, row).to_array();
                for (sum, value) in sum.iter_mut().zip(texel) {
                    *sum += f64::from(value);
                }
            }
        }
        let count = f64::from(self.width) * f64::from(self.height);
        Rgb::from(sum.map(|sum| (sum / count) as f32))
    }
}

/// Does the end mark follow the last scan? The decoder fills what is missing with grey, and says nothing. Within a scan
/// neither mark occurs; thumbnails, which have marks of their own, stand before it.
fn has_jpeg_end(bytes: &[u8]) -> bool {
    let last = |mark: [u8; 2]| bytes.windows(2).rposition(|pair| pair == mark);
    last([0xff, 0xd9]) > last([0xff, 0xda])
}

fn check_size(width: u64, height: u64) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err("the image has no pixels".to_owned());
    }
    match width.checked_mul(height) {
        Some(count) if count <= MAX_TEXELS => Ok(()),
        _ => Err(format!("the image has {width}×{height} pixels; at most {MAX_TEXELS} are read")),
    }
}

#[cfg(test)]
mod tests;
