//! Fuzz target: a field made of any bytes, packaged by every coder, comes back.
#![no_main]

use codec_fuzz::properties::check_round_trip;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_round_trip(bytes));
