//! A scene file as a graph of plugins with properties, before anyone asks what they mean.

use crate::scene::error::{Location, SceneError};
use glam::{DMat4, DVec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Index of a plugin in a [`Document`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct PluginId(pub(super) u32);

/// All plugins of a scene; the first is the `<scene>` itself.
#[derive(Debug)]
pub(super) struct Document {
    /// Found by [`PluginId`].
    pub(super) plugins: Vec<Plugin>,
    /// Where files may lie beside the folder of the file that names them: folders of including files, `<path>`s.
    pub(super) directories: Vec<PathBuf>,
}

/// `<kind type="name" id="…">` with what is inside.
#[derive(Debug)]
pub(super) struct Plugin {
    /// Its element: `bsdf`, `shape`, …
    pub(super) kind: String,
    /// Its type: `diffuse`, `rectangle`, …
    pub(super) name: String,
    /// Where it starts.
    pub(super) location: Location,
    /// In the order of the file.
    pub(super) properties: Vec<Property>,
}

/// A named value in a plugin, or a plugin in a plugin (whose name may be empty).
#[derive(Debug)]
pub(super) struct Property {
    /// Its name, with old spellings replaced.
    pub(super) name: String,
    /// What it says.
    pub(super) value: Value,
    /// Where it starts.
    pub(super) location: Location,
}

/// What a property may be.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// `<boolean>`
    Boolean(bool),
    /// `<integer>`
    Integer(i64),
    /// `<float>`
    Float(f64),
    /// `<string>`
    String(String),
    /// `<point>` or `<vector>`
    Vector(DVec3),
    /// `<rgb>`, `<srgb>` or a uniform `<spectrum>`, as linear Rec. 709
    Color(DVec3),
    /// `<transform>`
    Transform(DMat4),
    /// `<ref id>` until all of the file is read
    Reference(String),
    /// A nested plugin or one that a `<ref>` means
    Plugin(PluginId),
}

impl Value {
    /// What it is, for messages.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Boolean(_) => "a boolean",
            Self::Integer(_) => "an integer",
            Self::Float(_) => "a float",
            Self::String(_) => "a string",
            Self::Vector(_) => "a point or vector",
            Self::Color(_) => "a color",
            Self::Transform(_) => "a transform",
            Self::Reference(_) | Self::Plugin(_) => "a plugin",
        }
    }
}

impl std::ops::Index<PluginId> for Document {
    type Output = Plugin;
    fn index(&self, id: PluginId) -> &Plugin {
        &self.plugins[id.0 as usize]
    }
}

impl Document {
    /// The `<scene>`.
    pub(super) fn root(&self) -> PluginId {
        PluginId(0)
    }

    /// Replaces every reference by the plugin it means.
    ///
    /// # Errors
    /// [`SceneError::Unknown`] for an id that nothing has, [`SceneError::Cycle`] for a plugin that contains itself.
    pub(super) fn resolve(&mut self, ids: &HashMap<String, PluginId>) -> Result<(), SceneError> {
        for plugin in &mut self.plugins {
            for property in &mut plugin.properties {
                if let Value::Reference(id) = &property.value {
                    let found = ids.get(id).ok_or_else(|| {
                        SceneError::unknown(&property.location, "id", id.as_str(), ids.keys())
                    })?;
                    property.value = Value::Plugin(*found);
                }
            }
        }
        self.check_acyclic()
    }

    /// Walks from every plugin along its nested ones. Iterative: references may chain deeper than a call stack.
    fn check_acyclic(&self) -> Result<(), SceneError> {
        let mut is_done = vec![false; self.plugins.len()];
        let mut is_open = vec![false; self.plugins.len()];
        for start in 0..self.plugins.len() {
            // Each entry is a plugin on the way and how many of its properties were looked at.
            let mut way = vec![(start, 0)];
            while let Some((plugin, next)) = way.last_mut() {
                let (here, position) = (*plugin, *next);
                *next += 1;
                if is_done[here] {
                    way.pop();
                    continue;
                }
                is_open[here] = true;
                match self.plugins[here].properties.get(position) {
                    None => {
                        is_open[here] = false;
                        is_done[here] = true;
                        way.pop();
                    }
                    Some(Property { value: Value::Plugin(child), location, .. }) => {
                        let child = child.0 as usize;
                        if is_open[child] {
                            let first =
                                way.iter().position(|(plugin, _)| *plugin == child).unwrap_or(0);
                            let names =
                                way[first..].iter().map(|(plugin, _)| *plugin).chain([child]);
                            let chain: Vec<&str> =
                                names.map(|id| self.plugins[id].name.as_str()).collect();
                            return Err(SceneError::Cycle {
                                location: location.clone(),
                                what: format!(
                                    "{} \"{}\"",
                                    self.plugins[child].kind, self.plugins[child].name
                                ),
                                chain: chain.join(" → "),
                            });
                        }
                        way.push((child, 0));
                    }
                    Some(_) => {}
                }
            }
        }
        Ok(())
    }

    /// The file that a plugin names: in the folder of the file that names it, or in one of [`Document::directories`].
    /// Backslashes of scenes from Windows are read as slashes where nothing is found otherwise.
    ///
    /// # Errors
    /// [`SceneError::Value`] when there is no such file.
    pub(super) fn find_file(
        &self,
        filename: &str,
        what: &str,
        location: &Location,
    ) -> Result<PathBuf, SceneError> {
        find_file(filename, what, location, &self.directories)
    }
}

/// As [`Document::find_file`], for a document that is still being read.
pub(super) fn find_file(
    filename: &str,
    what: &str,
    location: &Location,
    directories: &[PathBuf],
) -> Result<PathBuf, SceneError> {
    let slashed = filename.replace('\\', "/");
    let own = location.file.parent().map(Path::to_path_buf);
    for name in [filename, &slashed] {
        for directory in own.iter().chain(directories) {
            let path = directory.join(name);
            if path.is_file() {
                return Ok(path);
            }
        }
    }
    let folder =
        own.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or_else(|| PathBuf::from("."));
    let expected = format!("a file in {}", folder.display());
    Err(SceneError::value(location, what, format!("\"{filename}\""), expected))
}
