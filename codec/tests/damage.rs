//! Damaged and hostile packages: each gives an error with a byte offset or a valid clip, without a
//! panic and within the limits.

mod common;

use codec::{Clip, Coder, Error, FormatError, Limits, contents, decode};
use common::{Parts, Rng, Shape, check_fields, field, options, put_u32, static_field, u32_at};

/// A package with every kind of section: plate, two layers of both regions, all columns.
fn package(rows: usize) -> Vec<u8> {
    package_by(Coder::Fixed, rows)
}

fn package_by(coder: Coder, rows: usize) -> Vec<u8> {
    let (field, plate) = (field(Shape::full(rows), 1), static_field(8, 1, 2));
    common::package(&field, Some(&plate), &options(coder, &[rows / 2]))
}

fn decoded(bytes: &[u8]) -> Result<Clip, Error> {
    decode(bytes, &Limits::default())
}

/// The error of decoding `bytes`.
#[track_caller]
fn error(bytes: &[u8]) -> Error {
    let error = decoded(bytes).expect_err("damaged bytes must not decode");
    assert!(error.to_string().contains("at byte "), "no offset in: {error}");
    error
}

/// Checks the error of `bytes`: its message contains `message`, its offset is `offset`.
#[track_caller]
fn refused(bytes: &[u8], message: &str, offset: usize) {
    let error = error(bytes).to_string();
    assert!(error.contains(message), "'{message}' expected: {error}");
    assert!(error.ends_with(&format!("at byte {offset}")), "byte {offset} expected: {error}");
}

#[test]
fn unchanged_parts_join_to_the_same_package() {
    let bytes = package(40);
    assert_eq!(Parts::new(&bytes).join(), bytes);
}

#[test]
fn empty_and_foreign_files_are_refused() {
    for bytes in [&b""[..], b"ply\nformat binary", b"AARX\x01\0\0\0", &[0; 100]] {
        refused(bytes, "not an .aarc package", 0);
    }
    refused(b"AA", "cut short: 12 bytes needed for the first layer, 2 present", 2);
}

#[test]
fn extra_bytes_are_refused() {
    let mut bytes = package(20);
    let end = bytes.len();
    bytes.extend_from_slice(&[0; 3]);
    refused(&bytes, "3 extra bytes after the last section", end);
    assert!(contents(&bytes, &Limits::default()).is_err());
}

#[test]
fn another_major_version_is_refused_and_another_minor_is_read() {
    let mut parts = Parts::new(&package(20));
    parts.head[6] = 9;
    let minor = contents(&parts.join(), &Limits::default()).unwrap();
    assert_eq!(minor.version_minor, 9);
    decoded(&parts.join()).unwrap();
    for major in [0, 2] {
        parts.head[4] = major;
        assert_eq!(error(&parts.join()), Error::Version { major: u16::from(major), minor: 9 });
        assert_eq!(
            error(&parts.join()).to_string(),
            format!("package version {major}.9 cannot be read, at byte 4; this program reads 1.x")
        );
    }
}

#[test]
fn checksum_errors_name_the_part_and_its_offset() {
    let bytes = package(20);
    let head = contents(&bytes, &Limits::default()).unwrap();
    let flipped = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at] ^= 1;
        bytes
    };
    refused(&flipped(20), "damaged head: CRC-32 is", head.head_bytes - 4);
    for section in &head.sections {
        let part = match section.kind {
            codec::SectionKind::TimeIndex => "damaged time index: CRC-32 is",
            _ => "damaged chunk of Gaussians: CRC-32 is",
        };
        refused(&flipped(section.end() - 1), part, section.offset);
    }
}

#[test]
fn unknown_sections_are_skipped_unless_critical() {
    let bytes = package(20);
    let plain = decoded(&bytes).unwrap();
    let parts = Parts::new(&bytes);
    for position in 0..=parts.table.len() {
        let mut parts = parts.clone();
        let mut entry = [0; 24];
        entry[0] = 200;
        put_u32(&mut entry, 16, u32::MAX as usize);
        parts.table.insert(position, entry);
        parts.sections.insert(position, b"from the future".to_vec());
        let bytes = parts.join();
        assert_eq!(decoded(&bytes).unwrap(), plain, "before section {position}");
        // The checksum of a skipped section is not read.
        let head = contents(&bytes, &Limits::default()).unwrap();
        let mut damaged = bytes.clone();
        damaged[head.sections[position].offset] ^= 1;
        assert_eq!(decoded(&damaged).unwrap(), plain, "before section {position}, damaged");

        parts.table[position][1] = 1;
        let at = head.head_bytes - 4 - 24 * (parts.table.len() - position);
        refused(&parts.join(), "unknown section kind 200, marked critical", at);
    }
}

