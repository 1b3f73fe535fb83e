//! All that a render under way needs to go on, in a file: checkpoints, and the parts of a picture that several machines
//! make.
//!
//! A file begins with a line that names it and its version. Then come the fields of [`State`] as `postcard` writes them, and
//! at last the SHA-256 of everything before it. Such files go from one run to the next of the same program, not
//! farther: [`Plan::program`] is part of what must agree.

use super::method::{Found, Report};
use super::plan::Plan;
use super::sampled::Samples;
use super::{Budget, RenderSettings, Rendered, SamplerKind, Shard};
use crate::scene::Scene;
use glam::DVec3;
use quietlight_denoise::{Layers, atomic, variance};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What a file begins with; the version changes with the fields.
const MAGIC: &[u8] = b"quietlight render under way, version 1\n";

/// Bytes of the checksum.
const CHECKSUM: usize = 32;

/// Why a state cannot be written, read or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// The operating system refused the file.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] quietlight_denoise::Error),
    /// The file is something else, of another version, or not whole.
    #[error(
        "{path}: found {found}, expected a render under way, written by this version of the program"
    )]
    Broken {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        found: &'static str,
    },
    /// It is of another picture.
    #[error("{what} is of another render: {differences}")]
    Differs {
        /// What is.
        what: String,
        /// What is different, and how.
        differences: String,
    },
    /// Parts of a picture that are not all there, or more than once, or not done.
    #[error("the parts of the picture do not fit together: {problem}")]
    Parts {
        /// What is wrong with them.
        problem: String,
    },
}

/// What a state is of, and how far it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// What it is of.
    pub plan: Plan,
    /// When it was to stop.
    pub budget: Budget,
    /// Which part of the samples or chains it has.
    pub shard: Shard,
    /// Has it all that the budget asks for?
    pub is_complete: bool,
    /// Wall time so far.
    pub elapsed: Duration,
    /// For the user of the library: what else should be known when the picture is made.
    pub notes: BTreeMap<String, String>,
}

/// What a render has found so far, with what it is a render of.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct State<'a> {
    /// What it is of. It comes first in a file, and can be read by itself.
    pub header: Header,
    pub(super) taken: Cow<'a, Samples>,
    pub(super) found: Option<Found<'a>>,
}

impl Header {
    /// Reads what a file begins with.
    ///
    /// # Errors
    /// [`StateError::Io`], [`StateError::Broken`].
    pub fn read(path: &Path) -> Result<Self, StateError> {
        let io = |source| StateError::Io { path: path.to_path_buf(), source };
        fields(path, open(path).map_err(io)?)
    }

    /// Is it of the picture that these settings make of the scene?
    ///
    /// # Errors
    /// [`StateError::Differs`] where it is of another scene, or of other settings that its numbers depend on.
    pub fn check(&self, scene: &Scene, settings: &RenderSettings) -> Result<(), StateError> {
        let wanted = Plan::of(scene, settings);
        let mut differences = self.plan.differences(&wanted);
        if self.shard != settings.shard {
            differences.push(format!("shard {} and not {}", self.shard, settings.shard));
        }
        // How far a budget of time goes is known to nobody before.
        let is_of_time =
            matches!((self.budget, settings.budget), (Budget::Time(_), Budget::Time(_)));
        if wanted.depends_on_budget && self.budget != settings.budget && !is_of_time {
            differences.push(format!("{} and not {}", self.budget, settings.budget));
        }
        if differences.is_empty() {
            return Ok(());
        }
        Err(StateError::Differs {
            what: "the checkpoint".into(),
            differences: differences.join("; "),
        })
    }
}

