//! [`QueueState`]: which clip is on display, which comes next, and what the loader has to do for it.
//!
//! A state machine without threads: it takes [`LoadEvent`]s and the wishes of the viewer, and answers with
//! [`Change`]s to the display and requests to the loader. At most one clip besides the clip on display is held ready.
//!
//! ```text
//! open ----> Opening --first version--> Current --newer versions--> idle
//!                                                                     |  request_next
//! shown <--- follow <--- Ready <--first version-- Next <--------------+
//! ```

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::event::{LoadEvent, Version};
use super::folder::{Direction, Neighbours};
use super::loader::Selection;
use super::queue::{Entry, Queue};
use crate::content::Progress;
use program::Fault;

/// What a display has to do.
#[derive(Debug)]
pub(crate) enum Change<C> {
    /// Show this clip.
    Show { entry: Entry, clip: C, transition: Transition },
    /// Say how much of the clip that playback waits for has arrived.
    Progress(Progress),
    /// Say that playback waits for the next clip.
    Waiting,
    /// Show a remark for a while.
    Note(String),
    /// Say why a clip cannot be shown. The clip on display, if there is one, stays.
    Failed(Fault),
    /// Remove the progress: nothing is being loaded.
    Idle,
}

/// How a clip takes the place of the clip on display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transition {
    /// From its start: the viewer opened it.
    Open,
    /// As the next clip of the playlist, which loses no time and changes nothing else.
    Follow,
    /// As another version of the clip on display, at the same instant.
    Refine,
}

/// What the loader works on.
#[derive(Debug)]
enum Loading {
    /// What the viewer opened; the flag says whether [`QueueState::neighbours`] are already the neighbours of this
    /// clip.
    Opening { has_neighbours: bool },
    /// Another clip of the playlist on display.
    Beside,
    /// Versions of the clip on display.
    Current,
    /// The next clip; the flag says whether playback is blocked on it.
    Next(Arc<AtomicBool>),
}

/// The next clip of the playlist.
#[derive(Debug)]
enum Next<C> {
    /// Not requested, or being loaded.
    Pending,
    Ready(Entry, C),
    /// All candidates failed. They are tried again once the clip on display starts over.
    Unavailable,
}

/// The clip on display, the next one, and the loader's work.
#[derive(Debug)]
pub(super) struct QueueState<C> {
    /// Whether the first clip of a playlist follows the last, and the next one is always held ready. Else the
    /// next one is loaded when it is asked for.
    cyclic: bool,
    /// Whether the next clip was asked for.
    next_wanted: bool,
    /// What was opened last: clips, playlists and folders; nothing for the demo.
    named: Vec<String>,
    /// What the clip on display was opened as: itself, or what lists it.
    opened_as: Vec<String>,
    /// The playlist on display.
    queue: Option<Queue>,
    /// The playlist that is being opened, until one of its clips is shown.
    opened: Option<Queue>,
    /// Without a playlist, the clips that a skip opens.
    neighbours: Neighbours,
    /// Those of the clip on display while another one is opened by name: they remain if it fails.
    neighbours_before: Option<Neighbours>,
    /// The clips of the playlist that the loader tries, from the clip that it tries now.
    candidates: VecDeque<Entry>,
    /// The clip on display.
    current: Option<Entry>,
    next: Next<C>,
    loading: Option<Loading>,
    request: Option<(Selection, Arc<AtomicBool>)>,
    skip_requested: bool,
}

impl<C> QueueState<C> {
    /// With nothing on display.
    pub(super) fn new(cyclic: bool) -> QueueState<C> {
        QueueState {
            cyclic,
            next_wanted: false,
            named: Vec::new(),
            opened_as: Vec::new(),
            queue: None,
            opened: None,
            neighbours: Neighbours::default(),
            neighbours_before: None,
            candidates: VecDeque::new(),
            current: None,
            next: Next::Pending,
            loading: None,
            request: None,
            skip_requested: false,
        }
    }

