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
                self.read_children(&root, &source, parent, 1)?;
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
mod tests;