impl State<'_> {
    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// [`StateError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), StateError> {
        let fail = |source| quietlight_denoise::Error::Io { path: path.to_path_buf(), source };
        let written = atomic::write(path, |file| {
            let mut file = Summed { inner: file, sha256: Sha256::new(), failure: None };
            file.write_all(MAGIC).map_err(fail)?;
            if postcard::to_io(self, &mut file).is_err() {
                let failure = file.failure.take();
                return Err(fail(failure.unwrap_or_else(|| io::ErrorKind::InvalidData.into())));
            }
            let checksum = file.sha256.finalize();
            file.inner.write_all(&checksum).map_err(fail)
        });
        Ok(written?)
    }

    /// Samples or mutations per pixel so far.
    pub fn samples(&self) -> u32 {
        self.found.as_ref().map_or(self.taken.samples(), Found::samples)
    }

    /// The picture as it is so far.
    pub fn finish(self) -> Rendered {
        let origin = DVec3::from_array(self.header.plan.origin);
        let found = self.found.as_ref();
        Rendered {
            layers: layers(&self.taken, found, self.header.plan.sampler, origin),
            samples: self.samples(),
            invalid_samples: invalid(&self.taken, found),
            report: found.map_or_else(Report::default, Found::report),
            elapsed: self.header.elapsed,
        }
    }
}

impl State<'static> {
    /// Reads what [`State::write`] wrote.
    ///
    /// # Errors
    /// [`StateError::Io`], [`StateError::Broken`].
    pub fn read(path: &Path) -> Result<Self, StateError> {
        let io = |source| StateError::Io { path: path.to_path_buf(), source };
        let broken = |found| StateError::Broken { path: path.to_path_buf(), found };
        let mut file = open(path).map_err(io)?;
        check_sum(&mut file).map_err(io)?.map_err(broken)?;
        file.rewind().map_err(io)?;
        fields(path, file)
    }

    /// Reads all shards of a picture, in any order, and puts them together: bit by bit what one process would have made.
    ///
    /// # Errors
    /// As [`State::read`]; [`StateError::Differs`] where they are not of the same picture; [`StateError::Parts`] where one is
    /// missing, there twice, or not done.
    pub fn merged(paths: &[PathBuf]) -> Result<Self, StateError> {
        let mut parts = Vec::new();
        for path in paths {
            parts.push((path.as_path(), Header::read(path)?));
        }
        check_parts(&parts)?;
        parts.sort_by_key(|(_, header)| header.shard.index());
        let refuse = |problem: String| StateError::Parts { problem };
        let mut paths = parts.into_iter().map(|(path, _)| path);
        let first = paths.next().ok_or_else(|| refuse("there are none".to_owned()))?;
        let mut whole = Self::read(first)?;
        for path in paths {
            let part = Self::read(path)?;
            whole.taken.to_mut().merge(&part.taken);
            let is_same_method = match (&mut whole.found, &part.found) {
                (Some(found), Some(more)) => found.merge(more),
                (found, more) => found.is_none() && more.is_none(),
            };
            if !is_same_method {
                return Err(refuse(format!("{} is of another method", path.display())));
            }
            whole.header.elapsed += part.header.elapsed;
        }
        whole.header.shard = Shard::WHOLE;
        Ok(whole)
    }
}

fn open(path: &Path) -> io::Result<File> {
    let file = File::open(path)?;
    if file.metadata()?.is_dir() { Err(io::ErrorKind::IsADirectory.into()) } else { Ok(file) }
}

/// The fields that a file of ours begins with.
fn fields<T: for<'de> Deserialize<'de>>(path: &Path, file: File) -> Result<T, StateError> {
    let broken = |found| StateError::Broken { path: path.to_path_buf(), found };
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let mut magic = [0; MAGIC.len()];
    if reader.read_exact(&mut magic).is_err() || magic != MAGIC {
        return Err(broken("another kind or version of file"));
    }
    let mut words = vec![0; 1 << 16];
    let (fields, _) = postcard::from_io((reader, &mut words[..]))
        .map_err(|_| broken("fields that do not belong there"))?;
    Ok(fields)
}

