//! [`Transfer`]: which request to send next, and what to do about the response.
//!
//! A state machine without sockets, after RFC 9110. It requests the whole file; after a broken connection
//! the rest of it, if the version is unchanged (`Range`, `If-Range`); and starts over where the rest is not
//! available. Waits before retries double until bytes arrive. It counts bytes and stores none.

use std::time::Duration;

use super::head::Head;
use super::retry::{PROGRESS_BYTES, RetryPolicy};

/// Limit on requests for one file: it ends transfers from servers that send a byte per connection.
const REQUESTS_MAX: u32 = 100;

/// Longest wait between two requests.
const WAIT_MAX: Duration = Duration::from_secs(8);

/// Longest wait that a server may ask for.
const RETRY_AFTER_MAX: Duration = Duration::from_secs(30);

/// A request for a file or the rest of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct FileRequest {
    /// Offset of the first byte to send; 0 requests the whole file.
    pub(super) offset: u64,
    /// Where to stop, before the end of the file.
    pub(super) end: Option<u64>,
    /// The version whose rest is wanted; the server sends another version whole.
    pub(super) if_range: Option<String>,
    /// The version in the cache.
    pub(super) if_none_match: Option<String>,
}

impl FileRequest {
    /// The same for the bytes up to `end` only.
    pub(super) fn up_to(self, end: u64) -> FileRequest {
        FileRequest { end: Some(end), ..self }
    }

    /// The value of the header `Range`, unless the whole file is requested.
    pub(super) fn range(&self) -> Option<String> {
        let offset = self.offset;
        match self.end {
            Some(end) => Some(format!("bytes={offset}-{}", end.saturating_sub(1))),
            None => (offset > 0).then(|| format!("bytes={offset}-")),
        }
    }
}

/// What to do next. Sentences are for the viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// Read the body; its first `skip` bytes were received before.
    Read { skip: u64 },
    /// Discard the bytes received before, then read the body.
    StartOver,
    /// Use the cached version, which is current.
    Unchanged,
    /// Wait, then send the next request; the sentence is the reason.
    Retry(Duration, String),
    /// Fail; a later attempt may succeed.
    GiveUp(String),
    /// Fail; the server's response is final.
    Refused(String),
    /// Fail; the file exceeds the limit.
    TooLarge(String),
}

/// The state of a transfer.
#[derive(Debug)]
pub(super) struct Transfer {
    retry: RetryPolicy,
    /// Limit on the file in bytes.
    limit: u64,
    /// Bytes of this version received.
    received: u64,
    /// Bytes of the whole file, if the server says.
    total: Option<u64>,
    /// The version of the received bytes.
    etag: Option<String>,
    /// The version in the cache.
    cached: Option<String>,
    /// Whether the server can send the rest of a file.
    ranges: bool,
    /// Whether checksums tell bytes of another version, so that ranges need no strong ETag.
    is_checked: bool,
    requests: u32,
    /// Broken connections since the last progress.
    breaks: u32,
    /// The most bytes received of any version, and those at the last progress.
    furthest: u64,
    progress: u64,
}

impl Transfer {
    /// A transfer of at most `limit` bytes. `cached` is the version in the cache.
    pub(super) fn new(retry: RetryPolicy, limit: u64, cached: Option<String>) -> Transfer {
        Transfer {
            retry,
            limit,
            received: 0,
            total: None,
            etag: None,
            cached,
            ranges: true,
            is_checked: false,
            requests: 0,
            breaks: 0,
            furthest: 0,
            progress: 0,
        }
    }

    /// A transfer of a part that begins at `offset`, of the version `etag` of a file of `total` bytes, as far as these
    /// are known. Checksums in the part tell if it is of another version.
    pub(super) fn part(
        retry: RetryPolicy,
        offset: u64,
        etag: Option<String>,
        total: Option<u64>,
    ) -> Transfer {
        let whole = Transfer::new(retry, u64::MAX, None);
        Transfer {
            received: offset,
            furthest: offset,
            progress: offset,
            etag,
            total,
            is_checked: true,
            ..whole
        }
    }

