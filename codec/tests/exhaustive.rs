//! All damage of one kind, on small packages by both coders: every cut, every byte as every other
//! byte, every byte changed under checksums that are true again, and every order of the section
//! table. Each is refused with a byte offset, or gives the clip, its first layers, or one as its
//! head announces it; within the limits on memory, and soon.
//!
//! What was tried and what came of it is printed:
//! `cargo test -p codec --test exhaustive -- --nocapture`. The counter of memory sees the whole
//! process, so this file is one test.

mod common;

use std::time::{Duration, Instant};

use codec::{
    Clip, Coder, Contents, EncodeOptions, Error, Limits, SectionKind, Source, contents, decode, encode,
};
use common::{Parts, Shape, field, info, put_u32, static_field};
use peak_alloc::PeakAlloc;
use properties::{CODERS, LIMITS, check_decoding};

#[path = "../fuzz/src/properties.rs"]
#[allow(dead_code, unreachable_pub, reason = "the fuzz targets use it from outside")]
mod properties;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory beside what limits count: the head, an error, the state of a coder.
const UNCOUNTED_BYTES: usize = 16 << 10;

/// Longest time for one decoding, which takes microseconds.
const PATIENCE: Duration = Duration::from_secs(10);

/// What a byte is combined with where not all other bytes are tried: its bits, one by one and all.
const MASKS: [u8; 9] = [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xff];

/// Tries one kind of damage.
type Kind = fn(&Subject, &mut Tally);

/// What came of one kind of damage.
#[derive(Default)]
struct Tally {
    refused: usize,
    whole: usize,
    /// Decoded, with fewer layers.
    shorter: usize,
    /// Decoded, and not the clip that it was: nothing can tell.
    other: usize,
    most_bytes: usize,
    longest: Duration,
}

/// A package with its clip and what decoding it takes.
struct Subject {
    bytes: Vec<u8>,
    head: Contents,
    clip: Clip,
    /// The least memory that it can be decoded in.
    least: Limits,
}

