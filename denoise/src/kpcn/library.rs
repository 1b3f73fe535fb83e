//! Where onnxruntime comes from when the program runs.
//!
//! In this order: the file that the environment variable `ORT_DYLIB_PATH` names, which is then the only one tried; a file
//! beside the executable; the one that the build put into the executable; the system's.

use std::fmt;
use std::path::{Path, PathBuf};

use super::embedded;

/// Environment variable with the path of an onnxruntime library, the same that the crate `ort` knows.
pub const PATH_VARIABLE: &str = "ORT_DYLIB_PATH";

/// What onnxruntime is called as a shared library.
const FILE_NAME: &str = if cfg!(target_os = "windows") {
    "onnxruntime.dll"
} else if cfg!(target_os = "macos") {
    "libonnxruntime.dylib"
} else {
    "libonnxruntime.so"
};

/// Where a library was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Named by [`PATH_VARIABLE`].
    Environment(PathBuf),
    /// Beside the executable.
    BesideExecutable(PathBuf),
    /// Inside the executable.
    Embedded,
    /// Wherever the system looks for libraries.
    System,
}

impl fmt::Display for Origin {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Environment(path) => write!(formatter, "{PATH_VARIABLE}={}", path.display()),
            Self::BesideExecutable(path) => path.display().fmt(formatter),
            Self::Embedded => "embedded in the executable".fmt(formatter),
            Self::System => write!(formatter, "the system's {FILE_NAME}"),
        }
    }
}

/// The places to try, in order.
pub(super) fn origins() -> Vec<Origin> {
    if let Some(path) = std::env::var_os(PATH_VARIABLE).filter(|path| !path.is_empty()) {
        return vec![Origin::Environment(path.into())];
    }
    let beside = std::env::current_exe().ok().map(|path| path.with_file_name(FILE_NAME));
    let beside = beside.filter(|path| path.is_file()).map(Origin::BesideExecutable);
    let embedded = embedded::ONNXRUNTIME.map(|_| Origin::Embedded);
    beside.into_iter().chain(embedded).chain([Origin::System]).collect()
}

impl Origin {
    /// Calls `load` with a path under which the system's loader finds the library. The path of an embedded one is good
    /// during the call only.
    ///
    /// # Errors
    /// Those of `load`, and the reason where the embedded library cannot be laid out for the loader.
    pub(super) fn with_path<T>(
        &self,
        load: impl FnOnce(&Path) -> Result<T, String>,
    ) -> Result<T, String> {
        match self {
            Self::Environment(path) | Self::BesideExecutable(path) => load(path),
            Self::System => load(Path::new(FILE_NAME)),
            Self::Embedded => {
                let bytes = embedded::ONNXRUNTIME.ok_or("nothing is embedded")?;
                with_file_of(bytes, load)
            }
        }
    }
}

/// Calls `load` with the path of a file in memory that holds `bytes`: the loader maps it, no folder need be writable, and
/// nothing is left behind.
#[cfg(target_os = "linux")]
fn with_file_of<T>(
    bytes: &[u8],
    load: impl FnOnce(&Path) -> Result<T, String>,
) -> Result<T, String> {
    use std::io::Write;
    use std::os::fd::AsRawFd;

    use rustix::fs::MemfdFlags;

    let file = rustix::fs::memfd_create("onnxruntime", MemfdFlags::CLOEXEC)
        .map_err(|error| format!("no file in memory: {error}"))?;
    let mut file = std::fs::File::from(file);
    file.write_all(bytes).map_err(|error| format!("no file in memory: {error}"))?;
    load(Path::new(&format!("/proc/self/fd/{}", file.as_raw_fd())))
}

/// As on Linux, with a temporary file.
#[cfg(not(target_os = "linux"))]
fn with_file_of<T>(
    bytes: &[u8],
    load: impl FnOnce(&Path) -> Result<T, String>,
) -> Result<T, String> {
    use std::io::Write;

    let written = tempfile::NamedTempFile::new().and_then(|mut file| {
        file.write_all(bytes)?;
        Ok(file)
    });
    load(written.map_err(|error| format!("no temporary file: {error}"))?.path())
}
