//! From XML text to a [`Document`]: substitution, includes, references, and the limits that keep hostile files small.

use super::document::{Document, Plugin, PluginId, Property, Value, encoding_of, find_file};
use super::parameters::Parameters;
use super::transform::{Step, vector};
use super::{upgrade, value};
use crate::scene::error::{Location, SceneError};
use glam::DMat4;
use roxmltree::{Node, ParsingOptions};
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest XML file read, in bytes. Scenes with ten thousand shapes have a few megabytes.
const MAX_FILE_BYTES: u64 = 256 << 20;
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

/// A file being read, and where its lines begin.
struct Source {
    path: Arc<Path>,
    text: String,
    lines: Vec<usize>,
}

impl Source {
    /// Reads a file of limited size. Only regular files: a pipe or a device could block or never end.
    fn open(path: &Path, location: Option<&Location>) -> Result<Self, SceneError> {
        let fail = |source| SceneError::Read { path: path.to_path_buf(), source };
        let start =
            || location.cloned().unwrap_or(Location { file: path.into(), line: 1, column: 1 });
        let file = File::open(path).map_err(fail)?;
        let metadata = file.metadata().map_err(fail)?;
        if !metadata.is_file() {
            return Err(SceneError::NoScene {
                path: path.to_path_buf(),
                problem: "is not a file".to_owned(),
            });
        }
        let mut bytes = Vec::new();
        file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(fail)?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            let what = format!("{} has too many bytes", path.display());
            return Err(SceneError::Limit { location: start(), what, limit: MAX_FILE_BYTES });
        }
        let text = String::from_utf8(bytes).map_err(|error| {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = 1 + valid.iter().filter(|byte| **byte == b'\n').count();
            let column = 1 + valid.iter().rev().take_while(|byte| **byte != b'\n').count();
            SceneError::Xml {
                location: Location { file: path.into(), line: line as u32, column: column as u32 },
                message: "not UTF-8 text".to_owned(),
            }
        })?;
        let lines = std::iter::once(0)
            .chain(text.match_indices('\n').map(|(newline, _)| newline + 1))
            .collect();
        Ok(Self { path: path.into(), text, lines })
    }

    /// Where an element begins.
    fn location(&self, node: Node<'_, '_>) -> Location {
        let start = node.range().start;
        let line = self.lines.partition_point(|line| *line <= start);
        let column = 1 + self.text[self.lines[line - 1]..start].chars().count();
        Location { file: self.path.clone(), line: line as u32, column: column as u32 }
    }
}

