//! [`Fetch`]: the thread that fetches a file, and the state it shares with its caller.
//!
//! On its own thread a slow server does not block the caller, and decoding does not block the transfer.
//! Dropping a [`Fetch`] cancels it without waiting: its connection is closed within a second. Only a name
//! that is being resolved, or a connection that is being opened, still takes its time; nothing is sent then.

use std::any::Any;
use std::ops::Range;
use std::panic::{self, AssertUnwindSafe};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use program::Fault;

use super::meter::Meter;
use super::partial_file::PartialFile;
use super::request::{Response, ResponseBody, Server};
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::transfer::{Action, Transfer};
use super::watch::Watch;
use crate::clips::{Progress, advice, part};

/// Bytes per read: dozens of reads a second on a fast network.
const BUFFER_BYTES: usize = 64 << 10;

/// How a fetch ended.
#[derive(Clone, Debug)]
pub(super) enum Outcome {
    /// The file is complete; `etag` is its version, if the server names one.
    Complete { etag: Option<String> },
    /// The file is a take, which is read in parts instead.
    Take,
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
    /// The URL of the file, where redirects led, once the server has responded.
    pub(super) url: Option<String>,
    /// Number of times that the file began again, as another version.
    pub(super) beginnings: u32,
    /// Whether nothing more arrives.
    has_ended: bool,
    meter: Meter,
    /// What the thread panicked with: a defect, which goes on in the caller's thread.
    panic: Option<Box<dyn Any + Send>>,
}

impl State {
    /// The state before the first response.
    pub(super) fn new(file: PartialFile) -> State {
        State {
            file,
            progress: Progress::default(),
            outcome: None,
            url: None,
            beginnings: 0,
            has_ended: false,
            meter: Meter::default(),
            panic: None,
        }
    }
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    start: Instant,
    watch: Arc<Watch>,
}

impl Shared {
    fn new(retry: &RetryPolicy, file: PartialFile) -> Shared {
        Shared {
            state: Mutex::new(State::new(file)),
            changed: Condvar::new(),
            start: Instant::now(),
            watch: Arc::new(Watch::new(retry)),
        }
    }

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

/// What to fetch.
#[derive(Clone, Debug)]
pub(super) struct FetchOptions {
    pub(super) url: String,
    pub(super) retry: RetryPolicy,
    /// Limit on the file.
    pub(super) max_bytes: usize,
    /// The version in the cache, with which nothing is fetched.
    pub(super) cached: Option<String>,
}

impl Fetch {
    /// Starts to fetch a file into `file`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses a thread.
    pub(super) fn start(options: FetchOptions, file: PartialFile) -> Result<Fetch, Fault> {
        Fetch::run(&options.retry.clone(), file, move |shared| {
            let FetchOptions { url, retry, max_bytes, cached } = options;
            let transfer = Transfer::new(retry, max_bytes as u64, cached);
            match Server::new(&url, retry, &shared.watch) {
                Ok(server) => {
                    Exchange { server, transfer, shared, has_responded: false, too_large: None }.run()
                }
                Err(error) => Some(failed(error.text(), false)),
            }
        })
    }

    /// Runs `work` on a thread of its own.
    fn run(
        retry: &RetryPolicy,
        file: PartialFile,
        work: impl FnOnce(&Shared) -> Option<Outcome> + Send + 'static,
    ) -> Result<Fetch, Fault> {
        let shared = Arc::new(Shared::new(retry, file));
        let ours = shared.clone();
        let thread = std::thread::Builder::new().name("fetch".into()).spawn(move || {
            let result = panic::catch_unwind(AssertUnwindSafe(|| work(&ours)));
            let mut state = ours.lock();
            state.has_ended = true;
            match result {
                Ok(outcome) => state.outcome = outcome,
                Err(panic) => state.panic = Some(panic),
            }
            drop(state);
            ours.changed.notify_all();
        });
        thread.map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(Fetch(shared))
    }

    /// The file as it arrives, with a `name` for messages.
    pub(super) fn file(&self, name: String) -> ArrivingFile {
        let beginnings = self.0.lock().beginnings;
        ArrivingFile { shared: self.0.clone(), name, beginnings, is_closed: AtomicBool::new(false) }
    }

