//! The command line of Quietlight.

use std::process::ExitCode;

fn main() -> ExitCode {
    quietlight::cli::run()
}
