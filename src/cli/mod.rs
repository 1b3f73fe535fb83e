//! The command line: a shell around the library, without an algorithm of its own. Only this module prints.

// First, for the others print by its macros.
#[macro_use]
mod talk;

mod args;
mod compare;
mod dataset;
mod denoise;
mod denoising;
mod doctor;
mod inspect;
mod integrator;
mod keep;
mod letters;
mod merge;
mod outcome;
mod output;
mod progress;
mod render;
mod replay;
mod spending;
mod strategies;
mod tradeoff;

use args::{Arguments, Command};
use clap::{CommandFactory, Parser};
use std::process::ExitCode;

/// Why a command did not succeed; each kind has its exit code.
enum Failure {
    /// The user gave something that cannot be used: exit code 2.
    BadInput(anyhow::Error),
    /// Something else went wrong, such as a full disk: exit code 1.
    Failed(anyhow::Error),
    /// Ctrl-C: what there was has been written. Exit code 130.
    Interrupted,
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Self::Failed(error)
    }
}

/// Marks an error as the user's to mend.
trait BadInput<T> {
    /// The same result, with the error as [`Failure::BadInput`].
    fn bad_input(self) -> Result<T, Failure>;
}

impl<T, E: Into<anyhow::Error>> BadInput<T> for Result<T, E> {
    fn bad_input(self) -> Result<T, Failure> {
        self.map_err(|error| Failure::BadInput(error.into()))
    }
}

/// Parses the arguments of the process, runs the command, prints an error with all its causes, and gives the exit code:
/// 0 done, 1 failed, 2 usage or bad input, 130 interrupted.
pub fn run() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match arguments.command {
        Command::Render(command) => render::run(&command),
        Command::Merge(command) => merge::run(&command),
        Command::Denoise(command) => denoise::run(&command),
        Command::Compare(command) => compare::run(&command),
        Command::Dataset(command) => dataset::run(&command),
        Command::Tradeoff(command) => tradeoff::run(&command),
        Command::Inspect(command) => inspect::run(&command),
        Command::Doctor => doctor::run(),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "quietlight", &mut script);
            println!("{}", String::from_utf8_lossy(&script).trim_end());
            Ok(())
        }
    };
    let (code, error) = match outcome {
        Ok(()) if talk::is_cut_off() => {
            (1, anyhow::anyhow!("standard output could not be written in full"))
        }
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Interrupted) => return ExitCode::from(130),
        Err(Failure::BadInput(error)) => (2, error),
        Err(Failure::Failed(error)) => (1, error),
    };
    let mut said = error.to_string();
    eprintln!("error: {said}");
    for cause in error.chain().skip(1).map(ToString::to_string) {
        // Some errors quote their cause already.
        if !said.contains(&cause) {
            eprintln!("  because: {cause}");
        }
        said = cause;
    }
    ExitCode::from(code)
}
