use std::path::{Path, PathBuf};

use ::exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, LayerAttributes, WritableImage,
};
use ndarray::Array3;

use super::*;
use crate::error::Error;
use crate::layers::{Image, Layer, LayerKind, Layers};

/// A repeatable image whose every value is different.
fn ramp(kind: usize, (channels, height, width): (usize, usize, usize)) -> Image {
    Array3::from_shape_fn((channels, height, width), |(c, y, x)| {
        (kind * 1000 + c * 100) as f32 + y as f32 * 7.25 + x as f32 * 0.1 - 3.0
    })
}

fn all_layers(width: usize, height: usize) -> Layers {
    let mut layers = Layers { width, height, ..Default::default() };
    for (index, kind) in LayerKind::ALL.into_iter().enumerate() {
        let shape = (kind.components().len(), height, width);
        let [mean, variance, a, b] = [0, 1, 2, 3].map(|role| ramp(4 * index + role, shape));
        layers.layers.insert(kind, Layer { mean, variance: Some(variance), halves: Some([a, b]) });
    }
    layers.samples = Some(Array3::from_elem((1, height, width), 64.0));
    layers.invalid = Some(ramp(90, (1, height, width)));
    layers.metadata = [("scene", "Küche/scene.xml"), ("seed", "7"), ("owner", "nobody")]
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .into();
    layers
}

fn temporary() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("layers.exr");
    (folder, path)
}

/// Writes a file with the given channels, as another renderer would.
fn write_foreign(
    path: &Path,
    channels: &[(&str, f32)],
    size: (usize, usize),
    attributes: LayerAttributes,
) {
    let plane = |value: f32| {
        FlatSamples::F32((0..size.0 * size.1).map(|index| value + index as f32).collect())
    };
    let list = channels.iter().map(|&(name, value)| AnyChannel::new(name, plane(value))).collect();
    let layer = ::exr::image::Layer::new(
        size,
        attributes,
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(list),
    );
    ::exr::image::Image::from_layer(layer).write().to_file(path).unwrap();
}

fn message(result: Result<Contents, Error>) -> String {
    result.expect_err("must be refused").to_string()
}

#[test]
fn every_layer_comes_back_bit_for_bit() {
    let (folder, path) = temporary();
    let mut layers = all_layers(13, 5);
    // What a decoder must not touch.
    let beauty = &mut layers.layers.get_mut(&LayerKind::Beauty).unwrap().mean;
    beauty[[0, 0, 0]] = f32::NAN;
    beauty[[1, 4, 12]] = f32::NEG_INFINITY;
    beauty[[2, 2, 2]] = 1e-40;
    let picture = ramp(99, (3, 5, 13));
    write(&path, &layers, &WriteOptions { picture: Some(&picture), halves: true, frame: None })
        .unwrap();
    let contents = read(&path).unwrap();

    let bits = |image: &Image| image.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(contents.picture.as_ref().map(bits), Some(bits(&picture)));
    assert_eq!(contents.layers.layers.len(), LayerKind::ALL.len());
    for (kind, layer) in &layers.layers {
        let read = &contents.layers.layers[kind];
        assert_eq!(bits(&read.mean), bits(&layer.mean), "{kind:?}");
        assert_eq!(read.variance.as_ref().map(bits), layer.variance.as_ref().map(bits), "{kind:?}");
        let halves = |layer: &Layer| layer.halves.as_ref().map(|[a, b]| [bits(a), bits(b)]);
        assert_eq!(halves(read), halves(layer), "{kind:?}");
    }
    assert_eq!(contents.layers.samples, layers.samples);
    assert_eq!(contents.layers.invalid, layers.invalid);
    assert_eq!(contents.layers.metadata, layers.metadata);
    assert_eq!(contents.frame, Frame::whole(13, 5));
    assert!(contents.ignored.is_empty());
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "nothing but the file is left"
    );
}

#[test]
fn halves_are_written_on_request_only() {
    let (_folder, path) = temporary();
    write(&path, &all_layers(3, 2), &WriteOptions::default()).unwrap();
    let contents = read(&path).unwrap();
    assert!(
        contents
            .layers
            .layers
            .values()
            .all(|layer| layer.halves.is_none() && layer.variance.is_some())
    );
    assert_eq!(contents.picture.unwrap(), contents.layers.layers[&LayerKind::Beauty].mean);
}

#[test]
fn a_crop_keeps_its_place() {
    let (_folder, path) = temporary();
    let frame = Frame { offset: (-3, 20), display_offset: (0, 0), display: (640, 480) };
    write(&path, &all_layers(4, 6), &WriteOptions { frame: Some(frame), ..Default::default() })
        .unwrap();
    let contents = read(&path).unwrap();
    assert_eq!(contents.frame, frame);
    assert_eq!((contents.layers.width, contents.layers.height), (4, 6));
}