    /// Waits until `is_ready`, for `time` at most, and returns the state, locked.
    ///
    /// # Panics
    /// If the thread has panicked.
    pub(super) fn wait(&self, time: Duration, is_ready: impl Fn(&State) -> bool) -> MutexGuard<'_, State> {
        let until = Instant::now() + time;
        let mut state = self.0.lock();
        loop {
            if let Some(panic) = state.panic.take() {
                drop(state);
                panic::resume_unwind(panic);
            }
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
        self.0.watch.cancel();
        // The thread looks at the watch with the state locked before it waits.
        drop(self.0.lock());
        self.0.changed.notify_all();
    }
}

/// A file that a [`Fetch`] brings, from its start. Of the bytes that are there it may be read also after the fetch.
pub(crate) struct ArrivingFile {
    shared: Arc<Shared>,
    name: String,
    /// [`State::beginnings`] of this version.
    beginnings: u32,
    is_closed: AtomicBool,
}

/// How often a read that waits for bytes looks whether it was closed.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);

impl ArrivingFile {
    /// Name for messages.
    pub(crate) fn name(&self) -> String {
        self.name.clone()
    }

    /// Which version of the file it is, by [`State::beginnings`].
    pub(super) fn beginnings(&self) -> u32 {
        self.beginnings
    }

    /// The bytes that are there.
    pub(crate) fn there(&self) -> Vec<u8> {
        self.shared.lock().file.bytes().to_vec()
    }

    /// Whether bytes that are not there will not come: the fetch has ended, or brings another version.
    pub(crate) fn has_failed(&self) -> bool {
        self.has_failed_in(&self.shared.lock())
    }

    fn has_failed_in(&self, state: &State) -> bool {
        let is_incomplete = !state.file.is_complete();
        let has_ended = state.has_ended || self.shared.watch.is_cancelled();
        state.beginnings != self.beginnings || is_incomplete && has_ended
    }

    /// Ends a read that waits, and those that follow.
    pub(crate) fn close(&self) {
        self.is_closed.store(true, Ordering::Relaxed);
    }

    /// Reads `range` once it is there; less at the end of the file.
    ///
    /// # Errors
    /// [`Fault::Network`] if it does not come, or the file was closed.
    pub(crate) fn read(&self, range: Range<u64>) -> Result<Vec<u8>, Fault> {
        let mut state = self.shared.lock();
        loop {
            let bytes = state.file.bytes();
            let is_there = bytes.len() as u64 >= range.end || state.file.is_complete();
            if is_there && state.beginnings == self.beginnings {
                return Ok(part(bytes, range));
            }
            if self.has_failed_in(&state) || self.is_closed.load(Ordering::Relaxed) {
                return Err(Fault::Network("the rest does not arrive: open it again".into()));
            }
            state = self.shared.wait(state, LOOK_INTERVAL);
        }
    }
}

impl std::fmt::Debug for ArrivingFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("ArrivingFile").field(&self.name).finish()
    }
}

/// Why an answer that fits no request ends a fetch.
pub(super) const NOT_UNDERSTOOD: &str = "the server's answer was not understood: try again later";

fn too_large(why: String) -> Outcome {
    Outcome::Failed { fault: Fault::Data(why), is_transient: false }
}

/// Whether a file is no clip but a take.
fn is_take(error: &codec::Error) -> bool {
    matches!(error, codec::Error::Format { error: codec::FormatError::Take, .. })
}

/// The fault of a download that cannot be decoded.
pub(super) fn undecodable(error: &codec::Error) -> Fault {
    Fault::Data(format!("{error}: {}", advice(error, "upload it again")))
}

fn failed(why: String, is_transient: bool) -> Outcome {
    Outcome::Failed { fault: Fault::Network(why), is_transient }
}

/// The outcome of a fetch that brought a web page, as networks send in place of anything else until the user
/// logs in.
fn web_page() -> Outcome {
    let why = "the server sends a web page: open the URL in a browser, the network may ask for a log-in";
    Outcome::Failed { fault: Fault::Data(why.into()), is_transient: true }
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
            Action::TooLarge(why) => too_large(why),
            Action::Read { .. } | Action::StartOver => failed(NOT_UNDERSTOOD.into(), true),
        })
    }
}

