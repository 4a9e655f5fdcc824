//! [`Download`]: fetches a file, opens it as soon as its first layer is there, and caches it.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use codec::{Limits, contents};
use program::Fault;

use super::cache::{Cache, CachedFile};
use super::fetch::{Fetch, FetchOptions, Outcome, State, undecodable};
use super::partial_file::PartialFile;
use super::remote_file::RemoteFile;
use super::retry::RetryPolicy;
use crate::clips::{LoadEvent, Progress, redacted};
use crate::takes::{OpenTake, TakeSource};

/// Time between two reports of progress: short, and still long enough to read the numbers.
pub(super) const REPORT_INTERVAL: Duration = Duration::from_millis(250);

/// Options of a download.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The cache, if downloads are cached.
    pub cache: Option<Cache>,
    /// Timeouts and retries.
    pub retry: RetryPolicy,
    /// Limits on the clip.
    pub limits: Limits,
}

impl Options {
    /// Caches a file, if there is a cache. Logs failure: the file plays without.
    pub(super) fn store(&self, url: &str, file: &CachedFile) {
        if let Some(cache) = &self.cache
            && let Err(error) = cache.put(url, file)
        {
            log::warn!("{}: cannot be cached: {error}", redacted(url));
        }
    }
}

/// Says that a cached version plays because the server was not reached.
pub(super) fn cached_version_note(url: &str, fault: &Fault) -> String {
    format!("{}: {fault}; the version cached on this device plays", redacted(url))
}

/// What a download does next: report an event and pause, or go on.
type Flow = ControlFlow<Result<LoadEvent, Fault>>;

fn report(take: OpenTake) -> Flow {
    ControlFlow::Break(Ok(LoadEvent::Take(Arc::new(take))))
}

/// A take that is being opened by a thread of its own, which may wait long for its server. Dropping it ends the read, and
/// leaves the thread behind.
#[derive(Debug)]
struct OpeningTake {
    file: Arc<RemoteFile>,
    is_open: bool,
    result: Receiver<Result<OpenTake, Fault>>,
}

impl OpeningTake {
    /// Begins to open the file at `url`.
    ///
    /// # Errors
    /// [`Fault::Network`] if the certificates to trust cannot be read; [`Fault::Device`] if the system refuses a thread.
    fn begin(url: &str, options: &Options) -> Result<OpeningTake, Fault> {
        let Options { cache, retry, limits } = options.clone();
        let file = Arc::new(RemoteFile::new(url, retry, cache)?);
        let (sender, result) = channel();
        let source = TakeSource::Remote(file.clone());
        let thread = std::thread::Builder::new().name("open".into()).spawn(move || {
            // Nobody listens where it is not wanted any more.
            let _ = sender.send(OpenTake::from_source(source, &limits));
        });
        thread.map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(OpeningTake { file, is_open: false, result })
    }
}

impl Drop for OpeningTake {
    fn drop(&mut self) {
        if !self.is_open {
            self.file.close();
        }
    }
}

/// A file being downloaded. Iterating waits for the next event, 250 ms at most. It ends after the
/// complete file or the first error. Dropping it cancels the download.
#[derive(Debug)]
pub struct Download {
    url: String,
    options: Options,
    stage: Stage,
    /// Whether the cached version was reported.
    has_cached: bool,
    /// The version of the file that was reported, by [`State::beginnings`].
    opened: Option<u32>,
    /// The reason of a retry reported last.
    trouble: Option<String>,
}

/// The stage of a download.
#[derive(Debug)]
enum Stage {
    Begin,
    Fetching(Fetch),
    /// The file is a take.
    Opening(OpeningTake),
    /// A remark on the take was reported; the take is next.
    Opened(Arc<OpenTake>),
    /// The file is complete; its package goes to the cache.
    Store {
        etag: String,
        package: Vec<u8>,
    },
    End,
}

impl Download {
    /// A download of the file at `url`, which starts with the first call of `next`.
    pub fn new(url: &str, options: Options) -> Download {
        Download {
            url: url.into(),
            options,
            stage: Stage::Begin,
            has_cached: false,
            opened: None,
            trouble: None,
        }
    }

