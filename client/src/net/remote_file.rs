//! [`RemoteFile`]: a file on a server that is read in parts, by range requests.
//!
//! All parts are of one version: `If-Range` has a changed file sent whole, which is an error here; the player then opens
//! the file again. A server that sends
//! the whole file instead of a part knows no ranges: the file then goes to disk as it arrives, and parts are read from
//! there. Parts are cached each for itself, so that a part played before needs no network.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use program::Fault;

use super::cache::{Cache, CachedFile};
use super::head::Head;
use super::request::{Response, ResponseBody, Server};
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::transfer::{Action, Transfer};
use super::watch::Watch;
use crate::clips::redacted;
use crate::takes::Traffic;

/// Bytes per read.
const BUFFER_BYTES: usize = 64 << 10;

/// Number of parts whose bytes stay in memory for a longer part with the same start: the first layers of what is drawn.
const RECENT_PARTS: usize = 4;

/// A file on a server.
pub(crate) struct RemoteFile {
    url: String,
    server: Server,
    watch: Arc<Watch>,
    retry: RetryPolicy,
    cache: Option<Cache>,
    /// Where a file goes that the server sends whole.
    folder: Option<PathBuf>,
    state: Mutex<State>,
    /// Whether the server sends the file whole.
    is_whole: AtomicBool,
    /// What came from the server.
    traffic: Mutex<Traffic>,
    /// Whether the server has another version.
    is_replaced: AtomicBool,
    /// For waits between requests, which a cancellation ends.
    pause: (Mutex<()>, Condvar),
}

#[derive(Default)]
struct State {
    etag: Option<String>,
    total: Option<u64>,
    /// Start and bytes of the latest parts.
    recent: VecDeque<(u64, Vec<u8>)>,
    /// Bytes of file that arrived, if the server knows no ranges.
    whole: Option<WholeFile>,
}

/// A file that arrives from its start.
struct WholeFile {
    disk: File,
    written: u64,
    /// `None` after the connection was lost.
    body: Option<ResponseBody>,
    transfer: Transfer,
}

/// Why a part cannot be read, or what to do before the next request.
enum Trouble {
    Retry(Duration),
    Failed(Fault),
}

impl RemoteFile {
    /// The file at `url`; nothing is fetched yet.
    ///
    /// # Errors
    /// [`Fault::Network`] if the certificates to trust cannot be read.
    pub(super) fn new(url: &str, retry: RetryPolicy, cache: Option<Cache>) -> Result<RemoteFile, Fault> {
        let watch = Arc::new(Watch::new(&retry));
        let server = Server::new(url, retry, &watch).map_err(|error| Fault::Network(error.text()))?;
        let folder = cache.as_ref().map(|cache| cache.folder().to_owned());
        let (state, pause) = (Mutex::default(), (Mutex::default(), Condvar::new()));
        let [is_whole, is_replaced] = [(); 2].map(|()| AtomicBool::new(false));
        let traffic = Mutex::default();
        Ok(RemoteFile {
            url: url.into(),
            server,
            watch,
            retry,
            cache,
            folder,
            state,
            is_whole,
            traffic,
            is_replaced,
            pause,
        })
    }

    /// The URL without secrets, for messages.
    pub(crate) fn name(&self) -> String {
        redacted(&self.url)
    }

    /// Length in bytes, once a part was read, if the server says.
    pub(crate) fn total(&self) -> Option<u64> {
        self.lock().total
    }

