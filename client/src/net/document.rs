//! [`document`]: a small file that is fetched whole, such as a playlist, and kept as clips are.

use std::ops::ControlFlow;

use codec::Limits;
use program::Fault;

use super::arrived::Arrived;
use super::fetch::{End, Fetch};
use super::{Options, REPORT};
use crate::clips::{Progress, redacted};

/// A file that was fetched, or kept by an earlier run.
#[derive(Debug)]
pub(crate) struct Document {
    pub(crate) bytes: Vec<u8>,
    /// Why it is the one that was kept, if the server was not reached.
    pub(crate) note: Option<String>,
}

/// Fetches the file at `url`, of at most so many bytes. It is kept if it `is_sound`: what a network says of
/// itself in its place does not replace what was kept. `tell` is told of it a few times a second, and
/// says whether to go on; `None` where it does not.
///
/// # Errors
/// [`Fault::Network`] or [`Fault::Data`] that names the address.
pub(crate) fn document(
    url: &str,
    options: &Options,
    max_bytes: usize,
    is_sound: &dyn Fn(&[u8]) -> bool,
    tell: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Option<Document>, Fault> {
    let kept = options
        .cache
        .as_ref()
        .and_then(|cache| cache.get(url))
        .filter(|kept| kept.package.len() <= max_bytes);
    let patience = if kept.is_some() { options.patience.in_passing() } else { options.patience };
    let known = kept.as_ref().map(|kept| kept.etag.clone()).filter(|etag| !etag.is_empty());
    let limits = Limits { max_bytes, ..options.limits };
    let fetch = Fetch::start(url, patience, max_bytes, Arrived::document(limits), known)
        .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
    let (end, bytes) = loop {
        let mut state = fetch.wait(REPORT, |state| state.end.is_some());
        if let Some(end) = state.end.take() {
            break (end, state.arrived.take());
        }
        let progress = state.progress.clone();
        drop(state);
        if tell(&progress).is_break() {
            return Ok(None);
        }
    };
    match (end, kept) {
        (End::Complete { etag }, _) => {
            if let Some(cache) = &options.cache
                && is_sound(&bytes)
                && let Err(error) = cache.put(url, etag.as_deref().unwrap_or_default(), &bytes)
            {
                log::warn!("{}: cannot be kept for the next time: {error}", redacted(url));
            }
            Ok(Some(Document { bytes, note: None }))
        }
        (End::Unchanged, Some(kept)) => Ok(Some(Document { bytes: kept.package, note: None })),
        (End::Failed { fault, passing: true }, Some(kept)) => {
            let note = format!("{}: {fault}; the version kept on this device plays", redacted(url));
            Ok(Some(Document { bytes: kept.package, note: Some(note) }))
        }
        (End::Failed { fault, .. }, _) => Err(fault.about(&redacted(url))),
        (End::Unchanged, None) => {
            Err(Fault::Network(format!("{}: the answer was not understood", redacted(url))))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::{Ipv4Addr, TcpListener};

    use super::*;
    use crate::net::Cache;

    /// The address of a file on a server that answers one request, with this.
    fn served(listener: &TcpListener, body: &'static str) -> std::thread::JoinHandle<()> {
        let listener = listener.try_clone().unwrap();
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
            while !lines.next().unwrap().unwrap().is_empty() {}
            let length = body.len();
            write!(stream, "HTTP/1.1 200 OK\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}")
                .unwrap();
        })
    }

    #[test]
    fn what_is_not_sound_replaces_nothing_that_was_kept() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1 << 20);
        let options = Options { cache: Some(cache.clone()), ..Options::default() };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let url = format!("http://{}/list", listener.local_addr().unwrap());
        for (body, kept) in [("{one}", "{one}"), ("<html>", "{one}"), ("{two}", "{two}")] {
            let server = served(&listener, body);
            let is_sound = &|bytes: &[u8]| bytes.starts_with(b"{");
            let fetched = document(&url, &options, 100, is_sound, &mut |_| ControlFlow::Continue(()));
            server.join().unwrap();
            assert_eq!(fetched.unwrap().unwrap().bytes, body.as_bytes());
            assert_eq!(cache.get(&url).unwrap().package, kept.as_bytes());
        }
    }
}
