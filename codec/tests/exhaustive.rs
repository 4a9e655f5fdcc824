//! Exhaustive damage to small packages of each coder: every prefix, nine changes of every byte, every
//! byte changed under valid checksums, and every order of the section table. Each must be refused with
//! a byte offset, or decode to the clip, to its first layers, or to a clip that fits the head, within
//! the limits on memory. `src/counters/tests.rs` bounds the work, on larger packages.
//!
//! `cargo test -p codec --test exhaustive -- --nocapture` prints the outcomes. The allocator counts the
//! whole process, so this file is one test.

mod common;

use codec::{Clip, Coder, Contents, Error, Limits, SectionKind, contents, decode};
use common::{Parts, Shape, field, options, package, put_u32, static_field};
use peak_alloc::PeakAlloc;
use properties::{LIMITS, check_decoding};

#[path = "../fuzz/src/properties.rs"]
#[allow(dead_code, unreachable_pub, reason = "a module of the fuzz targets")]
mod properties;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that the limits do not count: the head, an error, the state of a coder.
const UNCOUNTED_BYTES: usize = 16 << 10;

/// Changes of a byte: each bit, and all bits. A CRC-32 detects every change within 32 bits, so other changes of a byte
/// would show no more.
const MASKS: [u8; 9] = [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xff];

/// Tries one kind of damage.
type Trial = fn(&Subject, &mut Outcomes);

/// Outcomes of one kind of damage.
#[derive(Default)]
struct Outcomes {
    refused: usize,
    /// Decoded to the same clip.
    same: usize,
    /// Decoded to fewer layers.
    shorter: usize,
    /// Decoded to another valid clip.
    other: usize,
    most_bytes: usize,
}

/// A package, its clip and the memory that decoding takes.
struct Subject {
    bytes: Vec<u8>,
    head: Contents,
    clip: Clip,
    /// The smallest limits that suffice.
    smallest: Limits,
}

