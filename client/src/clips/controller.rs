//! [`ClipController`]: plays clips and playlists on a [`ClipTarget`], with a loader on a thread of its own.
//!
//! Window, headset and images drive it alike: they open a name, take in [`Change`]s, and say when a clip
//! is over. A take is shown as a clip is; its segments come and go while it is on display.

use std::time::{Duration, Instant};

use super::event::LoadEvent;
use super::folder::Direction;
use super::loader::{ClipTarget, LoadOptions, LoadRequest, TargetEvent, load};
use super::queue::Queue;
use super::state::{Change, QueueState};
use crate::clock::Clock;
use crate::content::redacted;
use crate::worker::{Report, Worker};
use program::Fault;

/// The clips of a display.
pub(crate) struct ClipController<T: ClipTarget> {
    state: QueueState<T::Ready>,
    worker: Worker<LoadRequest<T>, TargetEvent<T>>,
    options: LoadOptions,
    /// What clips are made ready for; `None` while there is no device.
    target: Option<T>,
    /// Where the clip that is requested next will be shown first, in seconds.
    position_s: f64,
    /// When a replaced file may be opened again, and the wait after that.
    reopens_at: Instant,
    reopens_after: Duration,
}

/// Wait after a replaced file was opened again. It doubles, so that a file that never rests is not opened all the time.
const REOPENS_AFTER: Duration = Duration::from_secs(5);

impl<T: ClipTarget> ClipController<T> {
    /// Starts the loader. `wake` is called from its thread whenever [`ClipController::poll`] may have a
    /// change. In a `cyclic` playlist the first clip follows the last, and the next one is always held ready.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(crate) fn new(
        options: LoadOptions,
        cyclic: bool,
        wake: impl Fn() + Send + 'static,
    ) -> Result<ClipController<T>, Fault> {
        let work = |request, report: &Report<'_, TargetEvent<T>>| {
            let _ = load(request, report);
        };
        let worker = Worker::new(work, wake)
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(ClipController {
            state: QueueState::new(cyclic),
            worker,
            options,
            target: None,
            position_s: 0.0,
            reopens_at: Instant::now(),
            reopens_after: REOPENS_AFTER,
        })
    }

    /// Sets what clips are made ready for. The clip on display, at `position_s` seconds, is loaded again for it, as a
    /// [`Refine`](super::state::Transition::Refine).
    pub(crate) fn set_target(&mut self, target: T, position_s: f64) {
        self.target = Some(target);
        self.position_s = position_s;
        self.state.reload();
        self.send_request();
    }

    /// Opens the clip on display again if its file was replaced, as a [`Refine`](super::state::Transition::Refine).
    /// Returns what to say. Does nothing while another one is about to be shown, and for a while after the last time.
    pub(crate) fn reopen(&mut self, clock: &Clock, is_replaced: impl FnOnce() -> bool) -> Option<String> {
        let is_leaving = self.state.skip_requested() || clock.overrun_s().is_some();
        let is_early = self.state.is_loading() || Instant::now() < self.reopens_at;
        if is_leaving || is_early || !is_replaced() {
            return None;
        }
        let name = self.state.reopen()?;
        self.position_s = clock.position_s();
        self.reopens_at = Instant::now() + self.reopens_after;
        self.reopens_after *= 2;
        self.send_request();
        Some(format!("{}: the file was replaced: opening it again", redacted(&name)))
    }

    /// Opens paths and URLs of clips, playlists and folders, or without any the demo; the present clip plays until one of
    /// them is shown.
    pub(crate) fn open(&mut self, names: impl IntoIterator<Item = String>) {
        self.state.open(names);
        (self.reopens_at, self.reopens_after) = (Instant::now(), REOPENS_AFTER);
        self.send_request();
    }

    /// The next change that follows from the loader's events, if there is one. Does not block.
    pub(crate) fn poll(&mut self) -> Option<Change<T::Ready>> {
        while self.state.is_loading() {
            let event = match self.worker.poll() {
                Ok(event) => event?,
                Err(_) => failure(),
            };
            if let Some(change) = self.on_event(event) {
                return Some(change);
            }
        }
        None
    }

    /// Waits for the next change; `None` if nothing is being loaded.
    ///
    /// # Panics
    /// If the loader has panicked.
    #[cfg(not(target_os = "android"))]
    pub(crate) fn wait(&mut self) -> Option<Change<T::Ready>> {
        while self.state.is_loading() {
            let event = self.worker.wait().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            if let Some(change) = self.on_event(event) {
                return Some(change);
            }
        }
        None
    }

    fn on_event(&mut self, event: TargetEvent<T>) -> Option<Change<T::Ready>> {
        let change = self.state.on_event(event);
        self.send_request();
        change
    }

    /// Takes in the clock of the clip on display, once a frame: at its end, unless the viewer has paused, or
    /// after a skip, goes to the next clip as soon as it is ready.
    pub(crate) fn advance(&mut self, clock: &mut Clock) -> Option<Change<T::Ready>> {
        if clock.take_started_over() {
            self.state.start_over();
            self.send_request();
            return None;
        }
        let is_over = clock.overrun_s().is_some() && clock.is_playing();
        if is_over || self.state.skip_requested() { self.follow() } else { None }
    }

    /// Asks for the next clip of the playlist ahead of [`ClipController::follow`].
    #[cfg(not(target_os = "android"))]
    pub(crate) fn prefetch(&mut self) {
        self.state.prefetch();
        self.send_request();
    }

    /// Goes to the next clip of the playlist if it is ready; else playback is blocked on it.
    pub(crate) fn follow(&mut self) -> Option<Change<T::Ready>> {
        let change = self.state.follow();
        self.send_request();
        change
    }

    /// Whether the clip on display waits at its end for the next one.
    pub(crate) fn is_followed(&self, looping: bool) -> bool {
        self.state.is_followed(looping)
    }

    /// Goes to the next or the previous clip: of the playlist, the next one as soon as it is ready; else of the folder.
    pub(crate) fn skip(&mut self, direction: Direction) -> Option<Change<T::Ready>> {
        let change = self.state.skip(direction);
        self.send_request();
        change
    }

    /// Whether there is a clip to go to in a direction, as far as is known.
    pub(crate) fn has_neighbour(&self, direction: Direction) -> bool {
        self.state.has_neighbour(direction)
    }

    /// Whether a clip is being loaded.
    pub(crate) fn is_loading(&self) -> bool {
        self.state.is_loading()
    }

    /// What was opened last, if it has one name.
    pub(crate) fn named(&self) -> Option<&str> {
        self.state.named()
    }

    /// The clip on display, a path or a URL; `None` for the demo.
    #[cfg(feature = "window")]
    pub(crate) fn current_name(&self) -> Option<&str> {
        self.state.current()?.name.as_deref()
    }

    /// The playlist on display, at the clip on display.
    pub(crate) fn queue(&self) -> Option<&Queue> {
        self.state.queue()
    }

    fn send_request(&mut self) {
        // Without a target the request waits for one.
        let Some(target) = &self.target else { return };
        if let Some((selection, is_blocking)) = self.state.take_request() {
            let position_s = std::mem::take(&mut self.position_s);
            self.worker.request(LoadRequest {
                target: target.clone(),
                selection,
                options: self.options.clone(),
                is_blocking,
                position_s,
            });
        }
    }
}

