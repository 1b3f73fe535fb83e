//! One XML element: its place, its attributes with parameters substituted, and the value it may be.

use super::document::Value;
use super::parameters::Parameters;
use super::source::Source;
use super::transform::{Step, vector};
use super::value::Encoding;
use super::{upgrade, value};
use crate::scene::error::{Location, SceneError};
use glam::DMat4;
use roxmltree::Node;

/// An element whose attributes were read; its children were not.
pub(super) struct Element<'a> {
    /// Its name; old ones are replaced.
    pub(super) name: &'a str,
    /// Where it starts.
    pub(super) location: Location,
    pub(super) node: Node<'a, 'a>,
    source: &'a Source,
    attributes: Vec<(&'a str, String)>,
}

impl<'a> Element<'a> {
    /// # Errors
    /// An attribute asks for a parameter that is not defined.
    pub(super) fn new(
        node: Node<'a, 'a>,
        source: &'a Source,
        parameters: &mut Parameters,
    ) -> Result<Self, SceneError> {
        let location = source.location(node);
        let attributes = node.attributes().map(|attribute| {
            Ok((attribute.name(), parameters.substitute(attribute.value(), &location)?))
        });
        let attributes = attributes.collect::<Result<_, SceneError>>()?;
        Ok(Self {
            name: upgrade::element(node.tag_name().name()),
            location,
            node,
            source,
            attributes,
        })
    }

    /// Is the attribute there?
    pub(super) fn has(&self, name: &str) -> bool {
        self.get(name).is_some()
    }

    /// An attribute, if it is there.
    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| *known == name).map(|(_, value)| value.as_str())
    }

    /// An attribute that has to be there.
    pub(super) fn need(&self, name: &str) -> Result<&str, SceneError> {
        let what = || format!("attribute \"{name}\" of <{}>", self.name);
        self.get(name).ok_or_else(|| SceneError::missing(&self.location, what()))
    }

    /// The attribute `name` in snake case; empty when it is not there.
    pub(super) fn property_name(&self) -> String {
        upgrade::snake_case(self.get("name").unwrap_or_default())
    }

    /// Are the needed attributes there, and none that mean nothing?
    pub(super) fn check(&self, needed: &[&str], optional: &[&str]) -> Result<(), SceneError> {
        for name in needed {
            self.need(name)?;
        }
        let is_known = |name: &str| needed.contains(&name) || optional.contains(&name);
        match self.attributes.iter().find(|(name, _)| !is_known(name)) {
            None => Ok(()),
            Some((name, _)) => {
                let known = needed.iter().chain(optional);
                let kind = format!("attribute of <{}>", self.name);
                Err(SceneError::unknown(&self.location, kind, *name, known))
            }
        }
    }

    /// Is there nothing inside?
    pub(super) fn check_empty(&self) -> Result<(), SceneError> {
        match self.node.children().find(Node::is_element) {
            None => Ok(()),
            Some(child) => {
                let kind = format!("element inside <{}>", self.name);
                let location = self.source.location(child);
                Err(SceneError::unknown(&location, kind, child.tag_name().name(), [""; 0]))
            }
        }
    }

    /// The value that this element is.
    ///
    /// # Errors
    /// Attributes that are missing or mean nothing, or text that is no such value.
    pub(super) fn value(&self, parameters: &mut Parameters) -> Result<Value, SceneError> {
        if self.name == "transform" {
            self.check(&["name"], &[])?;
            return self.transform(parameters).map(Value::Transform);
        }
        self.check_empty()?;
        let location = &self.location;
        match self.name {
            "point" | "vector" => {
                self.check(&["name"], &["x", "y", "z", "value"])?;
                return vector(&|name| self.get(name), 0.0, location).map(Value::Vector);
            }
            "rgb" | "srgb" => self.check(&["name", "value"], &["intent"])?,
            "spectrum" => self.check(&["name"], &["value", "intent", "filename"])?,
            _ => self.check(&["name", "value"], &[])?,
        }
        let what = format!("{} \"{}\"", self.name, self.need("name")?);
        if self.name == "spectrum"
            && let Some(curve) =
                self.get("filename").or(self.get("value").filter(|text| text.contains(':')))
        {
            let expected = "a uniform value or an <rgb>: wavelengths are not modelled";
            return Err(SceneError::value(location, what, format!("\"{curve}\""), expected));
        }
        let text = self.need("value")?;
        match self.name {
            "boolean" => value::boolean(text, &what, location).map(Value::Boolean),
            "integer" => value::integer(text, &what, location).map(Value::Integer),
            "float" => value::number(text, &what, location).map(Value::Float),
            "string" => Ok(Value::String(text.to_owned())),
            "srgb" => value::color(text, Encoding::Srgb, &what, location).map(Value::Color),
            _ => value::color(text, Encoding::Linear, &what, location).map(Value::Color),
        }
    }

    /// Steps in the order of the file: each is applied after those before it.
    fn transform(&self, parameters: &mut Parameters) -> Result<DMat4, SceneError> {
        let mut transform = DMat4::IDENTITY;
        for child in self.node.children().filter(Node::is_element) {
            let child = Element::new(child, self.source, parameters)?;
            let step = Step::from_element(child.name).ok_or_else(|| {
                let known = ["translate", "rotate", "scale", "lookat", "matrix"];
                SceneError::unknown(&child.location, "step of a transform", child.name, known)
            })?;
            let (needed, optional) = step.attributes();
            child.check(needed, optional)?;
            child.check_empty()?;
            transform = step.matrix(|name| child.get(name), &child.location)? * transform;
        }
        Ok(transform)
    }
}
