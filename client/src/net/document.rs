//! [`document`]: downloads a small file such as a playlist, and caches it as clips are cached.

use std::ops::ControlFlow;

use codec::Limits;
use program::Fault;

use super::cache::CachedFile;
use super::download::{Options, REPORT_INTERVAL, cached_version_note};
use super::fetch::{Fetch, FetchOptions, NOT_UNDERSTOOD, Outcome};
use super::partial_file::PartialFile;
use crate::clips::{Progress, redacted};

/// A file from the server or the cache.
#[derive(Debug)]
pub(crate) struct Document {
    pub(crate) bytes: Vec<u8>,
    /// Its URL, where redirects led, without secrets.
    pub(crate) url: String,
    /// Why the cached version is used, if the server was not reached.
    pub(crate) note: Option<String>,
}

/// Fetches the file at `url`, of at most `max_bytes` bytes. Caches it if it `is_valid`, so that the log-in
/// page of a network does not replace a cached file. Calls `on_progress` a few times a second; returns
/// `None` when it breaks.
///
/// # Errors
/// [`Fault::Network`] or [`Fault::Data`] with the URL.
pub(crate) fn document(
    url: &str,
    options: &Options,
    max_bytes: usize,
    is_valid: &dyn Fn(&[u8]) -> bool,
    on_progress: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Option<Document>, Fault> {
    let cache = options.cache.as_ref();
    let cached = cache.and_then(|cache| cache.get(url)).filter(|file| file.bytes.len() <= max_bytes);
    let retry = if cached.is_some() { options.retry.for_revalidation() } else { options.retry };
    let etag = cached.as_ref().map(|file| file.etag.clone()).filter(|etag| !etag.is_empty());
    let limits = Limits { max_bytes, ..options.limits };
    let fetch_options = FetchOptions { url: url.into(), retry, max_bytes, cached: etag };
    let fetch = Fetch::start(fetch_options, PartialFile::document(limits))?;
    let (outcome, bytes, base) = loop {
        let mut state = fetch.wait(REPORT_INTERVAL, |state| state.outcome.is_some());
        if let Some(outcome) = state.outcome.take() {
            let base = redacted(state.url.as_deref().unwrap_or(url));
            break (outcome, state.file.take(), base);
        }
        let progress = state.progress.clone();
        drop(state);
        if on_progress(&progress).is_break() {
            return Ok(None);
        }
    };
    match (outcome, cached) {
        (Outcome::Complete { etag }, _) => {
            let file = CachedFile { etag: etag.unwrap_or_default(), base, bytes };
            if is_valid(&file.bytes) {
                options.store(url, &file);
            }
            Ok(Some(Document { bytes: file.bytes, url: file.base, note: None }))
        }
        (Outcome::Unchanged, Some(file)) => Ok(Some(Document { bytes: file.bytes, url: base, note: None })),
        (Outcome::Failed { fault, is_transient: true }, Some(file)) => {
            let note = Some(cached_version_note(url, &fault));
            Ok(Some(Document { bytes: file.bytes, url: file.base, note }))
        }
        (Outcome::Failed { fault, .. }, _) => Err(fault.about(&redacted(url))),
        (Outcome::Unchanged, None) | (Outcome::Take, _) => {
            Err(Fault::Network(format!("{}: {NOT_UNDERSTOOD}", redacted(url))))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::{Ipv4Addr, TcpListener};

    use super::*;
    use crate::net::Cache;

    /// Answers one request with `body`.
    fn serve(listener: &TcpListener, body: &'static str) -> std::thread::JoinHandle<()> {
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
    fn an_invalid_file_does_not_replace_the_cached_one() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1 << 20);
        let options = Options { cache: Some(cache.clone()), ..Options::default() };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let url = format!("http://{}/list", listener.local_addr().unwrap());
        for (body, expected, cached) in [
            ("{one}", "{one}", "{one}"),
            ("one", "one", "{one}"),
            ("\n <html>", "{one}", "{one}"),
            ("{two}", "{two}", "{two}"),
        ] {
            let server = serve(&listener, body);
            let is_valid = &|bytes: &[u8]| bytes.starts_with(b"{");
            let fetched = document(&url, &options, 100, is_valid, &mut |_| ControlFlow::Continue(()));
            server.join().unwrap();
            let fetched = fetched.unwrap().unwrap();
            assert_eq!(fetched.bytes, expected.as_bytes(), "{body}");
            assert_eq!(fetched.note.is_some(), expected != body, "{:?}", fetched.note);
            assert_eq!(fetched.url, url);
            assert_eq!(cache.get(&url).unwrap().bytes, cached.as_bytes());
        }
    }
}
