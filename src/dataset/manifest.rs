//! What a data set says of itself: `manifest.json` of the whole, `view.json` of each view with pictures, `skipped.json` of
//! each of which none could be made.

#[cfg(test)]
mod tests;

use crate::folder::{Error, at, read_json, write_json};
use quietlight_denoise::sha256::sha256;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// Version of the layout of folders and files. Readers refuse others.
pub const SCHEMA: u32 = 1;

/// What the files are of.
const SET: &str = "a data set";

/// What decides the pictures of a data set. Two runs with equal settings make equal views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// All randomness comes from it.
    pub seed: u64,
    /// Scene files that the views vary in turn; generated scenes where there are none.
    pub scenes: Vec<PathBuf>,
    /// Side of the square of pixels that is rendered of each view.
    pub crop: u32,
    /// Noisy renders of each view.
    pub noisy: u32,
    /// Fewest samples per pixel of a noisy render.
    pub min_spp: u32,
    /// Most samples per pixel of a noisy render.
    pub max_spp: u32,
    /// Most samples per pixel of a reference.
    pub reference_spp: u32,
    /// Noise at which a reference is converged, as an estimated relative L2.
    pub reference_noise: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            seed: 0,
            scenes: Vec::new(),
            crop: 128,
            noisy: 3,
            min_spp: 1,
            max_spp: 256,
            reference_spp: 2048,
            reference_noise: 1e-3,
        }
    }
}

impl Settings {
    /// The settings that are not the same, as "name: one, not other"; empty where all are.
    pub fn differences(&self, other: &Self) -> String {
        let fields = |settings| match serde_json::to_value(settings) {
            Ok(serde_json::Value::Object(fields)) => fields,
            _ => serde_json::Map::new(),
        };
        let (ours, theirs) = (fields(self), fields(other));
        let different = ours.iter().filter(|(name, value)| theirs.get(*name) != Some(*value));
        let said: Vec<String> = different
            .map(|(name, value)| {
                let other = theirs.get(name).cloned().unwrap_or_default();
                format!("{}: {value}, not {other}", name.replace('_', "-"))
            })
            .collect();
        said.join("; ")
    }
}

/// `manifest.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Version of the program that made the set.
    pub version: String,
    /// How many views the set is to have; it may grow.
    pub views: u32,
    /// What decides the pictures.
    pub settings: Settings,
}

impl Manifest {
    /// The manifest of a set that this program makes.
    pub fn new(settings: Settings, views: u32) -> Self {
        Self { schema: SCHEMA, version: env!("CARGO_PKG_VERSION").to_owned(), views, settings }
    }

    /// Where the manifest of a data set lies.
    pub fn path(folder: &Path) -> PathBuf {
        folder.join("manifest.json")
    }

    /// Reads the manifest of the data set in `folder`.
    ///
    /// # Errors
    /// [`Error::File`] where there is none, or it is none of this schema.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let path = Self::path(folder);
        let manifest: Self = read_json(&path, SET)?;
        if manifest.schema != SCHEMA {
            let found = format!("schema {}", manifest.schema);
            let expected = format!("schema {SCHEMA}");
            return Err(quietlight_denoise::Error::Format { path, found, expected }.into());
        }
        Ok(manifest)
    }

    /// Writes it into `folder`, whole or not at all.
    ///
    /// # Errors
    /// [`Error::File`] where the folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        write_json(&Self::path(folder), self)
    }
}

/// Where a view comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Source {
    /// The scene generator.
    Generated {
        /// The seed given to it.
        generated: u64,
    },
    /// A scene file, its camera, lights and materials varied.
    File {
        /// The file, as it was named.
        file: PathBuf,
        /// Seed of the variation.
        variation: u64,
    },
}

impl Source {
    /// What identifies the whole scene: all views of one scene belong to one split.
    pub fn scene_key(&self) -> String {
        match self {
            Self::Generated { generated } => format!("generated-{generated:016x}"),
            Self::File { file, .. } => file.display().to_string(),
        }
    }
}

/// What a view may be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// To learn from.
    Train,
    /// To judge by: scenes never learnt from.
    Validation,
}

impl Split {
    /// The split of all views of a scene, by the second digit of the SHA-256 of its key: one scene in sixteen validates.
    pub fn of(scene_key: &str) -> Self {
        let digest = sha256(scene_key.as_bytes());
        if digest.as_bytes()[1] == b'0' { Self::Validation } else { Self::Train }
    }
}

