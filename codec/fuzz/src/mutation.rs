//! [`mutate`]: changes packages where a change reaches the decoder.
//!
//! Checksums, offsets and compression turn a change of a byte into noise that the first check
//! refuses. So a package is taken apart, one or two of its parts are changed, compressed ones in
//! their decompressed form, and it is put together again with everything around the change true.

use libfuzzer_sys::fuzzer_mutate;

use crate::common::{Parts, Rng, put_u32, u32_at};

/// Bytes of the head before the counts per layer: no head is shorter, its checksum not counted.
const FIXED_BYTES: usize = 76;

/// Bytes of the prefix of the head, which decides whether it is read at all.
const PREFIX_BYTES: usize = 12;

/// First bytes of a zstd frame.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Largest payload that is decompressed to be changed.
const RAW_BYTES_MAX: usize = 1 << 20;

/// Most bytes that a change adds to a part.
const GROWTH: usize = 32;

/// A mutator of libFuzzer: `data[..size]` becomes another package of at most `max_size` bytes,
/// whose length is returned.
pub fn mutate(data: &mut [u8], size: usize, max_size: usize, seed: u32) -> usize {
    let mut rng = Rng(seed.into());
    // One in sixteen is damaged as it lies, checksums included.
    if rng.below(16) == 0 || !comes_apart(&data[..size]) {
        return fuzzer_mutate(data, size, max_size);
    }
    let mut parts = Parts::of(&data[..size]);
    for _ in 0..1 + rng.below(2) {
        change(&mut parts, &mut rng);
    }
    let mut package = parts.join();
    if rng.below(16) == 0 {
        package.truncate(rng.below(package.len()));
    }
    if package.len() > max_size {
        return fuzzer_mutate(data, size, max_size);
    }
    data[..package.len()].copy_from_slice(&package);
    package.len()
}

/// Whether [`Parts::of`] can take `package` apart: its lengths and offsets lie within it.
fn comes_apart(package: &[u8]) -> bool {
    if package.len() < FIXED_BYTES + 4 {
        return false;
    }
    let (head_length, count) = (u32_at(package, 8), u32_at(package, 72));
    if head_length > package.len() || FIXED_BYTES + 24 * count + 4 > head_length {
        return false;
    }
    let table = &package[head_length - 4 - 24 * count..head_length - 4];
    table.chunks(24).all(|entry| u32_at(entry, 8) + u32_at(entry, 12) <= package.len())
}

/// Changes one part.
fn change(parts: &mut Parts, rng: &mut Rng) {
    let count = parts.table.len();
    if count == 0 || rng.below(5) == 0 {
        change_in_place(&mut parts.head[PREFIX_BYTES..]);
        return;
    }
    let i = rng.below(count);
    match rng.below(16) {
        0 => change_in_place(&mut parts.table[i]),
        1 => {
            parts.table.swap(i, rng.below(count));
        }
        2 => {
            parts.table.remove(i);
            parts.sections.remove(i);
        }
        3 => {
            // A section of a kind that a later version may define, not critical.
            let mut entry = parts.table[i];
            entry[..2].copy_from_slice(&[9, 0]);
            parts.table.insert(i, entry);
            parts.sections.insert(i, Vec::new());
        }
        4 => parts.sections[i] = changed(&parts.sections[i]),
        _ => change_payload(parts, i, rng),
    }
}

/// Changes the decompressed payload of section `i`.
fn change_payload(parts: &mut Parts, i: usize, rng: &mut Rng) {
    let section = &mut parts.sections[i];
    let compressed = section.starts_with(&ZSTD_MAGIC);
    let raw = if compressed { zstd::bulk::decompress(section, RAW_BYTES_MAX) } else { Ok(section.clone()) };
    let Ok(mut raw) = raw else {
        *section = changed(section);
        return;
    };
    // The counts fix the length of a compressed payload, so most changes keep it.
    if compressed && rng.below(16) > 0 {
        change_in_place(&mut raw);
    } else {
        raw = changed(&raw);
        put_u32(&mut parts.table[i], 16, raw.len());
    }
    *section =
        if compressed { zstd::bulk::compress(&raw, 1).expect("memory for a small frame") } else { raw };
}

fn change_in_place(bytes: &mut [u8]) {
    let size = bytes.len();
    fuzzer_mutate(bytes, size, size);
}

fn changed(bytes: &[u8]) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    changed.resize(bytes.len() + GROWTH, 0);
    let capacity = changed.len();
    let size = fuzzer_mutate(&mut changed, bytes.len(), capacity);
    changed.truncate(size);
    changed
}
