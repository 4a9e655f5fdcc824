//! [`Speaker`]: the sound of the clip on display: its track, volume and place, and the clock that it gives the player.

use std::path::PathBuf;

use glam::DVec3;

use super::track::SoundTrack;
use super::volume::Volume;
#[cfg(feature = "audio")]
use parts::Parts;

use crate::player::Player;

/// The sound of a display.
pub(crate) struct Speaker {
    /// How loud it is.
    pub(crate) volume: Volume,
    track: SoundTrack,
    #[cfg(feature = "audio")]
    parts: Parts,
}

/// Where ears are.
pub(crate) trait Listener {
    /// A point of the clip, in metres from the listener: x to the right, y up, z backwards.
    fn hears(&self, point: DVec3) -> DVec3;
}

impl Speaker {
    /// Without a track. The volume is remembered in `folder`.
    pub(crate) fn new(folder: Option<PathBuf>) -> Speaker {
        Speaker {
            volume: Volume::open(folder),
            track: SoundTrack::default(),
            #[cfg(feature = "audio")]
            parts: Parts::default(),
        }
    }
}

#[cfg(not(feature = "audio"))]
impl Speaker {
    /// Plays another track.
    pub(crate) fn change_track(&mut self, track: SoundTrack, _: bool) {
        self.track = track;
    }

    /// Whether the clip has sound.
    pub(crate) fn has_sound(&self) -> bool {
        let _ = &self.track;
        false
    }

    /// Seconds by which a frame advances the player: those of the display's clock.
    pub(crate) fn step(&mut self, _: &Player, _: bool, elapsed_s: f64, _: f64) -> f64 {
        elapsed_s
    }

    /// Does nothing: there is nothing to place.
    pub(crate) fn place(&mut self, _: &Player, _: &dyn Listener) {}

    /// What there is to say.
    pub(crate) fn take_note(&mut self) -> Option<String> {
        None
    }
}

#[cfg(feature = "audio")]
impl Speaker {
    /// Plays another track. If it `follows` the one before, the picture goes on without waiting for it.
    pub(crate) fn change_track(&mut self, track: SoundTrack, follows: bool) {
        self.track = track;
        self.parts.timing.change_track(follows);
    }

    /// Whether the clip has sound, as far as is known.
    pub(crate) fn has_sound(&self) -> bool {
        !self.track.is_empty()
    }

    /// Takes in the player before a frame that is seen `ahead_s` seconds from now, `elapsed_s` after the one before by the
    /// display's clock. Returns the seconds by which the frame advances the player.
    pub(crate) fn step(&mut self, player: &Player, is_scrubbing: bool, elapsed_s: f64, ahead_s: f64) -> f64 {
        if self.has_sound() {
            self.parts.start_thread();
        }
        self.parts.link.set_gain(self.volume.gain());
        let seen_at_s = self.parts.epoch.elapsed().as_secs_f64() + ahead_s;
        let frame = super::timing::FrameTime { elapsed_s, seen_at_s };
        let Parts { timing, link, .. } = &mut self.parts;
        let (elapsed_s, command) = timing.step(player, is_scrubbing, &self.track, link, frame);
        if let Some(command) = command {
            self.parts.send(command);
        }
        elapsed_s
    }

    /// Places the sound at the position of `player` for `listener`.
    pub(crate) fn place(&mut self, player: &Player, listener: &dyn Listener) {
        let position = self.track.position_at(player.position_s());
        let pan = position.map_or(super::panner::Pan::default(), |position| {
            super::panner::pan(listener.hears(DVec3::from(position.map(f64::from))))
        });
        self.parts.link.set_pan(&pan);
    }

    /// What there is to say, once: that there is no device, or that it was lost.
    pub(crate) fn take_note(&mut self) -> Option<String> {
        self.parts.take_note()
    }
}

#[cfg(feature = "audio")]
mod parts {
    use std::sync::Arc;
    use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
    use std::time::{Duration, Instant};

    use crate::audio::device::OpenDevice;
    use crate::audio::filler::SoundCommand;
    use crate::audio::link::Link;
    use crate::audio::timing::SoundTiming;

    /// Interval at which the sound thread fills the ring.
    const FILL_EVERY: Duration = Duration::from_millis(10);

    /// Wait before a device that is missing is looked for again.
    const RETRY_AFTER: Duration = Duration::from_secs(3);

    /// The clock, and the way to the sound thread.
    pub(super) struct Parts {
        pub(super) link: Arc<Link>,
        pub(super) timing: SoundTiming,
        pub(super) epoch: Instant,
        thread: Option<(Sender<SoundCommand>, Receiver<String>)>,
    }

    impl Default for Parts {
        fn default() -> Parts {
            let (link, timing, epoch) = (Arc::default(), SoundTiming::default(), Instant::now());
            Parts { link, timing, epoch, thread: None }
        }
    }

    impl Parts {
        /// Starts the sound thread, if it does not run. It ends with this value.
        pub(super) fn start_thread(&mut self) {
            if self.thread.is_some() {
                return;
            }
            let (commands, arriving) = channel();
            let (notes, noted) = channel();
            let (link, epoch) = (self.link.clone(), self.epoch);
            let run = move || play(&link, epoch, &arriving, &notes);
            if let Err(error) = std::thread::Builder::new().name("sound".into()).spawn(run) {
                log::warn!("no sound: cannot start a thread: {error}");
            }
            self.thread = Some((commands, noted));
        }

        pub(super) fn send(&self, command: SoundCommand) {
            if let Some((commands, _)) = &self.thread {
                // The thread ends only with this value.
                let _ = commands.send(command);
            }
        }

        pub(super) fn take_note(&self) -> Option<String> {
            self.thread.as_ref()?.1.try_recv().ok()
        }
    }

    /// Keeps a device open and its ring filled, until no more commands can come. What is missing is said once.
    fn play(link: &Arc<Link>, epoch: Instant, commands: &Receiver<SoundCommand>, notes: &Sender<String>) {
        let mut device: Option<OpenDevice> = None;
        let mut retry_at = Instant::now();
        let mut was_said = false;
        let mut say = |why: String| {
            if !std::mem::replace(&mut was_said, true) {
                let _ = notes.send(format!("{why}: the clip plays without sound"));
            }
        };
        loop {
            if link.take_lost() && device.take().is_some() {
                link.set_open(false);
                retry_at = Instant::now() + RETRY_AFTER;
                say("the audio device was lost".into());
            }
            if device.is_none() && Instant::now() >= retry_at {
                match OpenDevice::open(link, epoch) {
                    Ok(opened) => device = Some(opened),
                    Err(why) => {
                        retry_at = Instant::now() + RETRY_AFTER;
                        say(why);
                    }
                }
                link.set_open(device.is_some());
            }
            match commands.recv_timeout(FILL_EVERY) {
                Ok(command) => {
                    if let Some(device) = &mut device {
                        device.filler.take(command);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            if let Some(device) = &mut device {
                device.filler.fill();
            }
        }
    }
}