    /// Opens clips, playlists and folders, which replace everything once a clip of them can be shown.
    pub(super) fn open(&mut self, names: impl IntoIterator<Item = String>) {
        if self.current.is_some() && self.neighbours_before.is_none() {
            self.neighbours_before = Some(self.neighbours.clone());
        }
        self.open_named(names.into_iter().collect(), false);
    }

    fn open_named(&mut self, names: Vec<String>, has_neighbours: bool) {
        self.named.clone_from(&names);
        self.forget_next();
        self.opened = None;
        self.load(Loading::Opening { has_neighbours }, Selection::Named(names));
    }

    /// Loads the clip on display again, for another device, or opens again what was being opened. Clips
    /// that are ready are lost.
    pub(super) fn reload(&mut self) {
        self.forget_next();
        match self.current.clone() {
            Some(entry) => self.load(Loading::Current, Selection::FirstOf(vec![entry])),
            None if self.loading.is_some() => self.open(self.named.clone()),
            None => {}
        }
    }

    /// Opens the clip on display again, and returns its name. The demo has none.
    pub(super) fn reopen(&mut self) -> Option<String> {
        let entry = self.current.clone()?;
        let name = entry.name.clone()?;
        self.load(Loading::Current, Selection::FirstOf(vec![entry]));
        Some(name)
    }

    /// Goes to the next or the previous clip: of the playlist, the next one as soon as it is ready; else of the
    /// folder. Counts from the clip that is being opened, if there is one: two skips in quick succession are two clips.
    /// Where no clip of the playlist could be shown, all are tried again.
    pub(super) fn skip(&mut self, direction: Direction) -> Option<Change<C>> {
        if let Some(Loading::Opening { has_neighbours }) = self.loading {
            if has_neighbours && let Some(change) = self.skip_in_folder(direction) {
                return Some(change);
            }
            // A playlist on display goes on in place of what is being opened.
            if self.queue.is_none() || self.current.is_none() {
                return None;
            }
        }
        match (&self.queue, &self.current) {
            (Some(queue), Some(_)) => {
                let target = self.skip_target();
                if direction == Direction::Forward && target.is_none() {
                    self.skip_requested = true;
                    return None;
                }
                let mut queue = queue.clone();
                queue.go_to(target.unwrap_or(queue.position()));
                self.go_to_first_of(match direction {
                    Direction::Back => queue.candidates_before(),
                    Direction::Forward => queue.candidates(true),
                })
            }
            (Some(queue), None) => {
                let entries = queue.all();
                self.go_to_first_of(entries)
            }
            (None, _) => self.skip_in_folder(direction),
        }
    }

    /// Number of the clip of the playlist that the skips so far lead to, if it is not on display yet.
    fn skip_target(&self) -> Option<usize> {
        let entry = match (&self.loading, &self.next) {
            (Some(Loading::Beside), _) => self.candidates.front().cloned(),
            _ if !self.skip_requested => None,
            (_, Next::Ready(entry, _)) => Some(entry.clone()),
            (Some(Loading::Next(_)), _) => self.candidates.front().cloned(),
            (_, Next::Pending) => self.queue.as_ref()?.candidates(true).into_iter().next(),
            (_, Next::Unavailable) => None,
        };
        Some(entry?.number)
    }

    /// Opens the neighbour in a direction.
    fn skip_in_folder(&mut self, direction: Direction) -> Option<Change<C>> {
        let (name, neighbours) = self.neighbours.step(direction)?;
        // Past one that cannot be read, skips go on.
        (self.neighbours, self.neighbours_before) = (neighbours, None);
        self.open_named(vec![name], true);
        Some(Change::Waiting)
    }

    /// Opens the first of `entries` of the playlist that can be loaded, if there are some.
    fn go_to_first_of(&mut self, entries: Vec<Entry>) -> Option<Change<C>> {
        if entries.is_empty() {
            return None;
        }
        self.forget_next();
        self.opened = self.queue.clone();
        let is_beside = self.current.is_some();
        if is_beside {
            // Something else may have failed to open since.
            self.named.clone_from(&self.opened_as);
        }
        let loading = if is_beside { Loading::Beside } else { Loading::Opening { has_neighbours: false } };
        self.load(loading, Selection::FirstOf(entries));
        Some(Change::Waiting)
    }