/// One render of a view.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NoisyFile {
    /// Name within the view's folder.
    pub file: String,
    /// Samples per pixel.
    pub spp: u32,
    /// Seed of the render.
    pub seed: u64,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// The converged render of a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceFile {
    /// Name within the view's folder.
    pub file: String,
    /// Samples per pixel.
    pub spp: u32,
    /// Seed of the render.
    pub seed: u64,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Estimated relative L2 of what noise is left.
    pub relative_l2_noise: f64,
    /// The same of the picture brightened to middle grey, if it is darker: what [`Settings::reference_noise`] bounds.
    pub exposed_relative_l2_noise: f64,
}

/// What is known of a view before anything is rendered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Name of the view's folder: its number, six digits.
    pub id: String,
    /// Where it comes from.
    pub source: Source,
    /// What identifies the whole scene.
    pub scene_key: String,
    /// What the scene may be used for.
    pub split: Split,
    /// How many views were tried: all but the last were nearly black, constant, or looked at nothing.
    pub attempts: u32,
}

/// `view.json`: a view with its pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Which view.
    #[serde(flatten)]
    pub identity: Identity,
    /// What the scene has in it, as the generator says.
    pub tags: Vec<String>,
    /// Width and height of the whole film.
    pub film: [u32; 2],
    /// First column and row, width and height of what was rendered.
    pub crop: [u32; 4],
    /// Noisy renders.
    pub noisy: Vec<NoisyFile>,
    /// The converged render.
    pub reference: ReferenceFile,
    /// Wall time of making the view, on one worker.
    pub seconds: f64,
}

/// `skipped.json`: a view of which no pictures could be made. To have it tried again, delete the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkippedView {
    /// Which view.
    #[serde(flatten)]
    pub identity: Identity,
    /// Why.
    pub reason: String,
    /// Wall time of the attempts.
    pub seconds: f64,
}

/// What became of a view.
#[derive(Clone, Debug, PartialEq)]
pub enum Record {
    /// It has pictures.
    Rendered(View),
    /// No pictures could be made.
    Skipped(SkippedView),
}

/// Name of the file that says that a view is complete.
const VIEW: &str = "view.json";

/// Name of the file that says that a view was given up.
const SKIPPED: &str = "skipped.json";

impl View {
    /// Folder of the view of that id in the data set in `folder`.
    pub fn folder(folder: &Path, id: &str) -> PathBuf {
        folder.join("views").join(id)
    }

    /// Name of the view with that number.
    pub fn id(number: u32) -> String {
        format!("{number:06}")
    }
}

impl Record {
    /// Which view.
    pub fn identity(&self) -> &Identity {
        match self {
            Self::Rendered(view) => &view.identity,
            Self::Skipped(view) => &view.identity,
        }
    }

    /// Reads what became of a view; `None` where nothing has yet.
    ///
    /// # Errors
    /// [`Error::File`] where the file is there and cannot be read.
    pub fn read(folder: &Path, id: &str) -> Result<Option<Self>, Error> {
        let folder = View::folder(folder, id);
        let (view, skipped) = (folder.join(VIEW), folder.join(SKIPPED));
        if view.exists() {
            Ok(Some(Self::Rendered(read_json(&view, SET)?)))
        } else if skipped.exists() {
            Ok(Some(Self::Skipped(read_json(&skipped, SET)?)))
        } else {
            Ok(None)
        }
    }

    /// Writes it into the folder of its view, whole or not at all: from then on the view is done.
    ///
    /// # Errors
    /// [`Error::File`] where that folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        let folder = View::folder(folder, &self.identity().id);
        match self {
            Self::Rendered(view) => write_json(&folder.join(VIEW), view),
            Self::Skipped(view) => write_json(&folder.join(SKIPPED), view),
        }
    }
}

/// What became of the views of the data set in `folder`, by their ids; those not done are left out.
///
/// # Errors
/// [`Error::File`] where a folder or a file cannot be read.
pub fn records(folder: &Path) -> Result<Vec<Record>, Error> {
    let path = folder.join("views");
    let mut ids = Vec::new();
    for entry in fs::read_dir(&path).map_err(at(&path))? {
        ids.push(entry.map_err(at(&path))?.file_name().to_string_lossy().into_owned());
    }
    ids.sort_unstable();
    let mut records = Vec::new();
    for id in ids {
        records.extend(Record::read(folder, &id)?);
    }
    Ok(records)
}

/// The views with pictures of the data set in `folder`, by their ids.
///
/// # Errors
/// As [`records`].
pub fn views(folder: &Path) -> Result<Vec<View>, Error> {
    let records = records(folder)?.into_iter();
    Ok(records
        .filter_map(|record| match record {
            Record::Rendered(view) => Some(view),
            Record::Skipped(_) => None,
        })
        .collect())
}