#[test]
fn the_references_of_the_public_scenes_have_a_beauty_layer_with_variance() {
    let (_folder, path) = temporary();
    let channels = [
        ("R", 1.0),
        ("G", 2.0),
        ("B", 3.0),
        ("variance.R", 4.0),
        ("variance.G", 5.0),
        ("variance.B", 6.0),
    ];
    write_foreign(&path, &channels, (2, 2), LayerAttributes::default());
    let contents = read(&path).unwrap();
    let beauty = &contents.layers.layers[&LayerKind::Beauty];
    assert_eq!(beauty.mean[[1, 1, 1]], 5.0);
    assert_eq!(beauty.variance.as_ref().unwrap()[[2, 0, 1]], 7.0);
}

#[test]
fn blender_files_prefer_the_noisy_image_and_say_what_they_left_out() {
    let (_folder, path) = temporary();
    let mut channels = Vec::new();
    let names: Vec<(String, f32)> =
        [("Combined", 10.0), ("Noisy Image", 20.0), ("Denoising Albedo", 30.0)]
            .iter()
            .flat_map(|&(pass, value)| {
                ["R", "G", "B", "A"].map(|channel| (format!("ViewLayer.{pass}.{channel}"), value))
            })
            .chain(["X", "Y", "Z"].map(|axis| (format!("ViewLayer.Denoising Normal.{axis}"), 40.0)))
            .collect();
    channels.extend(names.iter().map(|(name, value)| (name.as_str(), *value)));
    write_foreign(&path, &channels, (3, 3), LayerAttributes::default());
    let contents = read(&path).unwrap();
    let first = |kind| contents.layers.layers[&kind].mean[[0, 0, 0]];
    assert_eq!(first(LayerKind::Beauty), 20.0);
    assert_eq!(first(LayerKind::Albedo), 30.0);
    assert_eq!(first(LayerKind::Normal), 40.0);
    assert_eq!(contents.picture, None);
    assert!(
        contents.ignored.contains(&"ViewLayer.Combined.R".to_owned()),
        "{:?}",
        contents.ignored
    );
}

#[test]
fn of_two_view_layers_one_is_taken_and_the_other_named() {
    let (_folder, path) = temporary();
    let names = ["Bg", "Fg"]
        .map(|layer| ["B", "G", "R"].map(|channel| format!("{layer}.Combined.{channel}")));
    let channels: Vec<_> = names.iter().flatten().map(|name| (name.as_str(), 1.0)).collect();
    write_foreign(&path, &channels, (3, 3), LayerAttributes::default());
    assert_eq!(read(&path).unwrap().ignored, names[1]);
}

#[test]
fn blenders_depth_of_nothing_is_no_depth() {
    let (_folder, path) = temporary();
    let mut channels = ["R", "G", "B"].map(|channel| (channel, 1.0)).to_vec();
    // The values of the pixels count up from there.
    channels.push(("ViewLayer.Depth.Z", 1e10));
    write_foreign(&path, &channels, (2, 1), LayerAttributes::default());
    let depth = &read(&path).unwrap().layers.layers[&LayerKind::Depth].mean;
    assert!(depth.iter().all(|&depth| depth == 0.0), "{depth}");
}

#[test]
fn a_variance_per_sample_is_divided_by_the_samples() {
    let (_folder, path) = temporary();
    let channels = [
        ("R", 1.0),
        ("G", 1.0),
        ("B", 1.0),
        ("Variance.R", 8.0),
        ("Variance.G", 8.0),
        ("Variance.B", 8.0),
    ];
    let mut attributes = LayerAttributes::default();
    let variance =
        |path: &Path| read(path).unwrap().layers.layers[&LayerKind::Beauty].variance.clone();
    write_foreign(&path, &channels, (1, 1), attributes.clone());
    assert_eq!(variance(&path), None, "without the number of samples nothing is known of the mean");
    attributes.other.insert("samplesPerPixel".into(), ::exr::prelude::AttributeValue::I32(16));
    write_foreign(&path, &channels, (1, 1), attributes);
    assert_eq!(variance(&path).unwrap()[[0, 0, 0]], 0.5);
}