    /// Whether there is a clip to go to in a direction, as far as is known.
    pub(super) fn has_neighbour(&self, direction: Direction) -> bool {
        match &self.queue {
            None => self.neighbours.get(direction).is_some(),
            Some(_) if self.current.is_none() => true,
            Some(queue) => queue.len() > 1 && !matches!(self.next, Next::Unavailable),
        }
    }

    /// Takes in an event of the loader.
    pub(super) fn on_event(&mut self, event: LoadEvent<C>) -> Option<Change<C>> {
        match event {
            LoadEvent::Progress(progress) => self.shows_progress().then_some(Change::Progress(progress)),
            LoadEvent::Note(note) => Some(Change::Note(note)),
            LoadEvent::Skipped(fault) => {
                self.candidates.pop_front();
                Some(skipped(&fault))
            }
            LoadEvent::Playlist(queue) => {
                (self.opened, self.neighbours) = (Some(queue), Neighbours::default());
                None
            }
            LoadEvent::Neighbours(neighbours) => {
                self.neighbours = neighbours;
                if let Some(Loading::Opening { has_neighbours }) = &mut self.loading {
                    *has_neighbours = true;
                }
                None
            }
            LoadEvent::Clip(version) => self.on_version(version),
            LoadEvent::Failed(fault) => Some(self.on_failure(fault)),
            LoadEvent::Done => {
                self.finish();
                Some(Change::Idle)
            }
        }
    }

    fn on_version(&mut self, Version { entry, is_first, clip }: Version<C>) -> Option<Change<C>> {
        match self.loading {
            Some(Loading::Opening { .. } | Loading::Beside) => {
                let is_beside = matches!(self.loading, Some(Loading::Beside));
                self.queue = self.opened.take();
                if let Some(queue) = &mut self.queue {
                    queue.go_to(entry.number);
                }
                self.opened_as.clone_from(&self.named);
                self.neighbours_before = None;
                self.forget_next();
                self.current = Some(entry.clone());
                self.loading = Some(Loading::Current);
                let transition = if is_beside { Transition::Follow } else { Transition::Open };
                Some(Change::Show { entry, clip, transition })
            }
            Some(Loading::Next(_)) if is_first || matches!(self.next, Next::Ready(..)) => {
                self.next = Next::Ready(entry, clip);
                None
            }
            _ => Some(Change::Show { entry, clip, transition: Transition::Refine }),
        }
    }

    fn on_failure(&mut self, fault: Fault) -> Change<C> {
        let is_last_candidate = self.is_next_coming();
        if let (Some(Loading::Opening { .. }), None) = (&self.loading, &self.current) {
            // The viewer may have the playlist tried again.
            self.queue = self.opened.take();
        }
        if let Some(before) = self.neighbours_before.take() {
            self.neighbours = before;
        }
        self.finish();
        if is_last_candidate { skipped(&fault) } else { Change::Failed(fault) }
    }

    /// No more events follow.
    fn finish(&mut self) {
        if self.is_next_coming() {
            self.next = Next::Unavailable;
        }
        self.loading = None;
        self.opened = None;
        self.request_next();
    }

    /// Takes in that the clip on display started over: failed candidates are tried again.
    pub(super) fn start_over(&mut self) {
        if let Next::Unavailable = self.next {
            self.next = Next::Pending;
        }
        self.request_next();
    }

    /// Whether the clip on display waits at its end for the next one. A looping clip whose newer versions
    /// are still being loaded does not: they may take long.
    pub(super) fn is_followed(&self, looping: bool) -> bool {
        let (Some(queue), Some(_)) = (&self.queue, &self.current) else { return false };
        let number = match &self.next {
            Next::Ready(entry, _) => entry.number,
            Next::Pending if !self.is_next_coming() && looping => return false,
            Next::Pending => (queue.position() + 1) % queue.len(),
            Next::Unavailable => return false,
        };
        queue.is_followed_by(number, looping)
    }