    /// Starts to fetch, and reports the cached version if there is one.
    fn begin(&mut self) -> Flow {
        let (etag, cached) = self.cached().unzip();
        self.has_cached = cached.is_some();
        let retry = if self.has_cached { self.options.retry.for_revalidation() } else { self.options.retry };
        let etag = etag.filter(|etag| !etag.is_empty());
        let limits = self.options.limits;
        let options =
            FetchOptions { url: self.url.clone(), retry, max_bytes: limits.max_bytes, cached: etag };
        match Fetch::start(options, PartialFile::package(limits)) {
            Ok(fetch) => self.stage = Stage::Fetching(fetch),
            Err(fault) => return self.fail(fault),
        }
        cached.map_or(ControlFlow::Continue(()), report)
    }

    /// The cached version, and its name on the server. Removes an entry that does not decode.
    fn cached(&self) -> Option<(String, OpenTake)> {
        let cache = self.options.cache.as_ref()?;
        let file = cache.get(&self.url)?;
        match self.open_bytes(file.bytes) {
            Ok(take) => Some((file.etag, take)),
            Err(fault) => {
                log::warn!("the cached file does not play: {fault}");
                cache.remove(&self.url);
                None
            }
        }
    }

    /// Opens a package that is in memory.
    fn open_bytes(&self, bytes: Vec<u8>) -> Result<OpenTake, Fault> {
        OpenTake::from_source(TakeSource::Memory(redacted(&self.url), bytes.into()), &self.options.limits)
    }

    /// Waits for the next event of a fetch.
    fn wait(&mut self, fetch: Fetch) -> Flow {
        let mut state = fetch.wait(REPORT_INTERVAL, |state| self.has_event(state));
        if self.is_new(&state) {
            drop(state);
            let file = fetch.file(redacted(&self.url));
            self.opened = Some(file.beginnings());
            let take = OpenTake::from_source(TakeSource::Arriving(Arc::new(file)), &self.options.limits);
            self.stage = Stage::Fetching(fetch);
            return ControlFlow::Break(take.map(|take| LoadEvent::Take(Arc::new(take))));
        }
        if let Some(outcome) = state.outcome.take() {
            // A copy: the take goes on reading from the file.
            let package = if state.file.is_complete() { state.file.bytes().to_vec() } else { Vec::new() };
            drop(state);
            return self.on_outcome(outcome, package);
        }
        let progress = state.progress.clone();
        drop(state);
        self.trouble.clone_from(&progress.trouble);
        self.stage = Stage::Fetching(fetch);
        ControlFlow::Break(Ok(LoadEvent::Progress(progress)))
    }

    /// Whether there is an event to report at once: the end, a first layer, or another trouble.
    fn has_event(&self, state: &State) -> bool {
        state.outcome.is_some() || self.is_new(state) || state.progress.trouble != self.trouble
    }

    /// Whether the first layer of a version is there that was not reported. None is while a cached version plays, which is
    /// better than an incomplete one.
    fn is_new(&self, state: &State) -> bool {
        !self.has_cached && self.opened != Some(state.beginnings) && state.file.playable_bytes() > 0
    }

    /// Handles the end of the fetch of `package`, which is empty unless it is complete.
    fn on_outcome(&mut self, outcome: Outcome, package: Vec<u8>) -> Flow {
        match outcome {
            Outcome::Unchanged => ControlFlow::Continue(()),
            Outcome::Take => match OpeningTake::begin(&self.url, &self.options) {
                Ok(opening) => {
                    self.stage = Stage::Opening(opening);
                    ControlFlow::Continue(())
                }
                Err(fault) => self.fail(fault),
            },
            Outcome::Complete { etag } => {
                let limits = &self.options.limits;
                let checked = contents(&package, limits).and_then(|head| head.check_sections(&package));
                if let Err(error) = checked {
                    return self.fail(undecodable(&error));
                }
                let take =
                    if self.has_cached { self.open_bytes(package.clone()).map(Some) } else { Ok(None) };
                self.stage = Stage::Store { etag: etag.unwrap_or_default(), package };
                match take {
                    Ok(None) => ControlFlow::Continue(()),
                    Ok(Some(take)) => report(take),
                    Err(fault) => {
                        self.stage = Stage::End;
                        ControlFlow::Break(Err(fault))
                    }
                }
            }
            Outcome::Failed { fault, is_transient: true } if self.has_cached => {
                ControlFlow::Break(Ok(LoadEvent::Note(cached_version_note(&self.url, &fault))))
            }
            Outcome::Failed { fault, .. } => self.fail(fault),
        }
    }

