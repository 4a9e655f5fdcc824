//! [`RemoteFile`]: a package on a server that is read in parts.
//!
//! The first response is the file from its start. What follows its head is read on from there, or requested part by part.
//! A server that knows no ranges sends the file whole, which then goes to disk as it arrives.
//!
//! All parts are of one version. The head of a package holds the checksums of all parts, so its own digest names the
//! version, and a part that was decoded is right. Both are cached: a file whose parts were read before needs no network.

use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use program::Fault;

use super::cache::{Cache, CachedFile};
use super::exchange::{Answer, Exchange, Stream, Trouble};
use super::retry::RetryPolicy;
use super::state::Transfer;
use super::whole_file::WholeFile;
use crate::content::{Traffic, digest};

/// Most parts whose bytes stay in memory for a longer part with the same start, the first layers of what is drawn, and most
/// bytes of them together: little of the 512 MiB that a headset of 4 GiB has for what arrives. The latest part stays even if
/// it is larger.
const RECENT_PARTS: usize = 4;
const RECENT_BYTES: usize = 8 << 20;

/// A package on a server.
#[derive(Debug)]
pub(crate) struct RemoteFile {
    exchange: Arc<Exchange>,
    retry: RetryPolicy,
    cache: Option<Cache>,
    /// Whether only the cache is read.
    is_offline: AtomicBool,
    /// Whether the server sends the file whole only.
    is_whole: AtomicBool,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    etag: Option<String>,
    total: Option<u64>,
    /// The head of the package, once it is known.
    head: Vec<u8>,
    /// Digest of the head, which names the version.
    version: String,
    /// Whether the server forbids to store the file.
    is_not_stored: bool,
    recent: VecDeque<ReadPart>,
    /// Starts of the parts that could not be decoded once.
    undecodable: BTreeSet<u64>,
    /// The response under way.
    stream: Option<Stream>,
    whole: Option<WholeFile>,
}

/// The first bytes of a part of the file.
#[derive(Debug)]
struct ReadPart {
    start: u64,
    bytes: Vec<u8>,
    /// The cache has the bytes up to here, and nothing beyond.
    cached_to: u64,
}

impl ReadPart {
    fn end(&self) -> u64 {
        self.start + self.bytes.len() as u64
    }
}

impl State {
    /// Takes what is known of the part that begins at `start`.
    fn take_part(&mut self, start: u64) -> ReadPart {
        self.find_part(start).unwrap_or_else(|| ReadPart {
            start,
            bytes: if start == 0 { self.head.clone() } else { Vec::new() },
            cached_to: start,
        })
    }

    fn find_part(&mut self, start: u64) -> Option<ReadPart> {
        let at = self.recent.iter().position(|part| part.start == start)?;
        self.recent.remove(at)
    }

    fn put_part(&mut self, part: ReadPart) {
        self.recent.push_back(part);
        let bytes = |recent: &VecDeque<ReadPart>| recent.iter().map(|part| part.bytes.len()).sum::<usize>();
        while self.recent.len() > 1
            && (self.recent.len() > RECENT_PARTS || bytes(&self.recent) > RECENT_BYTES)
        {
            self.recent.pop_front();
        }
    }

    fn set_head(&mut self, head: Vec<u8>) {
        self.version = digest(&head);
        self.head = head;
    }

    /// Takes in what an answer told of the file.
    fn learn(&mut self, transfer: &Transfer) {
        self.etag = transfer.etag().map(String::from);
        self.total = transfer.total();
        self.is_not_stored |= transfer.is_not_stored();
    }
}

impl RemoteFile {
    /// The file at `url`; nothing is requested yet.
    ///
    /// # Errors
    /// [`Fault::Network`] if the certificates to trust cannot be read.
    pub(crate) fn new(url: &str, retry: RetryPolicy, cache: Option<Cache>) -> Result<RemoteFile, Fault> {
        let exchange = Arc::new(Exchange::new(url, retry)?);
        let [is_offline, is_whole] = [(); 2].map(|()| AtomicBool::new(false));
        Ok(RemoteFile { exchange, retry, cache, is_offline, is_whole, state: Mutex::default() })
    }

