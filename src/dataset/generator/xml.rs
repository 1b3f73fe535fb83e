//! Scene files as trees of elements.

use glam::{DMat4, DVec3};
use std::fmt::Write;

/// An element with its attributes and children, in order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Element {
    tag: &'static str,
    attributes: Vec<(&'static str, String)>,
    children: Vec<Self>,
}

impl Element {
    /// `<tag/>`
    pub(super) fn new(tag: &'static str) -> Self {
        Self { tag, attributes: Vec::new(), children: Vec::new() }
    }

    /// `<kind type="name"/>`
    pub(super) fn plugin(kind: &'static str, name: &str) -> Self {
        Self::new(kind).attribute("type", name)
    }

    /// With one attribute more.
    pub(super) fn attribute(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.attributes.push((name, value.into()));
        self
    }

    /// With one child more.
    pub(super) fn child(mut self, child: Self) -> Self {
        self.children.push(child);
        self
    }

    /// With a property: `<tag name="…" value="…"/>`.
    pub(super) fn value(self, tag: &'static str, name: &str, value: impl Into<String>) -> Self {
        self.child(Self::new(tag).attribute("name", name).attribute("value", value))
    }

    /// With a number.
    pub(super) fn float(self, name: &str, value: f64) -> Self {
        self.value("float", name, number(value))
    }

    /// With an integer.
    pub(super) fn integer(self, name: &str, value: u32) -> Self {
        self.value("integer", name, value.to_string())
    }

    /// With a text.
    pub(super) fn string(self, name: &str, value: &str) -> Self {
        self.value("string", name, value)
    }

    /// With a flag.
    pub(super) fn boolean(self, name: &str, value: bool) -> Self {
        self.value("boolean", name, value.to_string())
    }

    /// With a linear colour.
    pub(super) fn rgb(self, name: &str, value: DVec3) -> Self {
        self.value("rgb", name, triple(value))
    }

    /// With a point.
    pub(super) fn point(self, name: &str, value: DVec3) -> Self {
        self.value("point", name, triple(value))
    }

    /// With a `<transform>` of one matrix.
    pub(super) fn matrix(self, name: &str, matrix: &DMat4) -> Self {
        let rows = matrix.transpose().to_cols_array().map(number).join(" ");
        let step = Self::new("matrix").attribute("value", rows);
        self.child(Self::new("transform").attribute("name", name).child(step))
    }

    /// Named, for a property that holds a plugin.
    pub(super) fn named(self, name: &str) -> Self {
        self.attribute("name", name)
    }

    /// As text, a line an element.
    pub(super) fn text(&self) -> String {
        let mut text = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n".to_owned();
        self.append(&mut text, 0);
        text
    }

    fn append(&self, text: &mut String, depth: usize) {
        let indent = "\t".repeat(depth);
        let attributes: String =
            self.attributes.iter().map(|(name, value)| format!(" {name}=\"{value}\"")).collect();
        let tag = self.tag;
        let written = if self.children.is_empty() {
            writeln!(text, "{indent}<{tag}{attributes}/>")
        } else {
            writeln!(text, "{indent}<{tag}{attributes}>")
        };
        written.expect("a string takes what is written to it");
        if !self.children.is_empty() {
            self.children.iter().for_each(|child| child.append(text, depth + 1));
            writeln!(text, "{indent}</{tag}>").expect("a string takes what is written to it");
        }
    }
}

/// A number with seven significant digits: more than a pixel of a scene needs, and as short as it can be.
pub(super) fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.6e}").parse().expect("a number that was just written");
    // Adding zero makes a zero of either sign a positive one.
    format!("{}", rounded + 0.0)
}

/// Three numbers.
pub(super) fn triple(value: DVec3) -> String {
    value.to_array().map(number).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_nest_and_numbers_are_short() {
        let shape = Element::plugin("shape", "sphere").float("radius", 0.1 + 0.2);
        let expected = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<shape type=\"sphere\">\n\t<float name=\"radius\" value=\"0.3\"/>\n</shape>\n";
        assert_eq!(shape.text(), expected);
        assert_eq!(number(-0.0), "0");
        assert_eq!(number(1.234_567_89e-5), "0.00001234568");
    }
}
