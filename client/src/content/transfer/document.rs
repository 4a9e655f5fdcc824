//! [`document`]: downloads a small file such as a playlist, and caches it.

use std::ops::ControlFlow;
use std::sync::Arc;

use program::Fault;

use super::cache::CachedFile;
use super::exchange::{Answer, Exchange, Trouble};
use super::options::{Options, REPORT_INTERVAL, cached_version_note};
use super::state::Transfer;
use super::task::Task;
use super::web_page::{WEB_PAGE, is_web_page};
use crate::content::{Progress, request_url};

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
    let (cache, key) = (options.cache.as_ref(), request_url(url));
    let cached = cache.and_then(|cache| cache.get(&key)).filter(|file| file.bytes.len() <= max_bytes);
    let retry = if cached.is_some() { options.retry.for_revalidation() } else { options.retry };
    let known = cached.as_ref().map(|file| file.etag.clone()).filter(|etag| !etag.is_empty());
    let exchange = Arc::new(Exchange::new(url, retry)?);
    let ours = exchange.clone();
    let mut task = Task::begin(exchange.clone(), move || {
        let transfer = Transfer::new(retry, 0, None, None).within(max_bytes as u64);
        fetch(&ours, transfer, known.as_deref()).map_err(|fault| fault.about(&ours.name()))
    })?;
    let fetched = loop {
        match task.wait(REPORT_INTERVAL) {
            Some(fetched) => break fetched,
            None if on_progress(&exchange.progress()).is_break() => return Ok(None),
            None => {}
        }
    };
    match (fetched, cached) {
        (Ok(Some((file, is_not_stored))), _) => {
            if let Some(cache) = cache
                && is_valid(&file.bytes)
            {
                match is_not_stored {
                    true => cache.remove(&key),
                    false => cache.store(&key, &file, &exchange.name()),
                }
            }
            Ok(Some(Document { bytes: file.bytes, url: file.base, note: None }))
        }
        (Ok(None), Some(file)) => Ok(Some(Document { bytes: file.bytes, url: exchange.base(), note: None })),
        (Err(fault), Some(file)) if !exchange.was_refused() => {
            let note = Some(cached_version_note(&fault));
            Ok(Some(Document { bytes: file.bytes, url: file.base, note }))
        }
        (Err(fault), _) => Err(fault),
        (Ok(None), None) => unreachable!("no version was known"),
    }
}

/// Fetches a file whole, and whether its server forbids to store it; `None` if the version `known` is current.
fn fetch(
    exchange: &Exchange,
    mut transfer: Transfer,
    known: Option<&str>,
) -> Result<Option<(CachedFile, bool)>, Fault> {
    exchange.begin(0, None);
    loop {
        match receive(exchange, &mut transfer, known) {
            Ok(Some(bytes)) if is_web_page(&bytes) => return Err(Fault::Data(WEB_PAGE.into())),
            Ok(bytes) => {
                let etag = transfer.etag().unwrap_or_default().into();
                let file = bytes.map(|bytes| CachedFile { etag, base: exchange.base(), bytes });
                return Ok(file.map(|file| (file, transfer.is_not_stored())));
            }
            Err(trouble) => exchange.wait(trouble)?,
        }
        transfer.start_over();
    }
}

/// Fetches a file by one request.
fn receive(
    exchange: &Exchange,
    transfer: &mut Transfer,
    known: Option<&str>,
) -> Result<Option<Vec<u8>>, Trouble> {
    let mut stream = match exchange.open(transfer, None, known)? {
        Answer::Rest(stream) | Answer::Whole(stream) => stream,
        Answer::Unchanged => return Ok(None),
    };
    let mut bytes = Vec::new();
    // Its limit ends one that is longer.
    exchange.receive(transfer, &mut stream, usize::MAX, &mut bytes)?;
    if transfer.total().is_some_and(|total| (bytes.len() as u64) < total) {
        return Err(exchange.on_end(transfer));
    }
    Ok(Some(bytes))
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::{Ipv4Addr, TcpListener};

    use super::*;
    use crate::content::transfer::Cache;

    /// Answers one request with `body` and these further headers.
    fn serve(
        listener: &TcpListener,
        headers: &'static str,
        body: &'static str,
    ) -> std::thread::JoinHandle<()> {
        let listener = listener.try_clone().unwrap();
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
            while !lines.next().unwrap().unwrap().is_empty() {}
            let length = body.len();
            let headers = format!("Content-Length: {length}\r\nConnection: close\r\n{headers}");
            write!(stream, "HTTP/1.1 200 OK\r\n{headers}\r\n{body}").unwrap();
        })
    }

    #[test]
    fn the_cache_holds_the_last_file_that_is_valid_and_may_be_stored() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1 << 20);
        let options = Options { cache: Some(cache.clone()), ..Options::default() };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let url = format!("http://{}/list", listener.local_addr().unwrap());
        for (headers, body, expected, cached) in [
            ("", "{one}", "{one}", Some("{one}")),
            ("", "one", "one", Some("{one}")),
            ("", "\n <html>", "{one}", Some("{one}")),
            ("", "{two}", "{two}", Some("{two}")),
            ("Cache-Control: private, no-store\r\n", "{three}", "{three}", None),
        ] {
            let server = serve(&listener, headers, body);
            let is_valid = &|bytes: &[u8]| bytes.starts_with(b"{");
            let fetched = document(&url, &options, 100, is_valid, &mut |_| ControlFlow::Continue(()));
            server.join().unwrap();
            let fetched = fetched.unwrap().unwrap();
            assert_eq!(fetched.bytes, expected.as_bytes(), "{body}");
            assert_eq!(fetched.note.is_some(), expected != body, "{:?}", fetched.note);
            assert_eq!(fetched.url, url);
            assert_eq!(cache.get(&url).map(|file| file.bytes).as_deref(), cached.map(str::as_bytes));
        }
    }
}
