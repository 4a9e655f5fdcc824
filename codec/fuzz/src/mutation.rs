//! [`mutate`]: mutates packages so that the changes reach the decoder.
//!
//! The first checksum refuses most changes of a byte. So a package is taken apart, one or two of its
//! parts are mutated, compressed ones after decompression, and joined with valid checksums, offsets and
//! compression. Parts of a take are its head, the entries of its table and its segments, which are packages.

use libfuzzer_sys::fuzzer_mutate;

use crate::common::{Parts, Rng, TakeParts, put_u32, u32_at};

/// Length of the head before the counts per layer: the shortest head, without its checksum.
const FIXED_BYTES: usize = 76;

/// Length of the prefix of the head: magic number, version and length.
const PREFIX_BYTES: usize = 12;

/// First bytes of a zstd frame.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Largest payload that is decompressed for a mutation.
const RAW_BYTES_MAX: usize = 1 << 20;

/// Largest number of bytes that a mutation adds to a part.
const GROWTH: usize = 32;

/// A mutator for libFuzzer: replaces the package `data[..size]` by another one of at most `max_size`
/// bytes, and returns its length.
pub fn mutate(data: &mut [u8], size: usize, max_size: usize, seed: u32) -> usize {
    let mut rng = Rng(seed.into());
    // One in sixteen is mutated as plain bytes, checksums included.
    let mutated = if rng.below(16) == 0 { None } else { mutated_package(&data[..size], &mut rng) };
    let Some(mut package) = mutated else {
        return fuzzer_mutate(data, size, max_size);
    };
    if rng.below(16) == 0 {
        package.truncate(rng.below(package.len()));
    }
    if package.len() > max_size {
        return fuzzer_mutate(data, size, max_size);
    }
    data[..package.len()].copy_from_slice(&package);
    package.len()
}

/// The package with one or two mutated parts; nothing if it cannot be taken apart.
fn mutated_package(package: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    if let Some(mut take) = TakeParts::new(package) {
        for _ in 0..1 + rng.below(2) {
            mutate_take(&mut take, rng);
        }
        // Rarely the table contradicts the segments.
        return Some(if rng.below(8) == 0 { take.join_as_they_are() } else { take.join() });
    }
    if !is_splittable(package) {
        return None;
    }
    let mut parts = Parts::new(package);
    for _ in 0..1 + rng.below(2) {
        mutate_part(&mut parts, rng);
    }
    Some(parts.join())
}

/// Mutates one part of a take.
fn mutate_take(take: &mut TakeParts, rng: &mut Rng) {
    let count = take.entries.len();
    if count == 0 || rng.below(5) == 0 {
        mutate_in_place(&mut take.head[PREFIX_BYTES..]);
        return;
    }
    let i = rng.below(count);
    match rng.below(8) {
        0 => mutate_in_place(&mut take.entries[i]),
        1 => {
            let other = rng.below(count);
            take.entries.swap(i, other);
            take.segments.swap(i, other);
        }
        2 => take.segments.swap(i, rng.below(count)),
        3 => {
            take.entries.remove(i);
            take.segments.remove(i);
        }
        4 => {
            take.entries.insert(i, take.entries[i].clone());
            take.segments.insert(i, take.segments[i].clone());
        }
        _ => {
            let segment = &mut take.segments[i];
            *segment = mutated_package(segment, rng).unwrap_or_else(|| mutated(segment));
        }
    }
}

/// Whether [`Parts::new`] can take `package` apart: all lengths and offsets lie within it.
fn is_splittable(package: &[u8]) -> bool {
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

/// Mutates one part.
fn mutate_part(parts: &mut Parts, rng: &mut Rng) {
    let count = parts.table.len();
    if count == 0 || rng.below(5) == 0 {
        mutate_in_place(&mut parts.head[PREFIX_BYTES..]);
        return;
    }
    let i = rng.below(count);
    match rng.below(16) {
        0 => mutate_in_place(&mut parts.table[i]),
        1 => {
            parts.table.swap(i, rng.below(count));
        }
        2 => {
            parts.table.remove(i);
            parts.sections.remove(i);
        }
        3 => {
            // A section of an unknown kind, not critical.
            let mut entry = parts.table[i];
            entry[..2].copy_from_slice(&[9, 0]);
            parts.table.insert(i, entry);
            parts.sections.insert(i, Vec::new());
        }
        4 => parts.sections[i] = mutated(&parts.sections[i]),
        _ => mutate_payload(parts, i, rng),
    }
}

/// Mutates the decompressed payload of section `i`.
fn mutate_payload(parts: &mut Parts, i: usize, rng: &mut Rng) {
    let section = &mut parts.sections[i];
    let compressed = section.starts_with(&ZSTD_MAGIC);
    let raw = if compressed { zstd::bulk::decompress(section, RAW_BYTES_MAX) } else { Ok(section.clone()) };
    let Ok(mut raw) = raw else {
        *section = mutated(section);
        return;
    };
    // The counts determine the length of a compressed payload, so most mutations keep it.
    if compressed && rng.below(16) > 0 {
        mutate_in_place(&mut raw);
    } else {
        raw = mutated(&raw);
        put_u32(&mut parts.table[i], 16, raw.len());
    }
    *section =
        if compressed { zstd::bulk::compress(&raw, 1).expect("memory for a small frame") } else { raw };
}

fn mutate_in_place(bytes: &mut [u8]) {
    let size = bytes.len();
    fuzzer_mutate(bytes, size, size);
}

fn mutated(bytes: &[u8]) -> Vec<u8> {
    let mut result = bytes.to_vec();
    result.resize(bytes.len() + GROWTH, 0);
    let capacity = result.len();
    let size = fuzzer_mutate(&mut result, bytes.len(), capacity);
    result.truncate(size);
    result
}
