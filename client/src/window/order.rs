//! [`carry_out`]: what is loaded for a window, on the thread of its loader, up to clips that can be drawn.

use std::ops::ControlFlow;
use std::sync::{Arc, Weak};

use codec::Clip;
use program::Fault;

use super::loader::Tell;
use super::session::{Job, Order, Playing, Told};
use crate::clips::queue::{Brought, Entry, Queue, Terms, bring};
use crate::clips::{Arrival, LoadEvent, cache_dir, playlist};
use crate::gpu::{Format, Gpu};

/// Carries an order out and tells of it.
pub(super) fn carry_out(Job { gpu, format, order }: Job, tell: Tell<'_, Told>) {
    let order = Work { gpu, format, tell }.carry_out(order);
    let _ = match order {
        Ok(ControlFlow::Continue(())) => tell(Told::Done),
        Ok(ControlFlow::Break(())) => ControlFlow::Break(()),
        Err(fault) => tell(Told::Failed(fault)),
    };
}

/// With what an order is carried out.
struct Work<'a> {
    gpu: Weak<Gpu>,
    format: Format,
    tell: Tell<'a, Told>,
}

/// Whether to go on, or what failed.
type Flow = Result<ControlFlow<()>, Fault>;

impl Work<'_> {
    fn carry_out(&self, order: Order) -> Flow {
        match order {
            Order::Rest(origin, arrival) => self.rest(&origin, arrival),
            Order::Again(origin) => {
                self.bring(&[Entry::alone(origin)], &at_once(), &|playing, _| Told::Better(playing))
            }
            Order::Next(entries, terms) => {
                self.bring(&entries, &terms, &|playing, entry| Told::Next(playing, entry.number))
            }
            Order::Open(name) if playlist::is_playlist(&name) => self.open_list(&name),
            Order::Open(name) => {
                self.bring(&[Entry::alone(Some(name))], &at_once(), &|playing, _| Told::New(playing, None))
            }
        }
    }

    fn rest(&self, origin: &Option<String>, arrival: Arrival) -> Flow {
        for news in arrival {
            let told = match news? {
                LoadEvent::Progress(progress) => Told::Progress(progress),
                LoadEvent::Note(note) => Told::Note(note),
                LoadEvent::Clip(clip) => Told::Better(self.ready(origin, &clip)?),
            };
            if (self.tell)(told).is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    fn open_list(&self, name: &str) -> Flow {
        let opened = playlist::open(name, cache_dir(), &mut |news| match news {
            LoadEvent::Progress(progress) => (self.tell)(Told::Progress(progress)),
            LoadEvent::Note(note) => (self.tell)(Told::Note(note)),
            LoadEvent::Clip(_) => ControlFlow::Continue(()),
        })?;
        let Some(opened) = opened else { return Ok(ControlFlow::Break(())) };
        let queue = Queue::new(opened);
        self.bring(&queue.all(), &at_once(), &|playing, entry| {
            let mut queue = queue.clone();
            queue.go_to(entry.number);
            Told::New(playing, Some(queue))
        })
    }

    /// A clip that can be drawn.
    fn ready(&self, origin: &Option<String>, clip: &Clip) -> Result<Box<Playing>, Fault> {
        let gpu = self.gpu.upgrade().ok_or_else(|| Fault::Device("the graphics device is gone".into()))?;
        Playing::new(&gpu, self.format, origin.clone(), clip).map(Box::new)
    }

    /// Brings the first of `entries` that can be had; its first version is told by `first`.
    fn bring(&self, entries: &[Entry], terms: &Terms, first: &dyn Fn(Box<Playing>, &Entry) -> Told) -> Flow {
        let is_awaited = || terms.awaited.load(std::sync::atomic::Ordering::Relaxed);
        bring(entries, terms, &mut |brought| {
            let told = match brought {
                // Who plays something else does not ask how far this is.
                Brought::Progress(progress) if is_awaited() => Told::Progress(progress),
                Brought::Progress(_) => Told::Waiting,
                Brought::Note(note) => Told::Note(note),
                Brought::Skipped(fault) => Told::Skipped(fault),
                Brought::Clip { entry, clip, first: is_first } => {
                    let playing = self.ready(&entry.name, &clip)?;
                    if is_first { first(playing, &entry) } else { Told::Better(playing) }
                }
            };
            Ok((self.tell)(told))
        })
    }
}

/// To be shown as soon as there is something to see.
fn at_once() -> Terms {
    Terms { kept: cache_dir(), layers: Some(1), awaited: Arc::new(true.into()) }
}
