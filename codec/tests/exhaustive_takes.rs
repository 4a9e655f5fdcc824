//! Exhaustive damage to small takes of each coder: every prefix, nine changes of every byte, every byte of the head
//! changed under a valid checksum, every order of the table and of the segments. Each must be refused with a byte
//! offset, or leave segments that decode to their clips or to clips that fit the heads, within the limits on memory.
//! `exhaustive.rs` does the same to clips.
//!
//! `cargo test -p codec --test exhaustive_takes -- --nocapture` prints the outcomes. The allocator counts the whole
//! process, so this file is one test.

mod common;

use std::num::NonZero;

use codec::{Clip, Coder, Limits, Take, package};
use common::{TakeParts, put_u32, small_take};
use peak_alloc::PeakAlloc;
use properties::{LIMITS, check_package};

#[path = "../fuzz/src/properties.rs"]
#[allow(dead_code, unreachable_pub, reason = "a module of the fuzz targets")]
mod properties;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that the limits do not count: two heads, an error, the state of a coder, and the checks of one clip.
const UNCOUNTED_BYTES: usize = 32 << 10;

/// Changes of a byte: each bit, and all bits. A CRC-32 detects every change within 32 bits, so other changes of a byte
/// would show no more.
const MASKS: [u8; 9] = [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xff];

/// Tries one kind of damage.
type Trial = fn(&Subject, &mut Outcomes);

/// Outcomes of one kind of damage.
#[derive(Default)]
struct Outcomes {
    /// Takes whose head was refused.
    refused: usize,
    /// Segments that were refused alone.
    refused_segments: usize,
    /// Segments that decoded to the same clip.
    same: usize,
    /// Segments that decoded to another valid clip, or to fewer layers.
    other: usize,
    most_bytes: usize,
}

/// A take and its clips.
struct Subject {
    bytes: Vec<u8>,
    take: Take,
    clips: Vec<Clip>,
    parts: TakeParts,
}

impl Subject {
    fn new(coder: Coder) -> Subject {
        let bytes = small_take(coder);
        let take = package(&bytes, &LIMITS).unwrap();
        let mut clips = Vec::new();
        check_package(&bytes, |_, clip| clips.push(clip.unwrap()));
        Subject { take, clips, parts: TakeParts::new(&bytes).unwrap(), bytes }
    }

    /// Reads a damaged take and all of its segments, checks and counts the outcomes, and returns which segments
    /// decoded to the same clip; nothing if the head was refused.
    fn read(&self, damaged: &[u8], outcomes: &mut Outcomes) -> Option<Vec<bool>> {
        // A copy of exact length, so that a sanitizer sees a read past the end.
        let damaged = damaged.to_vec();
        ALLOCATOR.reset_peak_usage();
        let before = ALLOCATOR.current_usage();
        let (mut same, mut decoded) = (Vec::new(), 0);
        check_package(&damaged, |index, clip| {
            decoded += 1;
            match clip {
                Err(_) => outcomes.refused_segments += 1,
                Ok(clip) if self.clips.get(index) == Some(&clip) => {
                    outcomes.same += 1;
                    same.resize(index, false);
                    same.push(true);
                }
                Ok(_) => outcomes.other += 1,
            }
        });
        let peak = ALLOCATOR.peak_usage() - before;
        outcomes.most_bytes = outcomes.most_bytes.max(peak);
        let allowed = LIMITS.max_bytes + 3 * damaged.len() + UNCOUNTED_BYTES;
        assert!(peak <= allowed, "{peak} bytes at once, {allowed} allowed");
        match package(&damaged, &LIMITS) {
            Ok(_) => {
                same.resize(same.len().max(decoded), false);
                Some(same)
            }
            Err(_) => {
                outcomes.refused += 1;
                None
            }
        }
    }

    /// Every prefix: refused before the head is complete; then each segment as far as its layers go.
    fn truncate(&self, outcomes: &mut Outcomes) {
        for length in 0..self.bytes.len() {
            let same = self.read(&self.bytes[..length], outcomes);
            assert_eq!(same.is_some(), length >= self.take.head_bytes, "{length} bytes");
            for (index, same) in same.into_iter().flatten().enumerate() {
                let segment = &self.take.segments[index];
                let is_complete = segment.offset as usize + segment.bytes() <= length;
                assert_eq!(same, is_complete, "segment {index} of {length} bytes");
            }
        }
    }

    /// Every byte changed: the head is refused, or one segment alone.
    fn flip(&self, outcomes: &mut Outcomes) {
        for at in 0..self.take.head_bytes {
            let mut damaged = self.bytes.clone();
            for mask in MASKS {
                damaged[at] = self.bytes[at] ^ mask;
                assert_eq!(self.read(&damaged, outcomes), None, "byte {at} ^ {mask:02x}");
            }
        }
        let [bits @ .., all] = MASKS;
        for (index, segment) in self.take.segments.iter().enumerate() {
            for at in 0..segment.bytes() {
                let mut damaged = self.parts.segments[index].clone();
                for mask in bits {
                    damaged[at] = self.parts.segments[index][at] ^ mask;
                    let decoded = self.take.decode_segment(index, &damaged, &LIMITS, NonZero::<usize>::MIN);
                    assert!(decoded.is_err(), "segment {index}, byte {at} ^ {mask:02x}");
                    outcomes.refused_segments += 1;
                }
                // All bits in the whole take, whose other segments play.
                let mut damaged = self.bytes.clone();
                damaged[segment.offset as usize + at] ^= all;
                let same = self.read(&damaged, outcomes).expect("the head is right");
                assert!(
                    same.iter().enumerate().all(|(i, same)| *same == (i != index)),
                    "segment {index}: {same:?}"
                );
            }
        }
    }