    /// Looks for the head in the cache; returns whether it is there. Only the cache is read then, until
    /// [`RemoteFile::go_online`].
    pub(crate) fn find_cached(&self) -> bool {
        let cached = self.cache.as_ref().and_then(|cache| cache.get(&self.exchange.key()));
        let Some(CachedFile { etag, bytes, .. }) = cached else { return false };
        self.is_offline.store(true, Ordering::Relaxed);
        let mut state = self.lock();
        state.set_head(bytes);
        state.etag = Some(etag).filter(|etag| !etag.is_empty());
        true
    }

    /// Requests the file, unless the version `known` is current; returns whether it is another one.
    ///
    /// # Errors
    /// [`Fault::Network`] if there is no answer, or no file.
    pub(crate) fn connect(&self, known: Option<&str>) -> Result<bool, Fault> {
        let mut state = self.lock();
        let mut transfer = Transfer::new(self.retry, 0, None, None);
        self.exchange.begin(0, None);
        loop {
            match self.exchange.open(&mut transfer, None, known) {
                Ok(Answer::Unchanged) => return Ok(false),
                Ok(Answer::Rest(stream) | Answer::Whole(stream)) => {
                    state.learn(&transfer);
                    state.stream = Some(stream);
                    return Ok(true);
                }
                Err(trouble) => self.exchange.wait(trouble)?,
            }
        }
    }

    /// Reads from the server what the cache lacks.
    pub(crate) fn go_online(&self) {
        self.is_offline.store(false, Ordering::Relaxed);
    }

    /// The requests for the file.
    pub(crate) fn exchange(&self) -> &Arc<Exchange> {
        &self.exchange
    }

    /// The version that the server named, if it did.
    pub(crate) fn etag(&self) -> Option<String> {
        self.lock().etag.clone()
    }

    /// The URL without secrets, for messages.
    pub(crate) fn name(&self) -> String {
        self.exchange.name()
    }

    /// Length in bytes, once a part was read, if the server says.
    pub(crate) fn total(&self) -> Option<u64> {
        self.lock().total
    }

    /// What came from the server so far, and not from the cache.
    pub(crate) fn traffic(&self) -> Traffic {
        self.exchange.traffic()
    }

    /// Whether the server sends parts, as far as is known.
    pub(crate) fn has_ranges(&self) -> bool {
        !self.is_whole.load(Ordering::Relaxed)
    }

    /// Whether a read found that the server has another version.
    pub(crate) fn is_replaced(&self) -> bool {
        self.exchange.is_replaced()
    }

    /// Ends the read of a part, and those that follow, with an error until [`RemoteFile::resume`]. A file that the server
    /// sends whole goes on: all that follows needs it.
    pub(crate) fn cancel(&self) {
        if self.has_ranges() {
            self.close();
        }
    }

    /// Ends the read under way, and those that follow, with an error.
    pub(crate) fn close(&self) {
        self.exchange.close();
    }

    /// Allows reads again.
    pub(crate) fn resume(&self) {
        self.exchange.resume();
    }

    /// Takes in the head of the package, which names the version of the file. What follows is read on from the response
    /// under way, or requested part by part.
    pub(crate) fn set_head(&self, head: &[u8], is_read_on: bool) {
        let mut state = self.lock();
        state.set_head(head.to_vec());
        if !is_read_on {
            state.stream = None;
        }
    }

    /// Reads the bytes from `start` to the last of `ends`; fewer at the end of the file. Pieces that end at each of `ends`
    /// are in the cache, or not. Blocks until all have arrived.
    ///
    /// # Errors
    /// [`Fault::Network`] if they do not arrive, the file has changed, or it was closed; [`Fault::Usage`] if the disk is
    /// full.
    pub(crate) fn read(&self, start: u64, ends: &[u64]) -> Result<Vec<u8>, Fault> {
        let mut state = self.lock();
        let end = ends.last().copied().unwrap_or(start);
        let mut part = state.take_part(start);
        self.extend_from_cache(&state, &mut part, ends);
        let read = match part.end() >= end {
            true => Ok(()),
            false => self.extend_from_server(&mut state, &mut part, end),
        };
        let length = part.bytes.len().min((end - start) as usize);
        let bytes = read.map(|()| part.bytes[..length].to_vec());
        // What has come of a read that was ended is not asked for again.
        state.put_part(part);
        bytes
    }

