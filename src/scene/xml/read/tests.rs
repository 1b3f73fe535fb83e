//! Facts about reading: places, parameters, references, includes, limits.

use super::*;
use glam::{DMat4, DVec3};
use std::fs;
use tempfile::TempDir;

/// Reads `<scene>` with this content, beside files of these names and contents.
fn read_with(
    content: &str,
    files: &[(&str, &str)],
    definitions: &[(&str, &str)],
) -> Result<Document, SceneError> {
    let folder = TempDir::new().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let path = folder.path().join("scene.xml");
    fs::write(&path, format!("<scene version='3.0.0'>{content}</scene>")).unwrap();
    let definitions: Vec<_> =
        definitions.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    read(&path, &definitions)
}

fn read_text(content: &str) -> Result<Document, SceneError> {
    read_with(content, &[], &[])
}

fn names(document: &Document) -> Vec<&str> {
    document.plugins.iter().map(|plugin| plugin.name.as_str()).collect()
}

#[test]
fn a_place_is_counted_in_lines_and_characters_from_one() {
    let error =
        read_text("\n  <bsdf type='diffuse'>\n    <string name='é' value='ü'/><nonsense/></bsdf>")
            .unwrap_err();
    let SceneError::Unknown { location, found, .. } = error else { panic!("{error}") };
    assert_eq!((location.line, location.column, found.as_str()), (3, 33, "nonsense"));
    let error = read_text("<bsdf type='a'/>é<x/>").unwrap_err().to_string();
    assert!(error.contains("scene.xml:1:40:"), "{error}");
    let error = read_text("<bsdf type='é'/><bsdf type='b'/><x/>").unwrap_err().to_string();
    assert!(error.contains("scene.xml:1:56:"), "{error}");
    assert!(location.file.ends_with("scene.xml"));
}

#[test]
fn every_value_is_read() {
    let document = read_text(
        "<shape type='x'><boolean name='b' value='true'/><integer name='i' value='-3'/><float name='f' value='1e-3'/>
         <string name='s' value='t'/><point name='p' x='1' z='3'/><vector name='v' value='1 2 3'/>
         <rgb name='c' value='1 0.5 0'/><spectrum name='u' value='0.25'/><spectrum name='n' type='d65'/>
         <transform name='toWorld'><scale value='2'/><translate x='1'/></transform></shape>",
    )
    .unwrap();
    let values: Vec<_> =
        document.plugins[1].properties.iter().map(|property| property.value.clone()).collect();
    assert_eq!(
        values,
        [
            Value::Boolean(true),
            Value::Integer(-3),
            Value::Float(1e-3),
            Value::String("t".to_owned()),
            Value::Vector(DVec3::new(1.0, 0.0, 3.0)),
            Value::Vector(DVec3::new(1.0, 2.0, 3.0)),
            Value::Color(DVec3::new(1.0, 0.5, 0.0)),
            Value::Color(DVec3::splat(0.25)),
            Value::Plugin(PluginId(2)),
            // First doubled, then moved by one.
            Value::Transform(
                DMat4::from_translation(DVec3::X) * DMat4::from_scale(DVec3::splat(2.0))
            ),
        ]
    );
    assert_eq!(document.plugins[1].properties[9].name, "to_world");
}

#[test]
fn parameters_are_substituted_in_any_attribute() {
    let content = "<default name='kind' value='diffuse'/><bsdf type='$kind' id='a$kind'/><ref id='adiffuse'/>";
    assert_eq!(names(&read_text(content).unwrap()), ["scene", "diffuse"]);
    let document = read_with(content, &[], &[("kind", "plastic")]);
    assert!(document.unwrap_err().to_string().contains("adiffuse"));
    let unused = read_with("", &[], &[("spp", "4")]).unwrap_err();
    assert!(matches!(unused, SceneError::UnusedDefinition { .. }), "{unused}");
}

