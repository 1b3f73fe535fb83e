//! A scene file as a graph of plugins with properties, before anyone asks what they mean.

use crate::scene::error::{Location, SceneError};
use glam::{DMat4, DVec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Most plugins in one plugin, each counted as often as it is met: forty blends of a blend with itself would be 2⁴⁰.
const MAX_NESTED: usize = 10_000;
/// Longest chain of plugins in each other.
const MAX_NESTING: usize = 64;

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
    /// [`SceneError::Unknown`] for an id that nothing has, [`SceneError::Cycle`] for a plugin that contains itself,
    /// [`SceneError::Limit`] where nesting goes too far.
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
        self.check_nesting()
    }

    /// Is there an image or a pattern in this plugin, or in one nested in it?
    pub(super) fn is_textured(&self, id: PluginId) -> bool {
        let Plugin { kind, name, .. } = &self[id];
        let is_pattern = kind == "texture" && (name == "bitmap" || name == "checkerboard");
        is_pattern || self.nested(id).any(|nested| self.is_textured(nested))
    }

    /// Walks from every plugin along its nested ones: is there a circle, and how much is nested in each? Iterative, for
    /// references may chain deeper than a call stack; later walks then recur safely.
    fn check_nesting(&self) -> Result<(), SceneError> {
        // Nested plugins counted as often as they are met, and how deep they go; 0 while not known.
        let mut sizes = vec![0usize; self.plugins.len()];
        let mut depths = vec![0usize; self.plugins.len()];
        let mut is_open = vec![false; self.plugins.len()];
        for start in 0..self.plugins.len() {
            // Each entry is a plugin on the way and how many of its properties were looked at.
            let mut way = vec![(start, 0)];
            while let Some((plugin, next)) = way.last_mut() {
                let (here, position) = (*plugin, *next);
                *next += 1;
                if sizes[here] > 0 {
                    way.pop();
                    continue;
                }
                is_open[here] = true;
                match self.plugins[here].properties.get(position) {
                    None => {
                        is_open[here] = false;
                        way.pop();
                        let nested = || self.nested(PluginId(here as u32)).map(|id| id.0 as usize);
                        sizes[here] = nested().fold(1, |sum, id| sum.saturating_add(sizes[id]));
                        depths[here] = 1 + nested().map(|id| depths[id]).max().unwrap_or(0);
                        self.check_limits(here, sizes[here], depths[here])?;
                    }
                    Some(Property { value: Value::Plugin(child), location, .. }) => {
                        let child = child.0 as usize;
                        if is_open[child] {
                            return Err(self.cycle(&way, child, location));
                        }
                        way.push((child, 0));
                    }
                    Some(_) => {}
                }
            }
        }
        Ok(())
    }

    /// The plugins nested in one, once for each time.
    pub(super) fn nested(&self, id: PluginId) -> impl Iterator<Item = PluginId> {
        self[id].properties.iter().filter_map(|property| match property.value {
            Value::Plugin(nested) => Some(nested),
            _ => None,
        })
    }

    /// The scene itself may hold as much as it likes.
    fn check_limits(&self, plugin: usize, size: usize, depth: usize) -> Result<(), SceneError> {
        for (count, limit, what) in [
            (size, MAX_NESTED, "too many plugins are nested in each other"),
            (depth, MAX_NESTING, "plugins are nested too deep"),
        ] {
            if count > limit && plugin != 0 {
                let (location, what) = (self.plugins[plugin].location.clone(), what.to_owned());
                return Err(SceneError::Limit { location, what, limit: limit as u64 });
            }
        }
        Ok(())
    }

    fn cycle(&self, way: &[(usize, usize)], back_to: usize, location: &Location) -> SceneError {
        let first = way.iter().position(|(plugin, _)| *plugin == back_to).unwrap_or(0);
        let names = way[first..].iter().map(|(plugin, _)| *plugin).chain([back_to]);
        let chain: Vec<&str> = names.map(|id| self.plugins[id].name.as_str()).collect();
        let Plugin { kind, name, .. } = &self.plugins[back_to];
        let (location, what) = (location.clone(), format!("{kind} \"{name}\""));
        SceneError::Cycle { location, what, chain: chain.join(" → ") }
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
