//! [`Fetch`]: the thread that fetches a file, and the state it shares with its caller.
//!
//! On its own thread a slow server does not block the caller, and decoding does not block the transfer.
//! Dropping a [`Fetch`] cancels it without waiting: the thread ends at its next byte or timeout.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use program::Fault;

use super::meter::Meter;
use super::partial_file::PartialFile;
use super::request::{ResponseBody, Server};
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::transfer::{Action, Transfer};
use crate::clips::Progress;

/// Bytes per read: dozens of reads a second on a fast network.
const BUFFER_BYTES: usize = 64 << 10;

/// How a fetch ended.
#[derive(Clone, Debug)]
pub(super) enum Outcome {
    /// The file is complete; `etag` is its version, if the server names one.
    Complete { etag: Option<String> },
    /// The cached version is current.
    Unchanged,
    /// `is_transient`: a later attempt may succeed.
    Failed { fault: Fault, is_transient: bool },
}

/// The state that both threads share.
#[derive(Debug)]
pub(super) struct State {
    pub(super) file: PartialFile,
    pub(super) progress: Progress,
    pub(super) outcome: Option<Outcome>,
    meter: Meter,
    is_cancelled: bool,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    start: Instant,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic leaves the state consistent: no update takes several statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>, time: Duration) -> MutexGuard<'a, State> {
        self.changed.wait_timeout(state, time).unwrap_or_else(PoisonError::into_inner).0
    }
}

/// A running fetch.
#[derive(Debug)]
pub(super) struct Fetch(Arc<Shared>);

impl Fetch {
    /// Starts to fetch the file at `url`, of at most `max_bytes` bytes, into `file`, unless its version is
    /// that of the cache, `cached`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses a thread.
    pub(super) fn start(
        url: &str,
        retry: RetryPolicy,
        max_bytes: usize,
        file: PartialFile,
        cached: Option<String>,
    ) -> Result<Fetch, Fault> {
        let state = State {
            file,
            progress: Progress::default(),
            outcome: None,
            meter: Meter::default(),
            is_cancelled: false,
        };
        let shared =
            Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new(), start: Instant::now() });
        let transfer = Transfer::new(retry, max_bytes as u64, cached);
        let (ours, url) = (shared.clone(), url.to_owned());
        let thread = std::thread::Builder::new().name("fetch".into()).spawn(move || {
            let outcome = match Server::new(&url, retry) {
                Ok(server) => Exchange { server, transfer, shared: &ours, has_responded: false }.run(),
                Err(error) => Some(failed(error.text(), false)),
            };
            ours.lock().outcome = outcome;
            ours.changed.notify_all();
        });
        thread.map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(Fetch(shared))
    }

    /// Waits until `is_ready`, for `time` at most, and returns the state, locked.
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
        self.0.lock().is_cancelled = true;
        self.0.changed.notify_all();
    }
}

fn failed(why: String, is_transient: bool) -> Outcome {
    Outcome::Failed { fault: Fault::Network(why), is_transient }
}

/// What follows a request.
enum AfterRequest {
    Retry(Duration, String),
    End(Outcome),
    Cancelled,
}

impl From<Action> for AfterRequest {
    fn from(action: Action) -> AfterRequest {
        AfterRequest::End(match action {
            Action::Retry(wait, why) => return AfterRequest::Retry(wait, why),
            Action::Unchanged => Outcome::Unchanged,
            Action::GiveUp(why) => failed(why, true),
            Action::Refused(why) => failed(why, false),
            Action::TooLarge(why) => Outcome::Failed { fault: Fault::Data(why), is_transient: false },
            Action::Read { .. } | Action::StartOver => failed("the answer was not understood".into(), true),
        })
    }
}

/// The requests of a fetch.
struct Exchange<'a> {
    server: Server,
    transfer: Transfer,
    shared: &'a Shared,
    has_responded: bool,
}

