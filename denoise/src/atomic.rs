//! Files that are whole or not there at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::error::Error;

/// Writes the file `path` by `write`: into a temporary name in the same folder, renamed when all is on disk.
///
/// On any error the old file, if there was one, is untouched and nothing half written is left; on Linux not even where the
/// process is killed in the middle, for the file has no name until it is whole.
///
/// # Errors
/// Those of `write`; [`Error::Io`] where the folder cannot be written; [`Error::Format`] where `path` exists and is
/// no regular file (a rename would replace a device or a folder).
pub fn write(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), Error>,
) -> Result<(), Error> {
    let io = |source| Error::Io { path: path.to_path_buf(), source };
    // A link is followed, so that the file it names is replaced and not the link.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    if target.exists() && !target.is_file() {
        return Err(Error::Format {
            path: path.to_path_buf(),
            found: "something that is no regular file".into(),
            expected: "a file name to write to".into(),
        });
    }
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };

    let mut builder = tempfile::Builder::new();
    builder.prefix(".quietlight-").suffix(".part");
    #[cfg(target_os = "linux")]
    if let Some(file) = unnamed(folder) {
        let mut buffer = BufWriter::new(&file);
        write(&mut buffer)?;
        buffer.flush().map_err(io)?;
        drop(buffer);
        file.sync_all().map_err(io)?;
        return publish(&file, &target, &builder).map_err(io);
    }
    #[cfg(unix)]
    {
        // Temporary files are private by default; the finished one has the permissions of any new file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.tempfile_in(folder).map_err(io)?;
    let mut buffer = BufWriter::new(temporary.as_file());
    write(&mut buffer)?;
    buffer.flush().map_err(io)?;
    drop(buffer);
    temporary.as_file().sync_all().map_err(io)?;
    temporary.persist(&target).map_err(|error| io(error.error))?;
    Ok(())
}

/// A file without a name; `None` where the file system has none such.
#[cfg(target_os = "linux")]
fn unnamed(folder: &Path) -> Option<File> {
    use rustix::fs::{Mode, OFlags, open};

    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    open(folder, flags, Mode::from_raw_mode(0o666)).ok().map(File::from)
}

/// Gives a file its name, in place of the one that had it. Only a rename can replace a file, so that it has a name of its own
/// for a moment.
#[cfg(target_os = "linux")]
fn publish(file: &File, target: &Path, builder: &tempfile::Builder<'_, '_>) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;

    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let origin = format!("/proc/self/fd/{}", file.as_raw_fd());
    let named = builder
        .make_in(folder, |path| Ok(linkat(CWD, &origin, CWD, path, AtFlags::SYMLINK_FOLLOW)?))?;
    named.persist(target).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        fs::write(&path, "old").unwrap();
        let failed = write(&path, |file| {
            file.write_all(b"half of the new").unwrap();
            Err(Error::MissingLayer { missing: "beauty".into(), found: "none".into() })
        });
        assert!(failed.is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["picture"]);
    }

    #[test]
    fn a_written_file_replaces_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        for text in ["old", "new"] {
            write(&path, |file| {
                file.write_all(text.as_bytes())
                    .map_err(|source| Error::Io { path: path.clone(), source })
            })
            .unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names(folder.path()), ["picture"]);
    }

    #[test]
    fn a_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(write(folder.path(), |_| Ok(())), Err(Error::Format { .. })));
        let absent = folder.path().join("absent").join("picture");
        assert!(matches!(write(&absent, |_| Ok(())), Err(Error::Io { .. })));
    }
}
