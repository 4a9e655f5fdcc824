//! [`Fetch`]: the thread that fetches a file, and what it shares with the one that decodes it.
//!
//! Bytes come in on a thread of their own, so that a slow server holds nothing up and decoding
//! does not hold up the bytes. Nobody waits for it to end: dropped, it ends with its next byte, or
//! when it would give up anyway.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use program::Fault;

use super::arrived::Arrived;
use super::meter::Meter;
use super::request::{Bytes, Server};
use super::transfer::{Patience, Step, Transfer};
use super::trouble::Trouble;
use crate::clips::Progress;

/// Bytes read at a time: several dozen times a second on the fastest networks.
const BUFFER_BYTES: usize = 64 << 10;

/// How fetching ended.
#[derive(Clone, Debug)]
pub(super) enum End {
    /// The package is here; this is the version, if the server tells one.
    Complete { etag: Option<String> },
    /// There is no other version than the known one.
    Unchanged,
    /// It is not to be had. `passing` is whether it may be some other time.
    Failed { fault: Fault, passing: bool },
}

/// What both threads know.
#[derive(Debug)]
pub(super) struct State {
    pub(super) arrived: Arrived,
    pub(super) progress: Progress,
    pub(super) end: Option<End>,
    meter: Meter,
    abandoned: bool,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    start: Instant,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // What is shared is whole between any two statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>, time: Duration) -> MutexGuard<'a, State> {
        self.changed.wait_timeout(state, time).unwrap_or_else(PoisonError::into_inner).0
    }
}

/// A clip that is being fetched.
#[derive(Debug)]
pub(super) struct Fetch(Arc<Shared>);

impl Fetch {
    /// Begins to fetch what is at `url`, of at most so many bytes, into `arrived`, unless its version is
    /// `known`.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(super) fn start(
        url: &str,
        patience: Patience,
        max_bytes: usize,
        arrived: Arrived,
        known: Option<String>,
    ) -> std::io::Result<Fetch> {
        let state = State {
            arrived,
            progress: Progress::default(),
            end: None,
            meter: Meter::default(),
            abandoned: false,
        };
        let shared =
            Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new(), start: Instant::now() });
        let transfer = Transfer::new(patience, max_bytes as u64, known);
        let (ours, url) = (shared.clone(), url.to_owned());
        std::thread::Builder::new().name("fetch".into()).spawn(move || {
            let end = match Server::new(&url, patience) {
                Ok(server) => Exchange { server, transfer, shared: &ours, answered: false }.run(),
                Err(trouble) => Some(failed(trouble.text(), false)),
            };
            ours.lock().end = end;
            ours.changed.notify_all();
        })?;
        Ok(Fetch(shared))
    }

    /// Waits up to `time` until `is_ready`, and lends what is known then.
    pub(super) fn wait(&self, time: Duration, is_ready: impl Fn(&State) -> bool) -> MutexGuard<'_, State> {
        let until = Instant::now() + time;
        let mut state = self.0.lock();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if is_ready(&state) || left.is_zero() {
                let now_s = self.0.start.elapsed().as_secs_f64();
                state.progress.bytes_per_s = state.meter.bytes_per_s(now_s);
                return state;
            }
            state = self.0.wait(state, left);
        }
    }
}

impl Drop for Fetch {
    fn drop(&mut self) {
        self.0.lock().abandoned = true;
        self.0.changed.notify_all();
    }
}

fn failed(why: String, passing: bool) -> End {
    End::Failed { fault: Fault::Network(why), passing }
}

/// What is left to do after a request.
enum Then {
    Again(Duration, String),
    End(End),
    /// Nobody wants it any more.
    Abandon,
}

impl From<Step> for Then {
    fn from(step: Step) -> Then {
        Then::End(match step {
            Step::Again(wait, why) => return Then::Again(wait, why),
            Step::Unchanged => End::Unchanged,
            Step::GiveUp(why) => failed(why, true),
            Step::Refused(why) => failed(why, false),
            Step::TooLarge(why) => End::Failed { fault: Fault::Data(why), passing: false },
            Step::Read { .. } | Step::StartOver => failed("the answer was not understood".into(), true),
        })
    }
}

