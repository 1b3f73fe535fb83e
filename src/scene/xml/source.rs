//! XML text of limited size, and the places in it.

use crate::scene::error::{Location, SceneError};
use roxmltree::Node;
use std::cell::Cell;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

/// Largest XML file read, in bytes. Scenes with ten thousand shapes have a few megabytes.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// A file being read.
pub(super) struct Source {
    path: Arc<Path>,
    pub(super) text: String,
    /// Where each line begins.
    lines: Vec<usize>,
    /// An offset and its column, found last: elements are asked for in the order of the text, and counting on from there
    /// keeps the whole linear even when all of the text is one line.
    last: Cell<(usize, usize)>,
}

impl Source {
    /// Reads a file of limited size. Only regular files: a pipe or a device could block or never end.
    pub(super) fn open(path: &Path) -> Result<Self, SceneError> {
        let fail = |source| SceneError::Read { path: path.to_path_buf(), source };
        // Asked before opening, which would already wait for the other end of a pipe.
        if !path.metadata().map_err(fail)?.is_file() {
            return Err(SceneError::NoScene {
                path: path.to_path_buf(),
                problem: "is not a file".to_owned(),
            });
        }
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(fail)?;
        file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(fail)?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            let what = format!("{} has too many bytes", path.display());
            return Err(SceneError::Limit {
                location: Location { file: path.into(), line: 1, column: 1 },
                what,
                limit: MAX_FILE_BYTES,
            });
        }
        let text = String::from_utf8(bytes).map_err(|error| {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = 1 + valid.iter().filter(|byte| **byte == b'\n').count();
            let column = 1 + valid.iter().rev().take_while(|byte| **byte != b'\n').count();
            SceneError::Xml {
                location: Location { file: path.into(), line: line as u32, column: column as u32 },
                message: "not UTF-8 text".to_owned(),
            }
        })?;
        let lines = std::iter::once(0)
            .chain(text.match_indices('\n').map(|(newline, _)| newline + 1))
            .collect();
        Ok(Self { path: path.into(), text, lines, last: Cell::new((0, 1)) })
    }

    /// Where an element begins.
    pub(super) fn location(&self, node: Node<'_, '_>) -> Location {
        let start = node.range().start;
        let line = self.lines.partition_point(|line| *line <= start);
        let line_start = (self.lines[line - 1], 1);
        let (offset, column) = match self.last.get() {
            last if (line_start.0..=start).contains(&last.0) => last,
            _ => line_start,
        };
        let column = column + self.text[offset..start].chars().count();
        self.last.set((start, column));
        Location { file: self.path.clone(), line: line as u32, column: column as u32 }
    }
}