impl Exchange<'_> {
    /// Sends requests until the end; `None` if cancelled.
    fn run(mut self) -> Option<Outcome> {
        loop {
            match self.request() {
                AfterRequest::Retry(wait, why) => self.wait_for_retry(wait, why)?,
                AfterRequest::End(outcome) => return Some(outcome),
                AfterRequest::Cancelled => return None,
            }
        }
    }

    /// Reports the reason of a retry and waits for its time; `None` if cancelled.
    fn wait_for_retry(&self, wait: Duration, why: String) -> Option<()> {
        let until = Instant::now() + wait;
        let mut state = self.shared.lock();
        state.progress.trouble = Some(why);
        self.shared.changed.notify_all();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if state.is_cancelled || left.is_zero() {
                return (!state.is_cancelled).then_some(());
            }
            state = self.shared.wait(state, left);
        }
    }

    /// Sends one request and reads the response.
    fn request(&mut self) -> AfterRequest {
        let request = self.transfer.next_request();
        let (head, body) = match self.server.get(&request) {
            Ok(response) => response,
            Err(error) => return self.on_error(error),
        };
        self.has_responded = true;
        match self.transfer.on_response(&request, &head) {
            Action::Read { skip } => self.read(body, skip),
            Action::StartOver => {
                self.shared.lock().file.clear();
                self.read(body, 0)
            }
            action => action.into(),
        }
    }

    /// Reads the body, without its first `skip` bytes, until the file is complete.
    fn read(&mut self, mut body: ResponseBody, mut skip: u64) -> AfterRequest {
        let mut buffer = vec![0; BUFFER_BYTES];
        loop {
            let count = match body.read(&mut buffer) {
                Ok(0) => return self.on_end(),
                Ok(count) => count,
                Err(error) => return self.on_error(error),
            };
            let skipped = skip.min(count as u64) as usize;
            skip -= skipped as u64;
            if let Some(end) = self.on_bytes(&buffer[skipped..count]) {
                return end;
            }
        }
    }

    /// Appends bytes to the file; returns what follows if the request ends with them.
    fn on_bytes(&mut self, bytes: &[u8]) -> Option<AfterRequest> {
        if let Err(action) = self.transfer.count(bytes.len() as u64) {
            return Some(action.into());
        }
        let now_s = self.shared.start.elapsed().as_secs_f64();
        let mut state = self.shared.lock();
        if state.is_cancelled {
            return Some(AfterRequest::Cancelled);
        }
        if let Err(error) = state.file.push(bytes) {
            let fault = Fault::Data(error.to_string());
            return Some(AfterRequest::End(Outcome::Failed { fault, is_transient: false }));
        }
        state.meter.count(now_s, bytes.len() as u64);
        let package_bytes = state.file.package_bytes().map(|bytes| bytes as u64);
        state.progress = Progress {
            received: state.file.bytes().len() as u64,
            total: package_bytes.or(self.transfer.total()),
            bytes_per_s: state.meter.bytes_per_s(now_s),
            trouble: None,
        };
        if state.file.is_complete() {
            return Some(self.complete());
        }
        self.shared.changed.notify_all();
        None
    }

    /// Handles the end of a body before the end of a package.
    fn on_end(&mut self) -> AfterRequest {
        let state = self.shared.lock();
        let received = state.file.bytes().len() as u64;
        if state.file.is_document() && self.transfer.total().is_none_or(|total| received >= total) {
            return self.complete();
        }
        let package_bytes = state.file.package_bytes();
        drop(state);
        self.transfer.on_end(package_bytes.map(|bytes| bytes as u64)).into()
    }

    fn complete(&self) -> AfterRequest {
        AfterRequest::End(Outcome::Complete { etag: self.transfer.etag().map(String::from) })
    }

    fn on_error(&mut self, error: RequestError) -> AfterRequest {
        match error {
            RequestError::Transient(why) => self.transfer.on_break(&why).into(),
            // A name that resolved before does not resolve while the network is down.
            RequestError::UnknownHost(why) if self.has_responded => self.transfer.on_break(&why).into(),
            RequestError::UnknownHost(why) | RequestError::Untrusted(why) => Action::GiveUp(why).into(),
            RequestError::Permanent(why) => Action::Refused(why).into(),
        }
    }
}
