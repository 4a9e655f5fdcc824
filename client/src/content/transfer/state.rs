//! [`Transfer`]: which request to send next, and what to do about the response.
//!
//! A state machine without sockets, after RFC 9110. It requests the whole file, or the rest of it from a byte on. After a
//! broken connection it requests what is missing; `If-Range` has a server with another version send that whole. Waits
//! before retries double until bytes arrive. It counts bytes and stores none.

use std::time::Duration;

use super::head::Head;
use super::retry::{PROGRESS_BYTES, RetryPolicy};

/// Limit on requests for one file: it ends transfers from servers that send a byte per connection.
const REQUESTS_MAX: u32 = 100;

/// Wrong answers to requests for a part after which the whole file is requested.
const WRONG_PARTS_MAX: u32 = 2;

/// Longest wait between two requests.
const WAIT_MAX: Duration = Duration::from_secs(8);

/// Longest wait that a server may ask for.
const RETRY_AFTER_MAX: Duration = Duration::from_secs(30);

/// What to say of a proxy that wants to know its user.
pub(super) const PROXY_LOG_IN: &str =
    "the proxy asks for a log-in (407 Proxy Authentication Required): write USER:PASSWORD@ before its host";

/// A request for a file or the rest of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct FileRequest {
    /// Offset of the first byte to send; 0 without an end requests the whole file.
    pub(super) offset: u64,
    /// Where to stop, before the end of the file.
    pub(super) end: Option<u64>,
    /// The version whose rest is wanted; the server sends another version whole.
    pub(super) if_range: Option<String>,
    /// The version in the cache.
    pub(super) if_none_match: Option<String>,
}

impl FileRequest {
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
    /// Read the body, which begins with the next byte.
    Read,
    /// Read the body, which is the file from its start: the server knows no ranges, or has another version.
    ReadWhole,
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
    /// Offset of the next byte.
    next: u64,
    /// Bytes of the whole file, if the server says.
    total: Option<u64>,
    /// The version of the received bytes.
    etag: Option<String>,
    /// Whether a version is known: by an answer, or from before.
    is_known: bool,
    /// Whether the server forbids to store what it sends.
    is_not_stored: bool,
    wrong_parts: u32,
    requests: u32,
    /// Broken connections since the last progress.
    breaks: u32,
    /// The furthest byte received, and the furthest at the last progress.
    furthest: u64,
    progress: u64,
}

impl Transfer {
    /// A transfer from the byte at `offset` on, of the version `etag` of a file of `total` bytes, as far as these are known.
    pub(super) fn new(retry: RetryPolicy, offset: u64, etag: Option<String>, total: Option<u64>) -> Transfer {
        Transfer {
            retry,
            limit: u64::MAX,
            next: offset,
            is_known: etag.is_some() || total.is_some(),
            total,
            etag,
            is_not_stored: false,
            wrong_parts: 0,
            requests: 0,
            breaks: 0,
            furthest: offset,
            progress: offset,
        }
    }

    /// The same of a file of at most `limit` bytes.
    pub(super) fn within(self, limit: u64) -> Transfer {
        Transfer { limit, ..self }
    }

    /// Begins again with the first byte.
    pub(super) fn start_over(&mut self) {
        self.next = 0;
    }