#[test]
fn numbers_out_of_range_in_the_head_are_refused() {
    let parts = Parts::new(&package(20));
    let with = |at: usize, bytes: &[u8]| {
        let mut parts = parts.clone();
        parts.head[at..at + bytes.len()].copy_from_slice(bytes);
        parts.join()
    };
    let nan = f32::NAN.to_le_bytes();
    refused(&with(12, &nan), "bad duration: NaN", 12);
    refused(&with(16, &[0; 4]), "bad frames per second: 0.0", 12);
    refused(&with(20, &nan), "bad up vector", 12);
    refused(&with(32, &[0; 4]), "bad metres per unit", 12);
    refused(&with(36, &nan), "bad bounds", 36);
    refused(&with(36, &1e9f32.to_le_bytes()), "bad bounds", 36);
    refused(&with(60, &[77]), "bad coder: 77", 60);
    refused(&with(61, &[4]), "bad SH degree: 4", 61);
    refused(&with(62, &[4]), "bad motion order: 4", 62);
    refused(&with(63, &[32]), "bad flags: 32", 63);
    refused(&with(64, &[0]), "the package is a take", 64);
    refused(&with(64, &[17]), "bad number of layers: 17", 64);
    refused(&with(65, &[65]), "bad number of viewpoints: 65", 65);
    refused(&with(66, &[4]), "bad SH degree of the plate: 4", 66);
    refused(&with(67, &[1]), "bad reserved byte: 1", 67);
    refused(&with(76, &[0; 8]), "bad size of a layer: 0", 76);
    // The first viewpoint follows two layers; its name follows 28 bytes of numbers.
    refused(&with(92, &nan), "bad position of a viewpoint", 92);
    refused(&with(92 + 24, &[0; 4]), "bad field of view of a viewpoint", 92);
    refused(&with(92 + 29, &[0xff]), "bad name of a viewpoint", 92 + 28);
    refused(&with(92 + 29, &[0x1b]), "bad name of a viewpoint", 92);
}

#[test]
fn a_wrong_length_of_the_head_is_refused() {
    let bytes = package(20);
    for length in [0, 12, 79] {
        let mut bytes = bytes.clone();
        put_u32(&mut bytes, 8, length);
        refused(&bytes, &format!("bad length of the head: {length}"), 8);
    }
    let mut long = bytes.clone();
    put_u32(&mut long, 8, u32::MAX as usize);
    refused(&long, "cut short: 4294967295 bytes needed", bytes.len());
}

#[test]
fn an_inconsistent_table_is_refused() {
    let parts = Parts::new(&package(20));
    let table_at = parts.head.len();
    let dynamic = parts.find(1, 1);
    let at = table_at + 24 * dynamic;
    // Entries: kind, flags, layer, region, chunk, offset, length, raw length, CRC.
    for (field, value, message) in [
        (0, 2, "Gaussians"),
        (1, 0, "critical Planned"),
        (1, 3, "bad section flags: 3"),
        (2, 1, "layer: 0"),
        (3, 0, "region: Dynamic"),
        (3, 3, "bad section region: 3"),
        (4, 1, "chunk: 0"),
    ] {
        let mut parts = parts.clone();
        parts.table[dynamic][field] = value;
        let message_at = if message.starts_with("bad section") { at + field } else { at };
        refused(&parts.join(), message, message_at);
    }
    let mut raw_length = parts.clone();
    let expected = u32_at(&parts.table[dynamic], 16);
    put_u32(&mut raw_length.table[dynamic], 16, expected + 1);
    refused(&raw_length.join(), &format!("raw length {expected} expected, {} found", expected + 1), at);

    let mut missing = parts.clone();
    let last = parts.table.len() - 1;
    missing.table.pop();
    missing.sections.pop();
    refused(&missing.join(), "the end of the table found", table_at + 24 * last);

    let mut doubled = parts.clone();
    doubled.table.push(parts.table[last]);
    doubled.sections.push(parts.sections[last].clone());
    refused(&doubled.join(), "no further section expected", table_at + 24 * (last + 1));

    let mut swapped = parts.clone();
    swapped.table.swap(dynamic, dynamic - 1);
    swapped.sections.swap(dynamic, dynamic - 1);
    refused(&swapped.join(), "TimeIndex", at - 24);
}

