//! The command line of Quietlight.

#![allow(unsafe_code, reason = "setting a variable of the environment is unsafe")]

use std::process::ExitCode;

fn main() -> ExitCode {
    // Newer onnxruntime libraries, which a user may have, send and keep records of their use unless they are told not to
    // before they are loaded.
    // SAFETY: no other thread has been started that could read the environment at the same time.
    unsafe { std::env::set_var("ORT_DISABLE_TELEMETRY", "1") };
    quietlight::cli::run()
}