    /// Whether a skip was requested and waits for the next clip.
    pub(super) fn skip_requested(&self) -> bool {
        self.skip_requested
    }

    /// Asks for the next clip of the playlist, which [`QueueState::follow`] will go to.
    #[cfg(not(target_os = "android"))]
    pub(super) fn prefetch(&mut self) {
        self.next_wanted = true;
        self.request_next();
    }

    /// Goes to the next clip of the playlist if it is ready; else playback is blocked on it.
    pub(super) fn follow(&mut self) -> Option<Change<C>> {
        self.next_wanted = true;
        self.request_next();
        match std::mem::replace(&mut self.next, Next::Pending) {
            Next::Ready(entry, clip) => {
                if let Some(queue) = &mut self.queue {
                    queue.go_to(entry.number);
                }
                self.current = Some(entry.clone());
                (self.next_wanted, self.skip_requested) = (false, false);
                // Its newer versions may be on their way.
                if let Some(Loading::Next(_)) = self.loading {
                    self.loading = Some(Loading::Current);
                }
                self.request_next();
                Some(Change::Show { entry, clip, transition: Transition::Follow })
            }
            next => {
                self.skip_requested &= !matches!(next, Next::Unavailable);
                self.next = next;
                match &self.loading {
                    Some(Loading::Next(is_blocking)) if !is_blocking.swap(true, Ordering::Relaxed) => {
                        Some(Change::Waiting)
                    }
                    _ => None,
                }
            }
        }
    }

    /// The request for the loader, if there is a new one.
    pub(super) fn take_request(&mut self) -> Option<(Selection, Arc<AtomicBool>)> {
        self.request.take()
    }

    /// Whether the loader is at work.
    pub(super) fn is_loading(&self) -> bool {
        self.loading.is_some()
    }

    /// What was opened last, if it has one name.
    pub(super) fn named(&self) -> Option<&str> {
        if let [name] = &self.named[..] { Some(name) } else { None }
    }

    /// The clip on display.
    #[cfg(feature = "window")]
    pub(super) fn current(&self) -> Option<&Entry> {
        self.current.as_ref()
    }

    /// The playlist on display.
    pub(super) fn queue(&self) -> Option<&Queue> {
        self.queue.as_ref()
    }

    /// Requests the next clip of the playlist if it is wanted, unless the loader is at work.
    fn request_next(&mut self) {
        let (Some(queue), Some(_)) = (&self.queue, &self.current) else { return };
        let is_wanted = self.cyclic || self.next_wanted;
        if !is_wanted || self.loading.is_some() || !matches!(self.next, Next::Pending) {
            return;
        }
        let candidates = queue.candidates(self.cyclic);
        if candidates.is_empty() {
            self.next = Next::Unavailable;
        } else {
            self.load(Loading::Next(Arc::default()), Selection::FirstOf(candidates));
        }
    }

    fn load(&mut self, loading: Loading, selection: Selection) {
        let is_blocking = match &loading {
            Loading::Next(is_blocking) => is_blocking.clone(),
            Loading::Opening { .. } | Loading::Beside | Loading::Current => Arc::new(true.into()),
        };
        self.candidates = match &selection {
            Selection::FirstOf(entries) => entries.clone().into(),
            _ => VecDeque::new(),
        };
        self.loading = Some(loading);
        self.request = Some((selection, is_blocking));
    }

    fn forget_next(&mut self) {
        (self.next, self.next_wanted, self.skip_requested) = (Next::Pending, false, false);
    }

    fn is_next_coming(&self) -> bool {
        matches!((&self.loading, &self.next), (Some(Loading::Next(_)), Next::Pending))
    }

    /// Whether the loader works on what playback waits for.
    fn shows_progress(&self) -> bool {
        match &self.loading {
            Some(Loading::Next(is_blocking)) => is_blocking.load(Ordering::Relaxed),
            _ => true,
        }
    }
}

fn skipped<C>(fault: &Fault) -> Change<C> {
    Change::Note(format!("{fault}; skipped"))
}

