//! Posters in clips and takes: they are read as they were written, change nothing else, and a damaged one is refused
//! alone.

mod common;

use codec::{
    Coder, Contents, Error, Limits, Poster, SectionKind, Sound, SoundInfo, contents, decode, poster,
    with_poster, with_sound,
};
use common::{Shape, field, options, package, small_take};

const POSTER: Poster =
    Poster { time_s: 0.75, position: [1.0, -2.0, 3.5], target: [0.0, 0.25, 0.0], fov_y: 0.9 };

fn limits() -> Limits {
    Limits::default()
}

fn clip(coder: Coder) -> Vec<u8> {
    package(&field(Shape::full(21), 1), None, &options(coder, &[8]))
}

fn head(package: &[u8]) -> Contents {
    contents(package, &limits()).unwrap()
}

#[test]
fn a_poster_is_read_as_it_was_written_and_changes_no_gaussian() {
    for coder in Coder::ALL {
        let bare = clip(coder);
        assert_eq!(poster(&bare, &limits()).unwrap(), None);
        let posted = with_poster(&bare, Some(&POSTER), &limits()).unwrap();
        assert_eq!(posted.len(), bare.len() + 60, "an entry of 24 bytes and 36 bytes");
        assert_eq!(poster(&posted, &limits()).unwrap(), Some(POSTER));
        assert_eq!(decode(&posted, &limits()).unwrap(), decode(&bare, &limits()).unwrap());
        let new = head(&posted);
        new.check_sections(&posted).unwrap();
        // It arrives with the first layer.
        assert_eq!(poster(&posted[..new.layer_bytes()[0]], &limits()).unwrap(), Some(POSTER));

        let other = Poster { time_s: 0.0, ..POSTER };
        let again = with_poster(&posted, Some(&other), &limits()).unwrap();
        assert_eq!(poster(&again, &limits()).unwrap(), Some(other));
        assert!(with_poster(&again, None, &limits()).unwrap() == bare, "the clip as it was");
        assert!(with_poster(&bare[..bare.len() - 1], None, &limits()).is_err(), "cut short");
    }
}

#[test]
fn the_poster_of_a_take_is_in_its_first_segment_and_leaves_the_others_as_they_are() {
    let bare = small_take(Coder::Fixed);
    let take_of = |bytes: &[u8]| codec::package(bytes, &limits()).unwrap();
    let take = take_of(&bare);
    let end = take.head_bytes + take.segments[0].bytes();
    assert!(take.segments.len() > 1 && end < bare.len(), "there are others");
    let start = with_poster(&bare[..end], Some(&POSTER), &limits()).unwrap();
    let posted = [&start, &bare[end..]].concat();
    let new = take_of(&posted);
    assert_eq!(poster(&posted, &limits()).unwrap(), Some(POSTER));
    assert_eq!(new.segments.len(), take.segments.len());
    for index in 0..take.segments.len() {
        let decoded = |take: &codec::Take, bytes: &[u8]| {
            let segment = &take.segments[index];
            let bytes = &bytes[segment.offset as usize..][..segment.bytes()];
            take.decode_segment(index, bytes, &limits(), std::num::NonZero::<usize>::MIN).unwrap()
        };
        assert_eq!(decoded(&new, &posted), decoded(&take, &bare), "segment {index}");
    }
    assert!(with_poster(&bare[..end - 1], Some(&POSTER), &limits()).is_err(), "cut short");
}

#[test]
fn sound_and_a_poster_come_and_go_in_any_order() {
    let bare = clip(Coder::Rans);
    let info = SoundInfo {
        channels: 1,
        position: None,
        stream: 1,
        start: 0,
        length: 960,
        lead: 312,
        packet_samples: 960,
    };
    let packets = vec![[7; 9]; info.packet_count()];
    let sound = Sound::new(info, packets.iter().map(<[u8; 9]>::as_slice)).unwrap();
    let posted = with_poster(&bare, Some(&POSTER), &limits()).unwrap();
    let heard = with_sound(&bare, Some(&sound)).unwrap();
    let both = with_sound(&posted, Some(&sound)).unwrap();
    assert!(both == with_poster(&heard, Some(&POSTER), &limits()).unwrap(), "the same bytes in either order");
    assert_eq!(head(&both).sound(&both, &limits()).unwrap(), Some(sound));
    assert_eq!(poster(&both, &limits()).unwrap(), Some(POSTER));
    assert!(with_sound(&both, None).unwrap() == posted, "without sound, the poster stays");
    assert!(with_poster(&both, None, &limits()).unwrap() == heard, "without the poster, the sound stays");
    assert!(with_sound(&posted, None).unwrap() == posted, "there was no sound");
}

#[test]
fn a_damaged_poster_is_refused_alone() {
    let mut posted = with_poster(&clip(Coder::Rans), Some(&POSTER), &limits()).unwrap();
    let section = head(&posted).sections[0];
    assert_eq!(section.kind, SectionKind::Poster);
    posted[section.offset] ^= 1;
    let error = poster(&posted, &limits()).unwrap_err();
    assert!(error.to_string().contains("damaged poster"), "{error}");
    assert!(head(&posted).check_sections(&posted).is_err());
    decode(&posted, &limits()).unwrap();
}

#[test]
fn numbers_out_of_range_are_neither_written_nor_read() {
    let bare = clip(Coder::Fixed);
    for bad in [
        Poster { time_s: f64::NAN, ..POSTER },
        Poster { position: [f32::INFINITY, 0.0, 0.0], ..POSTER },
        Poster { target: [0.0, f32::NAN, 0.0], ..POSTER },
        Poster { fov_y: 0.0, ..POSTER },
        Poster { fov_y: 3.2, ..POSTER },
    ] {
        assert!(with_poster(&bare, Some(&bad), &limits()).is_err(), "{bad:?}");
    }
    // A field of view of 0 with the right checksums.
    let mut posted = with_poster(&bare, Some(&POSTER), &limits()).unwrap();
    let contents = head(&posted);
    let section = contents.sections[0];
    posted[section.offset + 32..section.end()].fill(0);
    let crc = crc32fast::hash(&posted[section.offset..section.end()]).to_le_bytes();
    let table = contents.head_bytes - 4 - 24 * contents.sections.len();
    posted[table + 20..table + 24].copy_from_slice(&crc);
    let crc = crc32fast::hash(&posted[..contents.head_bytes - 4]).to_le_bytes();
    posted[contents.head_bytes - 4..contents.head_bytes].copy_from_slice(&crc);
    assert!(matches!(poster(&posted, &limits()), Err(Error::Format { .. })));
    decode(&posted, &limits()).unwrap();
}

#[test]
fn the_table_has_one_poster_before_all_chunks() {
    let posted = with_poster(&clip(Coder::Fixed), Some(&POSTER), &limits()).unwrap();
    let contents = head(&posted);
    let table = contents.head_bytes - 4 - 24 * contents.sections.len();
    // Critical, of layer 1, of another region, a second chunk.
    for (byte, value) in [(1, 1), (2, 1), (3, 1), (4, 1)] {
        let mut changed = posted.clone();
        changed[table + byte] = value;
        let crc = crc32fast::hash(&changed[..contents.head_bytes - 4]).to_le_bytes();
        changed[contents.head_bytes - 4..contents.head_bytes].copy_from_slice(&crc);
        let error = codec::contents(&changed, &limits()).unwrap_err();
        assert!(error.to_string().contains("poster"), "byte {byte}: {error}");
    }
}
