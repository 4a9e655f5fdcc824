//! [`SoundTrack`]: the sounds of a clip, or of the segments of a take that were loaded, on one time line.
//!
//! The loader of segments adds to it, the player drops what it no longer needs, and the sound thread reads. They share it.

use codec::{Contents, Limits};
#[cfg(feature = "audio")]
use codec::{SOUND_RATE_HZ, Sound};
#[cfg(feature = "audio")]
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most bytes of sounds of a take in memory: an hour of stereo. The latest sound stays even if it is larger; the limits of
/// the decoder bound it.
#[cfg(feature = "audio")]
const BYTES_MAX: usize = 64 << 20;

/// Most samples between the end of a sound and the beginning of the sound that continues its stream: each lies at most
/// half a sample beside its place in the stream. The thousandth is for sums of seconds.
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
const JOINS_WITHIN: f64 = 1.001;

/// The sounds of what is on display. Clones share them.
#[derive(Clone, Debug, Default)]
pub(crate) struct SoundTrack {
    #[cfg(feature = "audio")]
    parts: Arc<Mutex<TrackParts>>,
}

/// What is known of a track.
#[cfg(feature = "audio")]
#[derive(Debug, Default)]
struct TrackParts {
    /// At most one of each segment, the latest one last.
    sounds: Vec<PlacedSound>,
    /// What there is to say of a sound that cannot be heard.
    note: Option<String>,
}

/// A sound with its place in time.
#[cfg(feature = "audio")]
#[derive(Clone, Debug)]
#[cfg_attr(not(any(feature = "window", feature = "xr")), allow(dead_code, reason = "only displays play it"))]
pub(super) struct PlacedSound {
    /// Number of its segment in the file; 0 in a clip.
    segment: usize,
    /// Time of its first sample that is heard, in samples: exact, and where it is played.
    exact_start: f64,
    pub(super) start: i64,
    pub(super) sound: Arc<Sound>,
}

/// Until when a sound is heard, and what follows.
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Course {
    /// Sample up to which it is heard.
    pub(super) until: i64,
    /// Whether another sound continues its stream there.
    pub(super) is_continued: bool,
}

#[cfg(feature = "audio")]
#[cfg_attr(not(any(feature = "window", feature = "xr")), allow(dead_code, reason = "only displays play it"))]
impl PlacedSound {
    /// Time of the first sample behind those that are heard.
    pub(super) fn end(&self) -> i64 {
        self.start + i64::from(self.sound.info().length)
    }

    /// Time of the first sample of its first packet.
    pub(super) fn origin(&self) -> i64 {
        self.start - i64::from(self.sound.info().lead)
    }

    /// Whether it is heard at a sample, where it is the only one.
    fn holds(&self, sample: i64) -> bool {
        (self.start..self.end()).contains(&sample)
    }

    /// Bytes of memory that it takes: of its packets, and of a number for each.
    fn bytes(&self) -> usize {
        self.sound.packet_bytes() + size_of::<u32>() * self.sound.info().packet_count()
    }
}

#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
impl PlacedSound {
    /// Whether `next` continues the stream of this one, where this one ends.
    pub(super) fn is_followed_by(&self, next: &PlacedSound) -> bool {
        let (a, b) = (self.sound.info(), next.sound.info());
        let end = self.exact_start + f64::from(a.length);
        (end - next.exact_start).abs() <= JOINS_WITHIN
            && (a.stream, a.channels, a.packet_samples) == (b.stream, b.channels, b.packet_samples)
    }
}

#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
impl TrackParts {
    /// The sound that is heard behind `placed`, if it continues its stream, at the end of that one.
    fn follower(&self, placed: &PlacedSound) -> Option<PlacedSound> {
        let end = placed.end();
        let others = self.sounds.iter().filter(|other| other.segment != placed.segment);
        let heard = others.filter(|other| placed.is_followed_by(other) || other.holds(end));
        let last = heard.max_by_key(|other| other.segment).filter(|other| placed.is_followed_by(other))?;
        Some(PlacedSound { start: end, ..last.clone() })
    }
}

#[cfg(not(feature = "audio"))]
impl SoundTrack {
    /// Does nothing: there is no sound without the feature `audio`.
    pub(crate) fn add(&self, _: &Contents, _: &[u8], _: &Limits, _: usize, _: f64) {}

    /// Does nothing: there is nothing to drop.
    pub(crate) fn retain(&self, _: impl Fn(usize) -> bool) {}

    /// Whether a segment has a sound: never.
    pub(crate) fn has(&self, _: usize) -> bool {
        false
    }

    /// Number of sounds: none.
    pub(crate) fn len(&self) -> usize {
        0
    }

    /// Whether there is no sound: always.
    #[cfg(any(test, feature = "window", feature = "xr"))]
    pub(crate) fn is_empty(&self) -> bool {
        true
    }
}