#[cfg(test)]
mod tests {
    use super::*;

    type State = QueueState<&'static str>;

    fn clip(number: usize, is_first: bool, clip: &'static str) -> LoadEvent<&'static str> {
        let entry = Entry { number, name: Some(number.to_string()) };
        LoadEvent::Clip(Version { entry, is_first, clip })
    }

    fn failed(why: &str) -> LoadEvent<&'static str> {
        LoadEvent::Failed(Fault::Data(why.into()))
    }

    fn queue(count: usize) -> Queue {
        Queue::new((0..count).map(|number| number.to_string()).collect())
    }

    /// A change in short.
    fn short(change: Option<Change<&'static str>>) -> String {
        match change {
            None => String::new(),
            Some(Change::Show { entry, clip, transition }) => {
                format!("{transition:?} {} {clip}", entry.number)
            }
            Some(Change::Progress(_)) => "progress".into(),
            Some(Change::Waiting) => "waiting".into(),
            Some(Change::Note(note)) => note,
            Some(Change::Failed(fault)) => format!("failed: {fault}"),
            Some(Change::Idle) => "idle".into(),
        }
    }

    /// The numbers of the candidates requested, and the flag that says whether playback is blocked on them.
    fn requested(state: &mut State) -> Option<(Vec<usize>, Arc<AtomicBool>)> {
        match state.take_request()? {
            (Selection::FirstOf(entries), flag) => Some((entries.iter().map(|e| e.number).collect(), flag)),
            _ => None,
        }
    }

    fn candidates(state: &mut State) -> Option<Vec<usize>> {
        requested(state).map(|(numbers, _)| numbers)
    }

    /// A playlist of `count` clips. The first plays, and nothing else was requested.
    fn playing(count: usize) -> State {
        let mut state = State::new(true);
        state.open(Some("list".into()));
        assert!(matches!(state.take_request(), Some((Selection::Named(_), _))));
        assert_eq!(short(state.on_event(LoadEvent::Playlist(queue(count)))), "");
        assert_eq!(short(state.on_event(clip(0, true, "a"))), "Open 0 a");
        assert!(state.take_request().is_none(), "newer versions come first");
        assert_eq!(short(state.on_event(LoadEvent::Done)), "idle");
        state
    }

    #[test]
    fn the_next_clip_is_requested_once_and_follows_when_it_is_ready() {
        let mut state = playing(3);
        assert_eq!(candidates(&mut state).unwrap(), [1, 2]);
        assert!(state.is_followed(true) && state.is_followed(false));
        assert_eq!(short(state.on_event(clip(2, true, "c"))), "");
        assert_eq!(short(state.on_event(clip(2, false, "a better c"))), "", "of the next one");
        assert_eq!(short(state.on_event(LoadEvent::Done)), "idle");
        assert!(state.take_request().is_none() && state.is_followed(false));
        assert_eq!(short(state.follow()), "Follow 2 a better c");
        assert_eq!(state.queue().unwrap().position(), 2);
        assert_eq!(candidates(&mut state).unwrap(), [0, 1], "looped");
        assert!(!state.is_followed(false) && state.is_followed(true), "that was the last one");
    }

    #[test]
    fn a_late_next_clip_blocks_playback() {
        let mut state = playing(2);
        let (_, is_blocking) = requested(&mut state).unwrap();
        let progress = || LoadEvent::Progress(Progress::default());
        assert_eq!(short(state.on_event(progress())), "", "nobody waits for it");
        assert_eq!(short(state.follow()), "waiting");
        assert!(is_blocking.load(Ordering::Relaxed) && state.follow().is_none(), "said once");
        assert_eq!(short(state.on_event(progress())), "progress");
        state.on_event(clip(1, true, "b"));
        assert_eq!(short(state.follow()), "Follow 1 b");
        assert!(state.take_request().is_none(), "its newer versions come first");
        assert!(!state.is_followed(true), "a loop does not wait for them");
        assert_eq!(short(state.on_event(clip(1, false, "a better b"))), "Refine 1 a better b");
        state.on_event(LoadEvent::Done);
        assert_eq!(candidates(&mut state).unwrap(), [0]);
    }