/// The requests of a fetch.
struct Exchange<'a> {
    server: Server,
    transfer: Transfer,
    shared: &'a Shared,
    has_responded: bool,
    /// Why a clip of the announced length is refused, until its head tells whether it is a take.
    too_large: Option<String>,
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
            if self.shared.watch.is_cancelled() {
                return None;
            }
            if left.is_zero() {
                return Some(());
            }
            state = self.shared.wait(state, left);
        }
    }

    /// Sends one request and reads the response.
    fn request(&mut self) -> AfterRequest {
        let request = self.transfer.next_request();
        let response = self.server.get(&request);
        let Response { head, body, url } = match response {
            Ok(response) => response,
            Err(error) => return self.on_error(error),
        };
        self.shared.lock().url = Some(url);
        self.has_responded = true;
        match self.transfer.on_response(&request, &head) {
            Action::Read { skip } => self.read(body, skip),
            Action::StartOver => {
                let mut state = self.shared.lock();
                state.file.clear();
                state.beginnings += 1;
                drop(state);
                self.read(body, 0)
            }
            // A take may be: its head tells.
            Action::TooLarge(why) if !self.shared.lock().file.is_document() => {
                self.too_large = Some(why);
                self.read(body, 0)
            }
            action => action.into(),
        }
    }

    /// Reads the body, without its first `skip` bytes, until the file is complete.
    fn read(&mut self, mut body: ResponseBody, mut skip: u64) -> AfterRequest {
        let mut buffer = vec![0; BUFFER_BYTES];
        loop {
            let count = match self.server.read(&mut body, &mut buffer) {
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
        if self.shared.watch.is_cancelled() {
            return Some(AfterRequest::Cancelled);
        }
        self.shared.watch.count(Instant::now(), bytes.len() as u64);
        let mut state = self.shared.lock();
        let pushed = state.file.push(bytes);
        if pushed.as_ref().is_err_and(is_take) {
            return Some(AfterRequest::End(Outcome::Take));
        }
        let is_known = pushed.is_err() || state.file.package_bytes().is_some();
        if let Some(why) = self.too_large.take_if(|_| is_known) {
            return Some(AfterRequest::End(too_large(why)));
        }
        if let Err(error) = pushed {
            return Some(AfterRequest::End(match state.file.is_web_page() {
                true => web_page(),
                false => Outcome::Failed { fault: undecodable(&error), is_transient: false },
            }));
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
            return if state.file.is_web_page() { AfterRequest::End(web_page()) } else { self.complete() };
        }
        let package_bytes = state.file.package_bytes();
        drop(state);
        self.transfer.on_end(package_bytes.map(|bytes| bytes as u64)).into()
    }

    fn complete(&self) -> AfterRequest {
        AfterRequest::End(Outcome::Complete { etag: self.transfer.etag().map(String::from) })
    }

    fn on_error(&mut self, error: RequestError) -> AfterRequest {
        if self.shared.watch.is_cancelled() {
            return AfterRequest::Cancelled;
        }
        match error {
            RequestError::Transient(why) => self.transfer.on_break(&why).into(),
            // A name that resolved before does not resolve while the network is down.
            RequestError::UnknownHost(why) if self.has_responded => self.transfer.on_break(&why).into(),
            RequestError::UnknownHost(why) => {
                Action::GiveUp(format!("{why}: check the URL and the network")).into()
            }
            RequestError::Untrusted(why) => Action::GiveUp(why).into(),
            RequestError::Permanent(why) => Action::Refused(why).into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use codec::Limits;

    use super::*;

    #[test]
    fn a_panic_of_the_thread_goes_on_in_the_callers() {
        let file = PartialFile::package(Limits::default());
        let fetch = Fetch::run(&RetryPolicy::default(), file, |_| panic!("of the test")).unwrap();
        let wait = || drop(fetch.wait(Duration::from_secs(60), |state| state.outcome.is_some()));
        let panic = panic::catch_unwind(AssertUnwindSafe(wait)).unwrap_err();
        assert_eq!(panic.downcast_ref(), Some(&"of the test"));
    }

    #[test]
    fn a_name_that_does_not_resolve_is_tried_again_if_it_resolved_before() {
        let retry = RetryPolicy::default();
        let shared = Shared::new(&retry, PartialFile::package(Limits::default()));
        for has_responded in [false, true] {
            let server = Server::new("http://host/", retry, &shared.watch).unwrap();
            let transfer = Transfer::new(retry, 1000, None);
            let mut exchange = Exchange { server, transfer, shared: &shared, has_responded, too_large: None };
            match exchange.on_error(RequestError::UnknownHost("unknown".into())) {
                AfterRequest::Retry(..) => assert!(has_responded),
                AfterRequest::End(Outcome::Failed { .. }) => assert!(!has_responded),
                _ => panic!("neither a retry nor a failure"),
            }
        }
    }
}
