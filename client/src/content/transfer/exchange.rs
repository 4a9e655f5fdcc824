//! [`Exchange`]: the requests for one file, and the [`Stream`]s that answer them.
//!
//! Requests block; [`Exchange::close`] ends one that waits. What has arrived of the read under way can be asked for at any
//! time.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use program::Fault;

use super::meter::Meter;
use super::request::{Response, ResponseBody, Server};
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::state::{Action, Transfer};
use super::watch::Watch;
use crate::content::{Progress, Traffic, redacted, request_url};

/// Bytes per read: dozens of reads a second on a fast network.
pub(super) const BUFFER_BYTES: usize = 64 << 10;

/// Why an answer that fits no request ends a transfer.
const NOT_UNDERSTOOD: &str = "the server's answer was not understood: try again later";

/// The requests for one file.
pub(crate) struct Exchange {
    url: String,
    server: Server,
    watch: Arc<Watch>,
    /// Whether a final answer ended a transfer: the file is not there for this player.
    was_refused: AtomicBool,
    /// Whether the server has another version than was read before.
    is_replaced: AtomicBool,
    arrived: Mutex<Arrived>,
    start: Instant,
    /// For waits between requests, which [`Exchange::close`] ends.
    pause: (Mutex<()>, Condvar),
}

/// What has arrived.
#[derive(Default)]
struct Arrived {
    traffic: Traffic,
    /// Progress of the read under way.
    progress: Progress,
    meter: Meter,
    /// The URL of the file, where redirects led, once the server has responded.
    url: Option<String>,
}

/// A response under way.
#[derive(Debug)]
pub(super) struct Stream {
    body: ResponseBody,
    /// Offset in the file of its next byte.
    pub(super) at: u64,
    /// Offset of its end, if the server says.
    end: Option<u64>,
}

impl Stream {
    /// Whether all of it was read.
    pub(super) fn is_over(&self) -> bool {
        self.end.is_some_and(|end| self.at >= end)
    }
}

/// A response to a request for the next bytes.
pub(super) enum Answer {
    /// The bytes from the next one on.
    Rest(Stream),
    /// The file from its start, although its rest was requested.
    Whole(Stream),
    /// The version in the cache is current.
    Unchanged,
}

/// Why bytes cannot be received, or what to do before the next request.
pub(super) enum Trouble {
    Retry(Duration),
    /// The server has another version than was read before.
    Replaced,
    Failed(Fault),
}

impl Exchange {
    /// Requests for the file at `url`; nothing is sent yet.
    ///
    /// # Errors
    /// [`Fault::Network`] if the certificates to trust cannot be read.
    pub(super) fn new(url: &str, retry: RetryPolicy) -> Result<Exchange, Fault> {
        let watch = Arc::new(Watch::new(&retry));
        let server = Server::new(url, retry, &watch).map_err(|error| Fault::Network(error.text()))?;
        Ok(Exchange {
            url: url.into(),
            server,
            watch,
            was_refused: AtomicBool::new(false),
            is_replaced: AtomicBool::new(false),
            arrived: Mutex::default(),
            start: Instant::now(),
            pause: (Mutex::default(), Condvar::new()),
        })
    }

    /// Name of the file in the cache: the URL that is requested, since nothing else chooses what the server sends.
    pub(super) fn key(&self) -> String {
        request_url(&self.url)
    }

    /// The URL without secrets, for messages.
    pub(super) fn name(&self) -> String {
        redacted(&self.url)
    }

    /// The URL without secrets, where redirects led.
    pub(super) fn base(&self) -> String {
        redacted(self.arrived().url.as_deref().unwrap_or(&self.url))
    }

    /// What came from the server so far.
    pub(super) fn traffic(&self) -> Traffic {
        self.arrived().traffic
    }

    /// What has arrived of the read under way.
    pub(crate) fn progress(&self) -> Progress {
        let now_s = self.start.elapsed().as_secs_f64();
        let Arrived { progress, meter, .. } = &*self.arrived();
        Progress { bytes_per_s: meter.bytes_per_s(now_s), ..progress.clone() }
    }

    /// Whether the server's answer was final.
    pub(crate) fn was_refused(&self) -> bool {
        self.was_refused.load(Ordering::Relaxed)
    }

    /// Whether a transfer found another version than was read before.
    pub(crate) fn is_replaced(&self) -> bool {
        self.is_replaced.load(Ordering::Relaxed)
    }

    /// Ends the request under way, and those that follow, with an error until [`Exchange::resume`].
    pub(super) fn close(&self) {
        self.watch.cancel();
        drop(self.pause.0.lock());
        self.pause.1.notify_all();
    }

    /// Takes back [`Exchange::close`].
    pub(super) fn resume(&self) {
        self.watch.resume();
    }

    /// Begins a read: `received` bytes are there, and it needs `total`, as far as that is known.
    pub(super) fn begin(&self, received: u64, total: Option<u64>) {
        // Nobody waited for bytes since the read before.
        self.watch.begin(Instant::now());
        self.arrived().progress = Progress { received, total, ..Progress::default() };
    }

