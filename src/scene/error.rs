//! What can be wrong with a scene, said so that its author can mend it.

use super::material::NestingError;
use super::mesh_file::MeshError;
use super::mtl::MaterialError;
use std::error::Error;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A place in a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// The file, as it was opened.
    pub file: Arc<Path>,
    /// Counted from 1.
    pub line: u32,
    /// In characters, counted from 1.
    pub column: u32,
}

impl fmt::Display for Location {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}:{}", self.file.display(), self.line, self.column)
    }
}

/// Why a scene cannot be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The path given leads to no scene.
    #[error("{}: {problem}", path.display())]
    NoScene {
        /// What was to be loaded.
        path: PathBuf,
        /// What is expected instead.
        problem: String,
    },
    /// A file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not well-formed XML, or uses a document type definition.
    #[error("{location}: not well-formed XML: {message}")]
    Xml {
        /// Where the reader stopped.
        location: Location,
        /// What it says.
        message: String,
    },
    /// A mesh file, or a material library, that is itself the scene cannot be loaded.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A material of such a library cannot be made.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// A name that means nothing here: an element, a plugin, a property, a reference, a `$parameter`.
    #[error(
        "{location}: unknown {kind} \"{found}\"{}; known: {}",
        suggestion(found, known),
        list(known)
    )]
    Unknown {
        /// Where it stands.
        location: Location,
        /// What the name was taken for.
        kind: String,
        /// The name met.
        found: String,
        /// The names that would do.
        known: Vec<String>,
    },
    /// A value that does not fit.
    #[error("{location}: {what} is {found}, expected {expected}")]
    Value {
        /// Where it stands.
        location: Location,
        /// What it is a value of.
        what: String,
        /// The value met.
        found: String,
        /// What would do.
        expected: String,
    },
    /// Something that has to be there is not.
    #[error("{location}: {what} is missing")]
    Missing {
        /// Where it should be.
        location: Location,
        /// What.
        what: String,
    },
    /// Materials nested in a way that has no meaning here.
    #[error("{location}: {source}")]
    Nesting {
        /// Where the outer one starts.
        location: Location,
        /// Why.
        source: NestingError,
    },
    /// One thing said twice.
    #[error("{location}: {what} was already given at {previous}")]
    Duplicate {
        /// The second time.
        location: Location,
        /// What.
        what: String,
        /// The first time.
        previous: Location,
    },
    /// Something that contains itself.
    #[error("{location}: {what} contains itself: {chain}")]
    Cycle {
        /// Where the circle closes.
        location: Location,
        /// An included file, or a plugin.
        what: String,
        /// The way round.
        chain: String,
    },
    /// More than a scene file may have, to keep hostile files from filling the memory.
    #[error("{location}: {what}, the limit is {limit}")]
    Limit {
        /// Where it was passed.
        location: Location,
        /// What there is too much of.
        what: String,
        /// How much there may be.
        limit: u64,
    },
    /// A definition from outside (`-D name=value`) that no `$name` asks for.
    #[error(
        "definition {name}: the scene does not use ${name}{}; it uses: {}",
        suggestion(name, known),
        list(known)
    )]
    UnusedDefinition {
        /// The name defined.
        name: String,
        /// The parameters that the scene uses.
        known: Vec<String>,
    },
    /// A mesh or picture that the scene names cannot be loaded.
    #[error("{location}: cannot be loaded")]
    Asset {
        /// Where the scene names it.
        location: Location,
        /// What is wrong with it.
        source: Box<dyn Error + Send + Sync>,
    },
}

impl SceneError {
    /// [`SceneError::Value`] without the ceremony.
    pub(crate) fn value(
        location: &Location,
        what: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Value {
            location: location.clone(),
            what: what.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// [`SceneError::Unknown`] without the ceremony.
    pub(crate) fn unknown<K: ToString>(
        location: &Location,
        kind: impl Into<String>,
        found: impl Into<String>,
        known: impl IntoIterator<Item = K>,
    ) -> Self {
        let mut known: Vec<String> = known.into_iter().map(|name| name.to_string()).collect();
        known.sort_unstable();
        known.dedup();
        Self::Unknown { location: location.clone(), kind: kind.into(), found: found.into(), known }
    }

    /// [`SceneError::Missing`] without the ceremony.
    pub(crate) fn missing(location: &Location, what: impl Into<String>) -> Self {
        Self::Missing { location: location.clone(), what: what.into() }
    }

    /// [`SceneError::Asset`] without the ceremony.
    pub(crate) fn asset(location: &Location, source: impl Error + Send + Sync + 'static) -> Self {
        Self::Asset { location: location.clone(), source: Box::new(source) }
    }
}

/// Names with commas; "none" when there are none; at most 40, the rest counted.
fn list(names: &[String]) -> String {
    const MOST: usize = 40;
    match names.len() {
        0 => "none".to_owned(),
        count if count > MOST => format!("{} and {} more", names[..MOST].join(", "), count - MOST),
        _ => names.join(", "),
    }
}

/// " (did you mean …?)" when a known name is near to what was met: at most a third of its letters changed.
fn suggestion(found: &str, known: &[String]) -> String {
    let nearest = known.iter().map(|name| (edit_distance(found, name), name)).min();
    match nearest {
        Some((distance, name)) if distance * 3 <= found.chars().count().max(3) => {
            format!(" (did you mean \"{name}\"?)")
        }
        _ => String::new(),
    }
}

/// The least number of letters to insert, remove or replace that makes one word of the other (Levenshtein 1966).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edit_distance_counts_letters() {
        for (a, b, distance) in [
            ("", "", 0),
            ("", "abc", 3),
            ("kitten", "sitting", 3),
            ("alpha", "alpah", 2),
            ("x", "x", 0),
        ] {
            assert_eq!(edit_distance(a, b), distance, "{a} {b}");
            assert_eq!(edit_distance(b, a), distance, "{b} {a}");
        }
    }

    #[test]
    fn an_unknown_name_is_told_with_place_and_remedy() {
        let location = Location { file: Path::new("a/scene.xml").into(), line: 3, column: 7 };
        let error = SceneError::unknown(&location, "bsdf", "difuse", ["plastic", "diffuse"]);
        assert_eq!(
            error.to_string(),
            "a/scene.xml:3:7: unknown bsdf \"difuse\" (did you mean \"diffuse\"?); known: diffuse, plastic"
        );
        let error = SceneError::unknown(&location, "bsdf", "phong", ["plastic", "diffuse"]);
        assert!(!error.to_string().contains("did you mean"), "{error}");
    }
}