/// Requests until the end.
struct Exchange<'a> {
    server: Server,
    transfer: Transfer,
    shared: &'a Shared,
    /// Whether the server ever answered.
    answered: bool,
}

impl Exchange<'_> {
    /// The end; `None` where nobody waits for it any more.
    fn run(mut self) -> Option<End> {
        loop {
            match self.request() {
                Then::Again(wait, why) => self.rest(wait, why)?,
                Then::End(end) => return Some(end),
                Then::Abandon => return None,
            }
        }
    }

    /// Tells of the trouble and waits; `None` where nobody waits for it any more.
    fn rest(&self, wait: Duration, why: String) -> Option<()> {
        let until = Instant::now() + wait;
        let mut state = self.shared.lock();
        state.progress.trouble = Some(why);
        self.shared.changed.notify_all();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if state.abandoned || left.is_zero() {
                return (!state.abandoned).then_some(());
            }
            state = self.shared.wait(state, left);
        }
    }

    /// One request, and the bytes of its answer.
    fn request(&mut self) -> Then {
        let ask = self.transfer.ask();
        let (head, bytes) = match self.server.get(&ask) {
            Ok(answer) => answer,
            Err(trouble) => return self.lost(trouble),
        };
        self.answered = true;
        match self.transfer.answer(&ask, &head) {
            Step::Read { skip } => self.read(bytes, skip),
            Step::StartOver => {
                self.shared.lock().arrived.clear();
                self.read(bytes, 0)
            }
            step => step.into(),
        }
    }

    /// Takes in bytes, without the first `skip`, until the package is complete.
    fn read(&mut self, mut bytes: Bytes, mut skip: u64) -> Then {
        let mut buffer = vec![0; BUFFER_BYTES];
        loop {
            let count = match bytes.read(&mut buffer) {
                Ok(0) => {
                    let state = self.shared.lock();
                    let here = state.arrived.bytes().len() as u64;
                    if state.arrived.is_document() && self.transfer.total().is_none_or(|total| here >= total)
                    {
                        return Then::End(End::Complete { etag: self.transfer.etag().map(String::from) });
                    }
                    let needed = state.arrived.package_bytes();
                    drop(state);
                    return self.transfer.ended(needed.map(|bytes| bytes as u64)).into();
                }
                Ok(count) => count,
                Err(trouble) => return self.lost(trouble),
            };
            let skipped = skip.min(count as u64) as usize;
            skip -= skipped as u64;
            let new = &buffer[skipped..count];
            if let Err(step) = self.transfer.took(new.len() as u64) {
                return step.into();
            }
            let now_s = self.shared.start.elapsed().as_secs_f64();
            let mut state = self.shared.lock();
            if state.abandoned {
                return Then::Abandon;
            }
            if let Err(error) = state.arrived.push(new) {
                return Then::End(End::Failed { fault: Fault::Data(error.to_string()), passing: false });
            }
            state.meter.count(now_s, new.len() as u64);
            let here = state.arrived.bytes().len() as u64;
            let package = state.arrived.package_bytes().map(|bytes| bytes as u64);
            state.progress = Progress {
                received: here,
                total: package.or(self.transfer.total()),
                bytes_per_s: state.meter.bytes_per_s(now_s),
                trouble: None,
            };
            if state.arrived.is_complete() {
                return Then::End(End::Complete { etag: self.transfer.etag().map(String::from) });
            }
            self.shared.changed.notify_all();
        }
    }

    fn lost(&mut self, trouble: Trouble) -> Then {
        match trouble {
            Trouble::Passing(why) => self.transfer.lost(&why).into(),
            // A name that was known is missed because the network is gone.
            Trouble::Unresolved(why) if self.answered => self.transfer.lost(&why).into(),
            Trouble::Unresolved(why) | Trouble::Untrusted(why) => Step::GiveUp(why).into(),
            Trouble::Lasting(why) => Step::Refused(why).into(),
        }
    }
}