#[test]
fn sections_that_overlap_or_leave_gaps_are_refused() {
    let bytes = package(20);
    let head = contents(&bytes, &Limits::default()).unwrap();
    let entry = head.head_bytes - 4 - 24 * (head.sections.len() - 1);
    for offset in [0, head.sections[1].offset - 1, head.sections[1].offset + 1, u32::MAX as usize] {
        let mut bytes = bytes.clone();
        put_u32(&mut bytes, entry + 8, offset);
        let body = head.head_bytes - 4;
        let crc = crc32fast::hash(&bytes[..body]);
        put_u32(&mut bytes, body, crc as usize);
        refused(
            &bytes,
            &format!("offset {} expected, offset {offset} found", head.sections[1].offset),
            entry,
        );
    }
}

#[test]
fn inconsistent_counts_are_refused() {
    let parts = Parts::new(&package(20));
    let table_at = parts.head.len();
    // More rows than the chunks hold.
    let mut more = parts.clone();
    more.head[76] += 1;
    refused(&more.join(), "raw length", table_at + 24 * more.find(1, 0));
    // Rows of a missing chunk.
    let mut chunks = parts.clone();
    put_u32(&mut chunks.head, 76, 5000);
    refused(&chunks.join(), "raw length", table_at + 24 * chunks.find(1, 0));
    // More than the limits.
    let mut many = parts.clone();
    put_u32(&mut many.head, 80, u32::MAX as usize);
    refused(&many.join(), "Gaussians, 4000000 allowed", 76);
    // A missing plate.
    let mut plate = parts.clone();
    put_u32(&mut plate.head, 68, 0);
    refused(&plate.join(), "region: Plate", table_at);
    // A table shorter than its count.
    let bytes = parts.join();
    let mut count = bytes.clone();
    put_u32(&mut count, 72, parts.table.len() + 1);
    let body = table_at + 24 * parts.table.len();
    let crc = crc32fast::hash(&count[..body]);
    put_u32(&mut count, body, crc as usize);
    refused(&count, "8 entries of 24 bytes expected, 168 bytes found", table_at);
}

#[test]
fn limits_hold() {
    for coder in Coder::ALL {
        let bytes = package_by(coder, 40);
        let limits = Limits { max_gaussians: 47, ..Limits::default() };
        let error = decode(&bytes, &limits).unwrap_err();
        assert!(matches!(error, Error::Limits { quantity: "Gaussians", .. }));
        assert_eq!(error.to_string(), "the package asks for 48 Gaussians, 47 allowed, at byte 84");
        assert!(contents(&bytes, &limits).is_err());
        assert!(decode(&bytes, &Limits { max_gaussians: 48, ..limits }).is_ok());
        let limit = if coder == Coder::Fixed { 10_000 } else { 1 << 20 };
        match decode(&bytes, &Limits { max_bytes: limit, ..Limits::default() }).unwrap_err() {
            Error::Limits { quantity: "bytes of memory", limit: reported, .. } => assert_eq!(reported, limit),
            error => panic!("{error}"),
        }
        // Counts beyond the limits in a small file.
        let mut parts = Parts::new(&bytes);
        let rows = u32_at(&parts.head, 76);
        put_u32(&mut parts.head, 76, rows + 4_000_000);
        assert!(decoded(&parts.join()).is_err());
    }
}

/// A table that fits and a clip that fits need not fit together.
#[test]
fn the_section_table_and_the_clip_share_one_limit() {
    let mut parts = Parts::new(&package_by(Coder::Fixed, 2_000));
    let mut entry = [0; 24];
    entry[0] = 200;
    parts.table.resize(parts.table.len() + 20_000, entry);
    parts.sections.resize(parts.table.len(), Vec::new());
    let bytes = parts.join();
    let limits = |max_bytes| Limits { max_bytes, ..Limits::default() };
    let least = |fits: &dyn Fn(usize) -> bool| {
        let (mut too_few, mut enough) = (0_usize, 1 << 26);
        while enough - too_few > 1 {
            let middle = too_few.midpoint(enough);
            if fits(middle) { enough = middle } else { too_few = middle }
        }
        enough
    };
    let table = least(&|max_bytes| contents(&bytes, &limits(max_bytes)).is_ok());
    let plain = package_by(Coder::Fixed, 2_000);
    let clip = least(&|max_bytes| decode(&plain, &limits(max_bytes)).is_ok());
    let both = least(&|max_bytes| decode(&bytes, &limits(max_bytes)).is_ok());
    assert!(table > 20_000 * 24 && clip > 100_000, "{table} and {clip} bytes");
    assert!((table + clip - 1_000..=table + clip).contains(&both), "{both} bytes for {table} and {clip}");
}

