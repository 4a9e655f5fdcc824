//! Fuzz target: reads any bytes as the files of a capture.
#![no_main]

use aarc_fuzz::capture::check_capture;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_capture(bytes));
