//! What is written is what is read.

use super::*;

fn identity(source: Source) -> Identity {
    let scene_key = source.scene_key();
    let split = Split::of(&scene_key);
    Identity { id: View::id(7), source, scene_key, split, attempts: 2 }
}

/// A view whose numbers have all their digits.
fn view() -> View {
    View {
        identity: identity(Source::Generated { generated: u64::MAX - 1 }),
        tags: vec!["glass".to_owned(), "sun \"at noon\"".to_owned()],
        film: [256, 192],
        crop: [11, 7, 128, 128],
        noisy: vec![NoisyFile {
            file: "noisy-0.exr".to_owned(),
            spp: 16,
            seed: (1 << 53) + 1,
            sha256: "0f".repeat(32),
        }],
        reference: ReferenceFile {
            file: "reference.exr".to_owned(),
            spp: 2048,
            seed: 0,
            sha256: "ab".repeat(32),
            relative_l2_noise: 1.0 / 3.0 * 1e-3,
            exposed_relative_l2_noise: f64::MIN_POSITIVE,
        },
        seconds: 0.1 + 0.2,
    }
}

#[test]
fn what_is_written_is_read_again_to_the_last_digit() {
    let folder = tempfile::tempdir().unwrap();
    let manifest = Manifest::new(
        Settings { reference_noise: 1.0 / 3.0, seed: u64::MAX, ..Settings::default() },
        12,
    );
    manifest.write(folder.path()).unwrap();
    assert_eq!(Manifest::read(folder.path()).unwrap(), manifest);
    let source = Source::File { file: "a/scene.xml".into(), variation: u64::MAX };
    let skipped =
        SkippedView { identity: identity(source), reason: "dark".to_owned(), seconds: 0.7 };
    fs::create_dir_all(View::folder(folder.path(), "000007")).unwrap();
    assert_eq!(Record::read(folder.path(), "000007").unwrap(), None);
    for record in [Record::Skipped(skipped), Record::Rendered(view())] {
        record.write(folder.path()).unwrap();
        assert_eq!(Record::read(folder.path(), "000007").unwrap(), Some(record));
    }
    assert_eq!(views(folder.path()).unwrap(), [view()]);
}

#[test]
fn the_names_in_a_view_are_those_that_python_reads() {
    let json = serde_json::to_value(view()).unwrap();
    assert_eq!(json["source"]["generated"], u64::MAX - 1);
    assert_eq!(json["id"], "000007");
    assert_eq!(json["noisy"][0]["seed"], (1u64 << 53) + 1);
    for name in ["scene_key", "split", "tags", "film", "crop", "seconds", "attempts"] {
        assert!(!json[name].is_null(), "{name}");
    }
    assert!(json["reference"]["relative_l2_noise"].is_f64());
    assert_eq!(serde_json::to_value(Split::Validation).unwrap(), "validation");
}

#[test]
fn another_schema_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut manifest = Manifest::new(Settings::default(), 1);
    manifest.schema += 1;
    manifest.write(folder.path()).unwrap();
    let error = Manifest::read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("schema 2") && error.contains("schema 1"), "{error}");
}

#[test]
fn every_setting_that_differs_is_named() {
    let ours = Settings::default();
    assert_eq!(ours.differences(&ours), "");
    let theirs = Settings {
        seed: 1,
        scenes: vec!["a.xml".into()],
        crop: 2,
        noisy: 4,
        min_spp: 5,
        max_spp: 6,
        reference_spp: 7,
        reference_noise: 8.0,
    };
    let said = ours.differences(&theirs);
    let names = ["seed", "scenes", "crop", "noisy", "min-spp", "max-spp"];
    for name in names.into_iter().chain(["reference-spp", "reference-noise"]) {
        assert!(said.contains(&format!("{name}: ")), "{name} in {said}");
    }
}