#[test]
fn payloads_that_do_not_expand_as_announced_are_refused() {
    let parts = Parts::new(&package(20));
    let at = parts.find(1, 1);
    let mut short = parts.clone();
    short.set_raw(at, &parts.raw(at)[1..]);
    refused(&short.join(), "damaged payload: expands to", short.offset(at));
    let mut bomb = parts.clone();
    bomb.set_raw(at, &vec![0; 1 << 24]);
    refused(&bomb.join(), "damaged payload", bomb.offset(at));
    let mut noise = parts.clone();
    noise.sections[at] = vec![0x55; 100];
    refused(&noise.join(), "damaged payload", noise.offset(at));
    let mut empty = parts.clone();
    empty.sections[at].clear();
    refused(&empty.join(), "damaged payload", empty.offset(at));
}

#[test]
fn numbers_out_of_range_in_a_chunk_are_refused() {
    let parts = Parts::new(&package(40));
    let at = parts.find(1, 1);
    let raw = parts.raw(at);
    let rows = 15;
    // Ranges: origin, extent, log-scale, colour, 3 bands, 3 powers, rates.
    let ranges = 4 * (3 + 1 + 2 + 2 + 3 + 3 + 1);
    let rotations = ranges + rows * (6 + 3);
    let tau = rotations + rows * (4 + 1 + 48);
    let with = |changes: &[(usize, &[u8])]| {
        let mut raw = raw.clone();
        for (at, bytes) in changes {
            raw[*at..at + bytes.len()].copy_from_slice(bytes);
        }
        let mut parts = parts.clone();
        parts.set_raw(at, &raw);
        error(&parts.join()).to_string()
    };
    let (nan, huge) = (f32::NAN.to_le_bytes(), f32::MAX.to_le_bytes());
    for range in (0..ranges).step_by(4) {
        let message = with(&[(range, &nan)]);
        let expected = if range < 16 { "bad centre" } else { "bad range of a column: NaN" };
        assert!(message.contains(expected), "range at {range}: {message}");
    }
    assert!(with(&[(20, &huge)]).contains("bad range of a column: inf"));
    // Upper bytes of the first axis: FP16 infinity.
    assert!(with(&[(ranges, &[0x7c]), (ranges + rows, &[0])]).contains("bad centre: [inf"));
    let zero: Vec<(usize, &[u8])> = (0..4).map(|k| (rotations + k * rows, &[128u8][..])).collect();
    assert!(with(&zero).contains("bad length of a quaternion"));
    assert!(with(&[(tau, &[0x7e])]).contains("bad window (centre, width): (NaN"));
    assert!(with(&[(tau + 2 * rows, &[0x80])]).contains("bad window (centre, width)"), "negative width");
    let zero_width: [(usize, &[u8]); 2] = [(tau + 2 * rows, &[0]), (tau + 3 * rows, &[0])];
    assert!(with(&zero_width).contains(", 0.0)"));
}

#[test]
fn an_inconsistent_time_index_is_refused() {
    let parts = Parts::new(&package(40));
    let at = parts.find(2, 1);
    let index = &parts.sections[at];
    assert_eq!(index.len(), 448, "one byte a cell");
    let offset = parts.offset(at);
    let with = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut index = index.clone();
        change(&mut index);
        parts.with_payload(at, index)
    };
    let full = index.iter().position(|count| *count > 0).unwrap();
    let last = 447 - index.iter().rev().position(|count| *count > 0).unwrap();
    assert!(full + 1 < last);
    let move_row = |to: usize| with(&|index| (index[full] -= 1, index[to] += 1).1);
    refused(&move_row(full + 3), "time index puts row", offset);
    refused(&move_row(447), "in the wrong cell", offset);
    refused(&with(&|index| index[full] += 1), "more rows in its cells than in the layer", offset + last);
    refused(&with(&|index| index[full] -= 1), "fewer rows in its cells than in the layer", offset + 448);
    refused(&with(&|index| index.push(0)), "1 extra bytes after time index", offset + 448);
    refused(&with(&|index| index.truncate(447)), "time index is too short", offset + 447);
    refused(&with(&|index| index[447] = 0x80), "time index is too short", offset + 448);
    assert!(matches!(error(&move_row(447)), Error::Format { error: FormatError::TimeIndex { .. }, .. }));
}