#[test]
fn references_may_come_before_what_they_mean_and_go_by_an_alias() {
    let document = read_text(
        "<shape type='cube'><ref id='b'/></shape><bsdf type='diffuse' id='a'/><alias id='a' as='c'/>
         <bsdf type='twosided' id='b'><ref id='c' name='nested'/></bsdf>",
    )
    .unwrap();
    assert_eq!(names(&document), ["scene", "cube", "diffuse", "twosided"]);
    assert_eq!(document.plugins[1].properties[0].value, Value::Plugin(PluginId(3)));
    assert_eq!(document.plugins[3].properties[0].value, Value::Plugin(PluginId(2)));
    assert_eq!(document.plugins[3].properties[0].name, "nested");
    for wrong in ["<ref id='a'/>", "<alias id='a' as='b'/>"] {
        let error = read_text(wrong).unwrap_err();
        assert!(matches!(error, SceneError::Unknown { .. }), "{error}");
    }
    let twice = read_text("<bsdf type='a' id='i'/>\n<bsdf type='b' id='i'/>").unwrap_err();
    assert!(
        matches!(&twice, SceneError::Duplicate { location, previous, .. }
        if location.line == 2 && previous.line == 1),
        "{twice}"
    );
}

#[test]
fn a_plugin_in_itself_is_refused() {
    for content in [
        "<bsdf type='twosided' id='a'><ref id='a'/></bsdf>",
        "<bsdf type='x' id='a'><ref id='b'/></bsdf><bsdf type='y' id='b'><bsdf type='z'><ref id='a'/></bsdf></bsdf>",
    ] {
        let error = read_text(content).unwrap_err();
        assert!(matches!(error, SceneError::Cycle { .. }), "{error}");
    }
    // Sharing is no cycle.
    let shared =
        "<bsdf type='x' id='a'/><bsdf type='y'><ref id='a'/><ref id='a'/></bsdf><ref id='a'/>";
    assert!(read_text(shared).is_ok());
}

#[test]
fn references_that_multiply_or_chain_without_end_are_refused() {
    let blend = |i: usize| {
        format!("<bsdf type='blendbsdf' id='b{}'><ref id='b{i}'/><ref id='b{i}'/></bsdf>", i + 1)
    };
    let doubling: String = (0..40).map(blend).collect();
    let error = read_text(&format!("<bsdf type='diffuse' id='b0'/>{doubling}")).unwrap_err();
    assert!(matches!(error, SceneError::Limit { limit: 10_000, .. }), "{error}");
    let mask = |i: usize| format!("<bsdf type='mask' id='b{}'><ref id='b{i}'/></bsdf>", i + 1);
    let chain: String = (0..200_000).map(mask).collect();
    let error = read_text(&format!("{chain}<bsdf type='diffuse' id='b0'/>")).unwrap_err();
    assert!(matches!(error, SceneError::Limit { limit: 64, .. }), "{error}");
    // A scene may hold as many plugins as it likes.
    assert!(read_text(&"<shape type='cube'/>".repeat(20_000)).is_ok());
}

#[test]
fn includes_are_found_beside_the_file_that_names_them() {
    let files = [
        (
            "parts/a.xml",
            "<scene version='3.0.0'><include filename='b.xml'/><bsdf type='a'/></scene>",
        ),
        ("parts/b.xml", "<bsdf type='$kind'/>"),
    ];
    let content = "<default name='kind' value='b'/><include filename='parts\\a.xml'/>";
    assert_eq!(names(&read_with(content, &files, &[]).unwrap()), ["scene", "b", "a"]);
    let content = "<path value='parts'/><include filename='b.xml'/>";
    assert_eq!(names(&read_with(content, &files, &[("kind", "c")]).unwrap()), ["scene", "c"]);
    assert!(read_with("<include filename='b.xml'/>", &files, &[]).is_err());
}

