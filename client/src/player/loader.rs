//! [`SegmentLoader`]: the thread that reads, decodes and packs segments, the most urgent first.
//!
//! The player changes the list of wants while the thread works: the thread takes the first of them whenever it has
//! finished a segment. So a new plan waits for one segment at most, and no work is lost that is still wanted.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use program::Fault;

use crate::content::{LoadError, Loaded, OpenTake, Want};
use crate::worker::{Report, Worker};

/// What the thread reports.
pub(super) enum SegmentEvent {
    /// Layers of a segment are packed.
    Packed(Loaded),
    /// A segment cannot be read now.
    Unread(Want, Fault),
    /// A segment cannot be decoded.
    Damaged(Want, Fault),
    /// A segment cannot be loaded because the file is another version by now.
    Replaced(Want, Fault),
    /// The read of a segment was ended for the sake of others.
    Overtaken(Want),
    /// Nothing is left to load.
    Idle,
}

/// The wants, and those that were taken and not yet received by the player.
#[derive(Default)]
struct Wants {
    queue: VecDeque<Want>,
    under_way: Vec<Want>,
    /// Whether the read under way was told to end.
    is_cancelled: bool,
}

impl Wants {
    /// Takes in that a segment was loaded, perhaps with more layers than were wanted.
    fn on_loaded(&mut self, loaded: Want) {
        let is_it = |other: &&mut Want| (other.segment, other.from) == (loaded.segment, loaded.from);
        self.under_way.iter_mut().filter(is_it).for_each(|want| *want = loaded);
        let list = self.queue.drain(..).collect();
        self.queue = behind(&self.under_way, list).collect();
    }
}

/// The loader of a take.
pub(super) struct SegmentLoader {
    opened: Arc<OpenTake>,
    wants: Arc<Mutex<Wants>>,
    worker: Worker<(), SegmentEvent>,
    is_idle: bool,
}