/// Are these all shards of one picture, each once, and done?
fn check_parts(parts: &[(&Path, Header)]) -> Result<(), StateError> {
    let refuse = |problem: String| Err(StateError::Parts { problem });
    let Some((first_path, first)) = parts.first() else {
        return refuse("there are none".to_owned());
    };
    let count = first.shard.count();
    for (path, header) in parts {
        let mut differences = header.plan.differences(&first.plan);
        if header.budget != first.budget {
            differences.push(format!("{} and not {}", header.budget, first.budget));
        }
        if header.shard.count() != count {
            differences.push(format!("one of {} parts and not of {count}", header.shard.count()));
        }
        if !differences.is_empty() {
            let what = format!("{}, compared with {},", path.display(), first_path.display());
            return Err(StateError::Differs { what, differences: differences.join("; ") });
        }
        if !header.is_complete {
            return refuse(format!("{} is not done: --resume goes on with it", path.display()));
        }
    }
    for index in 0..count {
        let mut found = parts.iter().filter(|(_, header)| header.shard.index() == index);
        match (found.next(), found.next()) {
            (None, _) => return refuse(format!("part {index} of {count} is missing")),
            (Some((a, _)), Some((b, _))) => {
                let (a, b) = (a.display(), b.display());
                return refuse(format!("{a} and {b} are both part {index} of {count}"));
            }
            (Some(_), None) => {}
        }
    }
    Ok(())
}

/// All layers, with corrected variances; `origin` is what the scene was moved by.
pub(super) fn layers(
    taken: &Samples,
    found: Option<&Found<'_>>,
    sampler: SamplerKind,
    origin: DVec3,
) -> Layers {
    // The variance of independent samples is right, and of more degrees of freedom than that of the halves; that of
    // splats that depend on each other only the halves know.
    let correct = |mut layers: Layers, depends: bool| {
        for (kind, layer) in &mut layers.layers {
            if sampler == SamplerKind::Sobol
                || layer.variance.is_none()
                || (depends && kind.is_radiance())
            {
                variance::correct_variances(layer);
            }
        }
        layers
    };
    let mut layers = taken.layers(origin);
    match found {
        None => correct(layers, false),
        Some(Found::Spread(spread, rest)) => {
            spread.weigh(correct(layers, false), &correct(rest.layers(origin), false))
        }
        Some(found) => {
            found.put_radiance(&mut layers, origin);
            correct(layers, !found.is_independent())
        }
    }
}

/// Non-finite contributions dropped.
pub(super) fn invalid(taken: &Samples, found: Option<&Found<'_>>) -> u64 {
    taken.invalid() + found.map_or(0, Found::invalid)
}

/// What is written, with its checksum so far.
struct Summed<W> {
    inner: W,
    sha256: Sha256,
    /// Why it could not be written: `postcard` does not tell.
    failure: Option<io::Error>,
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes).inspect_err(|error| {
            let system = error.raw_os_error().map(io::Error::from_raw_os_error);
            self.failure = Some(system.unwrap_or_else(|| error.kind().into()));
        })?;
        self.sha256.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Is the file one of ours, and whole? Else what it is instead.
fn check_sum(file: &mut File) -> io::Result<Result<(), &'static str>> {
    let length = file.metadata()?.len();
    let Some(body) = length.checked_sub(CHECKSUM as u64).filter(|&b| b > MAGIC.len() as u64) else {
        return Ok(Err("a file too short to be one"));
    };
    let mut magic = [0; MAGIC.len()];
    file.read_exact(&mut magic)?;
    if magic != MAGIC {
        return Ok(Err("another kind or version of file"));
    }
    let mut sha256 = Sha256::new();
    sha256.update(magic);
    let mut left = body - MAGIC.len() as u64;
    let mut buffer = vec![0; 1 << 16];
    while left > 0 {
        let some = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        file.read_exact(&mut buffer[..some])?;
        sha256.update(&buffer[..some]);
        left -= some as u64;
    }
    let mut checksum = [0; CHECKSUM];
    file.read_exact(&mut checksum)?;
    let is_whole = checksum[..] == sha256.finalize()[..];
    Ok(if is_whole { Ok(()) } else { Err("a file that is damaged or cut off") })
}
