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
/// Most elements of a scene with all its includes. Nested includes could otherwise multiply without end.
const MAX_ELEMENTS: usize = 4_000_000;
/// Deepest nesting of elements: a scene with blended, bumped and masked materials needs about 10.
const MAX_DEPTH: usize = 64;
/// Deepest nesting of includes, as in Mitsuba.
const MAX_INCLUDES: usize = 15;

/// Elements that are plugins: `<kind type="…">`.
const PLUGIN_ELEMENTS: [&str; 13] = [
    "bsdf", "emitter", "film", "integrator", "medium", "phase", "rfilter", "sampler", "sensor", "shape", "spectrum",
    "texture", "volume",
];
/// Elements that are values.
const VALUE_ELEMENTS: [&str; 10] =
    ["boolean", "float", "integer", "point", "rgb", "spectrum", "srgb", "string", "transform", "vector"];
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
        let start = || location.cloned().unwrap_or(Location { file: path.into(), line: 1, column: 1 });
        let file = File::open(path).map_err(fail)?;
        let metadata = file.metadata().map_err(fail)?;
        if !metadata.is_file() {
            return Err(SceneError::NoScene { path: path.to_path_buf(), problem: "is not a file".to_owned() });
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
        let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(newline, _)| newline + 1)).collect();
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
    fn read_file(&mut self, path: &Path, included: Option<(PluginId, &Location)>) -> Result<(), SceneError> {
        let source = Source::open(path, included.map(|(_, location)| location))?;
        let canonical = path.canonicalize().map_err(|error| SceneError::Read { path: path.into(), source: error })?;
        if let Some((_, location)) = included {
            self.check_include(&canonical, location)?;
        }
        let options = ParsingOptions { allow_dtd: false, nodes_limit: 8 * MAX_ELEMENTS as u32, ..Default::default() };
        let xml = roxmltree::Document::parse_with_options(&source.text, options).map_err(|error| SceneError::Xml {
            location: Location { file: path.into(), line: error.pos().row, column: error.pos().col },
            message: error.to_string(),
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
                return Err(SceneError::unknown(&location, "outermost element", root.tag_name().name(), ["scene"]));
            }
            Some((parent, _)) if !is_scene => self.read_element(root, &source, parent, 1)?,
            Some((parent, _)) => self.read_children(root, &source, parent, 1)?,
            None => {
                self.check_version(root, &location)?;
                let name = "scene".to_owned();
                self.document.plugins.push(Plugin { kind: name.clone(), name, location, properties: Vec::new() });
                let scene = self.document.root();
                self.read_children(root, &source, scene, 1)?;
            }
        }
        self.open_files.pop();
        Ok(())
    }

    fn check_include(&self, canonical: &Path, location: &Location) -> Result<(), SceneError> {
        if let Some(first) = self.open_files.iter().position(|open| open == canonical) {
            let way = self.open_files[first..].iter().map(PathBuf::as_path).chain([canonical]);
            let chain: Vec<String> = way.map(|path| path.display().to_string()).collect();
            let what = "an included file".to_owned();
            return Err(SceneError::Cycle { location: location.clone(), what, chain: chain.join(" → ") });
        }
        if self.open_files.len() > MAX_INCLUDES {
            let what = "includes are nested too deep".to_owned();
            return Err(SceneError::Limit { location: location.clone(), what, limit: MAX_INCLUDES as u64 });
        }
        Ok(())
    }

    /// The version changes nothing (old spellings are upgraded in any), but one that is not understood is a sign that
    /// the file is not what it seems.
    fn check_version(&self, root: Node<'_, '_>, location: &Location) -> Result<(), SceneError> {
        match root.attribute("version") {
            Some(version) if version.split('.').any(|part| part.trim().parse::<u32>().is_err()) => {
                Err(SceneError::value(location, "version", format!("\"{version}\""), "numbers like 3.0.0"))
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
                return Err(SceneError::value(&source.location(child), "text between elements", found, "none"));
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
        for (count, limit, what) in
            [(self.elements, MAX_ELEMENTS, "too many elements"), (depth, MAX_DEPTH, "elements are nested too deep")]
        {
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
                return Err(SceneError::unknown(&source.location(child), kind, child.tag_name().name(), [""; 0]));
            }
            self.steer(name, parent, &attributes)
        }
    }

    /// `<ref>`, `<default>`, `<include>`, `<alias>` and `<path>`.
    fn steer(&mut self, name: &str, parent: PluginId, attributes: &Attributes) -> Result<(), SceneError> {
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
                    return Err(SceneError::value(location, "the name of a <default>", "empty", "a name"));
                }
                self.parameters.set_default(&name, &attributes.need("value")?);
                Ok(())
            }
            "include" => {
                attributes.check(&["filename"], &[])?;
                let filename = attributes.need("filename")?;
                let path = find_file(&filename, "the included file", location, &self.document.directories)?;
                self.read_file(&path, Some((parent, location)))
            }
            "alias" => {
                attributes.check(&["id", "as"], &[])?;
                let id = attributes.need("id")?;
                let found = self.ids.get(&id).copied();
                let found = found.ok_or_else(|| SceneError::unknown(location, "id", id, self.ids.keys()))?;
                self.register(attributes.need("as")?, found, location)
            }
            "path" => {
                attributes.check(&["value"], &[])?;
                let value = attributes.need("value")?;
                let own = location.file.parent().unwrap_or(Path::new(""));
                let directory = own.join(value.replace('\\', "/"));
                if !directory.is_dir() {
                    return Err(SceneError::value(location, "the path", format!("\"{value}\""), "a folder"));
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

    fn register(&mut self, name: String, id: PluginId, location: &Location) -> Result<(), SceneError> {
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
            && let Some(previous) = properties.iter().find(|previous| previous.name == property.name)
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

    fn read_children_of_value(&self, node: Node<'_, '_>, source: &Source) -> Result<(), SceneError> {
        match node.children().find(Node::is_element) {
            Some(child) => {
                let kind = format!("element inside <{}>", node.tag_name().name());
                Err(SceneError::unknown(&source.location(child), kind, child.tag_name().name(), [""; 0]))
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
    fn attributes(&mut self, node: Node<'_, '_>, location: &Location) -> Result<Attributes, SceneError> {
        let values = node.attributes().map(|attribute| {
            let value = self.parameters.substitute(attribute.value(), location)?;
            Ok((attribute.name().to_owned(), value))
        });
        let values = values.collect::<Result<_, SceneError>>()?;
        Ok(Attributes { element: node.tag_name().name().to_owned(), values, location: location.clone() })
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
        let missing = || SceneError::missing(&self.location, format!("attribute \"{name}\" of <{}>", self.element));
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
