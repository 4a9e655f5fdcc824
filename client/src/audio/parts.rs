//! [`Parts`]: the clock of the picture, and the thread that keeps a device open and its ring filled.

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

/// Wait before a device that was lost is looked for again, and where there was none so far.
const LOST_RETRY: Duration = Duration::from_secs(3);
const ABSENT_RETRY: Duration = Duration::from_secs(60);

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
            retry_at: Instant::now(),
            retry_after: ABSENT_RETRY,
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
    retry_at: Instant,
    retry_after: Duration,
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
            self.retry_at = Instant::now() + self.retry_after;
            self.say("the audio device was lost");
        }
        if self.device.is_some() || Instant::now() < self.retry_at {
            return;
        }
        match OpenDevice::open(&self.link, self.epoch) {
            Ok(opened) => (self.device, self.retry_after) = (Some(opened), LOST_RETRY),
            Err(why) => {
                self.retry_at = Instant::now() + self.retry_after;
                self.say(&why);
            }
        }
        self.link.set_open(self.device.is_some());
    }

    fn say(&mut self, why: &str) {
        if !std::mem::replace(&mut self.was_said, true) {
            let _ = self.notes.send(format!("{why}: the clip plays without sound"));
        }
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
