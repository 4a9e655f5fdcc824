//! Fuzz target: any bytes as the answers of a server.
#![no_main]

use aarc_fuzz::net::check_dialogue;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_dialogue(bytes));
