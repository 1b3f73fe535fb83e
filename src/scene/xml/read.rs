//! From XML text to a [`Document`]: substitution, includes, references, and the limits that keep hostile files small.

use super::document::{Document, Plugin, PluginId, Property, Value, find_file};
use super::element::Element;
use super::parameters::Parameters;
use super::source::Source;
use super::upgrade;
use crate::scene::error::{Location, SceneError};
use roxmltree::{Node, ParsingOptions};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Most elements of a scene with all its includes.
const MAX_ELEMENTS: usize = 4_000_000;
/// Most files of a scene. Ten files that each include the next ten times would otherwise be read 10¹⁰ times.
const MAX_FILES: usize = 10_000;
/// Deepest nesting of elements: a scene with blended, bumped and masked materials needs about 10.
const MAX_DEPTH: usize = 64;
/// Deepest nesting of includes, as in Mitsuba.
const MAX_INCLUDES: usize = 15;

/// Elements that are plugins: `<kind type="…">`.
const PLUGIN_ELEMENTS: [&str; 13] = [
    "bsdf",
    "emitter",
    "film",
    "integrator",
    "medium",
    "phase",
    "rfilter",
    "sampler",
    "sensor",
    "shape",
    "spectrum",
    "texture",
    "volume",
];
/// Elements that are values.
const VALUE_ELEMENTS: [&str; 10] = [
    "boolean",
    "float",
    "integer",
    "point",
    "rgb",
    "spectrum",
    "srgb",
    "string",
    "transform",
    "vector",
];
/// Elements that steer the reading.
const STEERING_ELEMENTS: [&str; 5] = ["alias", "default", "include", "path", "ref"];

/// Reads a scene file with everything that it includes.
///
/// # Errors
/// Whatever [`SceneError`] says, with its place.
pub(super) fn read(path: &Path, definitions: &[(String, String)]) -> Result<Document, SceneError> {
    let mut reader = Reader {
        parameters: Parameters::new(definitions),
        document: Document { plugins: Vec::new(), directories: Vec::new() },
        ids: HashMap::new(),
        open_files: Vec::new(),
        files: 0,
        elements: 0,
    };
    reader.read_file(path, None)?;
    reader.parameters.check_all_used()?;
    let Reader { mut document, ids, .. } = reader;
    document.resolve(&ids)?;
    Ok(document)
}

struct Reader {
    parameters: Parameters,
    document: Document,
    ids: HashMap<String, PluginId>,
    /// Canonical paths of the files being read, outermost first.
    open_files: Vec<PathBuf>,
    files: usize,
    elements: usize,
}

impl Reader {
    /// Reads a file: the scene itself, or one that is included into `parent` from `location`.
    fn read_file(
        &mut self,
        path: &Path,
        included: Option<(PluginId, &Location)>,
    ) -> Result<(), SceneError> {
        let fail = |source| SceneError::Read { path: path.to_path_buf(), source };
        let canonical = path.canonicalize().map_err(fail)?;
        if let Some((_, location)) = included {
            self.check_include(&canonical, location)?;
        }
        let source = Source::open(path)?;
        let options = ParsingOptions {
            allow_dtd: false,
            nodes_limit: 8 * MAX_ELEMENTS as u32,
            ..Default::default()
        };
        let xml =
            roxmltree::Document::parse_with_options(&source.text, options).map_err(|error| {
                SceneError::Xml {
                    location: Location {
                        file: path.into(),
                        line: error.pos().row,
                        column: error.pos().col,
                    },
                    message: error.to_string(),
                }
            })?;
        self.open_files.push(canonical);
        let directory = path.parent().unwrap_or(Path::new("")).to_path_buf();
        if !self.document.directories.contains(&directory) {
            self.document.directories.push(directory);
        }

        let root = Element::new(xml.root_element(), &source, &mut self.parameters)?;
        match included {
            Some((parent, _)) if root.name == "scene" => {
                self.read_children(&root, &source, parent, 1)?
            }
            Some((parent, _)) => self.read_element(root.node, &source, parent, 1)?,
            None if root.name == "scene" => {
                check_version(&root)?;
                let (kind, location) = (root.name.to_owned(), root.location.clone());
                self.document.plugins.push(Plugin {
                    name: kind.clone(),
                    kind,
                    location,
                    properties: Vec::new(),
                });
                let scene = self.document.root();
                self.read_children(&root, &source, scene, 1)?;
            }
            None => {
                return Err(SceneError::unknown(
                    &root.location,
                    "outermost element",
                    root.name,
                    ["scene"],
                ));
            }
        }
        self.open_files.pop();
        Ok(())
    }