    /// The next request.
    pub(super) fn next_request(&mut self) -> FileRequest {
        self.requests += 1;
        let if_none_match = self.cached.clone().filter(|_| self.received == 0);
        match self.strong_etag().filter(|_| self.ranges && self.received > 0) {
            Some(etag) => {
                FileRequest { offset: self.received, end: None, if_range: Some(etag), if_none_match }
            }
            None if self.is_checked && self.ranges => {
                FileRequest { offset: self.received, ..FileRequest::default() }
            }
            None => FileRequest { if_none_match, ..FileRequest::default() },
        }
    }

    /// The version, if it is a strong validator: only then equal versions have equal bytes.
    fn strong_etag(&self) -> Option<String> {
        self.etag.clone().filter(|etag| !etag.starts_with("W/"))
    }

    /// Bytes of the whole file, if the server says.
    pub(super) fn total(&self) -> Option<u64> {
        self.total
    }

    /// The version of the received bytes.
    pub(super) fn etag(&self) -> Option<&str> {
        self.etag.as_deref()
    }

    /// Evaluates the response to `request`.
    pub(super) fn on_response(&mut self, request: &FileRequest, head: &Head) -> Action {
        if matches!(head.status, 200 | 206)
            && let Some(encoding) = &head.encoding
        {
            return Action::Refused(format!(
                "the server sends it compressed ({encoding}), which was not requested: switch that off there"
            ));
        }
        match head.status {
            200 => self.on_whole_file(head),
            206 if request.range().is_some() => self.on_range(request, head),
            304 if request.if_none_match.is_some() => Action::Unchanged,
            416 if request.range().is_some() => {
                self.ranges = false;
                self.on_break("the file changed on the server")
            }
            408 | 425 | 429 | 500 | 502..=504 => self.on_busy_server(head),
            511 => Action::GiveUp(format!(
                "the network asks for a log-in ({}): log in with a browser",
                head.status_text()
            )),
            401 | 403 | 407 => Action::Refused(format!(
                "the server denies access ({}): ask for a URL with access",
                head.status_text()
            )),
            404 | 410 => {
                Action::Refused(format!("there is no such file ({}): check the URL", head.status_text()))
            }
            _ => Action::Refused(format!("the server answers {}: check the URL", head.status_text())),
        }
    }

    fn on_whole_file(&mut self, head: &Head) -> Action {
        let same = self.strong_etag().is_some_and(|etag| head.etag.as_ref() == Some(&etag));
        let skip =
            if same && (head.length.is_none() || head.length == self.total) { self.received } else { 0 };
        let starts_over = skip < self.received;
        self.total = head.length;
        self.etag.clone_from(&head.etag);
        self.received = skip;
        match self.check_limit(self.total.unwrap_or(0)) {
            Err(action) => action,
            Ok(()) if starts_over => Action::StartOver,
            Ok(()) => Action::Read { skip },
        }
    }

    fn on_range(&mut self, request: &FileRequest, head: &Head) -> Action {
        let (offset, total) = head.range.unwrap_or((u64::MAX, None));
        let same_total = total.is_none() || self.total.is_none() || total == self.total;
        let is_first = self.is_checked && self.etag.is_none() && self.total.is_none();
        let same_etag = head.etag.is_none() || head.etag == self.etag || is_first;
        if offset != request.offset || !same_total || !same_etag {
            self.ranges = false;
            return self.on_break("the server sent another part than requested");
        }
        self.total = total.or(self.total);
        if is_first {
            self.etag.clone_from(&head.etag);
        }
        match self.check_limit(self.total.unwrap_or(0)) {
            Err(action) => action,
            Ok(()) => Action::Read { skip: 0 },
        }
    }

