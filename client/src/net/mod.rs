//! Clips by address: [`Download`] fetches one, decodes it as its layers arrive, and keeps it; `document`
//! does so for what is no clip.
//!
//! ```text
//! request -> transfer -> arrived -> decode -> LoadEvent        request: HTTP; head: what an answer says
//!            (fetch: a thread)         |                  transfer: what to ask next
//!                                    cache                arrived: the bytes, and what plays of them
//!                                                         cache: clips of earlier runs, on disk
//! ```
//!
//! What was kept plays at once, while the server is asked whether there is another version. Memory
//! is bounded by [`Limits`]: nothing longer is fetched, and while the rest arrives, at most the
//! bytes that are decoded exist twice.

mod arrived;
mod cache;
mod document;
mod fetch;
mod head;
mod meter;
mod request;
mod transfer;
mod trouble;

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use codec::{Clip, Limits};
use program::Fault;

pub use cache::{CACHE_BYTES, Cache};
pub(crate) use document::document;
pub use transfer::Patience;

use crate::clips::{LoadEvent, decode, redacted};
use arrived::Arrived;
use fetch::{End, Fetch, State};

/// Time between two reports of progress: as fast as they can be read.
const REPORT: Duration = Duration::from_millis(250);

/// What a download does besides fetching.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Where clips are kept, if they are.
    pub cache: Option<Cache>,
    /// How long to wait, and how often to try.
    pub patience: Patience,
    /// Most that a clip may ask for.
    pub limits: Limits,
}

/// A clip on its way. Iterating waits for news, a quarter of a second at the longest; it ends after
/// the whole clip or the first error. Dropped, it stops.
#[derive(Debug)]
pub struct Download {
    url: String,
    options: Options,
    stage: Stage,
    /// Whether a version of an earlier run plays.
    has_kept: bool,
    /// Bytes that the clip told last was decoded from, and seconds that took.
    decoded: usize,
    decoding_s: f64,
    /// The trouble told last.
    trouble: Option<String>,
}

/// Where a download stands.
#[derive(Debug)]
enum Stage {
    Begin,
    Running(Fetch),
    /// What is here plays; this is why the rest is missing.
    Failed(Fault),
    /// All is told; this is to be kept.
    Keep {
        etag: String,
        package: Vec<u8>,
    },
    Over,
}

impl Download {
    /// Of the clip at `url`. Nothing is done before the first news are asked for.
    pub fn new(url: &str, options: Options) -> Download {
        Download {
            url: url.into(),
            options,
            stage: Stage::Begin,
            has_kept: false,
            decoded: 0,
            decoding_s: 0.0,
            trouble: None,
        }
    }

    /// Plays what was kept, and begins to fetch.
    fn begin(&mut self) -> ControlFlow<Result<LoadEvent, Fault>> {
        let kept = self.options.cache.as_ref().and_then(|cache| {
            let entry = cache.get(&self.url)?;
            match decode(&entry.package, &self.options.limits) {
                Ok(clip) => Some((entry.etag, clip)),
                Err(error) => {
                    log::warn!("{}: what was kept does not play: {error}", redacted(&self.url));
                    cache.remove(&self.url);
                    None
                }
            }
        });
        let (known, clip) = kept.unzip();
        self.has_kept = clip.is_some();
        let mut patience = self.options.patience;
        if self.has_kept {
            patience = patience.in_passing();
        }
        let known = known.filter(|etag| !etag.is_empty());
        let limits = self.options.limits;
        match Fetch::start(&self.url, patience, limits.max_bytes, Arrived::new(limits), known) {
            Ok(fetch) => self.stage = Stage::Running(fetch),
            Err(error) => return self.fail(Fault::Device(format!("cannot start a thread: {error}"))),
        }
        clip.map_or(ControlFlow::Continue(()), |clip| ControlFlow::Break(Ok(LoadEvent::Clip(Box::new(clip)))))
    }

