//! Importers on bytes that are cut short, changed, or lie about their counts: no panic, no large
//! allocation, and whatever is accepted is a valid field.

mod support;

use studio::export::{field_file, splatv, spz, static_ply};
use support::{Noise, data, field, import_bytes, import_error, info};

/// An up axis.
const UP: [f32; 3] = [0.0, 1.0, 0.0];

/// Small files of every format that is one file.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let mut samples = vec![
        ("field.ply", field_file(&field(3, 1, Some(2), true), &info())),
        ("static.ply", static_ply(&field(3, 1, None, false))),
        ("a.spz", spz(&field(3, 2, None, false), UP)),
        ("raw.spz", gunzip(&spz(&field(3, 2, None, false), UP))),
    ];
    let mut moving = splatv(&field(3, 0, Some(3), true), &info());
    moving.truncate(moving.len() - 1021 * 64);
    samples.push(("a.splatv", moving));
    for (name, path) in [
        ("v4.spz", "format-fixtures/splat-transform/minimal-v4.spz"),
        ("a.splat", "format-fixtures/splat-transform/minimal.splat"),
    ] {
        samples.extend(data(path).map(|path| (name, std::fs::read(path).expect("a fixture"))));
    }
    samples
}

fn gunzip(bytes: &[u8]) -> Vec<u8> {
    let mut plain = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(bytes), &mut plain).expect("our own file");
    plain
}

fn must_be_valid_if_accepted(name: &str, bytes: &[u8]) -> bool {
    match import_bytes(name, bytes) {
        Ok(imported) => {
            imported.field.check().expect("an accepted field is valid");
            assert!(!imported.field.is_empty());
            true
        }
        Err(error) => {
            assert!(error.is::<program::Fault>(), "{error}");
            false
        }
    }
}

#[test]
fn every_prefix() {
    for (name, bytes) in samples() {
        assert!(must_be_valid_if_accepted(name, &bytes), "{name} itself is good");
        for length in 0..bytes.len() {
            must_be_valid_if_accepted(name, &bytes[..length]);
        }
    }
}

#[test]
fn changed_bytes() {
    let mut noise = Noise(5);
    for (name, bytes) in samples() {
        for _ in 0..500 {
            let mut changed = bytes.clone();
            for _ in 0..=noise.bits() % 3 {
                let place = noise.bits() as usize % changed.len();
                changed[place] = match noise.bits() % 4 {
                    0 => 0,
                    1 => 0xff,
                    _ => noise.bits() as u8,
                };
            }
            must_be_valid_if_accepted(name, &changed);
        }
    }
}

#[test]
fn truncated_payloads_keep_their_whole_rows() {
    let original = field(8, 1, Some(1), false);
    let bytes = field_file(&original, &info());
    let row = 4 * (14 + 9 + 1 + 2 + 3);
    let imported = import_bytes("a.ply", &bytes[..bytes.len() - 2 * row - 1]).expect("five rows are whole");
    assert_eq!(imported.field.centers, original.centers[..5]);
    assert_eq!(imported.repairs.dropped["truncated payload"], 3);
    let message = import_error("a.ply", &bytes[..bytes.len() - 8 * row + 1]);
    assert!(message.contains("truncated payload: 8"), "{message}");

    // Eight rows and a half of the texture's 1024: a half row is damage, whole ones are the habit.
    let bytes = splatv(&original, &info());
    let cut = |bytes_left: usize| {
        import_bytes("a.splatv", &bytes[..bytes.len() - 1024 * 64 + bytes_left]).expect("some rows are whole")
    };
    assert!(cut(8 * 64).repairs.dropped.is_empty());
    assert_eq!(cut(5 * 64 + 32).field.len(), 5);
    assert!(cut(5 * 64 + 32).repairs.dropped.contains_key("truncated payload"));

    // Half of the SH array, which comes last.
    let plain = gunzip(&spz(&field(8, 1, None, false), UP));
    let imported = import_bytes("a.spz", &plain[..plain.len() - 4 * 9]).expect("four rows are whole");
    assert_eq!(imported.field.len(), 4);
    assert_eq!(imported.repairs.dropped["truncated payload"], 4);
}

#[test]
fn counts_that_lie_cost_nothing() {
    let one = static_ply(&field(1, 0, None, false));
    let text = String::from_utf8_lossy(&one[..200]).into_owned();
    assert!(text.contains("element vertex 1\n"), "{text}");
    for count in ["18446744073709551615", "4000000000000000000"] {
        let mut lying = Vec::new();
        let place = text.find("vertex 1").expect("a count") + "vertex ".len();
        lying.extend(&one[..place]);
        lying.extend(count.bytes());
        lying.extend(&one[place + 1..]);
        let imported = import_bytes("a.ply", &lying).expect("one row is there");
        assert_eq!(imported.field.len(), 1);
        assert!(imported.repairs.dropped["truncated payload"] > 1 << 60);
    }
}