    fn on_busy_server(&mut self, head: &Head) -> Action {
        let why = format!("the server answers {}", head.status_text());
        let retry_after = Duration::from_secs(head.retry_after_s.unwrap_or(0));
        if retry_after > RETRY_AFTER_MAX {
            return Action::GiveUp(format!(
                "{why} and asks to wait for {} s: try again after that",
                retry_after.as_secs()
            ));
        }
        match self.on_break(&why) {
            Action::Retry(wait, why) => Action::Retry(wait.max(retry_after), why),
            action => action,
        }
    }

    fn check_limit(&self, bytes: u64) -> Result<(), Action> {
        if bytes <= self.limit {
            return Ok(());
        }
        let most = self.limit >> 20;
        Err(Action::TooLarge(format!("larger than {most} MiB, the most that is read: make it smaller")))
    }

    /// Counts new bytes.
    ///
    /// # Errors
    /// [`Action::TooLarge`].
    pub(super) fn count(&mut self, bytes: u64) -> Result<(), Action> {
        self.received += bytes;
        self.furthest = self.furthest.max(self.received);
        if self.furthest - self.progress >= PROGRESS_BYTES {
            (self.progress, self.breaks) = (self.furthest, 0);
        }
        self.check_limit(self.received)
    }

    /// Evaluates the end of a body before the package is complete. `package_bytes` is the length of the
    /// package, if known.
    pub(super) fn on_end(&mut self, package_bytes: Option<u64>) -> Action {
        match self.total {
            Some(total) if self.received >= total => {
                let package_bytes = package_bytes.map_or("more".into(), |bytes| bytes.to_string());
                Action::Refused(format!(
                    "the file on the server is cut short, {total} bytes of {package_bytes}: upload it again"
                ))
            }
            _ => self.on_break("the connection was lost"),
        }
    }

