//! Sound of a package: what is written is read, what a damaged section gives, and that the Gaussians do not depend on it.

mod common;

use std::num::NonZero;

use codec::{
    Coder, Contents, EncodeError, Error, Limits, SectionKind, Sound, SoundInfo, contents, decode,
    encode_take_head, with_sound,
};
use common::{Parts, Rng, Shape, field, options, put_u32, static_field};

/// Bytes of a section before the lengths of its packets, as FORMAT.md has it.
const HEAD_BYTES: usize = 32;

/// A package with a plate and two layers of both regions.
fn package() -> Vec<u8> {
    let (field, plate) = (field(Shape::full(40), 1), static_field(8, 1, 2));
    common::package(&field, Some(&plate), &options(Coder::Rans, &[20]))
}

fn info() -> SoundInfo {
    SoundInfo {
        channels: 1,
        position: Some([0.5, -1.0, 2.0]),
        stream: 0xa5a5_0001,
        start: 480,
        length: 9_000,
        lead: 312,
        packet_samples: 960,
    }
}

/// Packets of 1 to 40 random bytes.
fn packets(count: usize) -> Vec<Vec<u8>> {
    let mut rng = Rng(3);
    let mut packet = || (0..=rng.below(40)).map(|_| rng.bits() as u8).collect();
    (0..count).map(|_| packet()).collect()
}

fn made(info: SoundInfo, packets: &[Vec<u8>]) -> Result<Sound, (&'static str, String)> {
    Sound::new(info, packets.iter().map(Vec::as_slice))
}

fn sound() -> Sound {
    made(info(), &packets(info().packet_count())).unwrap()
}

fn head(bytes: &[u8]) -> Contents {
    contents(bytes, &Limits::default()).unwrap()
}

fn read(bytes: &[u8]) -> Result<Option<Sound>, Error> {
    head(bytes).sound(bytes, &Limits::default())
}

/// Decodes everything but the sound.
fn decoded(bytes: &[u8]) -> codec::Clip {
    decode(bytes, &Limits::default()).unwrap()
}

#[test]
fn what_is_written_is_read_and_nothing_else_changes() {
    let plain = package();
    assert_eq!(read(&plain), Ok(None));
    let bytes = with_sound(&plain, Some(&sound())).unwrap();
    assert_eq!(read(&bytes), Ok(Some(sound())));
    assert_eq!(sound().packets().collect::<Vec<_>>(), packets(info().packet_count()));
    assert_eq!((sound().packet(0), sound().packet(10)), (Some(&packets(1)[0][..]), None));
    assert_eq!(decoded(&bytes), decoded(&plain));
    head(&bytes).check_sections(&bytes).unwrap();
    // One that is there is replaced, and taken out again.
    let other = made(SoundInfo { channels: 2, position: None, ..info() }, &packets(10)).unwrap();
    let replaced = with_sound(&bytes, Some(&other)).unwrap();
    assert_eq!(read(&replaced), Ok(Some(other)));
    assert_eq!(with_sound(&replaced, None).unwrap(), plain);
}

#[test]
fn the_sound_arrives_with_the_first_layer() {
    let bytes = with_sound(&package(), Some(&sound())).unwrap();
    let head = head(&bytes);
    assert_eq!(head.sections[0].kind, SectionKind::Sound);
    let first_layer = &bytes[..head.layer_bytes()[0]];
    assert_eq!(read(first_layer), Ok(Some(sound())));
    let cut = head.sound(&bytes[..head.sections[0].end() - 1], &Limits::default()).unwrap_err();
    assert!(cut.to_string().starts_with("package cut short"), "{cut}");
}

#[test]
fn readers_that_know_no_sound_skip_it() {
    // To them kind 3 is what kind 200 is to this one.
    let mut parts = Parts::new(&with_sound(&package(), Some(&sound())).unwrap());
    parts.table[0][0] = 200;
    let bytes = parts.join();
    assert_eq!(decoded(&bytes), decoded(&package()));
    assert_eq!(read(&bytes), Ok(None));
}