/// Changes under valid checksums reach the innermost checks. A package that still decodes must be a
/// valid clip.
#[test]
fn mutations_under_valid_checksums_never_break_the_decoder() {
    let mut rng = Rng(7);
    for (coder, rounds, least) in [(Coder::Fixed, 6_000, 500), (Coder::Rans, 8_000, 50)] {
        let parts = Parts::new(&package_by(coder, 60));
        let (mut accepted, mut refused) = (0, 0);
        for _ in 0..rounds {
            let mut parts = parts.clone();
            for _ in 0..1 + rng.below(3) {
                mutate_part(&mut parts, coder, &mut rng);
            }
            match decoded(&parts.join()) {
                Err(error) => {
                    assert!(error.to_string().contains("at byte "), "{error}");
                    refused += 1;
                }
                Ok(clip) => {
                    accepted += 1;
                    check_fields(&clip);
                    for field in [&clip.static_field, &clip.dynamic_field].into_iter().chain(&clip.plate) {
                        for i in 0..field.len() {
                            assert!(field.position_at(i, 0.3).iter().all(|x| x.is_finite()));
                            assert!((0.0..=1.0).contains(&field.opacity_at(i, 0.3)));
                        }
                    }
                    assert_eq!(clip.layers.last().unwrap().dynamic_count, clip.dynamic_field.len());
                }
            }
        }
        assert!(accepted > least && refused > 500, "{coder:?}: {accepted} accepted, {refused} refused");
    }
}

/// Mutates the head, an entry of the table, or a section; sections of `fixed` mostly before
/// compression, sections of `rans` half of the time in the head of the chunk.
fn mutate_part(parts: &mut Parts, coder: Coder, rng: &mut Rng) {
    let i = rng.below(parts.table.len());
    let is_index = parts.table[i][0] == 2;
    match (rng.below(6), coder) {
        (0, _) => mutate(&mut parts.head[12..], rng),
        (1, _) => mutate(&mut parts.table[i], rng),
        (2, Coder::Fixed) if !parts.sections[i].is_empty() => mutate(&mut parts.sections[i], rng),
        (_, Coder::Fixed) if !is_index => {
            if let Ok(mut raw) = zstd::bulk::decompress(&parts.sections[i], 1 << 16) {
                mutate(&mut raw, rng);
                parts.set_raw(i, &raw);
            }
        }
        (2 | 3, Coder::Rans) => mutate(&mut parts.sections[i][..26], rng),
        _ => mutate(&mut parts.sections[i], rng),
    }
}

/// Overwrites a byte or a 4-byte number with random bits or an extreme number.
fn mutate(bytes: &mut [u8], rng: &mut Rng) {
    const EXTREME: [u32; 8] = [0, 1, u32::MAX, 0x7f80_0000, 0x7fc0_0000, 0x8000_0000, 0x7f7f_ffff, 4097];
    let at = rng.below(bytes.len());
    match rng.below(3) {
        0 => bytes[at] = rng.bits() as u8,
        1 => bytes[at] ^= 1 << rng.below(8),
        _ => {
            let number = EXTREME[rng.below(EXTREME.len())].to_le_bytes();
            let count = number.len().min(bytes.len() - at);
            bytes[at..at + count].copy_from_slice(&number[..count]);
        }
    }
}

#[test]
fn random_bytes_are_refused() {
    let mut rng = Rng(8);
    let head = package(20);
    for _ in 0..3000 {
        let length = rng.below(400);
        let mut bytes: Vec<u8> = (0..length).map(|_| rng.bits() as u8).collect();
        // Half of them start like a package.
        let keep = rng.below(2) * rng.below(60.min(length.max(1)));
        bytes[..keep].copy_from_slice(&head[..keep]);
        error(&bytes);
    }
}
