//! [`Download`]: opens the package at a URL, from the cache and from its server.

use std::ops::ControlFlow;
use std::sync::Arc;

use program::Fault;

use super::event::OpenEvent;
use super::opened::OpenTake;
use super::progress::Progress;
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

/// Opens a take on a thread of its own; `None` if there is none.
type Opening = Task<Option<Arc<OpenTake>>>;

/// The stage of a download.
#[derive(Debug)]
enum Stage {
    Begin,
    /// The cache is read.
    Cached(Opening, Arc<RemoteFile>),
    /// The server is asked; `None` if the cached version is current.
    Opening(Opening),
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

    /// Begins to open the cached version, if there is a cache.
    fn begin(&mut self) -> Flow {
        let Options { cache: cache @ Some(_), retry, limits } = self.options.clone() else {
            return self.ask();
        };
        let begun = RemoteFile::new(&self.url, retry, cache).and_then(|file| {
            let file = Arc::new(file);
            let ours = file.clone();
            let opening = Task::begin(file.exchange().clone(), move || {
                if !ours.find_cached() {
                    return Ok(None);
                }
                let take = OpenTake::from_source(TakeSource::Remote(ours), &limits);
                Ok(take
                    .inspect_err(|fault| log::info!("the cached file does not play: {fault}"))
                    .ok()
                    .map(Arc::new))
            })?;
            Ok(Stage::Cached(opening, file))
        });
        self.enter(begun)
    }

    /// Waits for the cached version, then asks the server, and reports the cached version if there is one.
    fn wait_for_cached(&mut self, mut opening: Opening, file: Arc<RemoteFile>) -> Flow {
        let take = match opening.wait(REPORT_INTERVAL) {
            None => {
                self.stage = Stage::Cached(opening, file);
                return ControlFlow::Break(Ok(OpenEvent::Progress(Progress::default())));
            }
            Some(Err(fault)) => return ControlFlow::Break(Err(fault)),
            Some(Ok(take)) => take,
        };
        if take.is_some() {
            file.go_online();
            (self.has_cached, self.known) = (true, file.etag());
        }
        self.ask()?;
        take.map_or(ControlFlow::Continue(()), report)
    }

    /// Begins to open the version of the server.
    fn ask(&mut self) -> Flow {
        self.openings += 1;
        let Options { cache, retry, limits } = self.options.clone();
        let retry = if self.has_cached { retry.for_revalidation() } else { retry };
        let known = self.known.clone();
        let begun = RemoteFile::new(&self.url, retry, cache).and_then(|file| {
            let file = Arc::new(file);
            Task::begin(file.exchange().clone(), move || {
                if !file.connect(known.as_deref()).map_err(|fault| fault.about(&file.name()))? {
                    return Ok(None);
                }
                OpenTake::from_source(TakeSource::Remote(file), &limits).map(|take| Some(Arc::new(take)))
            })
        });
        self.enter(begun.map(Stage::Opening))
    }

    /// Goes on with a stage, if it could begin.
    fn enter(&mut self, begun: Result<Stage, Fault>) -> Flow {
        match begun {
            Ok(stage) => self.stage = stage,
            Err(fault) => return ControlFlow::Break(Err(fault.about(&redacted(&self.url)))),
        }
        ControlFlow::Continue(())
    }

    /// Waits for the version of the server.
    fn wait(&mut self, mut task: Opening) -> Flow {
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
                Stage::Cached(opening, file) => self.wait_for_cached(opening, file),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn nobody_waits_for_a_cache_that_does_not_answer() {
        use std::sync::mpsc::channel;
        use std::time::Duration;

        use crate::content::transfer::Cache;
        use crate::content::{digest, request_url};

        const URL: &str = "http://host/a";
        let folder = tempfile::tempdir().unwrap();
        // Opening it waits for a writer.
        let entry = folder.path().join(digest(request_url(URL))).with_extension("clip");
        assert!(std::process::Command::new("mkfifo").arg(entry).status().unwrap().success());
        let options = Options { cache: Some(Cache::new(folder.path(), 1000)), ..Options::default() };
        let (send, sent) = channel();
        std::thread::spawn(move || {
            let first = Download::new(URL, options).next();
            send.send(matches!(first, Some(Ok(OpenEvent::Progress(_))))).unwrap();
        });
        assert_eq!(sent.recv_timeout(Duration::from_secs(60)), Ok(true), "and it was dropped at once");
    }
}