#[test]
fn damaged_sound_is_refused_alone() {
    let bytes = with_sound(&package(), Some(&sound())).unwrap();
    let at = head(&bytes).sections[0].offset;
    let mut damaged = bytes.clone();
    damaged[at + 40] ^= 1;
    let error = read(&damaged).unwrap_err().to_string();
    assert!(
        error.starts_with("damaged sound: CRC-32 is") && error.ends_with(&format!("at byte {at}")),
        "{error}"
    );
    assert_eq!(decoded(&damaged), decoded(&bytes));
    assert!(head(&damaged).check_sections(&damaged).is_err(), "inspect says so");
}

#[test]
fn every_change_under_a_valid_checksum_is_refused_with_an_offset_or_is_another_sound() {
    let parts = Parts::new(&with_sound(&package(), Some(&sound())).unwrap());
    let payload = parts.sections[0].clone();
    let mut outcomes = [0, 0];
    for at in 0..payload.len() {
        for mask in [0x01, 0x02, 0x08, 0x40, 0x80, 0xff] {
            let mut changed = payload.clone();
            changed[at] ^= mask;
            match read(&parts.with_payload(0, changed)) {
                Ok(Some(other)) => {
                    outcomes[0] += 1;
                    assert_ne!(other, sound(), "byte {at}");
                    assert_eq!(
                        made(*other.info(), &other.packets().map(<[u8]>::to_vec).collect::<Vec<_>>()),
                        Ok(other)
                    );
                }
                Ok(None) => panic!("byte {at}: the sound vanished"),
                Err(error) => {
                    outcomes[1] += 1;
                    let error = error.to_string();
                    let offset: usize = error.rsplit(' ').next().unwrap().parse().unwrap();
                    let range = parts.offset(0)..=parts.offset(0) + payload.len();
                    assert!(range.contains(&offset), "byte {at}: {error}");
                }
            }
        }
    }
    assert!(outcomes.iter().all(|count| *count > 50), "{outcomes:?}");
    for length in 0..payload.len() {
        assert!(read(&parts.with_payload(0, payload[..length].to_vec())).is_err(), "cut to {length} bytes");
    }
    let extra = read(&parts.with_payload(0, [&payload[..], &[0]].concat())).unwrap_err().to_string();
    assert!(extra.contains("1 extra bytes after sound"), "{extra}");
}

#[test]
fn numbers_out_of_range_are_named() {
    let parts = Parts::new(&with_sound(&package(), Some(&sound())).unwrap());
    let changed = |at: usize, bytes: &[u8]| {
        let mut payload = parts.sections[0].clone();
        payload[at..at + bytes.len()].copy_from_slice(bytes);
        let error = read(&parts.with_payload(0, payload)).expect_err("out of range").to_string();
        assert!(error.ends_with(&format!("at byte {}", parts.offset(0) + at)), "{error}");
        error
    };
    for (at, bytes, message) in [
        (0, &[2][..], "bad codec of the sound: 2"),
        (1, &[0], "bad channels of the sound: 0"),
        (1, &[3], "bad channels of the sound: 3"),
        (2, &[3], "bad flags of the sound"),
        (12, &[0; 4], "bad length of the sound: 0"),
        (12, &[0xff; 4], "bad length of the sound: 4294967295"),
        (18, &[0xc1, 3], "bad samples of a packet: 961"),
        (20, &[0, 0, 0xc0, 0x7f], "bad position of the sound"),
        (HEAD_BYTES, &[0, 0], "bad length of a packet: 0"),
    ] {
        let error = changed(at, bytes);
        assert!(error.contains(message), "{error}");
    }
    for (info, field) in [
        (SoundInfo { channels: 2, ..info() }, "channels of a sound with a position"),
        (SoundInfo { position: Some([f32::NAN; 3]), ..info() }, "position of the sound"),
        (SoundInfo { length: 0, ..info() }, "length of the sound"),
        (SoundInfo { start: u32::MAX, ..info() }, "length of the sound"),
        (SoundInfo { packet_samples: 0, ..info() }, "samples of a packet"),
        (SoundInfo { length: 9_600, ..info() }, "number of packets"),
    ] {
        assert_eq!(made(info, &packets(10)).unwrap_err().0, field);
    }
    assert_eq!(made(info(), &vec![Vec::new(); 10]).unwrap_err().0, "length of a packet");
    assert_eq!(made(info(), &vec![vec![0; 65_536]; 10]).unwrap_err().0, "length of a packet");
}