    /// Every byte of the head changed, with a valid checksum.
    fn flip_under_checksum(&self, outcomes: &mut Outcomes) {
        let body = self.take.head_bytes - 4;
        for at in 0..body {
            for mask in MASKS {
                let mut damaged = self.bytes.clone();
                damaged[at] ^= mask;
                let crc = crc32fast::hash(&damaged[..body]);
                put_u32(&mut damaged, body, crc as usize);
                self.read(&damaged, outcomes);
            }
        }
    }

    /// Every byte of every segment changed, with valid checksums of its head and of the table: its own checksums
    /// detect it, or its clip is valid.
    fn flip_segments_under_checksums(&self, outcomes: &mut Outcomes) {
        for (index, package) in self.parts.segments.iter().enumerate() {
            let head_length = common::u32_at(package, 8);
            for at in 0..package.len() {
                for mask in MASKS {
                    let mut parts = self.parts.clone();
                    let segment = &mut parts.segments[index];
                    segment[at] ^= mask;
                    if at < head_length - 4 {
                        let crc = crc32fast::hash(&segment[..head_length - 4]);
                        put_u32(segment, head_length - 4, crc as usize);
                        put_u32(&mut parts.entries[index], 20, crc as usize);
                    }
                    self.read(&parts.join_as_they_are(), outcomes);
                }
            }
        }
    }

    /// Every order of the entries and, by itself, of the segments: only one is right.
    fn reorder(&self, outcomes: &mut Outcomes) {
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let is_right = order == [0, 1, 2];
            let entries = || order.map(|from| self.parts.entries[from].clone()).to_vec();
            let segments = || order.map(|from| self.parts.segments[from].clone()).to_vec();
            let both = TakeParts { entries: entries(), segments: segments(), ..self.parts.clone() };
            assert_eq!(self.read(&both.join_as_they_are(), outcomes).is_some(), is_right, "{order:?}");
            let table = TakeParts { entries: entries(), ..self.parts.clone() };
            assert_eq!(self.read(&table.join_as_they_are(), outcomes).is_some(), is_right, "{order:?}");
            let exchanged = TakeParts { segments: segments(), ..self.parts.clone() };
            let same = self.read(&exchanged.join_as_they_are(), outcomes).expect("the head is right");
            // A segment is in its place if its neighbours before it have their length together.
            let in_place = |index: usize| {
                let mut before = order[..index].to_vec();
                before.sort_unstable();
                order[index] == index && before.into_iter().eq(0..index)
            };
            assert!(
                same.iter().enumerate().all(|(index, same)| *same == in_place(index)),
                "{order:?}: {same:?}"
            );
        }
    }
}

/// A table of as many segments as there may be needs more than the limits of this file, and is refused for that.
fn large_tables_are_refused(subject: &Subject) {
    for count in [1_000, 20_000, 65_536] {
        let mut parts = subject.parts.clone();
        parts.entries = vec![parts.entries[0].clone(); count];
        for (i, entry) in parts.entries.iter_mut().enumerate() {
            // One after the other, 10 microseconds long.
            entry[..8].copy_from_slice(&(1e-5 * i as f64).to_le_bytes());
            entry[8..16].copy_from_slice(&1e-5f64.to_le_bytes());
        }
        let bytes = parts.join_as_they_are();
        ALLOCATOR.reset_peak_usage();
        let before = ALLOCATOR.current_usage();
        let read = package(&bytes[..], &LIMITS);
        let peak = ALLOCATOR.peak_usage() - before;
        let allowed = LIMITS.max_bytes + UNCOUNTED_BYTES;
        assert!(peak <= allowed, "{count} segments: {peak} bytes at once, {allowed} allowed");
        let enough = package(&bytes[..], &Limits { max_bytes: 16 << 20, ..LIMITS });
        assert!(enough.is_ok(), "{count}: {enough:?}");
        assert_eq!(read.is_ok(), count == 1_000 || count == 20_000, "{count}: {:?}", read.err());
    }
}

#[test]
fn damaged_takes_are_refused_or_play_what_is_left() {
    for coder in Coder::ALL {
        let subject = Subject::new(coder);
        println!("coder {}: {} bytes, head {}", coder.name(), subject.bytes.len(), subject.take.head_bytes);
        let kinds: [(&str, Trial); 5] = [
            ("prefixes", Subject::truncate),
            ("flips", Subject::flip),
            ("flips of the head under a valid checksum", Subject::flip_under_checksum),
            ("flips of segments under valid checksums", Subject::flip_segments_under_checksums),
            ("orders", Subject::reorder),
        ];
        for (kind, damage) in kinds {
            let mut outcomes = Outcomes::default();
            damage(&subject, &mut outcomes);
            let Outcomes { refused, refused_segments, same, other, most_bytes } = outcomes;
            println!(
                "{kind}: {refused} heads refused; of the other takes, {refused_segments} segments refused, {same} \
                 the same clip, {other} another; at most {most_bytes} bytes"
            );
            assert!(refused_segments > 0 && same > 0, "{kind}: one side is not tested");
        }
        large_tables_are_refused(&subject);
    }
}
