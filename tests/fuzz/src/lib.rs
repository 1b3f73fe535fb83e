//! What the fuzz targets share: a folder in memory for the files, and panics that count only when nobody caught them.

#[path = "../input.rs"]
mod input;

pub use input::Kind;

use std::cell::{OnceCell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::path::Path;
use tempfile::TempDir;

/// One of these a process.
pub struct Runner {
    kind: Kind,
    folder: TempDir,
}

thread_local! {
    static RUNNER: OnceCell<Runner> = const { OnceCell::new() };
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

impl Runner {
    /// The runner of this process.
    pub fn with(kind: Kind, run: impl FnOnce(&Self)) {
        RUNNER.with(|runner| run(runner.get_or_init(|| Self::new(kind))));
    }

    fn new(kind: Kind) -> Self {
        // libfuzzer's own hook ends the process at every panic, also where a reader catches that of a decoder.
        set_hook(Box::new(|info| {
            let trace = std::backtrace::Backtrace::force_capture();
            PANIC.with(|panic| *panic.borrow_mut() = format!("{info}\n{trace}"));
        }));
        let memory = Path::new("/dev/shm");
        let parent =
            if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
        let folder = TempDir::new_in(parent).expect("a temporary folder");
        kind.prepare(folder.path());
        Self { kind, folder }
    }

    /// Ends the process where the input makes the readers panic.
    pub fn run(&self, bytes: &[u8]) {
        let run = AssertUnwindSafe(|| self.kind.try_file(self.folder.path(), bytes));
        if catch_unwind(run).is_err() {
            PANIC.with(|panic| eprintln!("{}", panic.borrow()));
            std::process::abort();
        }
    }
}
