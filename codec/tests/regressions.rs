//! Replays inputs with which fuzzing once found a defect, and others that exercise deep checks, through
//! the properties of the fuzz targets. See fuzz/README.md.

use std::{fs, path::Path};

use properties::{LIMITS, check_decoding, check_package, check_round_trip};

#[path = "../fuzz/src/properties.rs"]
#[allow(dead_code, unreachable_pub, reason = "a module of the fuzz targets")]
mod properties;

/// Calls `check` with every file of a folder of regressions.
fn replay(target: &str, check: impl Fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/regressions").join(target);
    let mut count = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        // Printed only if a check panics.
        println!("{}", path.display());
        check(&fs::read(&path).unwrap());
        count += 1;
    }
    assert!(count > 0, "no regressions in {}", folder.display());
}

#[test]
fn packages_decode_to_a_valid_clip_or_an_error() {
    replay("decode", |bytes| {
        check_decoding(bytes, &codec::decode(bytes, &LIMITS));
        check_package(bytes, |_, _| ());
    });
}

#[test]
fn fields_round_trip() {
    replay("roundtrip", check_round_trip);
}
