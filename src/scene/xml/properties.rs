//! Asking a plugin for its properties. What was never asked for is an error: misspelt, or not supported.

use super::document::{Document, Plugin, PluginId, Property, Value};
use crate::math::Rgb;
use crate::scene::error::{Location, SceneError};
use glam::{DMat4, DVec3};

/// The properties of one plugin, with a note of which were asked for.
pub(super) struct Properties<'a> {
    pub(super) document: &'a Document,
    plugin: &'a Plugin,
    is_used: Vec<bool>,
    /// Names asked for.
    known: Vec<&'static str>,
    /// Kinds of nested plugins asked for.
    kinds: Vec<&'static str>,
}

/// What stands where a texture may stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum TextureValue {
    /// One number.
    Number(f64),
    /// A colour.
    Color(DVec3),
    /// A texture plugin.
    Plugin(PluginId),
}

impl<'a> Properties<'a> {
    /// Nothing asked for yet.
    pub(super) fn new(document: &'a Document, id: PluginId) -> Self {
        let plugin = &document[id];
        Self {
            document,
            plugin,
            is_used: vec![false; plugin.properties.len()],
            known: Vec::new(),
            kinds: Vec::new(),
        }
    }

    /// The plugin's type.
    pub(super) fn name(&self) -> &'a str {
        &self.plugin.name
    }

    /// Where the plugin starts.
    pub(super) fn location(&self) -> &'a Location {
        &self.plugin.location
    }

    /// `bsdf "diffuse"`, for messages.
    pub(super) fn title(&self) -> String {
        format!("{} \"{}\"", self.plugin.kind, self.plugin.name)
    }

    /// An error for a plugin type that is not among the `known`.
    pub(super) fn unknown_plugin(&self, known: &[&str]) -> SceneError {
        SceneError::unknown(self.location(), self.plugin.kind.as_str(), self.name(), known)
    }

    /// Takes note of a question and gives the property, if it is there.
    fn find(&mut self, name: &'static str) -> Option<&'a Property> {
        self.known.push(name);
        let index = self.plugin.properties.iter().position(|property| property.name == name)?;
        self.is_used[index] = true;
        Some(&self.plugin.properties[index])
    }

    fn typed<T>(
        &mut self,
        name: &'static str,
        expected: &str,
        convert: impl Fn(&'a Value) -> Option<T>,
    ) -> Result<Option<T>, SceneError> {
        let title = self.title();
        let Some(property) = self.find(name) else { return Ok(None) };
        match convert(&property.value) {
            Some(value) => Ok(Some(value)),
            None => {
                let what = format!("\"{name}\" of {title}");
                Err(SceneError::value(&property.location, what, property.value.kind(), expected))
            }
        }
    }

    /// A value that does not fit, at the place of the property that holds it.
    pub(super) fn wrong(
        &self,
        name: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> SceneError {
        let property = self.plugin.properties.iter().find(|property| property.name == name);
        let location = property.map_or(self.location(), |property| &property.location);
        SceneError::value(location, format!("\"{name}\" of {}", self.title()), found, expected)
    }

    /// The place of a property; of the plugin where it is not given.
    pub(super) fn location_of(&self, name: &str) -> &'a Location {
        let property = self.plugin.properties.iter().find(|property| property.name == name);
        property.map_or(self.location(), |property| &property.location)
    }

    /// Is the property given? Does not count as asking for it.
    pub(super) fn has(&self, name: &str) -> bool {
        self.plugin.properties.iter().any(|property| property.name == name)
    }

    /// Is the property given as a text? Does not count as asking for it.
    pub(super) fn is_string(&self, name: &str) -> bool {
        let property = self.plugin.properties.iter().find(|property| property.name == name);
        matches!(property, Some(Property { value: Value::String(_), .. }))
    }

    /// `true` or `false`.
    pub(super) fn boolean(
        &mut self,
        name: &'static str,
        default: bool,
    ) -> Result<bool, SceneError> {
        let value = self.typed(name, "a boolean", |value| match value {
            Value::Boolean(value) => Some(*value),
            _ => None,
        })?;
        Ok(value.unwrap_or(default))
    }

    /// A whole number, if given.
    pub(super) fn integer(&mut self, name: &'static str) -> Result<Option<i64>, SceneError> {
        self.typed(name, "an integer", |value| match value {
            Value::Integer(value) => Some(*value),
            _ => None,
        })
    }

    /// A number, if given; an integer will do.
    pub(super) fn float(&mut self, name: &'static str) -> Result<Option<f64>, SceneError> {
        self.typed(name, "a float", |value| match value {
            Value::Float(value) => Some(*value),
            Value::Integer(value) => Some(*value as f64),
            _ => None,
        })
    }

    /// A number with a default, which must lie where `is_allowed` says, described by `range`.
    pub(super) fn float_in(
        &mut self,
        name: &'static str,
        default: f64,
        range: &str,
        is_allowed: impl Fn(f64) -> bool,
    ) -> Result<f64, SceneError> {
        let value = self.float(name)?.unwrap_or(default);
        if is_allowed(value) { Ok(value) } else { Err(self.wrong(name, value.to_string(), range)) }
    }

    /// A text, if given.
    pub(super) fn string(&mut self, name: &'static str) -> Result<Option<&'a str>, SceneError> {
        self.typed(name, "a string", |value| match value {
            Value::String(value) => Some(value.as_str()),
            _ => None,
        })
    }

    /// One of a few words, or the first choice when nothing is given.
    pub(super) fn choice<T: Copy>(
        &mut self,
        name: &'static str,
        choices: &[(&'static str, T)],
    ) -> Result<T, SceneError> {
        let Some(found) = self.string(name)? else { return Ok(choices[0].1) };
        match choices.iter().find(|(word, _)| word.eq_ignore_ascii_case(found)) {
            Some((_, choice)) => Ok(*choice),
            None => {
                let known = choices.iter().map(|(word, _)| word);
                Err(SceneError::unknown(
                    self.location_of(name),
                    format!("{name} of {}", self.title()),
                    found,
                    known,
                ))
            }
        }
    }

    /// A point or vector, if given.
    pub(super) fn vector(&mut self, name: &'static str) -> Result<Option<DVec3>, SceneError> {
        self.typed(name, "a point or vector", |value| match value {
            Value::Vector(value) => Some(*value),
            _ => None,
        })
    }

    /// An invertible transform; the identity where none is given.
    pub(super) fn transform(&mut self, name: &'static str) -> Result<DMat4, SceneError> {
        let transform = self.typed(name, "a transform", |value| match value {
            Value::Transform(value) => Some(*value),
            _ => None,
        })?;
        let Some(transform) = transform else { return Ok(DMat4::IDENTITY) };
        if transform.is_finite()
            && transform.inverse().is_finite()
            && transform.determinant() != 0.0
        {
            Ok(transform)
        } else {
            Err(self.wrong(name, "not invertible", "a transform that loses no dimension"))
        }
    }

    /// What stands where a texture may stand, if anything.
    pub(super) fn texture(
        &mut self,
        name: &'static str,
    ) -> Result<Option<TextureValue>, SceneError> {
        let document = self.document;
        self.typed(name, "a texture, color or number", |value| match value {
            Value::Color(color) => Some(TextureValue::Color(*color)),
            Value::Float(number) => Some(TextureValue::Number(*number)),
            Value::Integer(number) => Some(TextureValue::Number(*number as f64)),
            Value::Plugin(id) if is_texture(&document[*id]) => Some(TextureValue::Plugin(*id)),
            _ => None,
        })
    }

    /// The nested plugins of a kind, whatever their names.
    pub(super) fn plugins(&mut self, kind: &'static str) -> Vec<PluginId> {
        self.kinds.push(kind);
        let mut found = Vec::new();
        for (property, is_used) in self.plugin.properties.iter().zip(&mut self.is_used) {
            if let Value::Plugin(id) = property.value
                && self.document[id].kind == kind
            {
                *is_used = true;
                found.push(id);
            }
        }
        found
    }

    /// The nested plugin of a kind, if there is one.
    ///
    /// # Errors
    /// [`SceneError::Duplicate`] when there are more.
    pub(super) fn plugin(&mut self, kind: &'static str) -> Result<Option<PluginId>, SceneError> {
        match self.plugins(kind)[..] {
            [] => Ok(None),
            [id] => Ok(Some(id)),
            [first, second, ..] => Err(SceneError::Duplicate {
                location: self.document[second].location.clone(),
                what: format!("the {kind} of {}", self.title()),
                previous: self.document[first].location.clone(),
            }),
        }
    }

    /// The file that the property `filename` names, and where it is named.
    pub(super) fn file(&mut self) -> Result<std::path::PathBuf, SceneError> {
        let title = self.title();
        let filename = self.string("filename")?;
        let filename = filename.ok_or_else(|| {
            SceneError::missing(self.location(), format!("\"filename\" of {title}"))
        })?;
        self.document.find_file(
            filename,
            &format!("\"filename\" of {title}"),
            self.location_of("filename"),
        )
    }

    /// Properties that change nothing in the picture, or nothing that this renderer does.
    pub(super) fn ignore(&mut self, names: &[&'static str]) {
        for name in names {
            self.find(name);
        }
    }

    /// # Errors
    /// [`SceneError::Unknown`] for a property or nested plugin that was never asked for.
    pub(super) fn finish(self) -> Result<(), SceneError> {
        let properties = self.plugin.properties.iter().zip(&self.is_used);
        let Some((property, _)) = properties.clone().find(|(_, is_used)| !**is_used) else {
            return Ok(());
        };
        let title = self.title();
        let (kind, found, known) = match property.value {
            Value::Plugin(id) if !is_texture(&self.document[id]) => {
                (format!("element inside {title}"), self.document[id].kind.as_str(), self.kinds)
            }
            Value::Plugin(id) if property.name.is_empty() => (
                format!("texture without a name inside {title}"),
                self.document[id].name.as_str(),
                self.known,
            ),
            _ => (format!("property of {title}"), property.name.as_str(), self.known),
        };
        Err(SceneError::unknown(&property.location, kind, found, known))
    }
}

/// Single precision, as everything downstream has it.
pub(super) fn rgb(color: DVec3) -> Rgb {
    Rgb::new(color.x as f32, color.y as f32, color.z as f32)
}

fn is_texture(plugin: &Plugin) -> bool {
    plugin.kind == "texture" || plugin.kind == "spectrum"
}
