//! Fuzz target: imports any bytes as a fitted field in any format.
#![no_main]

use aarc_fuzz::import::check_import;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_import(bytes));
