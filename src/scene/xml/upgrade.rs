//! Spellings of Mitsuba 0.5, 0.6 and 2 that mean something else or nothing in version 3.
//!
//! The rules are those by which Mitsuba 3 itself upgrades scenes (`src/core/parser.cpp`). They are applied to files of
//! every version: a camelCase name means nothing in version 3, so nothing can be mistaken.

use super::document::{Plugin, Property, Value};
use glam::{DMat4, DVec3};

/// `toWorld` → `to_world`, `intIOR` → `int_ior`: an underscore where a capital follows a small letter, and the whole run
/// of capitals made small.
pub(super) fn snake_case(name: &str) -> String {
    let mut result = String::with_capacity(name.len() + 4);
    let mut is_lowering = false;
    let mut previous = ' ';
    for letter in name.chars() {
        if letter.is_ascii_uppercase() && previous.is_ascii_lowercase() {
            result.push('_');
            is_lowering = true;
        }
        is_lowering &= letter.is_ascii_uppercase();
        result.push(if is_lowering { letter.to_ascii_lowercase() } else { letter });
        previous = letter;
    }
    result
}

/// The element that an old one became.
pub(super) fn element(name: &str) -> &str {
    match name {
        "camera" => "sensor",
        "luminaire" => "emitter",
        _ => name,
    }
}

/// Rewrites the properties of a plugin whose names are in snake case already.
pub(super) fn plugin(plugin: &mut Plugin) {
    match (plugin.kind.as_str(), plugin.name.as_str()) {
        ("bsdf", "diffuse") => rename(plugin, "diffuse_reflectance", "reflectance"),
        ("film", "ldrfilm") => plugin.name = "hdrfilm".to_owned(),
        _ => {}
    }
    texture_offsets_to_transform(plugin);
}

fn rename(plugin: &mut Plugin, from: &str, to: &str) {
    for property in &mut plugin.properties {
        if property.name == from {
            property.name = to.to_owned();
        }
    }
}

/// `uoffset`, `voffset`, `uscale`, `vscale` become `to_uv`: first moved, then scaled, as Mitsuba 3 does it (0.6 scaled
/// first; the two differ only where both are given).
fn texture_offsets_to_transform(plugin: &mut Plugin) {
    if plugin.kind != "texture" {
        return;
    }
    let mut offset = DVec3::ZERO;
    let mut scale = DVec3::ONE;
    let mut location = None;
    plugin.properties.retain(|property| {
        let number = match property.value {
            Value::Float(number) => number,
            Value::Integer(number) => number as f64,
            _ => return true,
        };
        match property.name.as_str() {
            "uoffset" => offset.x = number,
            "voffset" => offset.y = number,
            "uscale" => scale.x = number,
            "vscale" => scale.y = number,
            _ => return true,
        }
        location = Some(property.location.clone());
        false
    });
    if let Some(location) = location {
        let transform = DMat4::from_scale(scale) * DMat4::from_translation(offset);
        plugin.properties.push(Property {
            name: "to_uv".to_owned(),
            value: Value::Transform(transform),
            location,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::error::Location;
    use std::path::Path;

    #[test]
    fn camel_case_becomes_snake_case() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("sampleCount", "sample_count"),
            ("specularReflectance", "specular_reflectance"),
            ("fov", "fov"),
            ("to_world", "to_world"),
            ("color0", "color0"),
            ("rrDepth", "rr_depth"),
            ("", ""),
        ] {
            assert_eq!(snake_case(old), new);
        }
    }

    #[test]
    fn texture_offsets_become_a_transform() {
        let location = Location { file: Path::new("scene.xml").into(), line: 1, column: 1 };
        let property = |name: &str, value| Property {
            name: name.to_owned(),
            value,
            location: location.clone(),
        };
        let mut texture = Plugin {
            kind: "texture".to_owned(),
            name: "bitmap".to_owned(),
            location: location.clone(),
            properties: vec![
                property("uoffset", Value::Float(0.5)),
                property("uscale", Value::Integer(3)),
                property("voffset", Value::Float(-1.0)),
                property("raw", Value::Boolean(true)),
            ],
        };
        plugin(&mut texture);
        let names: Vec<&str> =
            texture.properties.iter().map(|property| property.name.as_str()).collect();
        assert_eq!(names, ["raw", "to_uv"]);
        let Value::Transform(transform) = texture.properties[1].value else {
            panic!("{texture:?}")
        };
        assert_eq!(
            transform.transform_point3(DVec3::new(1.0, 1.0, 0.0)),
            DVec3::new(4.5, 0.0, 0.0)
        );
    }
}
