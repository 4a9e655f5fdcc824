//! [`Speaker`]: the sound of the clip on display: its track, volume and place, and the pace that it gives the clock.

use std::path::PathBuf;

use glam::DVec3;

#[cfg(feature = "audio")]
use super::parts::Parts;
use super::track::SoundTrack;
use super::volume::Volume;
use crate::clock::Clock;

/// The sound of a display.
pub(crate) struct Speaker {
    /// How loud it is.
    pub(crate) volume: Volume,
    track: SoundTrack,
    /// Whether it plays no track.
    is_silent: bool,
    #[cfg(feature = "audio")]
    parts: Parts,
}

impl Speaker {
    /// Without a track. The volume is remembered in `folder`.
    pub(crate) fn new(folder: Option<PathBuf>) -> Speaker {
        Speaker {
            volume: Volume::open(folder),
            track: SoundTrack::default(),
            is_silent: false,
            #[cfg(feature = "audio")]
            parts: Parts::default(),
        }
    }

    /// One that plays nothing, for measurements: the display's clock alone counts, and no device is opened.
    #[cfg(feature = "xr")]
    pub(crate) fn silent() -> Speaker {
        Speaker { is_silent: true, ..Speaker::new(None) }
    }

    /// The volume, if the clip has sound as far as is known.
    pub(crate) fn controls(&mut self) -> Option<&mut Volume> {
        if self.track.is_empty() { None } else { Some(&mut self.volume) }
    }
}

#[cfg(not(feature = "audio"))]
impl Speaker {
    /// Plays another track.
    pub(crate) fn change_track(&mut self, track: SoundTrack, _: bool) {
        if !self.is_silent {
            self.track = track;
        }
    }

    /// Seconds by which a frame advances the clock: the seconds of the display.
    pub(crate) fn step(&mut self, _: &Clock, _: bool, elapsed_s: f64, _: f64) -> f64 {
        elapsed_s
    }

    /// Why nothing is heard: there is nothing to hear.
    #[cfg(feature = "window")]
    pub(crate) fn silence(&self) -> Option<String> {
        None
    }

    /// Does nothing: there is nothing to silence.
    #[cfg(feature = "window")]
    pub(crate) fn rest(&mut self, _: &Clock, _: bool) {}

    /// Does nothing: there is nothing to silence.
    #[cfg(feature = "xr")]
    pub(crate) fn stop(&mut self) {}

    /// Does nothing: there is nothing to place.
    pub(crate) fn place(&mut self, _: &Clock, _: impl Fn(DVec3) -> DVec3) {}

    /// What there is to say: nothing.
    pub(crate) fn take_note(&mut self) -> Option<String> {
        None
    }
}

#[cfg(feature = "audio")]
impl Speaker {
    /// Plays another track, unless it plays already. If it `follows` the track that plays, the picture goes on without
    /// waiting for it.
    pub(crate) fn change_track(&mut self, track: SoundTrack, follows: bool) {
        if !self.is_silent && !self.track.is_same(&track) {
            self.track = track;
            self.parts.timing.change_track(follows);
        }
    }

    /// Takes in the clock before a frame that is seen `ahead_s` seconds from now, `elapsed_s` after the frame before
    /// by the display. Returns the seconds by which the frame advances the clock.
    pub(crate) fn step(&mut self, clock: &Clock, is_scrubbing: bool, elapsed_s: f64, ahead_s: f64) -> f64 {
        if !self.track.is_empty() {
            self.parts.start_thread();
        }
        self.parts.link.set_gain(self.volume.gain());
        let now_s = self.parts.epoch.elapsed().as_secs_f64();
        self.parts.link.set_frame_at_s(now_s);
        let frame = super::timing::FrameTime { elapsed_s, seen_at_s: now_s + ahead_s };
        let Parts { timing, link, .. } = &mut self.parts;
        let (elapsed_s, command) = timing.step(clock, is_scrubbing, &self.track, link, frame);
        self.parts.send(command);
        elapsed_s
    }

    /// Why nothing is heard, if there is no audio device.
    #[cfg(feature = "window")]
    pub(crate) fn silence(&self) -> Option<String> {
        self.parts.link.absence()
    }

    /// Falls silent if the clock has paused since [`Speaker::step`], or runs otherwise than at the captured rate.
    #[cfg(feature = "window")]
    pub(crate) fn rest(&mut self, clock: &Clock, is_scrubbing: bool) {
        let command = self.parts.timing.rest(clock, is_scrubbing);
        self.parts.send(command);
    }

    /// Falls silent until the next frame.
    #[cfg(feature = "xr")]
    pub(crate) fn stop(&mut self) {
        let command = self.parts.timing.stop();
        self.parts.send(command);
    }

    /// Places the sound at the position of `clock`, before [`Speaker::step`]. `hears` turns a point of the clip into
    /// metres from the listener: x to the right, y up, z backwards.
    pub(crate) fn place(&mut self, clock: &Clock, hears: impl Fn(DVec3) -> DVec3) {
        let position = self.track.position_at(clock.position_s());
        self.parts.link.set_source_m(position.map(|position| hears(DVec3::from(position.map(f64::from)))));
    }

    /// What there is to say, once: that there is no device, that it was lost, or that the sound is damaged.
    pub(crate) fn take_note(&mut self) -> Option<String> {
        self.track.take_note().or_else(|| self.parts.take_note())
    }
}