impl SegmentLoader {
    /// Starts the thread. It calls `wake` whenever [`SegmentLoader::poll`] may have an event.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(super) fn new(
        opened: Arc<OpenTake>,
        wake: impl Fn() + Send + 'static,
    ) -> Result<SegmentLoader, Fault> {
        let wants = Arc::new(Mutex::new(Wants::default()));
        let (shared, ours) = (wants.clone(), opened.clone());
        let work = move |(), report: &Report<'_, SegmentEvent>| {
            loop {
                let want = {
                    let mut wants = lock(&shared);
                    let Some(want) = wants.queue.pop_front() else { break };
                    wants.under_way.push(want);
                    wants.is_cancelled = false;
                    ours.source().resume();
                    want
                };
                let packed = ours.load(want);
                let is_replaced = ours.is_replaced();
                let event = match packed {
                    Ok(loaded) => {
                        lock(&shared).on_loaded(loaded.want);
                        SegmentEvent::Packed(loaded)
                    }
                    Err(LoadError::Unread(_)) if lock(&shared).is_cancelled => SegmentEvent::Overtaken(want),
                    Err(error) if is_replaced => SegmentEvent::Replaced(want, error.into_fault()),
                    Err(LoadError::Unread(fault)) => SegmentEvent::Unread(want, fault),
                    Err(LoadError::Damaged(fault)) => SegmentEvent::Damaged(want, fault),
                };
                if (report.send)(event).is_break() {
                    return;
                }
            }
            let _ = (report.send)(SegmentEvent::Idle);
        };
        let worker = Worker::new(work, wake)
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(SegmentLoader { opened, wants, worker, is_idle: true })
    }

    /// Replaces the list of wants. Layers under way are left out. Ends the read of a segment that is not in the list.
    pub(super) fn set(&mut self, list: Vec<Want>) {
        let mut wants = lock(&self.wants);
        let is_wanted = |want: &Want| list.iter().any(|other| other.segment == want.segment);
        if wants.under_way.last().is_some_and(|want| !list.is_empty() && !is_wanted(want)) {
            wants.is_cancelled = true;
            self.opened.source().cancel();
        }
        wants.queue = behind(&wants.under_way, list).collect();
        let is_needed = !wants.queue.is_empty();
        drop(wants);
        if self.is_idle && is_needed {
            self.is_idle = false;
            self.worker.request(());
        }
    }

    /// The segments that were taken from the list, and that have sent no event yet.
    pub(super) fn under_way(&self) -> Vec<usize> {
        lock(&self.wants).under_way.iter().map(|want| want.segment).collect()
    }

    /// The next segment, if one was loaded or has failed. Does not block.
    pub(super) fn poll(&mut self) -> Option<SegmentEvent> {
        loop {
            let event = self.worker.poll().unwrap_or_else(|_| Some(self.panicked()))?;
            if let Some(event) = self.take_in(event) {
                return Some(event);
            }
        }
    }

    /// Waits for the next segment; `None` if there is none after `time`, or nothing is left to load.
    pub(super) fn wait(&mut self, time: Duration) -> Option<SegmentEvent> {
        if self.is_idle {
            return None;
        }
        let event = self.worker.wait_for(time).unwrap_or_else(|_| Some(self.panicked()))?;
        self.take_in(event)
    }

    /// Whether nothing is left to load.
    pub(super) fn is_idle(&self) -> bool {
        self.is_idle
    }

    /// Takes in an event of the thread; `None` if it was idle.
    fn take_in(&mut self, event: SegmentEvent) -> Option<SegmentEvent> {
        match &event {
            SegmentEvent::Packed(Loaded { want, .. })
            | SegmentEvent::Unread(want, _)
            | SegmentEvent::Damaged(want, _)
            | SegmentEvent::Replaced(want, _)
            | SegmentEvent::Overtaken(want) => {
                lock(&self.wants).under_way.retain(|other| other != want);
                Some(event)
            }
            SegmentEvent::Idle => {
                // Wants may have come after it last looked.
                self.is_idle = true;
                let list = lock(&self.wants).queue.drain(..).collect();
                self.set(list);
                None
            }
        }
    }

    /// The failure of the segment whose loading panicked: the last one that was taken. The thread takes further requests.
    fn panicked(&mut self) -> SegmentEvent {
        let want = lock(&self.wants).under_way.last().copied();
        self.is_idle = true;
        let why = "it could not be loaded because of a defect of the player: report it with the player's log";
        want.map_or(SegmentEvent::Idle, |want| SegmentEvent::Damaged(want, Fault::Defect(why.into())))
    }
}

impl Drop for SegmentLoader {
    /// Ends the read under way, and leaves the thread behind: a frame waits neither for a network nor for a decoder.
    fn drop(&mut self) {
        lock(&self.wants).queue.clear();
        self.opened.source().close();
        self.worker.leave_behind();
    }
}

/// What is left of `list` behind the layers under way.
fn behind(under_way: &[Want], list: Vec<Want>) -> impl Iterator<Item = Want> {
    let coming = |segment: usize| {
        let of_segment = under_way.iter().filter(|other| other.segment == segment);
        of_segment.map(|other| other.layers).max().unwrap_or(0)
    };
    let rest = list.into_iter().map(move |want| Want { from: want.from.max(coming(want.segment)), ..want });
    rest.filter(|want| want.from < want.layers)
}

fn lock(wants: &Mutex<Wants>) -> MutexGuard<'_, Wants> {
    wants.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_under_way_are_not_loaded_again() {
        let want = |segment, from, layers| Want { segment, from, layers };
        let list = || vec![want(1, 0, 1), want(2, 0, 1), want(1, 1, 3), want(2, 1, 4)];
        let rest = |under_way: &[Want]| behind(under_way, list()).collect::<Vec<_>>();
        assert_eq!(rest(&[]), list());
        assert_eq!(rest(&[want(1, 0, 1)]), [want(2, 0, 1), want(1, 1, 3), want(2, 1, 4)]);
        // More than is listed first, and two in a row.
        assert_eq!(rest(&[want(2, 0, 2)]), [want(1, 0, 1), want(1, 1, 3), want(2, 2, 4)]);
        assert_eq!(rest(&[want(1, 0, 1), want(1, 1, 3), want(2, 1, 4)]), []);
    }
}
