//! Plain pictures of three channels in the formats that people have: EXR, PFM, Radiance HDR, PNG, JPEG.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use crate::error::Error;
use crate::exr::{Contents, Frame};
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::srgb;

/// Reads a picture as linear Rec. 709, `[3, height, width]`, by the ending of its name. PNG and JPEG are decoded by the
/// sRGB curve, grey is spread over the three channels, alpha is left out. Of an EXR file with many layers the picture
/// `R G B` is taken, or the beauty layer where there is none.
///
/// # Errors
/// [`Error::Io`] where the file cannot be opened, [`Error::Format`] where it is damaged, has no picture in it, or is of
/// another format.
pub fn read_picture(path: &Path) -> Result<Image, Error> {
    let Contents { mut layers, picture, .. } = read_contents(path)?;
    let beauty = layers.layers.remove(&LayerKind::Beauty).map(|layer| layer.mean);
    picture.or(beauty).ok_or_else(|| {
        let found = layers.layers.keys().map(|kind| kind.name()).collect::<Vec<_>>().join(", ");
        Error::Format {
            path: path.into(),
            found: format!("the layers {found}"),
            expected: "a picture R, G, B".into(),
        }
    })
}

/// Reads all layers of an EXR file, or any other picture as a beauty layer.
pub(crate) fn read_contents(path: &Path) -> Result<Contents, Error> {
    let ending = path
        .extension()
        .map(|ending| ending.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let picture = match ending.as_str() {
        "exr" => return crate::exr::read(path),
        "pfm" => read_pfm(path)?,
        "png" | "jpg" | "jpeg" | "hdr" => read_other(path)?,
        _ => {
            return Err(Error::Format {
                path: path.into(),
                found: format!("the ending '{ending}'"),
                expected: "exr, pfm, hdr, png, jpg or jpeg".into(),
            });
        }
    };
    let (_, height, width) = picture.dim();
    let beauty = Layer { mean: picture.clone(), variance: None, halves: None };
    let layers = Layers {
        width,
        height,
        layers: BTreeMap::from([(LayerKind::Beauty, beauty)]),
        ..Default::default()
    };
    Ok(Contents {
        layers,
        picture: Some(picture),
        frame: Frame::whole(width, height),
        ignored: Vec::new(),
    })
}

/// Refuses a header that promises more pixels than `length` bytes of PNG, JPEG or Radiance HDR can hold, before memory is
/// asked for: a damaged header easily asks for gigabytes. The densest is a PNG of one bit a pixel, which deflate shrinks
/// 1032-fold at best (zlib's technical details); 2²² pixels are harmless in any case.
///
/// # Errors
/// What the header promises, in words.
pub fn check_promise(width: u32, height: u32, length: usize) -> Result<(), String> {
    const MOST_PER_BYTE: u64 = 8 * 1032;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > (1 << 22).max(MOST_PER_BYTE.saturating_mul(length as u64)) {
        return Err(format!(
            "its header promises {width}x{height} pixels, which {length} bytes cannot hold"
        ));
    }
    Ok(())
}

/// PNG and JPEG (8 or 16 bits, sRGB) and Radiance HDR (linear).
fn read_other(path: &Path) -> Result<Image, Error> {
    let damaged = |error: image::ImageError| match error {
        image::ImageError::IoError(source)
            if source.kind() != std::io::ErrorKind::UnexpectedEof =>
        {
            Error::Io { path: path.into(), source }
        }
        error => Error::Format {
            path: path.into(),
            found: format!("a file that cannot be decoded ({error})"),
            expected: "a whole picture of the format its name says".into(),
        },
    };
    let io = |source| Error::Io { path: path.into(), source };
    let bytes = std::fs::read(path).map_err(io)?;
    let format = image::ImageFormat::from_path(path).map_err(damaged)?;
    let decoder = image::ImageReader::with_format(Cursor::new(&bytes), format)
        .into_decoder()
        .map_err(damaged)?;
    let (width, height) = image::ImageDecoder::dimensions(&decoder);
    check_promise(width, height, bytes.len()).map_err(|found| Error::Format {
        path: path.into(),
        found,
        expected: "a whole picture".into(),
    })?;
    let decoded = image::DynamicImage::from_decoder(decoder).map_err(damaged)?;
    let linear = matches!(
        decoded,
        image::DynamicImage::ImageRgb32F(_) | image::DynamicImage::ImageRgba32F(_)
    );
    let rgb = decoded.into_rgb32f();
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    let pixels = rgb.into_raw();
    Ok(Image::from_shape_fn((3, height, width), |(channel, y, x)| {
        let value = pixels[(y * width + x) * 3 + channel];
        if linear { value } else { srgb::decode(value) }
    }))
}

/// Portable float map: `PF` (colour) or `Pf` (grey), width and height, a scale whose sign is the byte order (negative:
/// little endian), then rows of 32-bit floats from the bottom up.
fn read_pfm(path: &Path) -> Result<Image, Error> {
    let bytes = std::fs::read(path).map_err(|source| Error::Io { path: path.into(), source })?;
    let damaged = |found: String| Error::Format {
        path: path.into(),
        found,
        expected: "a portable float map: PF or Pf, width, height, scale, and all its pixels".into(),
    };
    let mut words = [""; 4];
    let mut at = 0;
    for word in &mut words {
        let start = at + bytes[at..].iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        let length =
            bytes[start..].iter().take(32).take_while(|byte| byte.is_ascii_graphic()).count();
        *word = std::str::from_utf8(&bytes[start..start + length]).unwrap_or_default();
        at = start + length;
    }
    let header = || damaged(format!("the header '{}'", words.join(" ")));
    let channels = match words[0] {
        "PF" => 3,
        "Pf" => 1,
        _ => return Err(header()),
    };
    let size = |word: &str| word.parse::<usize>().ok().filter(|&size| size > 0).ok_or_else(header);
    let (width, height) = (size(words[1])?, size(words[2])?);
    let scale: f32 = words[3].parse().map_err(|_| header())?;
    let floats = width
        .checked_mul(height)
        .and_then(|pixels| pixels.checked_mul(channels))
        .ok_or_else(header)?;
    // One white space ends the header.
    let data = bytes.get(at + 1..).unwrap_or_default();
    if data.len() / 4 < floats {
        return Err(damaged(format!("{} bytes of pixels for {width}x{height}", data.len())));
    }
    Ok(Image::from_shape_fn((3, height, width), |(channel, y, x)| {
        let index = ((height - 1 - y) * width + x) * channels + channel.min(channels - 1);
        let four = [data[index * 4], data[index * 4 + 1], data[index * 4 + 2], data[index * 4 + 3]];
        if scale < 0.0 { f32::from_le_bytes(four) } else { f32::from_be_bytes(four) }
    }))
}
