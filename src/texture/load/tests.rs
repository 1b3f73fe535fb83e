use super::*;
use image::{DynamicImage, ImageFormat};

fn encode(pixels: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    pixels.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn gradient() -> DynamicImage {
    DynamicImage::ImageRgb32F(image::Rgb32FImage::from_fn(17, 9, |x, y| {
        image::Rgb([x as f32 / 16.0, y as f32 / 8.0, 3.0])
    }))
}

#[test]
fn srgb_is_decoded_unless_raw() {
    // Values printed by Mitsuba 3.9.1 for the same 8-bit and 16-bit texels.
    let gray8 = DynamicImage::ImageLuma8(image::GrayImage::from_raw(2, 1, vec![128, 255]).unwrap());
    let gray16 = image::ImageBuffer::from_raw(2, 1, vec![32767u16, 65535]).unwrap();
    for (pixels, decoded, stored) in [
        (gray8, 0.215_860_4, 0.501_960_8),
        (DynamicImage::ImageLuma16(gray16), 0.213_989_26, 0.499_992_4),
    ] {
        let bytes = encode(&pixels, ImageFormat::Png);
        let image = Image::decode(&bytes, false).unwrap();
        assert!(image.is_gray());
        assert!((image.texel(0, 0).g - decoded).abs() < 5e-5, "{:?}", image.texel(0, 0));
        assert_eq!(image.texel(1, 0), Rgb::WHITE);
        let image = Image::decode(&bytes, true).unwrap();
        assert!((image.texel(0, 0).g - stored).abs() < 1e-6);
    }
    assert!((srgb_to_linear(0.040_45) - srgb_to_linear(0.040_450_01)).abs() < 1e-6);
}

#[test]
fn every_format_gives_its_pixels() {
    let rgb8 = DynamicImage::ImageRgb8(image::RgbImage::from_fn(16, 8, |x, _| {
        image::Rgb([200, if x < 8 { 10 } else { 90 }, 30])
    }));
    for format in [ImageFormat::Png, ImageFormat::Jpeg] {
        let image = Image::decode(&encode(&rgb8, format), true).unwrap();
        assert_eq!((image.width, image.height), (16, 8));
        // JPEG loses a little.
        assert!((image.texel(15, 7).g - 90.0 / 255.0).abs() < 0.02, "{format:?}");
        assert!((image.texel(0, 0).r - 200.0 / 255.0).abs() < 0.02);
    }
    for format in [ImageFormat::Hdr, ImageFormat::OpenExr] {
        let image = Image::decode(&encode(&gradient(), format), false).unwrap();
        let texel = image.texel(8, 2);
        let expected = Rgb::new(0.5, 0.25, 3.0);
        // RGBE shares an exponent: 8 bits of the largest component.
        assert!((texel - expected).map(f32::abs).max_component() < 0.01, "{format:?} {texel:?}");
    }
    let mut rgbe = encode(&gradient(), ImageFormat::Hdr);
    rgbe.splice(0..10, *b"#?RGBE");
    assert!(Image::decode(&rgbe, false).is_ok());
}

#[test]
fn exr_of_one_channel_is_gray_and_others_are_refused() {
    use exr::prelude::*;
    let write = |names: &[&str]| {
        let channels = names
            .iter()
            .map(|&name| AnyChannel::new(name, FlatSamples::F32(vec![0.25, f32::NAN, 1.0, 2.0])));
        let channels = AnyChannels::sort(channels.collect());
        let mut bytes = Cursor::new(Vec::new());
        Image::from_channels((2, 2), channels).write().to_buffered(&mut bytes).unwrap();
        super::Image::decode(&bytes.into_inner(), false)
    };
    for names in [&["Y"][..], &["depth"]] {
        let image = write(names).unwrap();
        assert!(image.is_gray());
        assert_eq!(image.texel(0, 0), Rgb::splat(0.25));
        assert_eq!((image.texel(1, 0), image.broken), (Rgb::BLACK, 1));
    }
    assert_eq!(write(&["A", "B", "G", "R"]).unwrap().broken, 1);
    assert!(write(&["X", "Z"]).unwrap_err().contains("R, G and B"));
}

#[test]
fn truncated_and_damaged_files_never_panic() {
    let rgb8 = DynamicImage::ImageRgb8(gradient().into_rgb8());
    for (pixels, format) in [
        (&rgb8, ImageFormat::Png),
        (&rgb8, ImageFormat::Jpeg),
        (&gradient(), ImageFormat::Hdr),
        (&gradient(), ImageFormat::OpenExr),
    ] {
        let bytes = encode(pixels, format);
        for length in 0..bytes.len() {
            let result = Image::decode(&bytes[..length], false);
            // The last four bytes of a PNG are the checksum of its end mark.
            let is_whole = format == ImageFormat::Png && length + 4 >= bytes.len();
            assert!(result.is_err() || is_whole, "{format:?}: {length} of {} bytes", bytes.len());
        }
        for position in 0..bytes.len() {
            for value in [0, 0x7f, 0xff] {
                let mut bytes = bytes.clone();
                bytes[position] = value;
                if let Ok(image) = Image::decode(&bytes, false) {
                    image.texel(image.width - 1, image.height - 1);
                }
            }
        }
    }
}

#[test]
fn errors_name_the_file() {
    let message = Image::load(Path::new("/none/wood.png"), false).unwrap_err().to_string();
    assert!(message.contains("/none/wood.png"));
    let mut file = tempfile::NamedTempFile::new().unwrap();
    std::io::Write::write_all(&mut file, b"not an image").unwrap();
    let message = Image::load(file.path(), false).unwrap_err().to_string();
    assert!(message.contains("unknown image format") && message.contains("EXR"), "{message}");
    // A PNG that claims to be 2³¹ − 1 pixels wide and high.
    let mut png = encode(&DynamicImage::new_luma8(1, 1), ImageFormat::Png);
    png[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    assert!(Image::decode(&png, false).is_err());
    assert!(check_size(1 << 14, (1 << 13) + 1).unwrap_err().contains("16384×8193"));
}