#[test]
fn cyclic_and_deep_includes_are_refused() {
    let files = [("a.xml", "<scene><include filename='scene.xml'/></scene>")];
    let error = read_with("<include filename='a.xml'/>", &files, &[]).unwrap_err();
    assert!(matches!(error, SceneError::Cycle { .. }), "{error}");

    let names: Vec<String> = (0..40).map(|i| format!("{i}.xml")).collect();
    let texts: Vec<String> =
        (1..41).map(|i| format!("<scene><include filename='{i}.xml'/></scene>")).collect();
    let files: Vec<(&str, &str)> =
        names.iter().map(String::as_str).zip(texts.iter().map(String::as_str)).collect();
    let error = read_with("<include filename='0.xml'/>", &files, &[]).unwrap_err();
    assert!(matches!(error, SceneError::Limit { .. }), "{error}");
}

#[test]
fn bombs_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("scene.xml");
    // A billion laughs: entities are not even looked at.
    fs::write(
        &path,
        "<!DOCTYPE s [<!ENTITY a 'ha'><!ENTITY b '&a;&a;'>]><scene version='3.0.0'>&b;</scene>",
    )
    .unwrap();
    let error = read(&path, &[]).unwrap_err();
    assert!(matches!(error, SceneError::Xml { .. }), "{error}");

    let deep = format!("{}{}", "<bsdf type='twosided'>".repeat(100_000), "</bsdf>".repeat(100_000));
    let error = read_text(&deep).unwrap_err();
    assert!(matches!(error, SceneError::Limit { limit: 64, .. }), "{error}");

    // Ten files of thirty includes of the next would be 30^10 elements.
    let many = |next: usize| {
        format!("<scene>{}</scene>", format!("<include filename='{next}.xml'/>").repeat(30))
    };
    let texts: Vec<String> = (1..11).map(many).chain(["<scene/>".to_owned()]).collect();
    let names: Vec<String> = (0..11).map(|i| format!("{i}.xml")).collect();
    let files: Vec<(&str, &str)> =
        names.iter().map(String::as_str).zip(texts.iter().map(String::as_str)).collect();
    let error = read_with("<include filename='0.xml'/>", &files, &[]).unwrap_err();
    assert!(matches!(error, SceneError::Limit { .. }), "{error}");
}

#[test]
fn a_megabyte_on_one_line_is_read_in_linear_time() {
    // Counting columns from the start of the line for each of 40 000 elements would look at 28 thousand million
    // characters: minutes.
    let start = std::time::Instant::now();
    assert_eq!(
        read_text(&"<bsdf type='diffuse'><float name='a' value='1'/></bsdf>".repeat(20_000))
            .unwrap()
            .plugins
            .len(),
        20_001
    );
    assert!(start.elapsed().as_secs() < 10, "{:?}", start.elapsed());
}

#[test]
fn text_that_is_no_scene_is_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("scene.xml");
    for text in
        ["", "<scene", "<scene></bsdf>", "<shape type='x'/>", "not xml", "<scene version='three'/>"]
    {
        fs::write(&path, text).unwrap();
        assert!(read(&path, &[]).is_err(), "{text}");
    }
    fs::write(&path, b"<scene version='3.0.0'>\n<!-- \xff --></scene>").unwrap();
    let error = read(&path, &[]).unwrap_err();
    assert!(
        matches!(&error, SceneError::Xml { location, .. } if (location.line, location.column) == (2, 6)),
        "{error}"
    );
    assert!(read(folder.path(), &[]).is_err());
    assert!(read(&folder.path().join("none.xml"), &[]).is_err());
    for content in [
        "stray",
        "<float name='a' value='1'><float name='b' value='2'/></float>",
        "<float name='a'/>",
        "<float name='a' value='1' unit='m'/>",
        "<bsdf/>",
        "<transform name='t'><float name='x' value='1'/></transform>",
        "<translate x='1'/>",
        "<float name='a' value='nan'/>",
        "<float name='a' value='1'/><integer name='a' value='1'/>",
        "<spectrum name='s' value='400:0.1, 700:0.9'/>",
        "<default name='' value='1'/>",
        "<path value='none'/>",
    ] {
        assert!(read_text(content).is_err(), "{content}");
    }
}
