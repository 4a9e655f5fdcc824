//! [`Download`]: opens the package at a URL, from the cache and from its server.

use std::ops::ControlFlow;
use std::sync::Arc;

use program::Fault;

use super::event::OpenEvent;
use super::opened::OpenTake;
use super::source::TakeSource;
use super::transfer::{Options, REPORT_INTERVAL, RemoteFile, Task, cached_version_note};
use super::url::redacted;

/// How often a file is opened again that changes while it is opened.
const OPENINGS_MAX: u32 = 3;

/// What a download does next: report an event and pause, or go on.
type Flow = ControlFlow<Result<OpenEvent, Fault>>;

fn report(take: Arc<OpenTake>) -> Flow {
    ControlFlow::Break(Ok(OpenEvent::Take(take)))
}

/// A package that is being opened. Iterating waits for the next event, 250 ms at most. It ends after the version of the
/// server, or the first error. Dropping it ends the transfer, and waits for nothing.
#[derive(Debug)]
pub struct Download {
    url: String,
    options: Options,
    stage: Stage,
    /// Whether the cached version was reported.
    has_cached: bool,
    /// The version of the cached package.
    known: Option<String>,
    openings: u32,
}

/// The stage of a download.
#[derive(Debug)]
enum Stage {
    Begin,
    /// The server is asked; `None` if the cached version is current.
    Opening(Task<Option<Arc<OpenTake>>>),
    /// A remark on the take was reported; the take is next.
    Opened(Arc<OpenTake>),
    End,
}

impl Download {
    /// A download of the package at `url`, which starts with the first call of `next`.
    pub fn new(url: &str, options: Options) -> Download {
        let url = url.into();
        Download { url, options, stage: Stage::Begin, has_cached: false, known: None, openings: 0 }
    }

    /// Asks the server, and reports the cached version if there is one.
    fn begin(&mut self) -> Flow {
        let (take, etag) = self.cached().unzip();
        (self.has_cached, self.known) = (take.is_some(), etag.flatten());
        self.ask()?;
        take.map_or(ControlFlow::Continue(()), report)
    }

    /// The cached version, and its name on the server.
    fn cached(&self) -> Option<(Arc<OpenTake>, Option<String>)> {
        let Options { cache, retry, limits } = &self.options;
        let file = Arc::new(RemoteFile::from_cache(&self.url, *retry, cache.as_ref()?)?);
        let take = OpenTake::from_source(TakeSource::Remote(file.clone()), limits);
        let take = take.inspect_err(|fault| log::info!("the cached file does not play: {fault}")).ok()?;
        file.go_online();
        Some((Arc::new(take), file.etag()))
    }

    /// Begins to open the version of the server.
    fn ask(&mut self) -> Flow {
        self.openings += 1;
        let Options { cache, retry, limits } = self.options.clone();
        let retry = if self.has_cached { retry.for_revalidation() } else { retry };
        let known = self.known.clone();
        let task = RemoteFile::new(&self.url, retry, cache).and_then(|file| {
            let file = Arc::new(file);
            Task::begin(file.exchange().clone(), move || {
                if !file.connect(known.as_deref()).map_err(|fault| fault.about(&file.name()))? {
                    return Ok(None);
                }
                OpenTake::from_source(TakeSource::Remote(file), &limits).map(|take| Some(Arc::new(take)))
            })
        });
        match task {
            Ok(task) => self.stage = Stage::Opening(task),
            Err(fault) => return ControlFlow::Break(Err(fault.about(&redacted(&self.url)))),
        }
        ControlFlow::Continue(())
    }

    /// Waits for the version of the server.
    fn wait(&mut self, mut task: Task<Option<Arc<OpenTake>>>) -> Flow {
        match task.wait(REPORT_INTERVAL) {
            None => {
                let progress = task.exchange().progress();
                self.stage = Stage::Opening(task);
                ControlFlow::Break(Ok(OpenEvent::Progress(progress)))
            }
            Some(Ok(None)) => ControlFlow::Continue(()),
            Some(Ok(Some(take))) => match take.truncation() {
                Some(note) => {
                    self.stage = Stage::Opened(take);
                    ControlFlow::Break(Ok(OpenEvent::Note(note)))
                }
                None => report(take),
            },
            Some(Err(_)) if task.exchange().is_replaced() && self.openings < OPENINGS_MAX => self.ask(),
            Some(Err(fault)) if self.has_cached && !task.exchange().was_refused() => {
                ControlFlow::Break(Ok(OpenEvent::Note(cached_version_note(&fault))))
            }
            Some(Err(fault)) => ControlFlow::Break(Err(fault)),
        }
    }
}

impl Iterator for Download {
    type Item = Result<OpenEvent, Fault>;

    fn next(&mut self) -> Option<Result<OpenEvent, Fault>> {
        loop {
            let flow = match std::mem::replace(&mut self.stage, Stage::End) {
                Stage::Begin => self.begin(),
                Stage::Opening(task) => self.wait(task),
                Stage::Opened(take) => report(take),
                Stage::End => return None,
            };
            if let ControlFlow::Break(event) = flow {
                return Some(event);
            }
        }
    }
}
