//! How much disk a data set takes, and how much there is.

use super::manifest::{Settings, View};
use std::path::Path;

/// Channels of a noisy file: the picture, 23 numbers in four images each (mean, variance, two halves), two counts.
const NOISY_CHANNELS: u64 = 3 + 4 * 23 + 2;

/// Channels of a reference: the same without halves.
const REFERENCE_CHANNELS: u64 = 3 + 2 * 23 + 2;

/// Part of the size that compression leaves of noisy layers, at most; measured over generated scenes.
const COMPRESSION: f64 = 0.5;

/// Bytes that a view takes, as the settings let expect.
pub(super) fn expected_view(settings: &Settings) -> u64 {
    let pixels = u64::from(settings.crop).pow(2);
    let channels = u64::from(settings.noisy) * NOISY_CHANNELS + REFERENCE_CHANNELS;
    (COMPRESSION * (channels * pixels * size_of::<f32>() as u64) as f64) as u64
}

/// Bytes that the files of a complete view take.
pub(super) fn view(folder: &Path, id: &str) -> u64 {
    let Ok(files) = View::folder(folder, id).read_dir() else { return 0 };
    files.filter_map(|file| Some(file.ok()?.metadata().ok()?.len())).sum()
}

/// Bytes free on the disk of an existing folder; `None` where the system does not say.
pub(super) fn free(folder: &Path) -> Option<u64> {
    #[cfg(unix)]
    {
        let disk = rustix::fs::statvfs(folder).ok()?;
        Some(disk.f_bavail * disk.f_frsize)
    }
    #[cfg(not(unix))]
    {
        let _ = folder;
        None
    }
}
