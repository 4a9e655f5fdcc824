//! Fuzz target: any bytes as `scene.json` or a file of a camera.
#![no_main]

use aarc_fuzz::scene::check_scene;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| check_scene(bytes));
