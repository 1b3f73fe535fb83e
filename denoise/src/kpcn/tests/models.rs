//! Files that are not networks that we can use are refused, with what was expected.

use std::borrow::Cow;

use super::whole::{files, pool};
use crate::error::Error;
use crate::kpcn::{Branch, Denoiser, Kind, Model, Network, orientation};

fn model(bytes: Vec<u8>) -> Model {
    Model::new("test.onnx".into(), Cow::Owned(bytes))
}

fn unit() -> Vec<u8> {
    std::fs::read(&files("unit")[0]).unwrap()
}

/// Replaces every occurrence by another of the same length, so that the file stays one.
#[track_caller]
fn patched(mut bytes: Vec<u8>, from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let places: Vec<usize> = bytes
        .windows(from.len())
        .enumerate()
        .filter_map(|(place, window)| (window == from).then_some(place))
        .collect();
    assert!(!places.is_empty(), "{} is not in the file", String::from_utf8_lossy(from));
    for place in places {
        bytes[place..place + to.len()].copy_from_slice(to);
    }
    bytes
}

#[test]
fn a_good_file_says_what_it_is() {
    for (tier, kind) in [("unit", Kind::KernelPyramid), ("unit-kernel", Kind::Kernel { size: 5 })] {
        for (path, branch) in files(tier).iter().zip(Branch::ALL) {
            let network = Network::of(&Model::read(path).unwrap(), 1).unwrap();
            assert_eq!((network.kind, network.branch), (kind, branch));
        }
    }
}

#[test]
fn a_session_is_made_once() {
    let model = model(unit());
    let [first, second] = [(); 2].map(|()| Network::of(&model, 1).unwrap());
    assert!(std::sync::Arc::ptr_eq(&first, &second));
}

#[test]
fn what_is_no_network_of_ours_is_refused() {
    let whole = unit();
    let half = whole[..whole.len() / 2].to_vec();
    for (bytes, said) in [
        (b"no network at all".to_vec(), "cannot be loaded"),
        (Vec::new(), "cannot be loaded"),
        (half, "cannot be loaded"),
        (patched(whole.clone(), b"kernel_pyramid", b"kernel_pyramix"), "kernel_pyramix"),
        (patched(whole.clone(), b"diffuse", b"diffuze"), "diffuze"),
        (patched(whole.clone(), b"log.dx.R", b"log.dx.X"), "log.dx.R"),
        (patched(whole.clone(), b"0.00316", b"0.00317"), "0.00317"),
        (patched(whole.clone(), b"version\x12\x013", b"version\x12\x012"), "'3'"),
        (
            patched(whole.clone(), b"level2", b"layer2"),
            "level2: 32-bit floats [1, 35, height, width]",
        ),
        // The weight's sides become 140 · 4 and 1.
        (
            patched(
                whole.clone(),
                b"Flatten*\x0b\x0a\x04axis\x18\x01",
                b"Flatten*\x0b\x0a\x04axis\x18\x02",
            ),
            "level0.weight: 32-bit floats [140, 4], level0.bias: 32-bit floats [140]",
        ),
        (patched(whole.clone(), b"input", b"imput"), "input: 32-bit floats [1, 88, height, width]"),
    ] {
        let error = Network::of(&model(bytes), 1).unwrap_err();
        assert!(matches!(&error, Error::Model { name, .. } if name == "test.onnx"), "{error}");
        assert!(error.to_string().contains(said), "{error}");
    }
}

#[test]
fn a_pair_is_one_of_each_branch_and_of_one_kind() {
    let ([diffuse, specular], [kernel, _]) = (files("unit"), files("unit-kernel"));
    // In any order.
    let pair = Denoiser::from_files([&specular, &diffuse], 1).unwrap();
    assert!(pair.models()[0].name.ends_with("kpcn-unit-diffuse.onnx"));
    let refused = |files| Denoiser::from_files(files, 1).unwrap_err().to_string();
    assert!(refused([&diffuse, &diffuse]).contains("the branch 'diffuse', as in"));
    assert!(refused([&kernel, &specular]).contains("Kernel { size: 5 }"));
    let missing = diffuse.with_file_name("missing.onnx");
    assert!(refused([&missing, &specular]).contains("missing.onnx"));
}

#[test]
fn models_in_each_others_place_are_refused() {
    let [diffuse, specular] = files("unit").map(|path| Model::read(&path).unwrap());
    let denoiser =
        Denoiser { models: [specular, diffuse], orientations: &orientation::ALL[..1], mixes: true };
    let layers = super::fixtures::layers();
    let error = denoiser.denoise(&layers, &pool(1), &|_| ()).unwrap_err().to_string();
    assert!(error.contains("the branch 'specular'"), "{error}");
}
