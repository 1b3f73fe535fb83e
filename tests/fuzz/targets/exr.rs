#![no_main]

use quietlight_fuzz::{Kind, Runner};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| Runner::with(Kind::Exr, |runner| runner.run(bytes)));
