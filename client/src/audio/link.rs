//! [`Link`]: what frame thread, sound thread and the device's thread share: numbers, without a lock on the device's.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};
use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::placing::Placement;

/// What the device's thread plays, and how.
#[derive(Default)]
pub(super) struct Link {
    /// Number of the first frame of the ring that is to be played; the frames before it are dropped.
    skip_to: AtomicU64,
    /// Bits of the gain of all sound, and of the level of [`Placement`].
    gain: AtomicU32,
    level: AtomicU32,
    is_placed: AtomicBool,
    /// Where the sound comes from, in metres from the listener. The device's thread does not look.
    source_m: Mutex<Option<DVec3>>,
    heard: HeardCell,
    /// Whether the device was lost.
    is_lost: AtomicBool,
    /// Whether a device is open.
    is_open: AtomicBool,
    /// Why none can be opened.
    absence: Mutex<Option<String>>,
    anchor: Mutex<Option<Anchor>>,
    /// Bits of the seconds at which the latest frame was shown.
    frame_at_s: AtomicU64,
}

/// A start that the sound thread has carried out: frame `index` of the ring is played `offset_s` seconds behind the
/// position that the start asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Anchor {
    /// Number of the start.
    pub(super) number: u64,
    pub(super) index: u64,
    pub(super) offset_s: f64,
    pub(super) rate_hz: u32,
}

/// Frames that were handed to the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Heard {
    /// Number of the first of them.
    pub(super) index: u64,
    /// When it is heard, in seconds.
    pub(super) at_s: f64,
    /// Number of frames.
    pub(super) count: u32,
}

impl Heard {
    /// Number of the frame that is heard at `now_s` seconds, with its fraction. It goes no farther than the frames that
    /// were handed over.
    pub(super) fn index_at(&self, now_s: f64, rate_hz: u32) -> f64 {
        let since = (now_s - self.at_s) * f64::from(rate_hz);
        self.index as f64 + since.min(f64::from(self.count))
    }
}

/// A [`Heard`] that one thread writes and others read without a lock: a sequence lock.
#[derive(Default)]
struct HeardCell {
    /// Odd while it is written.
    sequence: AtomicU32,
    index: AtomicU64,
    at_s: AtomicU64,
    count: AtomicU32,
}

/// Number of times that a reader tries before it gives up on a writer that is in between.
const TRIES: usize = 16;

impl HeardCell {
    fn write(&self, heard: Heard) {
        let sequence = self.sequence.load(Ordering::Relaxed);
        self.sequence.store(sequence.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        self.index.store(heard.index, Ordering::Relaxed);
        self.at_s.store(heard.at_s.to_bits(), Ordering::Relaxed);
        self.count.store(heard.count, Ordering::Relaxed);
        self.sequence.store(sequence.wrapping_add(2), Ordering::Release);
    }

    /// Forgets the latest; no writer is there.
    fn clear(&self) {
        self.sequence.store(0, Ordering::Release);
    }

    /// The latest; `None` if there is none, or each try met a writer.
    fn read(&self) -> Option<Heard> {
        for _ in 0..TRIES {
            let before = self.sequence.load(Ordering::Acquire);
            let heard = Heard {
                index: self.index.load(Ordering::Relaxed),
                at_s: f64::from_bits(self.at_s.load(Ordering::Relaxed)),
                count: self.count.load(Ordering::Relaxed),
            };
            fence(Ordering::Acquire);
            if before.is_multiple_of(2) && self.sequence.load(Ordering::Relaxed) == before {
                return (before > 0).then_some(heard);
            }
        }
        None
    }
}

impl Link {
    /// Forgets what the last device played: the frames of the next one count from 0.
    pub(super) fn begin_device(&self) {
        self.set_skip_to(0);
        self.heard.clear();
        self.set_anchor(None);
        self.take_lost();
    }

    pub(super) fn skip_to(&self) -> u64 {
        self.skip_to.load(Ordering::Acquire)
    }

    pub(super) fn set_skip_to(&self, index: u64) {
        self.skip_to.store(index, Ordering::Release);
    }

    pub(super) fn gain(&self) -> f32 {
        f32::from_bits(self.gain.load(Ordering::Relaxed))
    }

    pub(super) fn set_gain(&self, gain: f32) {
        self.gain.store(gain.to_bits(), Ordering::Relaxed);
    }

    /// How the sound is to be heard.
    pub(super) fn placement(&self) -> Placement {
        let level = f32::from_bits(self.level.load(Ordering::Relaxed));
        Placement { level, is_placed: self.is_placed.load(Ordering::Relaxed) }
    }

    /// Where the sound comes from, in metres from the listener: x to the right, y up, z backwards. `None` if it has no
    /// place.
    pub(super) fn source_m(&self) -> Option<DVec3> {
        *self.source_m.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets where the sound comes from. The device's thread may meet the level of one place and the direction of another,
    /// which the fades of [`super::placing::Placing`] hide.
    pub(super) fn set_source_m(&self, source_m: Option<DVec3>) {
        *self.source_m.lock().unwrap_or_else(PoisonError::into_inner) = source_m;
        let Placement { level, is_placed } = Placement::new(source_m);
        self.level.store(level.to_bits(), Ordering::Relaxed);
        self.is_placed.store(is_placed, Ordering::Relaxed);
    }

    /// The frames that were handed to the device last; `None` before the first.
    pub(super) fn heard(&self) -> Option<Heard> {
        self.heard.read()
    }

    pub(super) fn set_heard(&self, heard: Heard) {
        self.heard.write(heard);
    }

    /// Whether the device was lost since the last call.
    pub(super) fn take_lost(&self) -> bool {
        self.is_lost.swap(false, Ordering::AcqRel)
    }

    /// Says that the device was lost. Returns whether that was not said yet.
    pub(super) fn set_lost(&self) -> bool {
        !self.is_lost.swap(true, Ordering::AcqRel)
    }

    pub(super) fn is_open(&self) -> bool {
        self.is_open.load(Ordering::Acquire)
    }

    pub(super) fn set_open(&self, is_open: bool) {
        self.is_open.store(is_open, Ordering::Release);
    }

    /// Why no device can be opened, if none can.
    #[cfg(feature = "window")]
    pub(super) fn absence(&self) -> Option<String> {
        self.absence.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn set_absence(&self, why: Option<String>) {
        *self.absence.lock().unwrap_or_else(PoisonError::into_inner) = why;
    }

    /// Seconds at which the latest frame was shown.
    pub(super) fn frame_at_s(&self) -> f64 {
        f64::from_bits(self.frame_at_s.load(Ordering::Relaxed))
    }

    pub(super) fn set_frame_at_s(&self, now_s: f64) {
        self.frame_at_s.store(now_s.to_bits(), Ordering::Relaxed);
    }

    /// The latest start that was carried out.
    pub(super) fn anchor(&self) -> Option<Anchor> {
        *self.anchor.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn set_anchor(&self, anchor: Option<Anchor>) {
        *self.anchor.lock().unwrap_or_else(PoisonError::into_inner) = anchor;
    }
}