    #[test]
    fn a_skip_waits_for_the_next_clip() {
        let mut state = playing(2);
        candidates(&mut state).unwrap();
        assert!(state.has_neighbour(Direction::Forward));
        assert_eq!(short(state.skip(Direction::Forward)), "");
        assert!(state.skip_requested() && short(state.follow()) == "waiting");
        state.on_event(clip(1, true, "b"));
        assert_eq!(short(state.follow()), "Follow 1 b");
        assert!(!state.skip_requested());
        // A skip during the newer versions waits for them and for the clip after.
        state.skip(Direction::Forward);
        assert!(state.follow().is_none() && state.skip_requested());
        state.on_event(LoadEvent::Done);
        assert_eq!(short(state.follow()), "waiting");
        assert_eq!(short(state.on_event(failed("gone"))), "gone; skipped");
        assert!(
            state.follow().is_none() && !state.skip_requested() && !state.has_neighbour(Direction::Forward)
        );
    }

    #[test]
    fn failed_candidates_are_tried_again_when_the_clip_starts_over() {
        let mut state = playing(3);
        candidates(&mut state).unwrap();
        let bad = Fault::Data("bad".into());
        assert_eq!(short(state.on_event(LoadEvent::Skipped(bad))), "bad; skipped");
        assert_eq!(short(state.on_event(failed("worse"))), "worse; skipped");
        assert!(!state.is_followed(true) && state.take_request().is_none() && !state.is_loading());
        state.start_over();
        assert_eq!(candidates(&mut state).unwrap(), [1, 2]);
        state.start_over();
        assert!(state.take_request().is_none(), "they are being loaded");
        let mut single = playing(1);
        assert!(
            single.take_request().is_none()
                && !single.is_followed(true)
                && !single.has_neighbour(Direction::Forward)
        );
    }

    #[test]
    fn a_skip_after_all_failed_tries_the_first_clip_again() {
        let mut state = State::new(true);
        state.open(Some("list".into()));
        state.on_event(LoadEvent::Playlist(queue(2)));
        state.skip(Direction::Forward);
        assert!(!state.skip_requested(), "the loader is at work");
        assert_eq!(short(state.on_event(failed("all"))), "failed: all");
        state.take_request();
        assert!(
            state.has_neighbour(Direction::Forward) && state.follow().is_none() && !state.is_followed(true)
        );
        for _ in 0..2 {
            assert_eq!(short(state.skip(Direction::Forward)), "waiting");
            assert_eq!(candidates(&mut state).unwrap(), [0, 1]);
            assert_eq!(short(state.on_event(failed("again"))), "failed: again");
        }
        state.skip(Direction::Forward);
        assert_eq!(short(state.on_event(clip(1, true, "b"))), "Open 1 b");
        state.take_request();
        state.on_event(LoadEvent::Done);
        assert_eq!(candidates(&mut state).unwrap(), [0]);
    }

    #[test]
    fn a_skip_back_opens_the_clip_before() {
        let mut state = playing(3);
        candidates(&mut state).unwrap();
        state.on_event(clip(1, true, "b"));
        assert!(state.has_neighbour(Direction::Back));
        assert_eq!(short(state.skip(Direction::Back)), "waiting");
        assert_eq!(candidates(&mut state).unwrap(), [2, 1], "from the first one to the last");
        assert!(state.follow().is_none(), "the clip after is forgotten");
        assert_eq!(short(state.on_event(LoadEvent::Skipped(Fault::Data("bad".into())))), "bad; skipped");
        assert_eq!(short(state.on_event(clip(1, true, "b"))), "Follow 1 b");
        assert_eq!(state.queue().unwrap().position(), 1);
        assert_eq!(state.named(), Some("list"));
        state.on_event(LoadEvent::Done);
        assert_eq!(candidates(&mut state).unwrap(), [2, 0]);
        state.skip(Direction::Back);
        assert_eq!(candidates(&mut state).unwrap(), [0, 2]);
        assert_eq!(short(state.on_event(failed("gone"))), "failed: gone");
        assert_eq!(state.queue().unwrap().position(), 1, "the clip on display stays");
        state.open(Some("other".into()));
        state.on_event(failed("missing"));
        state.skip(Direction::Back);
        assert_eq!(state.named(), Some("list"));
    }