    fn check_include(&mut self, canonical: &Path, location: &Location) -> Result<(), SceneError> {
        if let Some(first) = self.open_files.iter().position(|open| open == canonical) {
            let way = self.open_files[first..].iter().map(PathBuf::as_path).chain([canonical]);
            let chain: Vec<String> = way.map(|path| path.display().to_string()).collect();
            let what = "an included file".to_owned();
            return Err(SceneError::Cycle {
                location: location.clone(),
                what,
                chain: chain.join(" → "),
            });
        }
        self.files += 1;
        check_limit(self.open_files.len(), MAX_INCLUDES, "includes are nested too deep", location)?;
        check_limit(self.files, MAX_FILES, "too many files are included", location)
    }

    fn read_children(
        &mut self,
        element: &Element<'_>,
        source: &Source,
        parent: PluginId,
        depth: usize,
    ) -> Result<(), SceneError> {
        for child in element.node.children() {
            if child.is_element() {
                self.read_element(child, source, parent, depth)?;
            } else if child.is_text()
                && let Some(text) = child.text().map(str::trim).filter(|text| !text.is_empty())
            {
                let location = source.location(child);
                return Err(SceneError::value(
                    &location,
                    "text between elements",
                    format!("\"{text}\""),
                    "none",
                ));
            }
        }
        Ok(())
    }

    fn read_element(
        &mut self,
        node: Node<'_, '_>,
        source: &Source,
        parent: PluginId,
        depth: usize,
    ) -> Result<(), SceneError> {
        let element = Element::new(node, source, &mut self.parameters)?;
        self.elements += 1;
        check_limit(self.elements, MAX_ELEMENTS, "too many elements", &element.location)?;
        check_limit(depth, MAX_DEPTH, "elements are nested too deep", &element.location)?;
        if PLUGIN_ELEMENTS.contains(&element.name)
            && (element.name != "spectrum" || element.has("type"))
        {
            self.read_plugin(&element, source, parent, depth)
        } else if VALUE_ELEMENTS.contains(&element.name) {
            let value = element.value(&mut self.parameters)?;
            self.add(
                parent,
                Property { name: element.property_name(), value, location: element.location },
            )
        } else {
            self.steer(&element, parent)
        }
    }

    fn read_plugin(
        &mut self,
        element: &Element<'_>,
        source: &Source,
        parent: PluginId,
        depth: usize,
    ) -> Result<(), SceneError> {
        element.check(&["type"], &["id", "name"])?;
        let location = element.location.clone();
        let id = PluginId(self.document.plugins.len() as u32);
        self.document.plugins.push(Plugin {
            kind: element.name.to_owned(),
            name: element.need("type")?.to_owned(),
            location: location.clone(),
            properties: Vec::new(),
        });
        if let Some(name) = element.get("id") {
            self.register(name, id, &location)?;
        }
        self.add(
            parent,
            Property { name: element.property_name(), value: Value::Plugin(id), location },
        )?;
        self.read_children(element, source, id, depth + 1)?;
        upgrade::plugin(&mut self.document.plugins[id.0 as usize]);
        Ok(())
    }