    /// Waits for something to tell.
    fn wait(&mut self, fetch: Fetch) -> ControlFlow<Result<LoadEvent, Fault>> {
        let is_ready = |state: &State| {
            state.end.is_some() || self.improves(state) || state.progress.trouble != self.trouble
        };
        let mut state = fetch.wait(REPORT, is_ready);
        let (playable, improves) = (state.arrived.playable(), self.improves(&state));
        if let Some(end) = state.end.take() {
            let bytes = state.arrived.take();
            drop(state);
            return match end {
                // The last layers may have come together with the trouble.
                End::Failed { fault, .. } if playable > self.decoded && !self.has_kept => {
                    match self.decode(&bytes[..playable]) {
                        Ok(clip) => {
                            self.stage = Stage::Failed(fault);
                            ControlFlow::Break(Ok(LoadEvent::Clip(Box::new(clip))))
                        }
                        Err(fault) => self.fail(fault),
                    }
                }
                end => self.end(end, bytes),
            };
        }
        if improves {
            let bytes = state.arrived.bytes()[..playable].to_vec();
            drop(state);
            let start = Instant::now();
            let clip = self.decode(&bytes);
            (self.decoded, self.decoding_s) = (playable, start.elapsed().as_secs_f64());
            return match clip {
                Ok(clip) => self.go_on(fetch, LoadEvent::Clip(Box::new(clip))),
                Err(fault) => self.fail(fault),
            };
        }
        let progress = state.progress.clone();
        drop(state);
        self.trouble.clone_from(&progress.trouble);
        self.go_on(fetch, LoadEvent::Progress(progress))
    }

    /// Whether what is here plays better than what was told, and can be decoded before the rest is
    /// here, which would have to wait for it. The first layer never waits.
    fn improves(&self, state: &State) -> bool {
        let playable = state.arrived.playable();
        // A coarse clip is no news where a whole one plays.
        if self.has_kept || playable <= self.decoded {
            return false;
        }
        let decoding_s = self.decoding_s * playable as f64 / self.decoded.max(1) as f64;
        self.decoded == 0 || state.progress.remaining_s().is_some_and(|left_s| left_s > decoding_s)
    }

    /// Tells something while the rest is on its way.
    fn go_on(&mut self, fetch: Fetch, news: LoadEvent) -> ControlFlow<Result<LoadEvent, Fault>> {
        self.stage = Stage::Running(fetch);
        ControlFlow::Break(Ok(news))
    }

    /// Takes in how fetching ended.
    fn end(&mut self, end: End, package: Vec<u8>) -> ControlFlow<Result<LoadEvent, Fault>> {
        match end {
            End::Unchanged => ControlFlow::Continue(()),
            End::Complete { etag } => match self.decode(&package) {
                Ok(clip) => {
                    self.stage = Stage::Keep { etag: etag.unwrap_or_default(), package };
                    ControlFlow::Break(Ok(LoadEvent::Clip(Box::new(clip))))
                }
                Err(fault) => self.fail(fault),
            },
            End::Failed { fault, passing: true } if self.has_kept => {
                let note = format!("{}: {fault}; the version kept on this device plays", redacted(&self.url));
                ControlFlow::Break(Ok(LoadEvent::Note(note)))
            }
            End::Failed { fault, .. } => self.fail(fault),
        }
    }

    fn decode(&self, bytes: &[u8]) -> Result<Clip, Fault> {
        decode(bytes, &self.options.limits).map_err(|error| Fault::Data(error.to_string()))
    }

    /// Ends with a fault of the clip.
    fn fail(&self, fault: Fault) -> ControlFlow<Result<LoadEvent, Fault>> {
        ControlFlow::Break(Err(fault.about(&redacted(&self.url))))
    }

    /// Keeps the clip for the next run.
    fn keep(&self, etag: &str, package: &[u8]) {
        if let Some(cache) = &self.options.cache
            && let Err(error) = cache.put(&self.url, etag, package)
        {
            log::warn!("{}: cannot be kept for the next time: {error}", redacted(&self.url));
        }
    }
}

impl Iterator for Download {
    type Item = Result<LoadEvent, Fault>;

    fn next(&mut self) -> Option<Result<LoadEvent, Fault>> {
        loop {
            let flow = match std::mem::replace(&mut self.stage, Stage::Over) {
                Stage::Begin => self.begin(),
                Stage::Running(fetch) => self.wait(fetch),
                Stage::Failed(fault) => self.fail(fault),
                Stage::Keep { etag, package } => {
                    self.keep(&etag, &package);
                    return None;
                }
                Stage::Over => return None,
            };
            if let ControlFlow::Break(news) = flow {
                return Some(news);
            }
        }
    }
}