    /// The next request, for the bytes up to `end` only, if one is given.
    pub(super) fn next_request(&mut self, end: Option<u64>) -> FileRequest {
        self.requests += 1;
        if self.wrong_parts >= WRONG_PARTS_MAX {
            return FileRequest::default();
        }
        let if_range = self.strong_etag().filter(|_| self.next > 0);
        FileRequest { offset: self.next, end, if_range, if_none_match: None }
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

    /// Whether the server forbids to store what it sends.
    pub(super) fn is_not_stored(&self) -> bool {
        self.is_not_stored
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
        self.is_not_stored |= head.is_not_stored;
        match head.status {
            200 => self.on_whole_file(request, head),
            206 if request.range().is_some() => self.on_range(request, head),
            304 if request.if_none_match.is_some() => Action::Unchanged,
            416 if request.range().is_some() => self.on_wrong_part("the file changed on the server"),
            407 => Action::GiveUp(PROXY_LOG_IN.into()),
            511 => Action::GiveUp(format!(
                "the network asks for a log-in ({}): log in with a browser",
                head.status_text()
            )),
            // Each 5xx is about the server, also the numbers that gateways invented, and not about the file.
            408 | 425 | 429 | 500..=599 => self.on_busy_server(head),
            401 | 403 => Action::Refused(format!(
                "the server denies access ({}): ask for a URL with access",
                head.status_text()
            )),
            404 | 410 => {
                Action::Refused(format!("there is no such file ({}): check the URL", head.status_text()))
            }
            _ => Action::Refused(format!("the server answers {}: check the URL", head.status_text())),
        }
    }

    fn on_whole_file(&mut self, request: &FileRequest, head: &Head) -> Action {
        if let Err(action) = self.check_limit(head.length.unwrap_or(0)) {
            return action;
        }
        self.total = head.length;
        self.etag.clone_from(&head.etag);
        self.is_known = true;
        if self.next > 0 || request.range().is_some() { Action::ReadWhole } else { Action::Read }
    }

    fn on_range(&mut self, request: &FileRequest, head: &Head) -> Action {
        let (offset, total) = head.range.unwrap_or((u64::MAX, None));
        let same_total = total.is_none() || self.total.is_none() || total == self.total;
        let same_etag = head.etag.is_none() || head.etag == self.etag || !self.is_known;
        if offset != request.offset || !same_total || !same_etag {
            return self.on_wrong_part("the server sent another part than requested");
        }
        self.total = total.or(self.total);
        if !self.is_known {
            self.etag.clone_from(&head.etag);
            self.is_known = true;
        }
        match self.check_limit(self.total.unwrap_or(0)) {
            Err(action) => action,
            Ok(()) => Action::Read,
        }
    }

    /// Evaluates an answer to a request for a part that cannot be used.
    fn on_wrong_part(&mut self, why: &str) -> Action {
        self.wrong_parts += 1;
        self.on_break(why)
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
        self.next += bytes;
        self.furthest = self.furthest.max(self.next);
        if self.furthest - self.progress >= PROGRESS_BYTES {
            (self.progress, self.breaks) = (self.furthest, 0);
        }
        self.check_limit(self.next)
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
    const RETRY: RetryPolicy = RetryPolicy {
        response_timeout: Duration::from_secs(10),
        read_timeout: Duration::from_secs(10),
        grace: Duration::from_secs(30),
        least_bytes_per_s: 1000,
        retries: 2,
        first_retries: 2,
        first_wait: Duration::from_millis(250),
    };

    fn transfer() -> Transfer {
        Transfer::new(RETRY, 0, None, None).within(LIMIT)
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
        let request = transfer.next_request(None);
        assert_eq!(request, FileRequest::default());
        assert_eq!(transfer.on_response(&request, &whole(100, etag)), Action::Read);
        transfer.count(40).unwrap();
        assert!(matches!(transfer.on_break("broke"), Action::Retry(..)));
        transfer
    }

    #[test]
    fn after_a_break_the_rest_of_the_same_version_is_requested() {
        for (etag, condition) in [("\"a\"", Some("\"a\"")), ("W/\"a\"", None), ("", None)] {
            let mut transfer = broken(etag);
            let request = transfer.next_request(Some(60));
            assert_eq!(
                (request.range().as_deref(), request.if_range.as_deref()),
                (Some("bytes=40-59"), condition)
            );
            assert_eq!(transfer.on_response(&request, &range(40, 100, etag)), Action::Read, "{etag}");
            assert_eq!((transfer.etag(), transfer.total()), ((!etag.is_empty()).then_some(etag), Some(100)));
        }
    }

    #[test]
    fn a_part_is_of_the_version_that_is_known() {
        // The version of the file is not known, or known from a part that was read before.
        for known in [None, Some("\"a\"")] {
            let mut transfer = Transfer::new(RETRY, 40, known.map(String::from), None);
            let request = transfer.next_request(Some(60));
            assert_eq!(
                (request.range().as_deref(), request.if_range.as_deref()),
                (Some("bytes=40-59"), known)
            );
            let action = transfer.on_response(&request, &range(40, 100, "\"b\""));
            match known {
                None => assert_eq!((action, transfer.etag()), (Action::Read, Some("\"b\""))),
                Some(_) => assert!(matches!(action, Action::Retry(..)), "against the rules"),
            }
        }
    }

    #[test]
    fn a_server_without_ranges_or_with_another_version_sends_the_whole_file() {
        for head in [whole(100, "\"a\""), whole(100, "\"b\""), whole(99, "")] {
            let mut transfer = broken("\"a\"");
            let request = transfer.next_request(None);
            assert_eq!(transfer.on_response(&request, &head), Action::ReadWhole, "{head:?}");
            assert_eq!((transfer.etag(), transfer.total()), (head.etag.as_deref(), head.length));
            transfer.start_over();
            let request = transfer.next_request(None);
            assert_eq!(request, FileRequest::default());
            assert_eq!(transfer.on_response(&request, &head), Action::Read, "{head:?}");
        }
    }

    #[test]
    fn after_two_wrong_parts_the_whole_file_is_requested() {
        let wrong = [
            range(41, 100, "\"a\""),
            range(40, 101, "\"a\""),
            range(40, 100, "\"b\""),
            Head { range: None, ..range(40, 100, "\"a\"") },
            Head { status: 416, ..Head::default() },
        ];
        for head in wrong {
            let mut transfer =
                Transfer::new(RetryPolicy { retries: 9, ..RETRY }, 40, Some("\"a\"".into()), Some(100));
            for _ in 0..2 {
                let request = transfer.next_request(Some(100));
                assert_eq!(request.range().as_deref(), Some("bytes=40-99"), "{head:?}");
                assert!(matches!(transfer.on_response(&request, &head), Action::Retry(..)), "{head:?}");
            }
            let request = transfer.next_request(Some(100));
            assert_eq!(request, FileRequest::default(), "{head:?}");
            assert_eq!(
                transfer.on_response(&request, &whole(100, "\"a\"")),
                Action::ReadWhole,
                "from its start"
            );
        }
        let mut transfer = transfer();
        let request = transfer.next_request(None);
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
        let request = transfer.next_request(None);
        transfer.on_response(&request, &whole(10_000, "\"a\""));
        let wait = |action| if let Action::Retry(wait, _) = action { wait.as_millis() } else { 0 };
        assert_eq!([0; 3].map(|_| wait(transfer.on_break("x"))), [250, 500, 0]);
        let is_over = |action| matches!(action, Action::GiveUp(why) if why.starts_with("gone: "));
        assert!(is_over(transfer.on_break("gone")));
        transfer.count(PROGRESS_BYTES - 1).unwrap();
        assert!(is_over(transfer.on_break("gone")), "a trickle is no progress");
        transfer.start_over();
        transfer.count(PROGRESS_BYTES - 1).unwrap();
        assert!(is_over(transfer.on_break("gone")), "nor are the same bytes again");
        transfer.count(1).unwrap();
        assert_eq!(wait(transfer.on_break("x")), 250);
    }

    #[test]
    fn a_server_that_sends_little_per_request_is_given_up() {
        let mut transfer = transfer();
        let mut is_retried = || {
            transfer.next_request(None);
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
            let request = transfer.next_request(None);
            transfer.on_response(&request, &Head { status, retry_after_s, ..Head::default() })
        };
        for status in [400, 401, 403, 404, 410, 418, 206, 304, 416] {
            let Action::Refused(why) = on_response(status, None) else { panic!("{status} is final") };
            assert!(why.contains(&status.to_string()), "{why}");
        }
        for status in [408, 425, 429, 500, 501, 502, 503, 504, 520, 522, 599] {
            assert!(matches!(on_response(status, None), Action::Retry(..)), "{status}");
        }
        for (status, sentence) in [(511, "log in"), (407, "the proxy")] {
            assert!(matches!(on_response(status, None), Action::GiveUp(why) if why.contains(sentence)));
        }
        let Action::Retry(wait, _) = on_response(503, Some(30)) else { panic!("a wait of 30 s is allowed") };
        assert_eq!(wait.as_secs(), 30);
        let Action::GiveUp(why) = on_response(503, Some(31)) else { panic!("a wait of 31 s is too long") };
        assert!(why.contains("31 s"), "{why}");
    }

    #[test]
    fn files_beyond_the_limit_are_refused_by_their_announced_and_actual_length() {
        let mut transfer = transfer();
        let request = transfer.next_request(None);
        let Action::TooLarge(why) = transfer.on_response(&request, &whole(LIMIT + 1, "")) else {
            panic!("too large")
        };
        assert!(why.contains("1 MiB"), "{why}");
        let unknown = Head { length: None, ..whole(0, "") };
        assert_eq!(transfer.on_response(&request, &unknown), Action::Read);
        transfer.count(LIMIT).unwrap();
        assert!(matches!(transfer.count(1), Err(Action::TooLarge(_))));
    }

    #[test]
    fn a_cached_version_is_revalidated_and_compressed_bodies_are_refused() {
        let mut transfer = transfer();
        let request = FileRequest { if_none_match: Some("\"k\"".into()), ..transfer.next_request(None) };
        let unchanged = Head { status: 304, ..Head::default() };
        assert_eq!(transfer.on_response(&request, &unchanged), Action::Unchanged);
        let compressed = Head { encoding: Some("gzip".into()), ..whole(9, "") };
        assert!(
            matches!(transfer.on_response(&request, &compressed), Action::Refused(why) if why.contains("gzip"))
        );
    }
}