    #[test]
    fn skips_in_quick_succession_count_from_the_clip_that_is_being_opened() {
        let (back, forward) = (Direction::Back, Direction::Forward);
        let mut state = playing(4);
        candidates(&mut state).unwrap();
        state.skip(back);
        assert_eq!(candidates(&mut state).unwrap(), [3, 2, 1]);
        assert_eq!(short(state.skip(back)), "waiting");
        assert_eq!(candidates(&mut state).unwrap(), [2, 1, 0]);
        assert_eq!(short(state.on_event(LoadEvent::Skipped(Fault::Data("bad".into())))), "bad; skipped");
        state.skip(back);
        assert_eq!(candidates(&mut state).unwrap(), [0, 3, 2], "from the one after the damaged one");
        state.skip(forward);
        assert_eq!(candidates(&mut state).unwrap(), [1, 2, 3]);
        assert_eq!(short(state.on_event(clip(1, true, "b"))), "Follow 1 b");
        // Before the next clip is there, while it is loaded, and once it is ready.
        assert_eq!(short(state.skip(forward)), "", "its newer versions come first");
        assert_eq!(short(state.skip(forward)), "waiting");
        assert_eq!(candidates(&mut state).unwrap(), [3, 0, 1]);
        for is_ready in [false, true] {
            let mut state = playing(4);
            assert_eq!(candidates(&mut state).unwrap(), [1, 2, 3]);
            if is_ready {
                state.on_event(clip(1, true, "b"));
            }
            assert_eq!(short(state.skip(forward)), "");
            assert_eq!(short(state.skip(forward)), "waiting");
            assert_eq!(candidates(&mut state).unwrap(), [2, 3, 0]);
            assert!(state.follow().is_none(), "not the clip between");
            assert_eq!(short(state.on_event(clip(2, true, "c"))), "Follow 2 c");
        }
        let mut single = playing(1);
        assert!(single.skip(back).is_none() && single.take_request().is_none() && !single.is_loading());
    }