impl Subject {
    /// A package with a plate, two layers of both regions, all columns, and a section of an unknown
    /// kind at the end.
    fn new(coder: Coder) -> Subject {
        let field = field(Shape { sh_degree: 1, ..Shape::full(8) }, 1);
        let package = package(&field, Some(&static_field(2, 0, 2)), &options(coder, &[4]));
        let mut parts = Parts::new(&package);
        parts.table.push([200, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        parts.sections.push(b"from the future".to_vec());
        let bytes = parts.join();
        let decodes = |max_bytes| decode(&bytes, &Limits { max_bytes, ..LIMITS }).is_ok();
        let (mut too_few, mut enough) = (0, LIMITS.max_bytes);
        while enough - too_few > 1 {
            let midpoint = too_few.midpoint(enough);
            *(if decodes(midpoint) { &mut enough } else { &mut too_few }) = midpoint;
        }
        Subject {
            head: contents(&bytes, &LIMITS).unwrap(),
            clip: decode(&bytes, &LIMITS).unwrap(),
            smallest: Limits { max_bytes: enough, ..LIMITS },
            bytes,
        }
    }

    /// Decodes a damaged package within the smallest limits and, if these do not suffice, within more.
    /// Checks and counts the outcome.
    fn decode(&self, damaged: &[u8], outcomes: &mut Outcomes) -> Result<Clip, Error> {
        // A copy of exact length, so that a sanitizer sees a read past the end.
        let damaged = damaged.to_vec();
        let mut measured = |limits: &Limits| {
            ALLOCATOR.reset_peak_usage();
            let before = ALLOCATOR.current_usage();
            let decoded = decode(&damaged, limits);
            let peak = ALLOCATOR.peak_usage() - before;
            let allowed = limits.max_bytes + 3 * damaged.len() + UNCOUNTED_BYTES;
            assert!(peak <= allowed, "{peak} bytes at once, {allowed} allowed");
            outcomes.most_bytes = outcomes.most_bytes.max(peak);
            decoded
        };
        let mut decoded = measured(&self.smallest);
        if let Err(Error::Limits { .. }) = decoded {
            decoded = measured(&LIMITS);
        }
        check_decoding(&damaged, &decoded);
        match &decoded {
            Err(_) => outcomes.refused += 1,
            Ok(clip) if *clip == self.clip => outcomes.same += 1,
            Ok(clip) if clip.layers.len() < clip.layers_announced.len() => outcomes.shorter += 1,
            Ok(_) => outcomes.other += 1,
        }
        decoded
    }

    /// Every prefix: refused before the first layer is complete, otherwise its complete layers.
    fn truncate(&self, outcomes: &mut Outcomes) {
        let layers = self.head.layer_bytes();
        for length in 0..self.bytes.len() {
            let decoded = self.decode(&self.bytes[..length], outcomes);
            let complete = layers.iter().filter(|end| **end <= length).count();
            if complete == 0 {
                assert!(decoded.is_err(), "{length} bytes");
                continue;
            }
            let clip = decoded.unwrap_or_else(|error| panic!("{length} bytes: {error}"));
            let end = self.clip.layers[complete - 1];
            assert_eq!((&clip.layers[..], &clip.plate), (&self.clip.layers[..complete], &self.clip.plate));
            assert_eq!(
                clip.static_field,
                self.clip.static_field.select(&(0..end.static_count).collect::<Vec<_>>())
            );
            assert_eq!(
                clip.dynamic_field,
                self.clip.dynamic_field.select(&(0..end.dynamic_count).collect::<Vec<_>>())
            );
        }
    }

    /// Every byte changed: a checksum detects it, except in a skipped section.
    fn flip(&self, outcomes: &mut Outcomes) {
        let skipped =
            self.head.sections.iter().find(|section| matches!(section.kind, SectionKind::Unknown(_)));
        let skipped = skipped.unwrap().offset;
        for at in 0..self.bytes.len() {
            for mask in MASKS {
                let mut damaged = self.bytes.clone();
                damaged[at] ^= mask;
                let decoded = self.decode(&damaged, outcomes);
                assert_eq!(decoded.is_err(), at < skipped, "byte {at} ^ {mask:02x}");
                assert!(decoded.is_err() || decoded.unwrap() == self.clip);
            }
        }
    }

    /// Every byte changed, with valid checksums.
    fn flip_under_checksums(&self, outcomes: &mut Outcomes) {
        for at in 0..self.bytes.len() {
            for mask in MASKS {
                let mut damaged = self.bytes.clone();
                damaged[at] ^= mask;
                self.fix_checksums(&mut damaged);
                let _ = self.decode(&damaged, outcomes);
            }
        }
    }

    /// Every byte changed before compression, of the coder `fixed`.
    fn flip_under_compression(&self, outcomes: &mut Outcomes) {
        let parts = Parts::new(&self.bytes);
        for (i, section) in self.head.sections.iter().enumerate() {
            if section.kind != SectionKind::Gaussians {
                continue;
            }
            let raw = parts.raw(i);
            for at in 0..raw.len() {
                for mask in MASKS {
                    let mut damaged = parts.clone();
                    let mut raw = raw.clone();
                    raw[at] ^= mask;
                    damaged.set_raw(i, &raw);
                    let _ = self.decode(&damaged.join(), outcomes);
                }
            }
        }
    }

    /// Every order of the section table, by itself and with the sections in the same order. Only the
    /// skipped section may move, together with its entry.
    fn reorder(&self, outcomes: &mut Outcomes) {
        let parts = Parts::new(&self.bytes);
        let table_at = parts.head.len();
        let mut read = 0;
        for_each_order(parts.table.len(), |order| {
            let mut damaged = self.bytes.clone();
            for (entry, from) in damaged[table_at..].chunks_mut(24).zip(order) {
                let at = table_at + 24 * from;
                entry.copy_from_slice(&self.bytes[at..at + 24]);
            }
            self.fix_head_checksum(&mut damaged);
            let moved = order.iter().enumerate().any(|(i, from)| i != *from);
            assert_eq!(self.decode(&damaged, outcomes).is_err(), moved, "{order:?}");

            let mut damaged = parts.clone();
            damaged.table = order.iter().map(|from| parts.table[*from]).collect();
            damaged.sections = order.iter().map(|from| parts.sections[*from].clone()).collect();
            let known = order.iter().filter(|from| **from + 1 < order.len());
            let decoded = self.decode(&damaged.join(), outcomes);
            assert_eq!(decoded.is_ok(), known.is_sorted(), "{order:?}");
            if let Ok(clip) = decoded {
                assert!(clip == self.clip, "{order:?}");
                read += 1;
            }
        });
        assert_eq!(read, parts.table.len(), "a skipped section may be anywhere");
    }

    /// Recomputes the checksums of changed sections and of the head.
    fn fix_checksums(&self, damaged: &mut [u8]) {
        let table = self.head.head_bytes - 4 - 24 * self.head.sections.len();
        for (i, section) in self.head.sections.iter().enumerate() {
            let changed = damaged[section.offset..section.end()] != self.bytes[section.offset..section.end()];
            if changed {
                let crc = crc32fast::hash(&damaged[section.offset..section.end()]);
                put_u32(damaged, table + 24 * i + 20, crc as usize);
            }
        }
        self.fix_head_checksum(damaged);
    }

    fn fix_head_checksum(&self, damaged: &mut [u8]) {
        let body = self.head.head_bytes - 4;
        // A change of the checksum itself stays.
        if damaged[..body] != self.bytes[..body] {
            let crc = crc32fast::hash(&damaged[..body]);
            put_u32(damaged, body, crc as usize);
        }
    }
}

/// Calls `visit` with every permutation of the numbers below `count` (Heap's algorithm).
fn for_each_order(count: usize, mut visit: impl FnMut(&[usize])) {
    let mut order: Vec<usize> = (0..count).collect();
    let mut turns = vec![0; count];
    visit(&order);
    let mut i = 1;
    while i < count {
        if turns[i] < i {
            order.swap(if i % 2 == 0 { 0 } else { turns[i] }, i);
            visit(&order);
            turns[i] += 1;
            i = 1;
        } else {
            turns[i] = 0;
            i += 1;
        }
    }
}

#[test]
fn damaged_packages_are_refused_or_decode_to_valid_clips() {
    let mut orders = 0;
    for_each_order(5, |_| orders += 1);
    assert_eq!(orders, 120);
    for coder in Coder::ALL {
        let subject = Subject::new(coder);
        let kinds: [(&str, Trial); 5] = [
            ("prefixes", Subject::truncate),
            ("flips", Subject::flip),
            ("flips under valid checksums", Subject::flip_under_checksums),
            ("flips under compression", Subject::flip_under_compression),
            ("orders of the table", Subject::reorder),
        ];
        let (bytes, sections) = (subject.bytes.len(), subject.head.sections.len());
        println!("coder {}: {bytes} bytes, {sections} sections", coder.name());
        for (kind, damage) in kinds {
            if kind == "flips under compression" && coder != Coder::Fixed {
                continue;
            }
            let mut outcomes = Outcomes::default();
            damage(&subject, &mut outcomes);
            let Outcomes { refused, same, shorter, other, most_bytes } = outcomes;
            let tried = refused + same + shorter + other;
            println!(
                "{kind}: {tried} tried; {refused} refused, {same} the same clip, {shorter} its first layers, \
                 {other} another; at most {most_bytes} bytes"
            );
            assert!(refused > 0 && tried > refused, "{kind}: one side is not tested");
        }
    }
}
