//! [`Parts`]: the clock of the picture, and the thread that keeps a device open and its ring filled. [`Retry`] says
//! when a device is opened again.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use super::device::OpenDevice;
use super::filler::SoundCommand;
use super::link::Link;
use super::timing::SoundTiming;

/// Interval at which the sound thread fills the ring, and at which it looks for frames while no device is open.
const FILL_EVERY: Duration = Duration::from_millis(10);
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Wait before a device is looked for again: one that was lost, and one that was never there.
const LOST_RETRY: Duration = Duration::from_secs(3);
const ABSENT_RETRY: Duration = Duration::from_secs(60);

/// Devices in a row that may be lost within [`STEADY`] of their opening, and are opened again at once: while it has no
/// timing yet, ALSA's plugin for PulseAudio reports an error and plays on (alsa-plugins 65).
const QUICK_LOSSES: u32 = 4;
const STEADY: Duration = Duration::from_secs(1);

/// Seconds without a frame after which sound stops: the window is hidden, or the headset sleeps.
const FRAMELESS_S: f64 = 0.25;

/// Seconds without a frame after which the device is closed: open, it costs power even in silence.
const UNUSED_S: f64 = 10.0;

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
        let keeper = DeviceKeeper {
            link: self.link.clone(),
            epoch: self.epoch,
            device: None,
            retry: Retry::new(Instant::now()),
            notes,
            was_said: false,
        };
        let run = move || keeper.run(&arriving);
        if let Err(error) = thread::Builder::new().name("sound".into()).spawn(run) {
            log::warn!("no sound: cannot start a thread: {error}");
        }
        self.thread = Some((commands, noted));
    }

    pub(super) fn send(&self, command: Option<SoundCommand>) {
        if let (Some((commands, _)), Some(command)) = (&self.thread, command) {
            // After a defect the thread is gone, and the link is closed.
            let _ = commands.send(command);
        }
    }

    pub(super) fn take_note(&self) -> Option<String> {
        self.thread.as_ref()?.1.try_recv().ok()
    }
}

/// The sound thread.
struct DeviceKeeper {
    link: Arc<Link>,
    epoch: Instant,
    device: Option<OpenDevice>,
    retry: Retry,
    notes: Sender<String>,
    /// Whether it was said that there is no sound.
    was_said: bool,
}

impl DeviceKeeper {
    /// Keeps a device open and its ring filled, until no more commands can come. What is missing is said once.
    fn run(mut self, commands: &Receiver<SoundCommand>) {
        loop {
            if self.frameless_s() < UNUSED_S {
                self.keep_open();
            } else if self.device.take().is_some() {
                self.link.set_open(false);
                log::debug!("the audio device is closed until the next frame");
            }
            let every = if self.device.is_some() { FILL_EVERY } else { LOOK_EVERY };
            let command = match commands.recv_timeout(every) {
                Ok(command) => Some(command),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return,
            };
            let frameless_s = self.frameless_s();
            let Some(device) = &mut self.device else { continue };
            // Before a start: its first sample is heard where it comes from.
            if let Some(source_m) = self.link.source_m() {
                device.binaural.follow(source_m);
            }
            if let Some(command) = command {
                device.filler.take(command);
            }
            if frameless_s > FRAMELESS_S && device.filler.is_playing() {
                device.filler.take(SoundCommand::Stop);
            }
            device.filler.fill();
        }
    }

    /// Seconds since the latest frame.
    fn frameless_s(&self) -> f64 {
        self.epoch.elapsed().as_secs_f64() - self.link.frame_at_s()
    }

    /// Opens a device where there is none, and lets go of one that was lost.
    fn keep_open(&mut self) {
        if self.link.take_lost() && self.device.take().is_some() {
            self.link.set_open(false);
            if !self.retry.on_lost(Instant::now()) {
                self.say("the audio device was lost");
            }
        }
        if self.device.is_some() || !self.retry.is_due(Instant::now()) {
            return;
        }
        match OpenDevice::open(&self.link, self.epoch) {
            Ok(opened) => {
                self.retry.on_opened(Instant::now());
                self.link.set_absence(None);
                self.device = Some(opened);
            }
            Err(why) => {
                self.retry.on_absent(Instant::now());
                self.say(&why);
            }
        }
        self.link.set_open(self.device.is_some());
    }

    fn say(&mut self, why: &str) {
        let why = format!("{why}: the clip plays without sound");
        self.link.set_absence(Some(why.clone()));
        if !std::mem::replace(&mut self.was_said, true) {
            let _ = self.notes.send(why);
        }
    }
}

/// When a device is opened again.
struct Retry {
    due_at: Instant,
    /// When a device was opened last.
    opened_at: Option<Instant>,
    quick_losses: u32,
}

impl Retry {
    /// Due at `now`, for the first time.
    fn new(now: Instant) -> Retry {
        Retry { due_at: now, opened_at: None, quick_losses: 0 }
    }

    fn is_due(&self, now: Instant) -> bool {
        now >= self.due_at
    }

    fn on_opened(&mut self, now: Instant) {
        self.opened_at = Some(now);
    }

    /// There is no device.
    fn on_absent(&mut self, now: Instant) {
        self.due_at = now + if self.opened_at.is_some() { LOST_RETRY } else { ABSENT_RETRY };
    }

    /// The device was lost. Returns whether it is opened again at once.
    fn on_lost(&mut self, now: Instant) -> bool {
        let is_quick = self.opened_at.is_some_and(|opened_at| now < opened_at + STEADY);
        self.quick_losses = if is_quick { self.quick_losses + 1 } else { 0 };
        let is_at_once = self.quick_losses < QUICK_LOSSES;
        self.due_at = if is_at_once { now } else { now + LOST_RETRY };
        is_at_once
    }
}

impl Drop for DeviceKeeper {
    fn drop(&mut self) {
        self.link.set_open(false);
        if thread::panicking() {
            let why = "the sound stopped because of a defect of the player: report it with the player's log";
            let _ = self.notes.send(why.into());
        }
    }
}

#[cfg(test)]
mod retry_tests {
    use super::*;

    #[test]
    fn a_device_is_opened_again_at_once_unless_it_is_lost_again_and_again() {
        let mut now = Instant::now();
        let mut retry = Retry::new(now);
        assert!(retry.is_due(now));
        let mut lose = |lasted: Duration| {
            retry.on_opened(now);
            now += lasted;
            let is_at_once = retry.on_lost(now);
            assert_eq!(retry.is_due(now), is_at_once);
            assert!(retry.is_due(now + LOST_RETRY));
            is_at_once
        };
        assert!(lose(Duration::from_secs(60)), "after a minute");
        for loss in 1..=6 {
            let is_at_once = lose(Duration::from_millis(10));
            assert_eq!(is_at_once, loss < QUICK_LOSSES, "loss {loss}");
        }
        assert!(lose(STEADY), "after one that lasted");
    }

    #[test]
    fn a_device_that_is_not_there_is_looked_for_after_a_while() {
        let (now, mut retry) = (Instant::now(), Retry::new(Instant::now()));
        retry.on_absent(now);
        assert!(!retry.is_due(now + LOST_RETRY) && retry.is_due(now + ABSENT_RETRY));
        retry.on_opened(now);
        retry.on_absent(now);
        assert!(!retry.is_due(now) && retry.is_due(now + LOST_RETRY), "there was one");
    }
}
