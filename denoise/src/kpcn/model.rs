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
    /// About 1.5 s of CPU a megapixel.
    Fast,
    /// About 3 s.
    #[default]
    Balanced,
    /// The networks of [`Balanced`](Self::Balanced) in six orientations, hence six times as much.
    High,
}

impl Quality {
    /// All of them, the fastest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::High];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::High => "high",
        }
    }

    /// The tier of the weights in `models.json`.
    const fn tier(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced | Self::High => "balanced",
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

/// One of the weights that `models.json` lists.
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
    let models = json.as_object().ok_or_else(|| damaged("no object".into()))?;
    let entry = |(name, model): (&String, &serde_json::Value)| {
        let text = |key: &str| {
            let value = model[key].as_str();
            value.map(str::to_owned).ok_or_else(|| damaged(format!("{name} without {key}")))
        };
        Ok(Entry {
            name: name.clone(),
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
            .find(|entry| entry.tier == quality.tier() && entry.branch == branch.name())
            .ok_or_else(|| Error::Model {
                name: format!("{} {}", quality.tier(), branch.name()),
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
        Self::new(entry.name.clone(), Cow::Borrowed(bytes)).checked(entry)
    }

    /// This model, if it is the one of the entry.
    fn checked(self, entry: &Entry) -> Result<Self, Error> {
        if self.sha256 == entry.sha256 {
            return Ok(self);
        }
        let found = format!("the SHA-256 {}", self.sha256);
        Err(self.refused(found, &format!("{} as in models.json", entry.sha256)))
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

    pub(super) fn new(name: String, bytes: Cow<'static, [u8]>) -> Self {
        let sha256 = sha256(&bytes);
        Self { name, bytes, sha256 }
    }

    /// The error that says why this file is not used.
    pub(super) fn refused(&self, found: String, expected: &str) -> Error {
        Error::Model { name: self.name.clone(), found, expected: expected.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"kpcn-fast-diffuse": {"file": "kpcn-fast-diffuse.onnx", "tier": "fast", "branch": "diffuse",
        "sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad", "steps": 7}}"#;

    #[test]
    fn the_list_is_read_and_what_it_lists_is_whole() {
        let [entry] = &parse(GOOD).unwrap()[..] else { panic!("one entry") };
        assert_eq!((entry.name.as_str(), entry.tier.as_str()), ("kpcn-fast-diffuse", "fast"));
        for entry in entries().unwrap() {
            Model::of_entry(&entry).unwrap();
        }
    }

    #[test]
    fn a_damaged_list_says_what_is_wrong() {
        for (list, said) in [
            ("", "no JSON"),
            ("[]", "no object"),
            (&GOOD.replace("\"tier\"", "\"tire\""), "kpcn-fast-diffuse without tier"),
            (&GOOD.replace("\"ba78", "5, \"ba78"), "no JSON"),
        ] {
            let error = parse(list).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn a_file_with_another_hash_is_refused() {
        let [entry] = &parse(GOOD).unwrap()[..] else { panic!("one entry") };
        // The hash in the list is that of the letters abc.
        let model = |bytes: &'static [u8]| Model::new("m".into(), Cow::Borrowed(bytes));
        assert!(model(b"abc").checked(entry).is_ok());
        let error = model(b"abd").checked(entry).unwrap_err().to_string();
        assert!(error.contains("SHA-256") && error.contains("ba7816bf"), "{error}");
    }

    #[test]
    fn weights_that_are_not_there_are_named() {
        let entry = Entry { file: "kpcn-no.onnx".into(), ..parse(GOOD).unwrap()[0].clone() };
        let error = Model::of_entry(&entry).unwrap_err().to_string();
        assert!(error.contains("models/kpcn-no.onnx"), "{error}");
    }
}
