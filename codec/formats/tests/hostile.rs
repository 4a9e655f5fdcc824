//! Readers on truncated and changed bytes and false counts: no panic, no large allocation, and every accepted
//! field is valid.

mod support;

use formats::{write_field_file, write_glb, write_splatv, write_spz, write_static_ply};
use support::{Noise, data, field, import_bytes, import_error, info};

/// An up axis.
const UP: [f32; 3] = [0.0, 1.0, 0.0];

/// Small files of every single-file format.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let mut samples = vec![
        ("field.ply", write_field_file(&field(3, 1, Some(2), true), &info())),
        ("static.ply", write_static_ply(&field(3, 1, None, false), None)),
        ("a.spz", write_spz(&field(3, 2, None, false), UP)),
        ("a.glb", write_glb(&field(3, 1, None, false), &info()).expect("a small file")),
        ("raw.spz", gunzip(&write_spz(&field(3, 2, None, false), UP))),
    ];
    let mut dynamic = write_splatv(&field(3, 0, Some(3), true), &info());
    dynamic.truncate(dynamic.len() - 1021 * 64);
    samples.push(("a.splatv", dynamic));
    for (name, path) in [
        ("v4.spz", "format-fixtures/splat-transform/minimal-v4.spz"),
        ("a.splat", "format-fixtures/splat-transform/minimal.splat"),
        ("a.ksplat", "format-fixtures/splat-transform/minimal.ksplat"),
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

/// Imports `bytes`; a result is a valid field or an error.
fn is_accepted(name: &str, bytes: &[u8]) -> bool {
    match import_bytes(name, bytes) {
        Ok(imported) => {
            imported.field.check().expect("an accepted field is valid");
            assert!(!imported.field.is_empty());
            true
        }
        Err(_) => false,
    }
}

#[test]
fn every_prefix() {
    for (name, bytes) in samples() {
        assert!(is_accepted(name, &bytes), "{name} itself is good");
        for length in 0..bytes.len() {
            is_accepted(name, &bytes[..length]);
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
            is_accepted(name, &changed);
        }
    }
}

#[test]
fn truncated_payloads_give_their_complete_rows() {
    let original = field(8, 1, Some(1), false);
    let bytes = write_field_file(&original, &info());
    let row = 4 * (14 + 9 + 1 + 2 + 3);
    let imported =
        import_bytes("a.ply", &bytes[..bytes.len() - 2 * row - 1]).expect("five rows are complete");
    assert_eq!(imported.field.centers, original.centers[..5]);
    assert_eq!(imported.account.repairs.dropped["truncated payload"], 3);
    let message = import_error("a.ply", &bytes[..bytes.len() - 8 * row + 1]);
    assert!(message.contains("announces 8 Gaussians and the file holds 0"), "{message}");

    // Writers omit complete rows of the texture's 1024; half a row is damage.
    let bytes = write_splatv(&original, &info());
    let cut = |bytes_left: usize| {
        import_bytes("a.splatv", &bytes[..bytes.len() - 1024 * 64 + bytes_left])
            .expect("some rows are complete")
    };
    assert!(cut(8 * 64).account.repairs.dropped.is_empty());
    assert_eq!(cut(5 * 64 + 32).field.len(), 5);
    assert!(cut(5 * 64 + 32).account.repairs.dropped.contains_key("truncated payload"));

    // Without half of the SH array, which is last.
    let plain = gunzip(&write_spz(&field(8, 1, None, false), UP));
    let imported = import_bytes("a.spz", &plain[..plain.len() - 4 * 9]).expect("four rows are complete");
    assert_eq!(imported.field.len(), 4);
    assert_eq!(imported.account.repairs.dropped["truncated payload"], 4);
}

#[test]
fn false_counts_allocate_nothing() {
    let one = write_static_ply(&field(1, 0, None, false), None);
    let text = String::from_utf8_lossy(&one[..200]).into_owned();
    assert!(text.contains("element vertex 1\n"), "{text}");
    for count in ["18446744073709551615", "4000000000000000000"] {
        let mut bytes = Vec::new();
        let start = text.find("vertex 1").expect("a count") + "vertex ".len();
        bytes.extend(&one[..start]);
        bytes.extend(count.bytes());
        bytes.extend(&one[start + 1..]);
        let message = import_error("a.ply", &bytes);
        assert!(message.contains(&format!("announces {count} Gaussians and the file holds 1")), "{message}");
    }

    // The texture of a .splatv file of 4 billion rows; the file has one line of it.
    let bytes = write_splatv(&field(400, 0, Some(1), false), &info());
    let length = 8 + u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..length]).expect("JSON");
    header[0]["size"] = 256_000_000_000u64.into();
    let header = header.to_string().into_bytes();
    let bytes = [&bytes[..4], &(header.len() as u32).to_le_bytes(), &header, &bytes[length..]].concat();
    let message = import_error("a.splatv", &bytes);
    assert!(message.contains("announces 3999999") && message.contains("the file holds 400"), "{message}");
}