impl Subject {
    /// Plate, two layers of both regions, all columns, and a section from the future at the end.
    fn new(coder: Coder) -> Subject {
        let (info, field, plate) =
            (info(), field(Shape { sh_degree: 1, ..Shape::full(8) }, 1), static_field(2, 0, 2));
        let options = EncodeOptions { coder, layers: vec![4], ..EncodeOptions::default() };
        let package = encode(&Source { info: &info, field: &field, plate: Some(&plate) }, &options).unwrap();
        let mut parts = Parts::of(&package);
        parts.table.push([200, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        parts.sections.push(b"from the future".to_vec());
        let bytes = parts.join();
        let decodes = |max_bytes| decode(&bytes, &Limits { max_bytes, ..LIMITS }).is_ok();
        let (mut too_few, mut enough) = (0, LIMITS.max_bytes);
        while enough - too_few > 1 {
            let middle = too_few.midpoint(enough);
            *(if decodes(middle) { &mut enough } else { &mut too_few }) = middle;
        }
        Subject {
            head: contents(&bytes, &LIMITS).unwrap(),
            clip: decode(&bytes, &LIMITS).unwrap(),
            least: Limits { max_bytes: enough, ..LIMITS },
            bytes,
        }
    }

    /// Decodes a copy of what became of the package, in as little memory as the package takes and, where
    /// that is refused, in more, and adds what came of it to the tally.
    fn decode(&self, damaged: &[u8], tally: &mut Tally) -> Result<Clip, Error> {
        // As long as it is, so that a sanitizer would see a read past the end.
        let damaged = damaged.to_vec();
        let mut measured = |limits: &Limits| {
            ALLOCATOR.reset_peak_usage();
            let (before, start) = (ALLOCATOR.current_usage(), Instant::now());
            let decoded = decode(&damaged, limits);
            let (peak, elapsed) = (ALLOCATOR.peak_usage() - before, start.elapsed());
            let allowed = limits.max_bytes + 3 * damaged.len() + UNCOUNTED_BYTES;
            assert!(peak <= allowed, "{peak} bytes at once, {allowed} allowed");
            assert!(elapsed < PATIENCE, "{elapsed:?}");
            tally.most_bytes = tally.most_bytes.max(peak);
            tally.longest = tally.longest.max(elapsed);
            decoded
        };
        let mut decoded = measured(&self.least);
        if let Err(Error::Limits { .. }) = decoded {
            decoded = measured(&LIMITS);
        }
        check_decoding(&damaged, &decoded);
        match &decoded {
            Err(_) => tally.refused += 1,
            Ok(clip) if *clip == self.clip => tally.whole += 1,
            Ok(clip) if clip.layers.len() < clip.layers_announced => tally.shorter += 1,
            Ok(_) => tally.other += 1,
        }
        decoded
    }

    /// Every cut: refused before the first layer is whole, that layer alone after it.
    fn cut(&self, tally: &mut Tally) {
        let layers = self.head.layer_bytes();
        for length in 0..self.bytes.len() {
            let decoded = self.decode(&self.bytes[..length], tally);
            let whole = layers.iter().filter(|end| **end <= length).count();
            if whole == 0 {
                assert!(decoded.is_err(), "{length} bytes");
                continue;
            }
            let clip = decoded.unwrap_or_else(|error| panic!("{length} bytes: {error}"));
            let end = self.clip.layers[whole - 1];
            assert_eq!((&clip.layers[..], &clip.plate), (&self.clip.layers[..whole], &self.clip.plate));
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

    /// Every byte as every other one: a checksum tells, but for a section that nobody reads.
    fn flip(&self, tally: &mut Tally) {
        let skipped =
            self.head.sections.iter().find(|section| matches!(section.kind, SectionKind::Unknown(_)));
        let skipped = skipped.unwrap().offset;
        for at in 0..self.bytes.len() {
            for mask in 1..=255 {
                let mut damaged = self.bytes.clone();
                damaged[at] ^= mask;
                let decoded = self.decode(&damaged, tally);
                assert_eq!(decoded.is_err(), at < skipped, "byte {at} ^ {mask:02x}");
                assert!(decoded.is_err() || decoded.unwrap() == self.clip);
            }
        }
    }

    /// Every byte changed, and all checksums true again: whatever it says then, it is whole in itself.
    fn lie(&self, tally: &mut Tally) {
        for at in 0..self.bytes.len() {
            for mask in MASKS {
                let mut damaged = self.bytes.clone();
                damaged[at] ^= mask;
                self.mend(&mut damaged);
                let _ = self.decode(&damaged, tally);
            }
        }
    }

    /// The same to what sections hold before compression, which the coder `fixed` does.
    fn lie_within(&self, tally: &mut Tally) {
        let parts = Parts::of(&self.bytes);
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
                    let _ = self.decode(&damaged.join(), tally);
                }
            }
        }
    }

    /// Every order of the section table, alone and with the sections in that order: only one that
    /// moves nothing but what is skipped is read.
    fn reorder(&self, tally: &mut Tally) {
        let parts = Parts::of(&self.bytes);
        let table_at = parts.head.len();
        let mut read = 0;
        for_each_order(parts.table.len(), |order| {
            let mut damaged = self.bytes.clone();
            for (entry, from) in damaged[table_at..].chunks_mut(24).zip(order) {
                let at = table_at + 24 * from;
                entry.copy_from_slice(&self.bytes[at..at + 24]);
            }
            self.mend_head(&mut damaged);
            let moved = order.iter().enumerate().any(|(i, from)| i != *from);
            assert_eq!(self.decode(&damaged, tally).is_err(), moved, "{order:?}");

            let mut damaged = parts.clone();
            damaged.table = order.iter().map(|from| parts.table[*from]).collect();
            damaged.sections = order.iter().map(|from| parts.sections[*from].clone()).collect();
            let known = order.iter().filter(|from| **from + 1 < order.len());
            let decoded = self.decode(&damaged.join(), tally);
            assert_eq!(decoded.is_ok(), known.is_sorted(), "{order:?}");
            if let Ok(clip) = decoded {
                assert!(clip == self.clip, "{order:?}");
                read += 1;
            }
        });
        assert_eq!(read, parts.table.len(), "what is skipped may stand anywhere");
    }

    /// Makes the checksums of `damaged` true, which has its sections where they were.
    fn mend(&self, damaged: &mut [u8]) {
        let table = self.head.head_bytes - 4 - 24 * self.head.sections.len();
        for (i, section) in self.head.sections.iter().enumerate() {
            let changed = damaged[section.offset..section.end()] != self.bytes[section.offset..section.end()];
            if changed {
                let crc = crc32fast::hash(&damaged[section.offset..section.end()]);
                put_u32(damaged, table + 24 * i + 20, crc as usize);
            }
        }
        self.mend_head(damaged);
    }

    fn mend_head(&self, damaged: &mut [u8]) {
        let body = self.head.head_bytes - 4;
        // What was changed in the checksum itself stays.
        if damaged[..body] != self.bytes[..body] {
            let crc = crc32fast::hash(&damaged[..body]);
            put_u32(damaged, body, crc as usize);
        }
    }
}

/// Calls `look` with every order of the numbers below `count` (Heap's algorithm).
fn for_each_order(count: usize, mut look: impl FnMut(&[usize])) {
    let mut order: Vec<usize> = (0..count).collect();
    let mut turns = vec![0; count];
    look(&order);
    let mut i = 1;
    while i < count {
        if turns[i] < i {
            order.swap(if i % 2 == 0 { 0 } else { turns[i] }, i);
            look(&order);
            turns[i] += 1;
            i = 1;
        } else {
            turns[i] = 0;
            i += 1;
        }
    }
}

#[test]
fn all_damage_of_a_kind_is_refused_or_plays() {
    let mut orders = 0;
    for_each_order(5, |_| orders += 1);
    assert_eq!(orders, 120);
    for coder in CODERS {
        let subject = Subject::new(coder);
        let kinds: [(&str, Kind); 5] = [
            ("cuts", Subject::cut),
            ("flips", Subject::flip),
            ("flips under true checksums", Subject::lie),
            ("flips under compression", Subject::lie_within),
            ("orders of the table", Subject::reorder),
        ];
        let (bytes, sections) = (subject.bytes.len(), subject.head.sections.len());
        println!("coder {}: {bytes} bytes, {sections} sections", coder.name());
        for (kind, damage) in kinds {
            if kind == "flips under compression" && coder != Coder::Fixed {
                continue;
            }
            let mut tally = Tally::default();
            damage(&subject, &mut tally);
            let Tally { refused, whole, shorter, other, most_bytes, longest } = tally;
            let tried = refused + whole + shorter + other;
            println!(
                "{kind}: {tried} tried; {refused} refused, {whole} the same clip, {shorter} its first layers, \
                 {other} another; at most {most_bytes} bytes, {longest:?}"
            );
            assert!(refused > 0 && tried > refused, "{kind}: one side is not tested");
        }
    }
}
