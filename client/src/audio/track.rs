//! [`SoundTrack`]: the sounds of a clip, or of the segments of a take that were loaded, on one time line.
//!
//! The loader of segments adds to it while the sound thread reads. It is shared, and holds a bounded number of sounds:
//! those nearest to the one that was added last.

use codec::{Contents, Limits};
#[cfg(feature = "audio")]
use codec::{SOUND_RATE_HZ, Sound};
#[cfg(feature = "audio")]
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most sounds of a take in memory: twice as many as can be heard at one instant.
#[cfg(feature = "audio")]
const SOUNDS_MAX: usize = 64;

/// The sounds of what is on display. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct SoundTrack {
    #[cfg(feature = "audio")]
    parts: Arc<Mutex<TrackParts>>,
}

/// What is known of a track.
#[cfg(feature = "audio")]
#[derive(Debug, Default)]
struct TrackParts {
    sounds: Vec<PlacedSound>,
    /// What there is to say of a sound that cannot be heard.
    note: Option<String>,
}

/// A sound with its place in time.
#[cfg(feature = "audio")]
#[derive(Clone, Debug)]
#[cfg_attr(not(any(feature = "window", feature = "xr")), allow(dead_code, reason = "only displays play it"))]
pub(super) struct PlacedSound {
    /// Time of its first sample that is heard, in samples.
    pub(super) start: i64,
    pub(super) sound: Arc<Sound>,
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
}

impl SoundTrack {
    /// The sound of a clip, from its package or a prefix of one that has its first layer.
    pub(crate) fn of_clip(package: &[u8], limits: &Limits) -> SoundTrack {
        let track = SoundTrack::default();
        if let Ok(head) = codec::contents(package, limits) {
            track.add(&head, package, limits, 0.0);
        }
        track
    }
}

#[cfg(not(feature = "audio"))]
impl SoundTrack {
    /// Does nothing: there is no sound without the feature `audio`.
    pub(crate) fn add(&self, _: &Contents, _: &[u8], _: &Limits, _: f64) {}

    /// Whether there is no sound: always.
    pub(crate) fn is_empty(&self) -> bool {
        true
    }
}

#[cfg(feature = "audio")]
impl SoundTrack {
    /// Adds the sound of a package, or of a prefix of one, whose clip time 0 lies at `start_s` seconds. If it is damaged,
    /// [`SoundTrack::take_note`] says so.
    pub(crate) fn add(&self, head: &Contents, package: &[u8], limits: &Limits, start_s: f64) {
        match head.sound(package, limits) {
            Ok(Some(sound)) => self.insert(sound, start_s),
            Ok(None) => {}
            Err(error) => self.lock().note = Some(format!("no sound: {error}: copy the file again")),
        }
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

    /// Adds a sound whose time 0 lies at `start_s` seconds, in place of the one that was there.
    pub(super) fn insert(&self, sound: Sound, start_s: f64) {
        let start = samples(start_s) + i64::from(sound.info().start);
        let placed = PlacedSound { start, sound: Arc::new(sound) };
        let sounds = &mut self.lock().sounds;
        sounds.retain(|other| other.start != start);
        sounds.push(placed);
        if sounds.len() > SOUNDS_MAX {
            sounds.sort_by_key(|other| (other.start - start).abs());
            sounds.truncate(SOUNDS_MAX);
        }
    }

    /// Whether there is no sound so far.
    pub(crate) fn is_empty(&self) -> bool {
        self.lock().sounds.is_empty()
    }

    /// The sound that is heard at a time in samples: the one that begins last.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(super) fn at(&self, sample: i64) -> Option<PlacedSound> {
        let parts = self.lock();
        let held = parts.sounds.iter().filter(|placed| (placed.start..placed.end()).contains(&sample));
        held.max_by_key(|placed| placed.start).cloned()
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

#[cfg(all(test, feature = "audio"))]
mod track_tests {
    use super::*;
    use codec::SoundInfo;

    fn sound(start: u32, length: u32) -> Sound {
        let info =
            SoundInfo { channels: 1, position: None, stream: 1, start, length, lead: 0, packet_samples: 960 };
        Sound::new(info, vec![&[1u8][..]; info.packet_count()].into_iter()).unwrap()
    }

    #[test]
    fn the_sound_that_begins_last_is_heard() {
        let track = SoundTrack::default();
        track.insert(sound(0, 48_000), 0.0);
        track.insert(sound(4_800, 48_000), 0.5);
        let start = |sample| track.at(sample).map(|placed| placed.start);
        assert_eq!(
            [0, 28_799, 28_800, 76_799, 76_800].map(start),
            [Some(0), Some(0), Some(28_800), Some(28_800), None]
        );
        assert_eq!((track.next_after(0), track.next_after(28_800)), (Some(28_800), None));
    }

    #[test]
    fn a_bounded_number_is_in_memory() {
        let track = SoundTrack::default();
        for second in 0..1000 {
            track.insert(sound(0, 48_000), f64::from(second));
        }
        assert_eq!(track.lock().sounds.len(), SOUNDS_MAX);
        assert!(track.at(samples(999.5)).is_some() && track.at(samples(940.5)).is_some());
        assert!(track.at(samples(900.5)).is_none());
        track.insert(sound(0, 24_000), 999.0);
        assert!(track.at(samples(999.7)).is_none(), "a sound takes the place of the one before");
    }
}
