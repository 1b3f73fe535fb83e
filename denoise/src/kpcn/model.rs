//! Files of weights: those in the executable, listed in `models/models.json`, and a user's own.

use std::borrow::Cow;
use std::path::Path;

use super::embedded;
use super::network::Branch;
use crate::error::Error;
use crate::sha256::sha256;

/// The list of the weights that are embedded.
const LIST: &str = include_str!("../../../models/models.json");

/// What a user trades: each next one is slower and more exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// At most a second of CPU a megapixel.
    Fast,
    /// At most three.
    #[default]
    Balanced,
    /// At most twenty.
    High,
}

impl Quality {
    /// All of them, the fastest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::High];

    /// Its name, that of the tier of the weights.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::High => "high",
        }
    }
}

/// A file of weights, not yet loaded.
#[derive(Clone, Debug)]
pub struct Model {
    /// What messages call it.
    pub name: String,
    /// The file.
    pub(super) bytes: Cow<'static, [u8]>,
    /// Its SHA-256 in hexadecimal digits.
    pub sha256: String,
}

/// A line of `models.json`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Name of the model.
    pub name: String,
    /// Name of its file in `models`.
    pub file: String,
    /// SHA-256 of the file in hexadecimal digits.
    pub sha256: String,
    /// The quality that it is for.
    pub tier: String,
    /// The light that it is for.
    pub branch: String,
}

/// What `models.json` lists.
///
/// # Errors
/// [`Error::Model`] where the list is not one.
pub fn entries() -> Result<Vec<Entry>, Error> {
    parse(LIST)
}

fn parse(list: &str) -> Result<Vec<Entry>, Error> {
    let damaged = |found: String| Error::Model {
        name: "models.json".into(),
        found,
        expected: "{\"models\": [{\"name\", \"file\", \"sha256\", \"tier\", \"branch\"}, ...]}"
            .into(),
    };
    let json: serde_json::Value =
        serde_json::from_str(list).map_err(|error| damaged(format!("no JSON ({error})")))?;
    let models = json["models"].as_array().ok_or_else(|| damaged("no list of models".into()))?;
    let entry = |model: &serde_json::Value| {
        let text = |key: &str| {
            let value = model[key].as_str();
            value.map(str::to_owned).ok_or_else(|| damaged(format!("{model} without {key}")))
        };
        Ok(Entry {
            name: text("name")?,
            file: text("file")?,
            sha256: text("sha256")?,
            tier: text("tier")?,
            branch: text("branch")?,
        })
    };
    models.iter().map(entry).collect()
}

impl Model {
    /// The embedded weights of a quality and a branch.
    ///
    /// # Errors
    /// [`Error::Model`] where there are none, or where they are not those that the list names.
    pub fn embedded(quality: Quality, branch: Branch) -> Result<Self, Error> {
        let entries = entries()?;
        let entry = entries
            .iter()
            .find(|entry| entry.tier == quality.name() && entry.branch == branch.name())
            .ok_or_else(|| Error::Model {
                name: format!("{} {}", quality.name(), branch.name()),
                found: "no weights of that name in this program".into(),
                expected: "an entry in models/models.json when it was built".into(),
            })?;
        Self::of_entry(entry)
    }

    /// The embedded weights of an entry of the list.
    ///
    /// # Errors
    /// [`Error::Model`] where they are missing or are not those that the list names.
    pub fn of_entry(entry: &Entry) -> Result<Self, Error> {
        let bytes = embedded::MODELS.iter().find(|(file, _)| *file == entry.file);
        let bytes = bytes.map(|(_, bytes)| *bytes).ok_or_else(|| Error::Model {
            name: entry.name.clone(),
            found: "no such file in this program".into(),
            expected: format!("models/{} when it was built", entry.file),
        })?;
        let model = Self::new(entry.name.clone(), Cow::Borrowed(bytes));
        if model.sha256 == entry.sha256 {
            return Ok(model);
        }
        let found = format!("the SHA-256 {}", model.sha256);
        Err(model.refused(found, &format!("{} as in models.json", entry.sha256)))
    }

    /// A user's own file.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let bytes =
            std::fs::read(path).map_err(|source| Error::Io { path: path.into(), source })?;
        Ok(Self::new(path.display().to_string(), Cow::Owned(bytes)))
    }

    fn new(name: String, bytes: Cow<'static, [u8]>) -> Self {
        let sha256 = sha256(&bytes);
        Self { name, bytes, sha256 }
    }

    /// The error that says why this file is not used.
    pub(super) fn refused(&self, found: String, expected: &str) -> Error {
        Error::Model { name: self.name.clone(), found, expected: expected.into() }
    }
}