    fn extend_from_cache(&self, state: &State, part: &mut ReadPart, ends: &[u64]) {
        let Some(cache) = &self.cache else { return };
        let mut start = part.start;
        for &end in ends {
            let has_start = (start..end).contains(&part.end());
            if has_start
                && let Some(key) = self.cache_key(state, start, end)
                && let Some(file) = cache.get(&key)
                && file.bytes.len() as u64 == end - start
            {
                part.bytes.truncate((start - part.start) as usize);
                part.bytes.extend(file.bytes);
                part.cached_to = end;
            }
            start = end;
        }
    }

    fn extend_from_server(&self, state: &mut State, part: &mut ReadPart, end: u64) -> Result<(), Fault> {
        if self.is_offline.load(Ordering::Relaxed) {
            return Err(Fault::Network("it is not in the cache as a whole".into()));
        }
        let total = (!state.head.is_empty()).then(|| end - part.start);
        self.exchange.begin(part.bytes.len() as u64, total);
        let mut transfer = Transfer::new(self.retry, part.end(), state.etag.clone(), state.total);
        while state.whole.is_none() {
            let end = state.total.map_or(end, |total| total.min(end));
            if part.end() >= end {
                return Ok(());
            }
            if let Err(trouble) = self.receive(state, &mut transfer, part, end) {
                state.stream = None;
                self.exchange.wait(trouble)?;
            }
        }
        let Some(whole) = &mut state.whole else { return Ok(()) };
        if state.head.is_empty() {
            // They may be of another version.
            part.bytes.clear();
        }
        let bytes = whole.read(&self.exchange, &state.head, part.end(), end)?;
        part.bytes.extend(bytes);
        Ok(())
    }

    /// Receives bytes of `part` up to `end`, or begins to receive the file whole.
    fn receive(
        &self,
        state: &mut State,
        transfer: &mut Transfer,
        part: &mut ReadPart,
        end: u64,
    ) -> Result<(), Trouble> {
        let at = part.end();
        let mut stream = match state.stream.take().filter(|stream| stream.at == at) {
            Some(stream) => stream,
            None => match self.exchange.open(transfer, (at > 0).then_some(end), None)? {
                Answer::Rest(stream) => {
                    state.learn(transfer);
                    stream
                }
                Answer::Whole(stream) => {
                    state.learn(transfer);
                    let folder = self.cache.as_ref().map(Cache::folder);
                    let transfer = Transfer::new(self.retry, 0, state.etag.clone(), state.total);
                    let whole = WholeFile::new(folder, stream, transfer).map_err(Trouble::Failed)?;
                    self.is_whole.store(true, Ordering::Relaxed);
                    state.whole = Some(whole);
                    return Ok(());
                }
                Answer::Unchanged => return Err(self.exchange.on_end(transfer)),
            },
        };
        let length = (end - part.start) as usize;
        self.exchange.receive(transfer, &mut stream, length, &mut part.bytes)?;
        // A response from the start may be of another version than the head.
        let known = part.bytes.len().min(state.head.len());
        if part.start == 0 && part.bytes[..known] != state.head[..known] {
            part.bytes.clear();
            return Err(Trouble::Replaced);
        }
        if part.bytes.len() < length {
            return Err(self.exchange.on_end(transfer));
        }
        state.stream = Some(stream).filter(|stream| !stream.is_over());
        Ok(())
    }

    /// Takes in that the part that begins at `start` cannot be decoded, with pieces that end at `ends`. Returns whether
    /// to read it again: once, unless the file was replaced or the server sends it whole.
    pub(crate) fn on_undecodable(&self, start: u64, ends: &[u64]) -> bool {
        self.look_for_replacement();
        let mut state = self.lock();
        state.find_part(start);
        let mut from = start;
        for &end in ends {
            if let (Some(cache), Some(key)) = (&self.cache, self.cache_key(&state, from, end)) {
                cache.remove(&key);
            }
            from = end;
        }
        let may_be_read =
            !self.is_offline.load(Ordering::Relaxed) && self.has_ranges() && !self.is_replaced();
        may_be_read && state.undecodable.insert(start)
    }

    /// Looks whether the file begins in the same way as it did.
    fn look_for_replacement(&self) {
        if self.is_offline.load(Ordering::Relaxed) {
            return;
        }
        let head = self.lock().head.clone();
        let mut transfer = Transfer::new(self.retry, 0, None, None);
        let answer = self.exchange.open(&mut transfer, Some(head.len() as u64), None);
        let Ok(Answer::Rest(mut stream) | Answer::Whole(mut stream)) = answer else { return };
        let mut bytes = Vec::new();
        let read = self.exchange.receive(&mut transfer, &mut stream, head.len(), &mut bytes);
        if read.is_ok() && bytes != head {
            let _ = self.exchange.wait(Trouble::Replaced);
        }
    }