    /// Waits until the take is open.
    fn open_take(&mut self, mut opening: OpeningTake) -> Flow {
        let take = match opening.result.recv_timeout(REPORT_INTERVAL) {
            Ok(take) => {
                opening.is_open = true;
                take
            }
            Err(RecvTimeoutError::Timeout) => {
                let received = opening.file.traffic().bytes;
                self.stage = Stage::Opening(opening);
                let progress = Progress { received, ..Progress::default() };
                return ControlFlow::Break(Ok(LoadEvent::Progress(progress)));
            }
            Err(RecvTimeoutError::Disconnected) => {
                return self
                    .fail(Fault::Defect("it cannot be opened: report it with the player's log".into()));
            }
        };
        match take {
            Ok(take) => {
                let (note, take) = (take.truncation(), Arc::new(take));
                ControlFlow::Break(Ok(match note {
                    Some(note) => {
                        self.stage = Stage::Opened(take);
                        LoadEvent::Note(note)
                    }
                    None => LoadEvent::Take(take),
                }))
            }
            // It names the URL.
            Err(fault) => ControlFlow::Break(Err(fault)),
        }
    }

    fn fail(&self, fault: Fault) -> Flow {
        ControlFlow::Break(Err(fault.about(&redacted(&self.url))))
    }
}

impl Iterator for Download {
    type Item = Result<LoadEvent, Fault>;

    fn next(&mut self) -> Option<Result<LoadEvent, Fault>> {
        loop {
            let flow = match std::mem::replace(&mut self.stage, Stage::End) {
                Stage::Begin => self.begin(),
                Stage::Fetching(fetch) => self.wait(fetch),
                Stage::Opening(opening) => self.open_take(opening),
                Stage::Opened(take) => ControlFlow::Break(Ok(LoadEvent::Take(take))),
                Stage::Store { etag, package } => {
                    let file = CachedFile { etag, base: redacted(&self.url), bytes: package };
                    self.options.store(&self.url, &file);
                    return None;
                }
                Stage::End => return None,
            };
            if let ControlFlow::Break(event) = flow {
                return Some(event);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    /// The state of a fetch that has received `bytes` bytes.
    fn received(bytes: usize) -> State {
        let mut file = PartialFile::package(Limits::default());
        file.push(&DEMO[..bytes]).unwrap();
        State::new(file)
    }

    #[test]
    fn the_end_and_a_first_layer_and_trouble_are_reported_at_once() {
        let first = contents(DEMO, &Limits::default()).unwrap().layer_bytes()[0];
        let mut download = Download::new("http://host/a.aarc", Options::default());
        assert!(!download.has_event(&received(first - 1)), "no layer is complete");
        assert!(download.has_event(&received(first)));
        let mut again = received(first);
        again.beginnings = 1;
        download.opened = Some(0);
        assert!(!download.has_event(&received(first)) && download.has_event(&again), "another version");
        download.has_cached = true;
        assert!(!download.has_event(&again), "the cached version plays");
        let mut troubled = received(first);
        troubled.progress.trouble = Some("the connection was lost".into());
        assert!(download.has_event(&troubled));
        download.trouble.clone_from(&troubled.progress.trouble);
        assert!(!download.has_event(&troubled), "it was reported");
        troubled.outcome = Some(Outcome::Unchanged);
        assert!(download.has_event(&troubled));
    }
}
