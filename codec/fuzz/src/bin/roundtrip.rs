//! Fuzz target: packages a field made of any bytes with every coder, and checks the decoded clip.
#![no_main]

use codec_fuzz::properties::check_round_trip;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_round_trip(bytes));