impl Reader {
    /// Reads a file: the scene itself, or one that `parent` includes from `location`.
    fn read_file(
        &mut self,
        path: &Path,
        included: Option<(PluginId, &Location)>,
    ) -> Result<(), SceneError> {
        let source = Source::open(path, included.map(|(_, location)| location))?;
        let canonical = path
            .canonicalize()
            .map_err(|error| SceneError::Read { path: path.into(), source: error })?;
        if let Some((_, location)) = included {
            self.check_include(&canonical, location)?;
        }
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

        let root = xml.root_element();
        let location = source.location(root);
        let is_scene = root.tag_name().name() == "scene";
        match included {
            None if !is_scene => {
                return Err(SceneError::unknown(
                    &location,
                    "outermost element",
                    root.tag_name().name(),
                    ["scene"],
                ));
            }
            Some((parent, _)) if !is_scene => self.read_element(root, &source, parent, 1)?,
            Some((parent, _)) => self.read_children(root, &source, parent, 1)?,
            None => {
                self.check_version(root, &location)?;
                let name = "scene".to_owned();
                self.document.plugins.push(Plugin {
                    kind: name.clone(),
                    name,
                    location,
                    properties: Vec::new(),
                });
                let scene = self.document.root();
                self.read_children(root, &source, scene, 1)?;
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
        if self.open_files.len() > MAX_INCLUDES {
            let what = "includes are nested too deep".to_owned();
            return Err(SceneError::Limit {
                location: location.clone(),
                what,
                limit: MAX_INCLUDES as u64,
            });
        }
        self.files += 1;
        if self.files > MAX_FILES {
            let what = "too many files are included".to_owned();
            return Err(SceneError::Limit {
                location: location.clone(),
                what,
                limit: MAX_FILES as u64,
            });
        }
        Ok(())
    }

    /// The version changes nothing (old spellings are upgraded in any), but one that is not understood is a sign that
    /// the file is not what it seems.
    fn check_version(&self, root: Node<'_, '_>, location: &Location) -> Result<(), SceneError> {
        match root.attribute("version") {
            Some(version) if version.split('.').any(|part| part.trim().parse::<u32>().is_err()) => {
                Err(SceneError::value(
                    location,
                    "version",
                    format!("\"{version}\""),
                    "numbers like 3.0.0",
                ))
            }
            _ => Ok(()),
        }
    }

    fn read_children(
        &mut self,
        node: Node<'_, '_>,
        source: &Source,
        parent: PluginId,
        depth: usize,
    ) -> Result<(), SceneError> {
        for child in node.children() {
            if child.is_element() {
                self.read_element(child, source, parent, depth)?;
            } else if child.is_text() && !child.text().unwrap_or("").trim().is_empty() {
                let found = format!("\"{}\"", child.text().unwrap_or("").trim());
                return Err(SceneError::value(
                    &source.location(child),
                    "text between elements",
                    found,
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
        let location = source.location(node);
        self.elements += 1;
        for (count, limit, what) in [
            (self.elements, MAX_ELEMENTS, "too many elements"),
            (depth, MAX_DEPTH, "elements are nested too deep"),
        ] {
            if count > limit {
                let what = what.to_owned();
                return Err(SceneError::Limit { location, what, limit: limit as u64 });
            }
        }
        let name = upgrade::element(node.tag_name().name());
        let attributes = self.attributes(node, &location)?;
        if PLUGIN_ELEMENTS.contains(&name) && (name != "spectrum" || attributes.has("type")) {
            self.read_plugin(node, source, parent, depth, &attributes)
        } else if VALUE_ELEMENTS.contains(&name) {
            let value = self.read_value(node, source, &attributes)?;
            let name = upgrade::snake_case(&attributes.get("name").unwrap_or_default());
            self.add(parent, Property { name, value, location })
        } else {
            if let Some(child) = node.children().find(Node::is_element) {
                let kind = format!("element inside <{name}>");
                return Err(SceneError::unknown(
                    &source.location(child),
                    kind,
                    child.tag_name().name(),
                    [""; 0],
                ));
            }
            self.steer(name, parent, &attributes)
        }
    }

    /// `<ref>`, `<default>`, `<include>`, `<alias>` and `<path>`.
    fn steer(
        &mut self,
        name: &str,
        parent: PluginId,
        attributes: &Attributes,
    ) -> Result<(), SceneError> {
        let location = &attributes.location;
        match name {
            "ref" => {
                attributes.check(&["id"], &["name"])?;
                let name = upgrade::snake_case(&attributes.get("name").unwrap_or_default());
                let value = Value::Reference(attributes.need("id")?);
                self.add(parent, Property { name, value, location: location.clone() })
            }
            "default" => {
                attributes.check(&["name", "value"], &[])?;
                let name = attributes.need("name")?;
                if name.is_empty() {
                    return Err(SceneError::value(
                        location,
                        "the name of a <default>",
                        "empty",
                        "a name",
                    ));
                }
                self.parameters.set_default(&name, &attributes.need("value")?);
                Ok(())
            }
            "include" => {
                attributes.check(&["filename"], &[])?;
                let filename = attributes.need("filename")?;
                let path = find_file(
                    &filename,
                    "the included file",
                    location,
                    &self.document.directories,
                )?;
                self.read_file(&path, Some((parent, location)))
            }
            "alias" => {
                attributes.check(&["id", "as"], &[])?;
                let id = attributes.need("id")?;
                let found = self.ids.get(&id).copied();
                let found = found
                    .ok_or_else(|| SceneError::unknown(location, "id", id, self.ids.keys()))?;
                self.register(attributes.need("as")?, found, location)
            }
            "path" => {
                attributes.check(&["value"], &[])?;
                let value = attributes.need("value")?;
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
            _ => {
                let known = PLUGIN_ELEMENTS.iter().chain(&VALUE_ELEMENTS).chain(&STEERING_ELEMENTS);
                Err(SceneError::unknown(location, "element", name, known))
            }
        }
    }

    fn read_plugin(
        &mut self,
        node: Node<'_, '_>,
        source: &Source,
        parent: PluginId,
        depth: usize,
        attributes: &Attributes,
    ) -> Result<(), SceneError> {
        attributes.check(&["type"], &["id", "name"])?;
        let location = attributes.location.clone();
        let id = PluginId(self.document.plugins.len() as u32);
        self.document.plugins.push(Plugin {
            kind: upgrade::element(node.tag_name().name()).to_owned(),
            name: attributes.need("type")?,
            location: location.clone(),
            properties: Vec::new(),
        });
        if let Some(name) = attributes.get("id") {
            self.register(name, id, &location)?;
        }
        let name = upgrade::snake_case(&attributes.get("name").unwrap_or_default());
        self.add(parent, Property { name, value: Value::Plugin(id), location })?;
        self.read_children(node, source, id, depth + 1)?;
        upgrade::plugin(&mut self.document.plugins[id.0 as usize]);
        Ok(())
    }

    fn register(
        &mut self,
        name: String,
        id: PluginId,
        location: &Location,
    ) -> Result<(), SceneError> {
        if let Some(previous) = self.ids.get(&name) {
            let previous = self.document[*previous].location.clone();
            let what = format!("id \"{name}\"");
            return Err(SceneError::Duplicate { location: location.clone(), what, previous });
        }
        self.ids.insert(name, id);
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

    fn read_value(
        &mut self,
        node: Node<'_, '_>,
        source: &Source,
        attributes: &Attributes,
    ) -> Result<Value, SceneError> {
        let location = &attributes.location;
        let element = node.tag_name().name();
        if element == "transform" {
            attributes.check(&["name"], &[])?;
            return self.read_transform(node, source).map(Value::Transform);
        }
        self.read_children_of_value(node, source)?;
        let name = attributes.get("name").unwrap_or_default();
        let what = format!("{element} \"{name}\"");
        match element {
            "point" | "vector" => {
                attributes.check(&["name"], &["x", "y", "z", "value"])?;
                return vector(&|name| attributes.get(name), 0.0, location).map(Value::Vector);
            }
            "rgb" | "srgb" => attributes.check(&["name", "value"], &["intent"])?,
            "spectrum" => attributes.check(&["name", "value"], &["intent", "filename"])?,
            _ => attributes.check(&["name", "value"], &[])?,
        }
        let text = attributes.need("value")?;
        match element {
            "boolean" => value::boolean(&text, &what, location).map(Value::Boolean),
            "integer" => value::integer(&text, &what, location).map(Value::Integer),
            "float" => value::number(&text, &what, location).map(Value::Float),
            "string" => Ok(Value::String(text)),
            "spectrum" if text.contains(':') => {
                let expected = "a uniform value or an rgb: wavelengths are not modelled";
                Err(SceneError::value(location, what, format!("\"{text}\""), expected))
            }
            _ => value::color(&text, encoding_of(element), &what, location).map(Value::Color),
        }
    }

    fn read_children_of_value(
        &self,
        node: Node<'_, '_>,
        source: &Source,
    ) -> Result<(), SceneError> {
        match node.children().find(Node::is_element) {
            Some(child) => {
                let kind = format!("element inside <{}>", node.tag_name().name());
                Err(SceneError::unknown(
                    &source.location(child),
                    kind,
                    child.tag_name().name(),
                    [""; 0],
                ))
            }
            None => Ok(()),
        }
    }

    /// Steps in the order of the file: each is applied after those before it.
    fn read_transform(&mut self, node: Node<'_, '_>, source: &Source) -> Result<DMat4, SceneError> {
        let mut transform = DMat4::IDENTITY;
        for child in node.children().filter(Node::is_element) {
            let location = source.location(child);
            let name = child.tag_name().name();
            let step = Step::from_element(name).ok_or_else(|| {
                let known = ["translate", "rotate", "scale", "lookat", "matrix"];
                SceneError::unknown(&location, "step of a transform", name, known)
            })?;
            let attributes = self.attributes(child, &location)?;
            let (needed, optional) = step.attributes();
            attributes.check(needed, optional)?;
            transform = step.matrix(|name| attributes.get(name), &location)? * transform;
        }
        Ok(transform)
    }

    /// All attributes of an element, with parameters substituted.
    fn attributes(
        &mut self,
        node: Node<'_, '_>,
        location: &Location,
    ) -> Result<Attributes, SceneError> {
        let values = node.attributes().map(|attribute| {
            let value = self.parameters.substitute(attribute.value(), location)?;
            Ok((attribute.name().to_owned(), value))
        });
        let values = values.collect::<Result<_, SceneError>>()?;
        Ok(Attributes {
            element: node.tag_name().name().to_owned(),
            values,
            location: location.clone(),
        })
    }
}

/// The attributes of an element.
struct Attributes {
    element: String,
    values: Vec<(String, String)>,
    location: Location,
}

impl Attributes {
    fn has(&self, name: &str) -> bool {
        self.values.iter().any(|(known, _)| known == name)
    }

    fn get(&self, name: &str) -> Option<String> {
        self.values.iter().find(|(known, _)| known == name).map(|(_, value)| value.clone())
    }

    fn need(&self, name: &str) -> Result<String, SceneError> {
        let missing = || {
            SceneError::missing(
                &self.location,
                format!("attribute \"{name}\" of <{}>", self.element),
            )
        };
        self.get(name).ok_or_else(missing)
    }

    /// Are the needed attributes there, and none that mean nothing?
    fn check(&self, needed: &[&str], optional: &[&str]) -> Result<(), SceneError> {
        for name in needed {
            self.need(name)?;
        }
        for (name, _) in &self.values {
            if !needed.contains(&name.as_str()) && !optional.contains(&name.as_str()) {
                let known = needed.iter().chain(optional);
                let kind = format!("attribute of <{}>", self.element);
                return Err(SceneError::unknown(&self.location, kind, name, known));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
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
