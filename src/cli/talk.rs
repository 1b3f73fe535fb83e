//! What is printed. A reader who goes away (`| head -1`) ends no render, and a full disk behind standard output is told in
//! the end: the library's own macros would panic at both.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stderr, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

static IS_CUT_OFF: AtomicBool = AtomicBool::new(false);

/// Could something not be written to standard output, though somebody reads it?
pub(super) fn is_cut_off() -> bool {
    IS_CUT_OFF.load(Ordering::Relaxed)
}

/// A line for standard output.
pub(super) fn tell(text: Arguments<'_>) {
    let written = writeln!(stdout(), "{text}");
    if written.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe) {
        IS_CUT_OFF.store(true, Ordering::Relaxed);
    }
}

/// A line for standard error. Where it cannot be written, nobody is left to be told.
pub(super) fn warn(text: Arguments<'_>) {
    writeln!(stderr(), "{text}").ok();
}

/// [`tell`] with a format.
macro_rules! println {
    ($($text:tt)*) => { $crate::cli::talk::tell(format_args!($($text)*)) };
}

/// [`warn`] with a format.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::cli::talk::warn(format_args!($($text)*)) };
}