/// The event of a loader that has panicked. It takes further requests.
fn failure<C>() -> LoadEvent<C> {
    let why =
        "the clip could not be loaded because of a defect of the player: report it with the player's log";
    LoadEvent::Failed(Fault::Defect(why.into()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;
    use std::sync::mpsc::{Sender, channel};

    use super::*;
    use crate::clips::Entry;
    use crate::clips::state::Transition;
    use crate::content::{OpenTake, SourceOptions};
    use crate::player::Beginning;
    use crate::test_fields;

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    fn options() -> LoadOptions {
        LoadOptions { source: SourceOptions::default(), min_layers: 1, is_complete: false }
    }

    /// Panics for every clip.
    #[derive(Clone)]
    struct Defective;

    impl ClipTarget for Defective {
        type Ready = ();

        fn prepare(&self, _: &Entry, _: Arc<OpenTake>, _: Beginning<'_>) -> Result<(), Fault> {
            panic!("of the test")
        }
    }

    #[test]
    fn a_panic_of_the_loader_is_a_failure_with_the_exit_code_of_a_defect() {
        let (wake, woken) = channel();
        let mut clips = ClipController::new(options(), true, move || {
            let _ = wake.send(());
        })
        .unwrap();
        clips.open(None);
        clips.set_target(Defective, 0.0);
        let fault = loop {
            woken.recv_timeout(Duration::from_secs(60)).expect("the display is woken for it");
            if let Some(Change::Failed(fault)) = clips.poll() {
                break fault;
            }
        };
        assert_eq!(fault.exit_code(), 1, "{fault}");
        assert!(!clips.is_loading(), "a display that waits on would load for ever");
    }

    /// Waits for every clip but the demo, as for a server that is silent.
    #[derive(Clone)]
    struct Patient(Sender<()>);

    impl ClipTarget for Patient {
        type Ready = ();

        fn prepare(&self, entry: &Entry, _: Arc<OpenTake>, beginning: Beginning<'_>) -> Result<(), Fault> {
            self.0.send(()).unwrap();
            while entry.name.is_some() && !(beginning.is_overtaken)() {
                std::thread::sleep(Duration::from_millis(1));
            }
            Ok(())
        }
    }

    #[test]
    fn another_clip_opens_while_one_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        std::fs::write(&path, DEMO).unwrap();
        let (begin, begun) = channel();
        let mut clips = ClipController::new(options(), true, || ()).unwrap();
        clips.set_target(Patient(begin), 0.0);
        clips.open(Some(path.to_str().unwrap().into()));
        begun.recv_timeout(Duration::from_secs(60)).unwrap();
        clips.open(None);
        let shown = std::iter::from_fn(|| clips.wait()).find_map(|change| match change {
            Change::Show { entry, .. } => Some(entry.name),
            _ => None,
        });
        assert_eq!(shown, Some(None), "it is the demo");
    }

    #[test]
    #[cfg(unix)]
    fn nobody_waits_for_a_disk_that_does_not_answer() {
        let folder = tempfile::tempdir().unwrap();
        let [other, pipe, list] = ["b.aarc", "a.aarc", "a.json"].map(|name| folder.path().join(name));
        let field = test_fields::field(&test_fields::ball()[..50]);
        std::fs::write(&other, test_fields::package(&test_fields::y_up(), &field)).unwrap();
        // Opening them waits for a writer.
        let made = std::process::Command::new("mkfifo").args([&pipe, &list]).status();
        assert!(made.unwrap().success());
        let (done, is_done) = channel();
        std::thread::spawn(move || {
            let mut clips = ClipController::new(options(), true, || ()).unwrap();
            clips.set_target(Display, 0.0);
            for path in [&pipe, &list] {
                let name = |path: &Path| path.to_str().map(String::from);
                clips.open(name(path));
                std::thread::sleep(Duration::from_millis(200));
                clips.open(name(&other));
                while clips.wait().is_some() {}
                done.send("another clip opens").unwrap();
                clips.open(name(path));
                std::thread::sleep(Duration::from_millis(200));
            }
            drop(clips);
            done.send("it is closed").unwrap();
        });
        for expected in ["another clip opens", "another clip opens", "it is closed"] {
            let done = is_done.recv_timeout(Duration::from_secs(60));
            assert_eq!(done, Ok(expected));
        }
    }

    /// Shows every clip.
    #[derive(Clone)]
    struct Display;

    impl ClipTarget for Display {
        type Ready = ();

        fn prepare(&self, _: &Entry, _: Arc<OpenTake>, _: Beginning<'_>) -> Result<(), Fault> {
            Ok(())
        }
    }

    #[test]
    fn the_next_clip_follows_at_the_end_unless_paused_and_after_a_skip() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.aarc", "b.aarc"] {
            std::fs::write(folder.path().join(name), DEMO).unwrap();
        }
        let list = folder.path().join("list.json");
        std::fs::write(&list, r#"{"version": 1, "clips": ["a.aarc", "b.aarc"]}"#).unwrap();
        let list = list.to_str().unwrap();
        let mut clips = ClipController::new(options(), true, || ()).unwrap();
        clips.set_target(Display, 0.0);
        clips.open(Some(list.into()));
        assert_eq!(clips.named(), Some(list));
        let mut clock = Clock::new(1.0, 10.0);
        clock.set_has_next(true);
        let followed = |change| match change {
            Some(Change::Show { entry, transition: Transition::Follow, .. }) => Some(entry.number),
            None => None,
            Some(change) => panic!("{change:?}"),
        };
        while clips.wait().is_some() {}
        assert_eq!(followed(clips.advance(&mut clock)), None, "in the middle of the clip");
        clock.advance(2.0);
        clock.set_playing(false);
        assert_eq!(followed(clips.advance(&mut clock)), None, "paused at the end");
        clock.set_playing(true);
        assert_eq!(followed(clips.advance(&mut clock)), Some(1));
        clock.continue_with(1.0, 10.0);
        while clips.wait().is_some() {}
        assert_eq!(followed(clips.advance(&mut clock)), None, "in the middle of the second clip");
        assert!(clips.skip(Direction::Forward).is_none(), "the next clip is shown with the next frame");
        assert_eq!(followed(clips.advance(&mut clock)), Some(0));
    }
}