    #[test]
    fn without_a_playlist_a_skip_opens_the_clips_beside_it_in_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, c, d] = ["a", "b", "c", "d"].map(|stem| {
            let path = folder.path().join(stem).with_extension("aarc");
            std::fs::write(&path, "").unwrap();
            path.to_str().unwrap().to_owned()
        });
        let opened = |state: &mut State| match state.take_request() {
            Some((Selection::Named(names), _)) => names.into_iter().next(),
            _ => None,
        };
        for (direction, beside, second) in [(Direction::Forward, &c, &d), (Direction::Back, &a, &d)] {
            let mut state = State::new(true);
            state.open(Some(b.clone()));
            state.take_request();
            state.skip(direction);
            assert!(state.take_request().is_none(), "its folder is not known yet");
            state.on_event(LoadEvent::Neighbours(Neighbours::find(Some(&b))));
            assert_eq!(short(state.on_event(failed("damaged"))), "failed: damaged");
            assert!(state.has_neighbour(direction) && state.take_request().is_none());
            state.skip(direction);
            assert_eq!(opened(&mut state).as_ref(), Some(beside));
            assert_eq!(short(state.skip(direction)), "waiting");
            assert_eq!(
                opened(&mut state).as_ref(),
                Some(second),
                "counted from the one that is being opened"
            );
            assert_eq!(short(state.on_event(clip(0, true, "d"))), "Open 0 d");
            // Its newer versions are still on their way.
            state.skip(Direction::Back);
            assert_eq!(opened(&mut state).as_ref(), Some(&c));
        }
    }

    #[test]
    fn what_fails_to_open_leaves_the_neighbours_of_the_clip_on_display() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|stem| {
            let path = folder.path().join(stem).with_extension("aarc");
            std::fs::write(&path, "").unwrap();
            path.to_str().unwrap().to_owned()
        });
        let mut state = State::new(true);
        state.open(Some(a.clone()));
        state.on_event(LoadEvent::Neighbours(Neighbours::find(Some(&a))));
        state.on_event(clip(0, true, "a"));
        state.on_event(LoadEvent::Done);
        for event in [LoadEvent::Neighbours(Neighbours::default()), LoadEvent::Playlist(queue(2))] {
            state.open(Some("elsewhere".into()));
            state.on_event(event);
            state.on_event(failed("missing"));
            assert_eq!(state.neighbours.get(Direction::Forward), Some(&b));
        }
    }

    #[test]
    fn a_new_clip_replaces_everything_once_it_can_be_shown() {
        let mut state = playing(2);
        candidates(&mut state).unwrap();
        state.on_event(clip(1, true, "b"));
        state.open(Some("other".into()));
        assert!(matches!(state.take_request(), Some((Selection::Named(_), _))));
        assert_eq!(short(state.on_event(failed("missing"))), "failed: missing");
        assert_eq!(candidates(&mut state).unwrap(), [1], "the playlist goes on");
        state.open(Some("other".into()));
        state.on_event(LoadEvent::Neighbours(Neighbours::default()));
        assert_eq!(short(state.on_event(clip(0, true, "o"))), "Open 0 o");
        assert!(state.queue().is_none());
        assert_eq!(short(state.on_event(clip(0, false, "O"))), "Refine 0 O");
        state.take_request();
        assert!(short(state.on_event(LoadEvent::Done)) == "idle" && state.take_request().is_none());
    }

    #[test]
    fn after_a_device_was_lost_the_clip_on_display_is_loaded_again() {
        let mut state = playing(2);
        candidates(&mut state).unwrap();
        state.on_event(clip(1, true, "b"));
        state.reload();
        assert_eq!(candidates(&mut state).unwrap(), [0]);
        assert!(state.follow().is_none(), "the next clip was lost, too");
        assert_eq!(short(state.on_event(clip(0, true, "a"))), "Refine 0 a");
        state.on_event(LoadEvent::Done);
        assert_eq!(candidates(&mut state).unwrap(), [1]);
        // Before there is a clip, what was named is opened again.
        let mut state = State::new(true);
        state.open(Some("list".into()));
        state.take_request();
        state.reload();
        assert!(matches!(state.take_request(), Some((Selection::Named(names), _)) if names == ["list"]));
    }

    #[test]
    fn better_versions_that_fail_leave_the_clip_on_display() {
        let mut state = State::new(true);
        state.open(None);
        state.take_request();
        state.on_event(clip(0, true, "a"));
        assert_eq!(short(state.on_event(failed("lost"))), "failed: lost");
        assert!(!state.is_loading() && state.take_request().is_none());
    }

    #[test]
    fn images_play_a_list_once_and_load_no_clip_that_is_not_asked_for() {
        let mut state = State::new(false);
        state.open(Some("list".into()));
        assert!(state.follow().is_none(), "there is none yet");
        state.take_request();
        state.on_event(LoadEvent::Playlist(queue(3)));
        state.on_event(clip(0, true, "a"));
        state.on_event(LoadEvent::Done);
        assert!(state.take_request().is_none(), "images may need no other clip");
        state.prefetch();
        assert_eq!(candidates(&mut state).unwrap(), [1, 2]);
        state.on_event(clip(1, true, "b"));
        state.on_event(LoadEvent::Done);
        assert_eq!(short(state.follow()), "Follow 1 b");
        assert!(state.take_request().is_none());
        assert_eq!(short(state.follow()), "waiting", "it has to be loaded first");
        assert_eq!(candidates(&mut state).unwrap(), [2]);
        state.on_event(clip(2, true, "c"));
        state.on_event(LoadEvent::Done);
        assert_eq!(short(state.follow()), "Follow 2 c");
        state.prefetch();
        assert!(state.take_request().is_none() && state.follow().is_none() && !state.is_loading());
    }
}