#[test]
fn a_table_with_sound_elsewhere_is_refused() {
    let parts = Parts::new(&with_sound(&package(), Some(&sound())).unwrap());
    let refused = |parts: &Parts| contents(&parts.join(), &Limits::default()).unwrap_err().to_string();
    for (at, value) in [(1, 1), (2, 1), (3, 1), (4, 1), (16, 1)] {
        let mut parts = parts.clone();
        parts.table[0][at] ^= value;
        let error = refused(&parts);
        assert!(error.contains("sound first, of layer 0"), "byte {at}: {error}");
    }
    let mut twice = parts.clone();
    twice.table.insert(0, parts.table[0]);
    twice.sections.insert(0, parts.sections[0].clone());
    let mut last = parts.clone();
    last.table.rotate_left(1);
    last.sections.rotate_left(1);
    for parts in [twice, last] {
        assert!(refused(&parts).contains("sound first"), "{}", refused(&parts));
    }
}

#[test]
fn limits_bound_the_memory_of_sound() {
    let bytes = with_sound(&package(), Some(&sound())).unwrap();
    let needed = |max_bytes| match head(&bytes).sound(&bytes, &Limits { max_bytes, ..Limits::default() }) {
        Ok(_) => None,
        Err(Error::Limits { needed, limit, .. }) if limit == max_bytes => Some(needed),
        Err(error) => panic!("{error}"),
    };
    let table = size_of_val(&head(&bytes).sections[..]);
    let all = table + 4 * sound().packets().len() + sound().packet_bytes();
    assert_eq!((needed(all), needed(all - 1)), (None, Some(all)));
    assert!(needed(0).is_some());
    // A number of packets that the section cannot hold is refused before anything is allocated for it.
    let parts = Parts::new(&bytes);
    let mut payload = parts.sections[0].clone();
    put_u32(&mut payload, 12, 4_000_000_000);
    let error = read(&parts.with_payload(0, payload)).unwrap_err().to_string();
    assert!(error.contains("sound is too short"), "{error}");
    // And so is a packet that is longer than the section, at any limit.
    let mut payload = parts.sections[0].clone();
    payload[HEAD_BYTES..HEAD_BYTES + 2].copy_from_slice(&[0xff; 2]);
    let bytes = parts.with_payload(0, payload);
    let limits = Limits { max_bytes: 4_096, ..Limits::default() };
    let error = head(&bytes).sound(&bytes, &limits).unwrap_err().to_string();
    assert!(error.contains("sound is too short"), "{error}");
}

#[test]
fn segments_of_a_take_have_sounds_of_their_own() {
    let plain = package();
    let package = with_sound(&plain, Some(&sound())).unwrap();
    let [head, silent] = [&package, &plain].map(|bytes| head(bytes));
    let segment = |start_s, contents| codec::SegmentPackage { start_s, duration_s: 1.32, level: 0, contents };
    let (first, second) = (segment(0.0, &head), segment(1.4, &silent));
    let mut bytes = encode_take_head(&common::info(), 2.72, &[first, second]).unwrap();
    bytes.extend_from_slice(&package);
    bytes.extend_from_slice(&plain);
    let take = codec::package(&bytes, &Limits::default()).unwrap();
    let part = |index: usize, layers: usize| {
        let segment = &take.segments[index];
        &bytes[segment.offset as usize..][..segment.layers[layers].bytes]
    };
    for layers in [0, 1] {
        let segment = take.segment_contents(0, part(0, layers), &Limits::default()).unwrap();
        assert_eq!(segment.sound(part(0, layers), &Limits::default()), Ok(Some(sound())));
    }
    let second = take.segment_contents(1, part(1, 1), &Limits::default()).unwrap();
    assert_eq!(second.sound(part(1, 1), &Limits::default()), Ok(None));
    let one = NonZero::<usize>::MIN;
    let clip = |index| take.decode_segment(index, part(index, 1), &Limits::default(), one).unwrap();
    assert_eq!(clip(0), clip(1));
}

#[test]
fn only_whole_clip_packages_take_sound() {
    let bytes = package();
    for part in [&bytes[..bytes.len() - 1], &bytes[..40], b"nothing"] {
        assert!(matches!(with_sound(part, Some(&sound())), Err(EncodeError::Package(_))));
    }
}