    /// Caches the head, so that the file opens without the server.
    pub(crate) fn keep_head(&self) {
        let state = self.lock();
        if let Some(cache) = self.cache.as_ref().filter(|_| state.is_not_stored) {
            cache.remove(&self.exchange.key());
        } else if !self.is_offline.load(Ordering::Relaxed) {
            self.store(&state, &self.exchange.key(), &state.head);
        }
    }

    /// Caches the pieces of the part that begins at `start` which end at `ends`, from the piece with the number
    /// `checked` on, if they were read before: these are known to be right. `is_last` is whether no longer part will be
    /// read.
    pub(crate) fn keep(&self, start: u64, ends: &[u64], checked: usize, is_last: bool) {
        let mut state = self.lock();
        let Some(mut part) = state.find_part(start) else { return };
        let mut from = start;
        for (number, &end) in ends.iter().enumerate() {
            if number >= checked && end > part.cached_to && end <= part.end() {
                if let Some(key) = self.cache_key(&state, from, end) {
                    let [low, high] = [from, end].map(|at| (at - start) as usize);
                    self.store(&state, &key, &part.bytes[low..high]);
                }
                part.cached_to = end;
            }
            from = end;
        }
        if !is_last {
            state.put_part(part);
        }
    }

    /// Name of a piece of the file in the cache; `None` while its version is not known.
    fn cache_key(&self, state: &State, start: u64, end: u64) -> Option<String> {
        (!state.head.is_empty()).then(|| format!("{}#{start}-{end} {}", self.exchange.key(), state.version))
    }

    /// Caches bytes, if there is a cache and the server allows it.
    fn store(&self, state: &State, key: &str, bytes: &[u8]) {
        let Some(cache) = self.cache.as_ref().filter(|_| !state.is_not_stored) else { return };
        let etag = state.etag.clone().unwrap_or_default();
        let file = CachedFile { etag, base: self.exchange.base(), bytes: bytes.to_vec() };
        cache.store(key, &file, &self.name());
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pieces_that_were_decoded_are_cached() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1 << 20);
        let file = RemoteFile::new("http://host/a", RetryPolicy::default(), Some(cache.clone())).unwrap();
        file.set_head(b"head", false);
        file.lock().put_part(ReadPart { start: 10, bytes: b"firstrest".to_vec(), cached_to: 10 });
        file.keep(10, &[15, 19], 1, true);
        let cached = |start, end| {
            let key = file.cache_key(&file.lock(), start, end).unwrap();
            cache.get(&key).map(|file| file.bytes)
        };
        assert_eq!((cached(10, 15), cached(15, 19)), (None, Some(b"rest".to_vec())));
    }

    #[test]
    fn a_user_name_makes_no_cache_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1 << 20);
        let file = |url| RemoteFile::new(url, RetryPolicy::default(), Some(cache.clone())).unwrap();
        let of_ann = file("http://ann:pass@host/a");
        of_ann.set_head(b"head", false);
        of_ann.keep_head();
        let found = file("http://host/a");
        assert!(found.find_cached(), "it is the same file");
        assert_eq!(found.cache_key(&found.lock(), 4, 9), of_ann.cache_key(&of_ann.lock(), 4, 9));
        assert!(!file("http://host/a?1").find_cached());
    }

    #[test]
    fn the_latest_parts_stay_as_far_as_memory_is_meant_for_them() {
        let mut state = State::default();
        let mut kept = |bytes: usize, start: u64| {
            state.put_part(ReadPart { start, bytes: vec![0; bytes], cached_to: start });
            state.recent.iter().map(|part| part.start).collect::<Vec<_>>()
        };
        (0..4).for_each(|start| drop(kept(1, start)));
        assert_eq!(kept(1, 4), [1, 2, 3, 4]);
        assert_eq!(kept(RECENT_BYTES / 2, 5), [2, 3, 4, 5]);
        assert_eq!(kept(RECENT_BYTES / 2, 6), [5, 6]);
        assert_eq!(kept(2 * RECENT_BYTES, 7), [7], "what is read on");
        assert_eq!(kept(1, 8), [8]);
    }
}