#[test]
fn the_parts_of_a_file_name_their_channels() {
    let (_folder, path) = temporary();
    let part = |name: &str, channels: &[&str], value: f32| {
        let list = channels
            .iter()
            .map(|&channel| AnyChannel::new(channel, FlatSamples::F32(vec![value; 4])))
            .collect();
        ::exr::image::Layer::new(
            (2, 2),
            LayerAttributes::named(name),
            Encoding::FAST_LOSSLESS,
            AnyChannels::sort(list),
        )
    };
    let parts = [
        part("depth", &["Z"], 4.0),
        part("main", &["R", "G", "B"], 1.0),
        part("another", &["R", "G", "B"], 9.0),
        part("albedo", &["R", "G", "B"], 2.0),
        part("N", &["X", "Y", "Z"], 3.0),
    ];
    let attributes = ::exr::prelude::ImageAttributes::with_size((2, 2));
    let parts: ::exr::image::Layers<_> = parts.into_iter().collect();
    ::exr::image::Image::from_layers(attributes, parts).write().to_file(&path).unwrap();
    let contents = read(&path).unwrap();
    let kinds = [LayerKind::Beauty, LayerKind::Albedo, LayerKind::Normal, LayerKind::Depth];
    let values = kinds.map(|kind| contents.layers.layers[&kind].mean[[0, 1, 1]]);
    assert_eq!(values, [1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn a_file_without_a_known_layer_says_what_it_has() {
    let (_folder, path) = temporary();
    write_foreign(&path, &[("mask", 1.0), ("uv.U", 1.0)], (2, 2), LayerAttributes::default());
    let message = message(read(&path));
    assert!(message.contains("layers.exr") && message.contains("mask, uv.U"), "{message}");
}

#[test]
fn a_layer_with_a_missing_channel_is_refused() {
    let (_folder, path) = temporary();
    let channels = [("R", 1.0), ("G", 1.0), ("B", 1.0), ("albedo.R", 1.0), ("albedo.B", 1.0)];
    write_foreign(&path, &channels, (2, 2), LayerAttributes::default());
    let message = message(read(&path));
    assert!(message.contains("albedo.R, albedo.B") && message.contains("R, G, B"), "{message}");
}

#[test]
fn a_cut_off_file_is_an_error_at_every_length() {
    let (_folder, path) = temporary();
    write(&path, &all_layers(9, 33), &WriteOptions::default()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for length in (0..whole.len()).step_by(97).chain(whole.len() - 20..whole.len()) {
        std::fs::write(&path, &whole[..length]).unwrap();
        let error = read(&path).expect_err("a cut-off file");
        assert!(error.to_string().contains("layers.exr"), "{error}");
    }
}

#[test]
fn damaged_bytes_never_panic() {
    let (_folder, path) = temporary();
    write(&path, &all_layers(6, 18), &WriteOptions::default()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for position in (0..whole.len()).step_by(whole.len() / 400) {
        for flip in [0x01, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[position] ^= flip;
            std::fs::write(&path, &bytes).unwrap();
            // Some damage goes unseen (a changed pixel or text); the rest is an error, never a panic.
            let _ = read(&path);
        }
    }
}

#[test]
fn a_small_file_that_promises_many_pixels_is_refused_before_memory_is_taken() {
    let (_folder, path) = temporary();
    write(&path, &all_layers(2, 2), &WriteOptions::default()).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let name = b"dataWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 4;
    bytes[at + 8..at + 12].copy_from_slice(&1_000_000_i32.to_le_bytes());
    bytes[at + 12..at + 16].copy_from_slice(&1_000_000_i32.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let message = message(read(&path));
    assert!(message.contains("promises"), "{message}");
}

#[test]
fn a_missing_file_is_named() {
    let message = message(read(Path::new("/nowhere/at-all.exr")));
    assert!(message.contains("/nowhere/at-all.exr"), "{message}");
}

#[test]
fn separate_files_make_layers() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    write_foreign(
        &file("colour.exr"),
        &[("R", 1.0), ("G", 2.0), ("B", 3.0)],
        (3, 2),
        LayerAttributes::default(),
    );
    write_foreign(
        &file("normal.exr"),
        &[("R", 4.0), ("G", 5.0), ("B", 6.0)],
        (3, 2),
        LayerAttributes::default(),
    );
    let mut pfm = b"PF\n3 2\n-1.0\n".to_vec();
    pfm.extend((0..18).flat_map(|value| (value as f32).to_le_bytes()));
    std::fs::write(file("albedo.pfm"), &pfm).unwrap();
    let separate = |kind, name: &str| SeparateFile { kind, role: Role::Mean, path: file(name) };
    let files =
        [separate(LayerKind::Albedo, "albedo.pfm"), separate(LayerKind::Normal, "normal.exr")];
    let layers = read_separate(&file("colour.exr"), &files).unwrap().layers;
    assert_eq!(layers.layers[&LayerKind::Beauty].mean[[2, 1, 2]], 8.0);
    assert_eq!(layers.layers[&LayerKind::Normal].mean[[1, 0, 0]], 5.0);
    // The rows of a PFM go from the bottom up: the first pixel of the file is the last row.
    assert_eq!(layers.layers[&LayerKind::Albedo].mean[[1, 1, 0]], 1.0);
    assert_eq!(layers.layers[&LayerKind::Albedo].mean[[0, 0, 2]], 15.0);

    // A display shows no negative numbers.
    let shown = separate(LayerKind::Normal, "normal.png");
    let refused = read_separate(&file("colour.exr"), &[shown]).unwrap_err().to_string();
    assert!(refused.contains("normal.png") && refused.contains("an EXR or PFM"), "{refused}");

    pfm.pop();
    std::fs::write(file("albedo.pfm"), &pfm).unwrap();
    assert!(matches!(read_separate(&file("colour.exr"), &files), Err(Error::Format { .. })));
    write_foreign(
        &file("normal.exr"),
        &[("R", 4.0), ("G", 5.0), ("B", 6.0)],
        (3, 3),
        LayerAttributes::default(),
    );
    assert!(matches!(read_separate(&file("colour.exr"), &files[1..]), Err(Error::Shape { .. })));
}