#[cfg(feature = "audio")]
impl SoundTrack {
    /// Adds the sound of a package, or of a prefix of one: the sound of segment `segment`, whose clip time 0 lies at
    /// `start_s` seconds. If it is damaged, [`SoundTrack::take_note`] says so.
    pub(crate) fn add(&self, head: &Contents, package: &[u8], limits: &Limits, segment: usize, start_s: f64) {
        match head.sound(package, limits) {
            Ok(Some(sound)) => self.insert(sound, segment, start_s),
            Ok(None) => {}
            Err(error) => self.lock().note = Some(format!("no sound: {error}: copy the file again")),
        }
    }

    /// Drops the sounds of segments that are not `needed`.
    pub(crate) fn retain(&self, needed: impl Fn(usize) -> bool) {
        self.lock().sounds.retain(|placed| needed(placed.segment));
    }

    /// What there is to say, once.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn take_note(&self) -> Option<String> {
        self.lock().note.take()
    }

    /// Whether both are clones of one track.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn is_same(&self, other: &SoundTrack) -> bool {
        Arc::ptr_eq(&self.parts, &other.parts)
    }

    /// Adds the sound of a segment whose time 0 lies at `start_s` seconds, in place of the sound that the segment had.
    /// Where all sounds then have more than [`BYTES_MAX`], the oldest are dropped.
    pub(super) fn insert(&self, sound: Sound, segment: usize, start_s: f64) {
        let exact_start = start_s * f64::from(SOUND_RATE_HZ) + f64::from(sound.info().start);
        let start = samples(start_s) + i64::from(sound.info().start);
        let sounds = &mut self.lock().sounds;
        sounds.retain(|other| other.segment != segment);
        sounds.push(PlacedSound { segment, exact_start, start, sound: Arc::new(sound) });
        let mut bytes: usize = sounds.iter().map(PlacedSound::bytes).sum();
        while bytes > BYTES_MAX && sounds.len() > 1 {
            bytes -= sounds.remove(0).bytes();
        }
    }

    /// Whether the sound of a segment is in memory.
    pub(crate) fn has(&self, segment: usize) -> bool {
        self.lock().sounds.iter().any(|placed| placed.segment == segment)
    }

    /// Number of sounds in memory.
    pub(crate) fn len(&self) -> usize {
        self.lock().sounds.len()
    }

    /// Whether there is no sound so far.
    #[cfg(any(test, feature = "window", feature = "xr"))]
    pub(crate) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The sound that is heard at a time in samples: of several, the sound of the segment that comes last in the file.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn at(&self, sample: i64) -> Option<PlacedSound> {
        let parts = self.lock();
        let held = parts.sounds.iter().filter(|placed| placed.holds(sample));
        held.max_by_key(|placed| placed.segment).cloned()
    }

    /// The sound that continues the stream of `placed`, at its end.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn follower(&self, placed: &PlacedSound) -> Option<PlacedSound> {
        self.lock().follower(placed)
    }

    /// How long `placed` is heard from a sample on that it holds: up to its end, or up to the sound of a later segment.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn course(&self, placed: &PlacedSound, sample: i64) -> Course {
        let parts = self.lock();
        let follower = parts.follower(placed);
        let is_neighbour = |other: &PlacedSound| {
            // Rounding may put a sample of both into the other.
            other.is_followed_by(placed)
                || follower.as_ref().is_some_and(|next| next.segment == other.segment)
        };
        let later =
            parts.sounds.iter().filter(|other| other.segment > placed.segment && !is_neighbour(other));
        let starts = later.filter(|other| other.end() > sample).map(|other| other.start.max(sample));
        match starts.min().filter(|start| *start < placed.end()) {
            Some(until) => Course { until, is_continued: false },
            None => Course { until: placed.end(), is_continued: follower.is_some() },
        }
    }

    /// Beginning of the first sound behind a time in samples.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn next_after(&self, sample: i64) -> Option<i64> {
        self.lock().sounds.iter().map(|placed| placed.start).filter(|start| *start > sample).min()
    }

    /// Point of the scene from which the sound at `position_s` seconds comes.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn position_at(&self, position_s: f64) -> Option<[f32; 3]> {
        self.at(samples(position_s))?.sound.info().position
    }

    fn lock(&self) -> MutexGuard<'_, TrackParts> {
        self.parts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The sample at a time in seconds.
#[cfg(feature = "audio")]
pub(super) fn samples(seconds: f64) -> i64 {
    (seconds * f64::from(SOUND_RATE_HZ)).round() as i64
}

#[cfg(test)]
#[cfg(feature = "audio")]
mod track_tests {
    use codec::{SegmentPackage, SoundInfo};

    use super::*;
    use crate::content::{OpenTake, Want};
    use crate::test_fields;

    fn sound(start: u32, length: u32) -> Sound {
        let info =
            SoundInfo { channels: 1, position: None, stream: 1, start, length, lead: 0, packet_samples: 960 };
        Sound::new(info, vec![&[1u8][..]; info.packet_count()].into_iter()).unwrap()
    }

    fn packets_of(bytes: usize) -> Sound {
        let packet = vec![1u8; 50_000];
        let count = bytes.div_ceil(packet.len());
        let length = 960 * count as u32;
        let info = SoundInfo { length, ..*sound(0, length).info() };
        Sound::new(info, vec![&packet[..]; count].into_iter()).unwrap()
    }

