//! Fuzz target: reads any bytes as `scene.json` or as a camera file.
#![no_main]

use aarc_fuzz::scene::check_scene;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_scene(bytes));