    /// What came from the server so far, and not from the cache.
    pub(crate) fn traffic(&self) -> Traffic {
        *self.traffic.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the server sends parts, as far as is known.
    pub(crate) fn has_ranges(&self) -> bool {
        !self.is_whole.load(Ordering::Relaxed)
    }

    /// Whether a read found that the server has another version.
    pub(crate) fn is_replaced(&self) -> bool {
        self.is_replaced.load(Ordering::Relaxed)
    }

    /// Ends the read of a part, and those that follow, with an error until [`RemoteFile::resume`]. A file that the server
    /// sends whole goes on: all that follows needs it.
    pub(crate) fn cancel(&self) {
        if !self.is_whole.load(Ordering::Relaxed) {
            self.close();
        }
    }

    /// Ends the read under way, and those that follow, with an error.
    pub(crate) fn close(&self) {
        self.watch.cancel();
        drop(self.pause.0.lock());
        self.pause.1.notify_all();
    }

    /// Allows reads again.
    pub(crate) fn resume(&self) {
        self.watch.resume();
    }

    /// Reads `range`; less at the end of the file. Blocks until it has arrived.
    ///
    /// # Errors
    /// [`Fault::Network`] if it does not arrive, the file has changed, or it was cancelled; [`Fault::Usage`] if the disk
    /// is full.
    pub(crate) fn read(&self, range: Range<u64>) -> Result<Vec<u8>, Fault> {
        let mut state = self.lock();
        let range = range.start..state.total.map_or(range.end, |total| range.end.min(total)).max(range.start);
        if state.whole.is_none() {
            if let Some(bytes) = self.cached(&state, &range) {
                return Ok(bytes);
            }
            if let Some(bytes) = self.read_part(&mut state, &range)? {
                self.store(&state, &range, &bytes);
                return Ok(bytes);
            }
        }
        self.read_whole(&mut state, &range)
    }

    /// Reads a part by range requests; `None` if the server knows none, and sends the file whole.
    fn read_part(&self, state: &mut State, range: &Range<u64>) -> Result<Option<Vec<u8>>, Fault> {
        let at = state.recent.iter().position(|(start, _)| *start == range.start);
        let mut bytes = at.and_then(|at| state.recent.remove(at)).map_or_else(Vec::new, |(_, bytes)| bytes);
        bytes.truncate((range.end - range.start) as usize);
        let has_ranges = self.extend_part(state, range, &mut bytes);
        // What has come of a read that was ended is not asked for again.
        state.recent.push_back((range.start, bytes.clone()));
        if state.recent.len() > RECENT_PARTS {
            state.recent.pop_front();
        }
        has_ranges.map(|has_ranges| has_ranges.then_some(bytes))
    }

    /// Extends `bytes`, the start of `range`, to all of it; `false` if the server knows no ranges.
    fn extend_part(&self, state: &mut State, range: &Range<u64>, bytes: &mut Vec<u8>) -> Result<bool, Fault> {
        let start = range.start + bytes.len() as u64;
        let mut transfer = Transfer::part(self.retry, start, state.etag.clone(), state.total);
        while range.start + (bytes.len() as u64) < range.end {
            let request = transfer.next_request().up_to(range.end);
            let asked = Instant::now();
            let step = self.server.get(&request).map_err(|error| self.on_error(&mut transfer, error));
            let answered = Instant::now();
            let step =
                step.and_then(|Response { head, body, .. }| match transfer.on_response(&request, &head) {
                    Action::Read { .. } if head.status == 206 => {
                        state.etag = transfer.etag().map(String::from);
                        state.total = transfer.total();
                        let end = state.total.map_or(range.end, |total| range.end.min(total));
                        self.receive(&mut transfer, body, (end - range.start) as usize, bytes).map(|()| None)
                    }
                    Action::Read { .. } => Ok(Some((head, body))),
                    action => Err(self.on_action(action)),
                });
            let mut traffic = self.traffic.lock().unwrap_or_else(PoisonError::into_inner);
            traffic.delay += answered - asked;
            traffic.elapsed += answered.elapsed();
            drop(traffic);
            match step {
                Ok(None) => {
                    let end = state.total.unwrap_or(range.end);
                    if range.start + bytes.len() as u64 >= end {
                        break;
                    }
                }
                Ok(Some((head, body))) => {
                    self.begin_whole(state, head, body)?;
                    return Ok(false);
                }
                Err(Trouble::Retry(wait)) => self.wait(wait)?,
                Err(Trouble::Failed(fault)) => return Err(fault),
            }
        }
        Ok(true)
    }

    /// Appends to `bytes` what `body` holds, up to `length` bytes.
    fn receive(
        &self,
        transfer: &mut Transfer,
        mut body: ResponseBody,
        length: usize,
        bytes: &mut Vec<u8>,
    ) -> Result<(), Trouble> {
        let mut buffer = vec![0; BUFFER_BYTES];
        while bytes.len() < length {
            let count = match self.server.read(&mut body, &mut buffer) {
                Ok(0) => return Err(self.on_action(transfer.on_end(None))),
                Ok(count) => count.min(length - bytes.len()),
                Err(error) => return Err(self.on_error(transfer, error)),
            };
            bytes.extend_from_slice(&buffer[..count]);
            self.count(transfer, count as u64)?;
        }
        Ok(())
    }

    /// Begins to write a file to disk that the server sends whole, as `body`.
    fn begin_whole(&self, state: &mut State, head: Head, body: ResponseBody) -> Result<(), Fault> {
        let disk = match &self.folder {
            Some(folder) => std::fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder)),
            None => tempfile::tempfile(),
        };
        let disk = disk.map_err(|error| self.disk_fault(&error))?;
        let mut transfer = Transfer::new(self.retry, u64::MAX, None);
        let request = transfer.next_request();
        transfer.on_response(&request, &head);
        (state.etag, state.total) = (head.etag, head.length);
        self.is_whole.store(true, Ordering::Relaxed);
        state.whole = Some(WholeFile { disk, written: 0, body: Some(body), transfer });
        Ok(())
    }

    /// Reads a part of a file that the server sends whole, as soon as it has arrived.
    fn read_whole(&self, state: &mut State, range: &Range<u64>) -> Result<Vec<u8>, Fault> {
        let whole = state.whole.as_mut().expect("the server sends the file whole");
        let end = state.total.map_or(range.end, |total| range.end.min(total));
        let mut buffer = vec![0; BUFFER_BYTES];
        while whole.written < end {
            match self.receive_whole(whole, &mut buffer) {
                Ok(()) => {}
                Err(Trouble::Retry(wait)) => self.wait(wait)?,
                Err(Trouble::Failed(fault)) => return Err(fault),
            }
        }
        let mut bytes = Vec::new();
        let read = whole.disk.seek(SeekFrom::Start(range.start)).and_then(|_| {
            (&mut whole.disk)
                .take(range.end.min(whole.written).saturating_sub(range.start))
                .read_to_end(&mut bytes)
        });
        read.map_err(|error| self.disk_fault(&error))?;
        Ok(bytes)
    }

    /// Writes the next bytes of a file that the server sends whole to disk.
    fn receive_whole(&self, whole: &mut WholeFile, buffer: &mut [u8]) -> Result<(), Trouble> {
        let WholeFile { disk, written, body, transfer } = whole;
        if body.is_none() {
            let request = transfer.next_request();
            let Response { head, body: next, .. } =
                self.server.get(&request).map_err(|error| self.on_error(transfer, error))?;
            match transfer.on_response(&request, &head) {
                Action::Read { skip } => {
                    let mut next = next;
                    self.skip(transfer, &mut next, skip, buffer)?;
                    *body = Some(next);
                }
                action => return Err(self.on_action(action)),
            }
        }
        let Some(open) = body else { return Ok(()) };
        match self.server.read(open, buffer) {
            Ok(0) => {
                *body = None;
                Err(self.on_action(transfer.on_end(None)))
            }
            Ok(count) => {
                let end = disk.seek(SeekFrom::Start(*written)).and_then(|_| disk.write_all(&buffer[..count]));
                end.map_err(|error| Trouble::Failed(self.disk_fault(&error)))?;
                *written += count as u64;
                self.count(transfer, count as u64)
            }
            Err(error) => {
                *body = None;
                Err(self.on_error(transfer, error))
            }
        }
    }

    /// Counts bytes of the file that have arrived.
    fn count(&self, transfer: &mut Transfer, bytes: u64) -> Result<(), Trouble> {
        self.traffic.lock().unwrap_or_else(PoisonError::into_inner).bytes += bytes;
        self.watch.count(Instant::now(), bytes);
        transfer.count(bytes).map_err(|action| self.on_action(action))
    }

    /// Reads `count` bytes that were received before.
    fn skip(
        &self,
        transfer: &mut Transfer,
        body: &mut ResponseBody,
        mut count: u64,
        buffer: &mut [u8],
    ) -> Result<(), Trouble> {
        while count > 0 {
            let most = buffer.len().min(usize::try_from(count).unwrap_or(usize::MAX));
            match self.server.read(body, &mut buffer[..most]) {
                Ok(0) => return Err(self.on_action(transfer.on_end(None))),
                Ok(read) => count -= read as u64,
                Err(error) => return Err(self.on_error(transfer, error)),
            }
        }
        Ok(())
    }

    fn on_error(&self, transfer: &mut Transfer, error: RequestError) -> Trouble {
        if self.watch.is_cancelled() {
            return Trouble::Failed(self.cancelled());
        }
        match error {
            RequestError::Transient(why) | RequestError::UnknownHost(why) => {
                self.on_action(transfer.on_break(&why))
            }
            error => Trouble::Failed(Fault::Network(error.text())),
        }
    }

    fn on_action(&self, action: Action) -> Trouble {
        Trouble::Failed(Fault::Network(match action {
            Action::Retry(wait, why) => {
                log::info!("{}: {why}", self.name());
                return Trouble::Retry(wait);
            }
            Action::GiveUp(why) | Action::Refused(why) | Action::TooLarge(why) => why,
            Action::StartOver => {
                self.is_replaced.store(true, Ordering::Relaxed);
                "the file changed on the server: open it again".into()
            }
            Action::Read { .. } | Action::Unchanged => {
                "the server's answer was not understood: try again later".into()
            }
        }))
    }

    /// Waits before the next request.
    fn wait(&self, wait: Duration) -> Result<(), Fault> {
        let until = Instant::now() + wait;
        let mut guard = self.pause.0.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if self.watch.is_cancelled() {
                return Err(self.cancelled());
            }
            if left.is_zero() {
                return Ok(());
            }
            guard = self.pause.1.wait_timeout(guard, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn cancelled(&self) -> Fault {
        Fault::Network("cancelled".into())
    }

    fn disk_fault(&self, error: &io::Error) -> Fault {
        Fault::Usage(format!("the part that plays cannot be written to disk: {error}: free some space"))
    }

    /// Name of a part in the cache. Only a strong ETag names a version.
    fn cache_key(&self, state: &State, range: &Range<u64>) -> Option<String> {
        let etag = state.etag.as_ref().filter(|etag| !etag.starts_with("W/"))?;
        (range.start > 0).then(|| format!("{}#{}-{} {etag}", self.url, range.start, range.end))
    }

    fn cached(&self, state: &State, range: &Range<u64>) -> Option<Vec<u8>> {
        let (cache, key) = (self.cache.as_ref()?, self.cache_key(state, range)?);
        cache.get(&key).map(|file| file.bytes)
    }

    fn store(&self, state: &State, range: &Range<u64>, bytes: &[u8]) {
        let (Some(cache), Some(key)) = (&self.cache, self.cache_key(state, range)) else { return };
        let etag = state.etag.clone().unwrap_or_default();
        let file = CachedFile { etag, base: self.name(), bytes: bytes.to_vec() };
        if let Err(error) = cache.put(&key, &file) {
            log::warn!("{}: cannot be cached: {error}", self.name());
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl std::fmt::Debug for RemoteFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("RemoteFile").field(&self.name()).finish()
    }
}