    /// Requests the next bytes, up to `end` if that is given, unless the version `known` is current.
    pub(super) fn open(
        &self,
        transfer: &mut Transfer,
        end: Option<u64>,
        known: Option<&str>,
    ) -> Result<Answer, Trouble> {
        let mut request = transfer.next_request(end);
        request.if_none_match = known.map(String::from);
        let asked = Instant::now();
        let response = self.server.get(&request);
        self.arrived().traffic.delay += asked.elapsed();
        let Response { head, body, url } = response.map_err(|error| self.on_error(transfer, error))?;
        self.arrived().url = Some(url);
        let stream =
            |body, at: u64| Stream { body, at, end: head.length.map(|length| at.saturating_add(length)) };
        match transfer.on_response(&request, &head) {
            Action::Read => Ok(Answer::Rest(stream(body, request.offset))),
            Action::ReadWhole => Ok(Answer::Whole(stream(body, 0))),
            Action::Unchanged => Ok(Answer::Unchanged),
            action => Err(self.on_action(action)),
        }
    }

    /// Appends what `stream` holds to `bytes`, until there are `length`, or it ends.
    pub(super) fn receive(
        &self,
        transfer: &mut Transfer,
        stream: &mut Stream,
        length: usize,
        bytes: &mut Vec<u8>,
    ) -> Result<(), Trouble> {
        let mut buffer = vec![0; BUFFER_BYTES.min(length.saturating_sub(bytes.len()))];
        while bytes.len() < length {
            let most = buffer.len().min(length - bytes.len());
            let count = self.receive_piece(transfer, stream, &mut buffer[..most])?;
            if count == 0 {
                break;
            }
            bytes.extend_from_slice(&buffer[..count]);
        }
        Ok(())
    }

    /// Reads the next bytes of `stream` into `buffer`, and returns how many; 0 at its end.
    pub(super) fn receive_piece(
        &self,
        transfer: &mut Transfer,
        stream: &mut Stream,
        buffer: &mut [u8],
    ) -> Result<usize, Trouble> {
        let asked = Instant::now();
        let read = self.server.read(&mut stream.body, buffer);
        let now = Instant::now();
        let count = read.map_err(|error| self.on_error(transfer, error))? as u64;
        stream.at += count;
        self.watch.count(now, count);
        let mut arrived = self.arrived();
        arrived.traffic.bytes += count;
        arrived.traffic.elapsed += now - asked;
        arrived.progress.received += count;
        arrived.progress.trouble = None;
        arrived.meter.count(self.start.elapsed().as_secs_f64(), count);
        drop(arrived);
        transfer.count(count).map_err(|action| self.on_action(action))?;
        Ok(count as usize)
    }

    /// The trouble of a stream that ends before its bytes are there.
    pub(super) fn on_end(&self, transfer: &mut Transfer) -> Trouble {
        self.on_action(transfer.on_break("the connection was lost"))
    }

    /// Waits before the next request, or ends for good.
    ///
    /// # Errors
    /// The fault that ends the transfer; [`Fault::Network`] if it is closed.
    pub(super) fn wait(&self, trouble: Trouble) -> Result<(), Fault> {
        let wait = match trouble {
            Trouble::Retry(wait) => wait,
            Trouble::Failed(fault) => return Err(fault),
            Trouble::Replaced => {
                self.is_replaced.store(true, Ordering::Relaxed);
                return Err(Fault::Network("the file changed on the server: open it again".into()));
            }
        };
        let until = Instant::now() + wait;
        let mut guard = self.pause.0.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if self.watch.is_cancelled() {
                return Err(cancelled());
            }
            if left.is_zero() {
                return Ok(());
            }
            guard = self.pause.1.wait_timeout(guard, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn on_error(&self, transfer: &mut Transfer, error: RequestError) -> Trouble {
        if self.watch.is_cancelled() {
            return Trouble::Failed(cancelled());
        }
        let has_responded = self.arrived().url.is_some();
        self.on_action(match error {
            RequestError::Transient(why) => transfer.on_break(&why),
            // A name that resolved before does not resolve while the network is down.
            RequestError::UnknownHost(why) if has_responded => transfer.on_break(&why),
            RequestError::UnknownHost(why) => Action::GiveUp(format!("{why}: check the URL and the network")),
            RequestError::Blocked(why) => Action::GiveUp(why),
            RequestError::Permanent(why) => Action::Refused(why),
        })
    }

    fn on_action(&self, action: Action) -> Trouble {
        let refuse = || self.was_refused.store(true, Ordering::Relaxed);
        Trouble::Failed(match action {
            Action::Retry(wait, why) => {
                log::info!("{}: {why}", self.name());
                self.arrived().progress.trouble = Some(why);
                return Trouble::Retry(wait);
            }
            Action::GiveUp(why) => Fault::Network(why),
            Action::Refused(why) => {
                refuse();
                Fault::Network(why)
            }
            Action::TooLarge(why) => {
                refuse();
                Fault::Data(why)
            }
            Action::Read | Action::ReadWhole | Action::Unchanged => Fault::Network(NOT_UNDERSTOOD.into()),
        })
    }

    fn arrived(&self) -> MutexGuard<'_, Arrived> {
        self.arrived.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The fault of a read that was ended by its caller.
fn cancelled() -> Fault {
    Fault::Network("cancelled".into())
}

impl std::fmt::Debug for Exchange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Exchange").field(&self.name()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_does_not_resolve_is_tried_again_if_it_resolved_before() {
        let exchange = Exchange::new("http://host/", RetryPolicy::default()).unwrap();
        let trouble = || {
            let mut transfer = Transfer::new(RetryPolicy::default(), 0, None, None);
            exchange.on_error(&mut transfer, RequestError::UnknownHost("unknown".into()))
        };
        assert!(matches!(trouble(), Trouble::Failed(Fault::Network(why)) if why.contains("check the URL")));
        exchange.arrived().url = Some("http://host/".into());
        assert!(matches!(trouble(), Trouble::Retry(_)));
        assert!(!exchange.was_refused(), "a later attempt may succeed");
    }
}