    fn starts(track: &SoundTrack, samples: [i64; 5]) -> [Option<i64>; 5] {
        samples.map(|sample| track.at(sample).map(|placed| placed.start))
    }

    #[test]
    fn of_two_sounds_that_of_the_later_segment_in_the_file_is_heard() {
        let track = SoundTrack::default();
        track.insert(sound(0, 48_000), 1, 0.0);
        track.insert(sound(4_800, 12_000), 2, 0.5);
        // One that begins later, in a segment that comes before both.
        track.insert(sound(0, 96_000), 0, 0.7);
        let expected = [Some(0), Some(28_800), Some(28_800), Some(0), Some(33_600)];
        assert_eq!(starts(&track, [0, 28_800, 40_799, 40_800, 48_000]), expected);
        assert_eq!((track.next_after(0), track.next_after(28_800)), (Some(28_800), Some(33_600)));
        let course = |sample: i64| {
            let Course { until, is_continued } = track.course(&track.at(sample).unwrap(), sample);
            (until, is_continued)
        };
        let expected = [(28_800, false), (40_800, false), (48_000, false), (129_600, false)];
        assert_eq!([0, 30_000, 40_800, 48_000].map(course), expected);
    }

    #[test]
    fn parts_of_a_stream_join_within_a_sample() {
        // The third of a sample that a cut of a take leaves, and more than rounding explains.
        let track = |offset: f64| {
            let track = SoundTrack::default();
            track.insert(sound(0, 9_600), 0, 0.4 / 48_000.0);
            track.insert(sound(0, 9_600), 1, (9_600.4 + offset) / 48_000.0);
            track
        };
        for offset in [-1.0, -0.7, 0.0, 0.3, 1.0] {
            let track = track(offset);
            let first = track.at(100).unwrap();
            assert_eq!(track.course(&first, 100), Course { until: 9_600, is_continued: true }, "{offset}");
            assert_eq!(track.follower(&first).map(|next| next.start), Some(9_600), "{offset}");
        }
        for offset in [-2.0, -1.2, 1.2, 2.0] {
            let track = track(offset);
            assert!(track.follower(&track.at(100).unwrap()).is_none(), "{offset}");
        }
    }

    #[test]
    fn the_packets_of_a_take_are_heard_where_its_segments_play() {
        const SECOND: usize = SOUND_RATE_HZ as usize;
        let limits = Limits::default();
        // Half a second of sound in each second, whose packets say where they belong.
        let info = *sound(0, 24_000).info();
        let package = |segment: u8| {
            let packets: Vec<[u8; 2]> = (0..info.packet_count()).map(|i| [segment, i as u8]).collect();
            let sound = Sound::new(info, packets.iter().map(|packet| &packet[..])).unwrap();
            let field = test_fields::field(&test_fields::ball()[..50]);
            codec::with_sound(&test_fields::package(&test_fields::y_up(), &field), Some(&sound)).unwrap()
        };
        let packages: Vec<Vec<u8>> = (0..4).map(package).collect();
        let heads: Vec<_> =
            packages.iter().map(|package| codec::contents(package, &limits).unwrap()).collect();
        let segments: Vec<_> = (0..)
            .map(f64::from)
            .zip(&heads)
            .map(|(start_s, contents)| SegmentPackage { start_s, duration_s: 1.0, level: 0, contents })
            .collect();
        let head = codec::encode_take_head(&test_fields::y_up(), 4.0, &segments).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        std::fs::write(&path, [head, packages.concat()].concat()).unwrap();
        let opened = OpenTake::open(&path, &limits).unwrap();
        for segment in [2, 0, 3, 1] {
            opened.load(Want { segment, from: 0, layers: 1 }).unwrap();
        }
        for sample in (0..4 * SECOND).step_by(479) {
            let heard = opened.sound.at(sample as i64).map(|placed| {
                let offset = sample - placed.start as usize;
                placed.sound.packet(offset / 960).unwrap().to_vec()
            });
            let (segment, offset) = (sample / SECOND, sample % SECOND);
            let expected = (offset < 24_000).then(|| vec![segment as u8, (offset / 960) as u8]);
            assert_eq!(heard, expected, "sample {sample}");
        }
    }

    #[test]
    fn bytes_are_bounded_and_the_latest_sound_stays() {
        let track = SoundTrack::default();
        let numbers = || track.lock().sounds.iter().map(|placed| placed.segment).collect::<Vec<_>>();
        (0..5).for_each(|segment| track.insert(packets_of(BYTES_MAX / 4), segment, segment as f64));
        assert_eq!(numbers(), [2, 3, 4]);
        track.insert(packets_of(2 * BYTES_MAX), 9, 9.0);
        assert_eq!(numbers(), [9]);
        track.insert(sound(0, 960), 9, 9.0);
        track.insert(sound(0, 960), 3, 3.0);
        assert_eq!(numbers(), [9, 3], "a sound takes the place of the one before");
        track.retain(|segment| segment == 3);
        assert_eq!(numbers(), [3]);
    }
}