    /// Evaluates a broken connection; `why` is the cause as a sentence.
    pub(super) fn on_break(&mut self, why: &str) -> Action {
        let RetryPolicy { retries, first_retries, .. } = self.retry;
        let retries = if self.furthest > 0 { retries } else { first_retries };
        if self.breaks >= retries || self.requests >= REQUESTS_MAX {
            return Action::GiveUp(format!("{why}: check the network, or try again later"));
        }
        let wait = self.retry.first_wait.saturating_mul(1 << self.breaks.min(16)).min(WAIT_MAX);
        self.breaks += 1;
        Action::Retry(wait, format!("{why}, trying again ({} of {retries})", self.breaks))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: u64 = 1 << 20;

    fn transfer() -> Transfer {
        Transfer::new(RetryPolicy { retries: 2, first_retries: 2, ..RetryPolicy::default() }, LIMIT, None)
    }

    fn whole(length: u64, etag: &str) -> Head {
        let etag = (!etag.is_empty()).then(|| etag.into());
        Head { status: 200, length: Some(length), etag, ..Head::default() }
    }

    fn range(first: u64, total: u64, etag: &str) -> Head {
        Head { status: 206, range: Some((first, Some(total))), ..whole(total - first, etag) }
    }

    /// A transfer of 100 bytes of the version `etag`, broken after 40.
    fn broken(etag: &str) -> Transfer {
        let mut transfer = transfer();
        let request = transfer.next_request();
        assert_eq!(request, FileRequest::default());
        assert_eq!(transfer.on_response(&request, &whole(100, etag)), Action::Read { skip: 0 });
        transfer.count(40).unwrap();
        assert!(matches!(transfer.on_break("broke"), Action::Retry(..)));
        transfer
    }

    #[test]
    fn after_a_break_the_rest_of_the_same_version_is_requested() {
        let mut transfer = broken("\"a\"");
        let request = transfer.next_request();
        assert_eq!(
            request,
            FileRequest { offset: 40, if_range: Some("\"a\"".into()), ..FileRequest::default() }
        );
        assert_eq!(transfer.on_response(&request, &range(40, 100, "\"a\"")), Action::Read { skip: 0 });
        transfer.count(60).unwrap();
        assert_eq!((transfer.received, transfer.total()), (100, Some(100)));
    }

    #[test]
    fn parts_are_of_the_version_of_the_first_one() {
        let part = |offset, etag: Option<&str>, total| {
            Transfer::part(RetryPolicy::default(), offset, etag.map(String::from), total)
        };
        let mut first = part(0, None, None);
        let request = first.next_request().up_to(50);
        assert_eq!((request.range().as_deref(), &request.if_range), (Some("bytes=0-49"), &None));
        assert_eq!(first.on_response(&request, &range(0, 100, "\"a\"")), Action::Read { skip: 0 });
        assert_eq!((first.etag(), first.total()), (Some("\"a\""), Some(100)));

        let etag = Some("\"a\"");
        let answered = |head: Head| {
            let mut transfer = part(40, etag, Some(100));
            let request = transfer.next_request().up_to(60);
            assert_eq!(
                (request.range().as_deref(), request.if_range.as_deref()),
                (Some("bytes=40-59"), etag)
            );
            transfer.on_response(&request, &head)
        };
        assert_eq!(answered(range(40, 100, "\"a\"")), Action::Read { skip: 0 });
        assert_eq!(answered(whole(100, "\"a\"")), Action::Read { skip: 40 }, "a server without ranges");
        assert_eq!(answered(whole(100, "\"b\"")), Action::StartOver, "the file changed");
        assert!(matches!(answered(range(40, 100, "\"b\"")), Action::Retry(..)), "against the rules");
        // Checksums tell versions where the server does not.
        let request = part(40, None, Some(100)).next_request().up_to(60);
        assert_eq!((request.range().as_deref(), request.if_range), (Some("bytes=40-59"), None));
    }

    #[test]
    fn a_server_without_ranges_sends_all_again_and_received_bytes_are_skipped() {
        let mut transfer = broken("\"a\"");
        let request = transfer.next_request();
        assert_eq!(transfer.on_response(&request, &whole(100, "\"a\"")), Action::Read { skip: 40 });
    }

    #[test]
    fn another_version_starts_over() {
        for head in [whole(100, "\"b\""), whole(100, ""), whole(99, "\"a\"")] {
            let mut transfer = broken("\"a\"");
            let request = transfer.next_request();
            assert_eq!(transfer.on_response(&request, &head), Action::StartOver, "{head:?}");
            assert_eq!((transfer.received, transfer.total()), (0, head.length));
        }
    }

    #[test]
    fn without_a_strong_etag_ranges_are_not_joined() {
        for etag in ["", "W/\"a\""] {
            let mut transfer = broken(etag);
            let request = transfer.next_request();
            assert_eq!(request, FileRequest::default(), "{etag}");
            assert_eq!(transfer.on_response(&request, &whole(100, etag)), Action::StartOver, "{etag}");
        }
    }

    #[test]
    fn after_a_wrong_range_the_whole_file_is_requested() {
        let wrong = [
            range(41, 100, "\"a\""),
            range(40, 101, "\"a\""),
            range(40, 100, "\"b\""),
            Head { range: None, ..range(40, 100, "\"a\"") },
            Head { status: 416, ..Head::default() },
        ];
        for head in wrong {
            let mut transfer = broken("\"a\"");
            let request = transfer.next_request();
            assert!(matches!(transfer.on_response(&request, &head), Action::Retry(..)), "{head:?}");
            assert_eq!(transfer.next_request(), FileRequest::default(), "{head:?}");
        }
        let mut transfer = transfer();
        let request = transfer.next_request();
        for head in [range(0, 100, ""), Head { status: 416, ..Head::default() }] {
            assert!(
                matches!(transfer.on_response(&request, &head), Action::Refused(_)),
                "no range was requested"
            );
        }
    }

    #[test]
    fn waits_double_up_to_the_last_retry_and_progress_resets_them() {
        let mut transfer = transfer();
        let request = transfer.next_request();
        transfer.on_response(&request, &whole(10_000, "\"a\""));
        let wait = |action| if let Action::Retry(wait, _) = action { wait.as_millis() } else { 0 };
        assert_eq!([0; 3].map(|_| wait(transfer.on_break("x"))), [250, 500, 0]);
        let is_over = |action| matches!(action, Action::GiveUp(why) if why.starts_with("gone: "));
        assert!(is_over(transfer.on_break("gone")));
        transfer.count(PROGRESS_BYTES - 1).unwrap();
        assert!(is_over(transfer.on_break("gone")), "a trickle is no progress");
        transfer.count(1).unwrap();
        assert_eq!(wait(transfer.on_break("x")), 250);
    }

    #[test]
    fn a_server_that_sends_little_per_request_is_given_up() {
        let mut transfer = transfer();
        let mut is_retried = || {
            transfer.next_request();
            transfer.count(PROGRESS_BYTES).unwrap();
            matches!(transfer.on_break("x"), Action::Retry(..))
        };
        assert!((1..REQUESTS_MAX).all(|_| is_retried()));
        assert!(!is_retried());
    }

    #[test]
    fn statuses_are_final_or_retried() {
        let on_response = |status, retry_after_s| {
            let mut transfer = transfer();
            let request = transfer.next_request();
            transfer.on_response(&request, &Head { status, retry_after_s, ..Head::default() })
        };
        for status in [400, 401, 403, 404, 410, 418, 206, 304, 416, 501] {
            let Action::Refused(why) = on_response(status, None) else { panic!("{status} is final") };
            assert!(why.contains(&status.to_string()), "{why}");
        }
        for status in [408, 425, 429, 500, 502, 503, 504] {
            assert!(matches!(on_response(status, None), Action::Retry(..)), "{status}");
        }
        assert!(matches!(on_response(511, None), Action::GiveUp(why) if why.contains("log in")));
        let Action::Retry(wait, _) = on_response(503, Some(30)) else { panic!("a wait of 30 s is allowed") };
        assert_eq!(wait.as_secs(), 30);
        let Action::GiveUp(why) = on_response(503, Some(31)) else { panic!("a wait of 31 s is too long") };
        assert!(why.contains("31 s"), "{why}");
    }

    #[test]
    fn files_beyond_the_limit_are_refused_by_their_announced_and_actual_length() {
        let mut transfer = transfer();
        let request = transfer.next_request();
        let Action::TooLarge(why) = transfer.on_response(&request, &whole(LIMIT + 1, "")) else {
            panic!("too large")
        };
        assert!(why.contains("1 MiB"), "{why}");
        let unknown = Head { length: None, ..whole(0, "") };
        assert_eq!(transfer.on_response(&request, &unknown), Action::Read { skip: 0 });
        transfer.count(LIMIT).unwrap();
        assert!(matches!(transfer.count(1), Err(Action::TooLarge(_))));
    }

    #[test]
    fn an_announced_end_is_final() {
        let mut transfer = broken("\"a\"");
        assert!(matches!(transfer.on_end(Some(100)), Action::Retry(..)), "40 of 100 announced");
        transfer.count(60).unwrap();
        let Action::Refused(why) = transfer.on_end(Some(120)) else { panic!("100 of 100 announced") };
        assert!(why.contains("100 bytes of 120"), "{why}");
    }

    #[test]
    fn a_cached_version_is_revalidated_and_compressed_bodies_are_refused() {
        let mut transfer = Transfer::new(RetryPolicy::default(), LIMIT, Some("\"k\"".into()));
        let request = transfer.next_request();
        assert_eq!(request.if_none_match.as_deref(), Some("\"k\""));
        assert_eq!(
            transfer.on_response(&request, &Head { status: 304, ..Head::default() }),
            Action::Unchanged
        );
        let compressed = Head { encoding: Some("gzip".into()), ..whole(9, "") };
        assert!(
            matches!(transfer.on_response(&request, &compressed), Action::Refused(why) if why.contains("gzip"))
        );
    }
}