    /// `<ref>`, `<default>`, `<include>`, `<alias>` and `<path>`.
    fn steer(&mut self, element: &Element<'_>, parent: PluginId) -> Result<(), SceneError> {
        element.check_empty()?;
        let location = &element.location;
        match element.name {
            "ref" => {
                element.check(&["id"], &["name"])?;
                let value = Value::Reference(element.need("id")?.to_owned());
                self.add(
                    parent,
                    Property { name: element.property_name(), value, location: location.clone() },
                )
            }
            "default" => {
                element.check(&["name", "value"], &[])?;
                let name = element.need("name")?;
                if name.is_empty() {
                    return Err(SceneError::value(
                        location,
                        "the name of a <default>",
                        "empty",
                        "a name",
                    ));
                }
                self.parameters.set_default(name, element.need("value")?);
                Ok(())
            }
            "include" => {
                element.check(&["filename"], &[])?;
                let filename = element.need("filename")?;
                let path =
                    find_file(filename, "the included file", location, &self.document.directories)?;
                self.read_file(&path, Some((parent, location)))
            }
            "alias" => {
                element.check(&["id", "as"], &[])?;
                let id = element.need("id")?;
                let found = self.ids.get(id).copied();
                let found = found
                    .ok_or_else(|| SceneError::unknown(location, "id", id, self.ids.keys()))?;
                self.register(element.need("as")?, found, location)
            }
            "path" => {
                element.check(&["value"], &[])?;
                let value = element.need("value")?;
                let own = location.file.parent().unwrap_or(Path::new(""));
                let directory = own.join(value.replace('\\', "/"));
                if !directory.is_dir() {
                    return Err(SceneError::value(
                        location,
                        "the path",
                        format!("\"{value}\""),
                        "a folder",
                    ));
                }
                self.document.directories.push(directory);
                Ok(())
            }
            name => {
                let known = PLUGIN_ELEMENTS.iter().chain(&VALUE_ELEMENTS).chain(&STEERING_ELEMENTS);
                Err(SceneError::unknown(location, "element", name, known))
            }
        }
    }

    fn register(
        &mut self,
        name: &str,
        id: PluginId,
        location: &Location,
    ) -> Result<(), SceneError> {
        if let Some(previous) = self.ids.get(name) {
            let previous = self.document[*previous].location.clone();
            let what = format!("id \"{name}\"");
            return Err(SceneError::Duplicate { location: location.clone(), what, previous });
        }
        self.ids.insert(name.to_owned(), id);
        Ok(())
    }

    fn add(&mut self, parent: PluginId, property: Property) -> Result<(), SceneError> {
        let properties = &mut self.document.plugins[parent.0 as usize].properties;
        if !property.name.is_empty()
            && let Some(previous) =
                properties.iter().find(|previous| previous.name == property.name)
        {
            let what = format!("property \"{}\"", property.name);
            let previous = previous.location.clone();
            return Err(SceneError::Duplicate { location: property.location, what, previous });
        }
        properties.push(property);
        Ok(())
    }
}

/// The version changes nothing (old spellings are upgraded in any), but one that is not understood is a sign that the
/// file is not what it seems.
fn check_version(root: &Element<'_>) -> Result<(), SceneError> {
    match root.get("version") {
        Some(version) if version.split('.').any(|part| part.trim().parse::<u32>().is_err()) => {
            Err(SceneError::value(
                &root.location,
                "version",
                format!("\"{version}\""),
                "numbers like 3.0.0",
            ))
        }
        _ => Ok(()),
    }
}

fn check_limit(
    count: usize,
    limit: usize,
    what: &str,
    location: &Location,
) -> Result<(), SceneError> {
    if count <= limit {
        return Ok(());
    }
    Err(SceneError::Limit {
        location: location.clone(),
        what: what.to_owned(),
        limit: limit as u64,
    })
}

#[cfg(test)]
mod tests {
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
        let definitions: Vec<_> = definitions
            .iter()
            .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
            .collect();
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
        let error = read_text(
            "\n  <bsdf type='diffuse'>\n    <string name='é' value='ü'/><nonsense/></bsdf>",
        )
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

        let deep =
            format!("{}{}", "<bsdf type='twosided'>".repeat(100_000), "</bsdf>".repeat(100_000));
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
        for text in [
            "",
            "<scene",
            "<scene></bsdf>",
            "<shape type='x'/>",
            "not xml",
            "<scene version='three'/>",
        ] {
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
}
