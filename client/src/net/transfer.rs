//! [`Transfer`]: what to ask a server for next, and what its answers mean.
//!
//! A state machine without sockets, after RFC 9110: it asks for the whole, after a break for the
//! rest on condition that the file is still the same (`Range`, `If-Range`), and starts over where
//! that cannot be had. Breaks are followed by waits that double as long as nothing arrives. It
//! counts bytes; who drives it keeps them.

use std::time::Duration;

use super::head::Head;

/// Most requests for one clip, so that a server that sends byte after byte ends some day.
const REQUESTS_MAX: u32 = 100;

/// Longest wait between two requests, also where a server asks for one.
const WAIT_MAX: Duration = Duration::from_secs(8);
const WAIT_ASKED_MAX: Duration = Duration::from_secs(30);

/// How long to wait for a server, and how often to try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// Longest time for a connection to stand, and for an answer to begin.
    pub answer: Duration,
    /// Longest time without a byte.
    pub silence: Duration,
    /// Breaks in a row without a byte in between after which to give up, less one.
    pub retries: u32,
    /// The same before the first byte of all.
    pub first_retries: u32,
    /// The wait after the first break; the next ones are twice as long each.
    pub first_wait: Duration,
}

impl Default for Patience {
    /// Up to ten seconds for an answer or a byte, and five retries over eight seconds.
    fn default() -> Patience {
        Patience {
            answer: Duration::from_secs(10),
            silence: Duration::from_secs(10),
            retries: 5,
            first_retries: 5,
            first_wait: Duration::from_millis(250),
        }
    }
}

impl Patience {
    /// That of someone who has the clip already and only asks whether there is a newer one.
    pub(super) fn in_passing(self) -> Patience {
        let answer = self.answer.min(Duration::from_secs(3));
        Patience { answer, first_retries: 0, ..self }
    }
}

/// A request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Ask {
    /// The first byte wanted; 0 asks for the whole.
    pub(super) first: u64,
    /// The version that a part is wanted of; of another one, the whole.
    pub(super) if_range: Option<String>,
    /// The version that is here already.
    pub(super) if_none_match: Option<String>,
}

/// What to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Read the bytes that follow, without the first `skip` of them, which are here already.
    Read { skip: u64 },
    /// Forget the bytes that are here, then read.
    StartOver,
    /// The version that is here is the present one.
    Unchanged,
    /// Wait this long, then ask again, because of this.
    Again(Duration, String),
    /// Nothing came of it, and trying again might help: the sentence says why.
    GiveUp(String),
    /// The server's answer is final, and this is what it says.
    Refused(String),
    /// There is more of it than is taken.
    TooLarge(String),
}

/// A transfer.
#[derive(Debug)]
pub(super) struct Transfer {
    patience: Patience,
    /// Most bytes that are taken.
    limit: u64,
    received: u64,
    total: Option<u64>,
    /// The version that the bytes are of.
    etag: Option<String>,
    /// The version that was here before.
    known: Option<String>,
    /// Whether the server sends parts.
    ranges: bool,
    requests: u32,
    /// Breaks in a row without a byte in between that was not here before.
    breaks: u32,
    /// Most bytes that were ever here.
    furthest: u64,
}

impl Transfer {
    /// Of at most `limit` bytes. `known` is the version that is here already.
    pub(super) fn new(patience: Patience, limit: u64, known: Option<String>) -> Transfer {
        Transfer {
            patience,
            limit,
            received: 0,
            total: None,
            etag: None,
            known,
            ranges: true,
            requests: 0,
            breaks: 0,
            furthest: 0,
        }
    }

    /// What to ask for now.
    pub(super) fn ask(&mut self) -> Ask {
        self.requests += 1;
        let if_none_match = self.known.clone().filter(|_| self.received == 0);
        match self.strong_etag().filter(|_| self.ranges && self.received > 0) {
            Some(etag) => Ask { first: self.received, if_range: Some(etag), if_none_match },
            None => Ask { if_none_match, ..Ask::default() },
        }
    }

    /// The version, if equal ones are equal byte for byte: only then parts fit together.
    fn strong_etag(&self) -> Option<String> {
        self.etag.clone().filter(|etag| !etag.starts_with("W/"))
    }

    /// Bytes in all, as the server says.
    pub(super) fn total(&self) -> Option<u64> {
        self.total
    }

    /// The version of the bytes.
    pub(super) fn etag(&self) -> Option<&str> {
        self.etag.as_deref()
    }

    /// Takes in how the server answers `ask`.
    pub(super) fn answer(&mut self, ask: &Ask, head: &Head) -> Step {
        if matches!(head.status, 200 | 206)
            && let Some(encoding) = &head.encoding
        {
            return Step::Refused(format!(
                "the server sends it packed ({encoding}), which was not asked for"
            ));
        }
        match head.status {
            200 => self.whole(head),
            206 if ask.first > 0 => self.part(ask, head),
            304 if ask.if_none_match.is_some() => Step::Unchanged,
            416 if ask.first > 0 => {
                self.ranges = false;
                self.lost("the file changed on the server")
            }
            408 | 425 | 429 | 500 | 502..=504 => self.busy(head),
            401 | 403 | 407 => {
                Step::Refused(format!("the server does not give it out ({})", named(head.status)))
            }
            404 | 410 => Step::Refused(format!("there is no such file ({})", named(head.status))),
            status => Step::Refused(format!("the server answers {}", named(status))),
        }
    }

    /// The whole file comes.
    fn whole(&mut self, head: &Head) -> Step {
        let same = self.strong_etag().is_some_and(|etag| head.etag.as_ref() == Some(&etag));
        let skip =
            if same && (head.length.is_none() || head.length == self.total) { self.received } else { 0 };
        let starts_over = skip < self.received;
        self.total = head.length;
        self.etag.clone_from(&head.etag);
        self.received = skip;
        match self.within_limit(self.total.unwrap_or(0)) {
            Err(step) => step,
            Ok(()) if starts_over => Step::StartOver,
            Ok(()) => Step::Read { skip },
        }
    }

    /// A part of it comes.
    fn part(&mut self, ask: &Ask, head: &Head) -> Step {
        let (first, total) = head.range.unwrap_or((u64::MAX, None));
        let same_total = total.is_none() || self.total.is_none() || total == self.total;
        let same_etag = head.etag.is_none() || head.etag == self.etag;
        if first != ask.first || !same_total || !same_etag {
            self.ranges = false;
            return self.lost("the server sent another part than asked for");
        }
        self.total = total.or(self.total);
        match self.within_limit(self.total.unwrap_or(0)) {
            Err(step) => step,
            Ok(()) => Step::Read { skip: 0 },
        }
    }

    fn busy(&mut self, head: &Head) -> Step {
        let why = format!("the server answers {}", named(head.status));
        let asked = Duration::from_secs(head.retry_after_s.unwrap_or(0));
        if asked > WAIT_ASKED_MAX {
            return Step::GiveUp(format!("{why} and asks to wait for {} s", asked.as_secs()));
        }
        match self.lost(&why) {
            Step::Again(wait, why) => Step::Again(wait.max(asked), why),
            step => step,
        }
    }

    fn within_limit(&self, bytes: u64) -> Result<(), Step> {
        if bytes <= self.limit {
            return Ok(());
        }
        let most = self.limit >> 20;
        Err(Step::TooLarge(format!("larger than {most} MiB, the most that is read")))
    }

    /// Takes in that so many bytes came that were not here yet.
    ///
    /// # Errors
    /// [`Step::TooLarge`].
    pub(super) fn took(&mut self, bytes: u64) -> Result<(), Step> {
        self.received += bytes;
        if self.received > self.furthest {
            (self.furthest, self.breaks) = (self.received, 0);
        }
        self.within_limit(self.received)
    }

    /// Takes in that the server says that this was all, though the package goes on: up to `needed`
    /// bytes.
    pub(super) fn ended(&mut self, needed: Option<u64>) -> Step {
        match self.total {
            Some(total) if self.received >= total => {
                let needed = needed.map_or("more".into(), |needed| needed.to_string());
                Step::Refused(format!("the file on the server is cut short, {total} bytes of {needed}"))
            }
            _ => self.lost("the connection was lost"),
        }
    }

    /// Takes in that the connection broke, because of `why`.
    pub(super) fn lost(&mut self, why: &str) -> Step {
        let Patience { retries, first_retries, .. } = self.patience;
        let retries = if self.furthest > 0 { retries } else { first_retries };
        if self.breaks >= retries || self.requests >= REQUESTS_MAX {
            return Step::GiveUp(why.into());
        }
        let wait = self.patience.first_wait.saturating_mul(1 << self.breaks.min(16)).min(WAIT_MAX);
        self.breaks += 1;
        Step::Again(wait, format!("{why}, trying again ({} of {retries})", self.breaks))
    }
}

/// A status with its name.
fn named(status: u16) -> String {
    let name = match status {
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        407 => "Proxy Authentication Required",
        408 => "Request Timeout",
        410 => "Gone",
        416 => "Range Not Satisfiable",
        425 => "Too Early",
        429 => "Too Many Requests",
        500 => "Internal Server Error",
        502 => "Bad Gateway",
        503 => "Service Unavailable",
        504 => "Gateway Timeout",
        _ => return status.to_string(),
    };
    format!("{status} {name}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: u64 = 1 << 20;

    fn transfer() -> Transfer {
        Transfer::new(Patience { retries: 2, first_retries: 2, ..Patience::default() }, LIMIT, None)
    }

    fn whole(length: u64, etag: &str) -> Head {
        let etag = (!etag.is_empty()).then(|| etag.into());
        Head { status: 200, length: Some(length), etag, ..Head::default() }
    }

    fn part(first: u64, total: u64, etag: &str) -> Head {
        Head { status: 206, range: Some((first, Some(total))), ..whole(total - first, etag) }
    }

    /// A transfer of 100 bytes with that tag that broke after 40.
    fn broken(etag: &str) -> Transfer {
        let mut transfer = transfer();
        let ask = transfer.ask();
        assert_eq!(ask, Ask::default());
        assert_eq!(transfer.answer(&ask, &whole(100, etag)), Step::Read { skip: 0 });
        transfer.took(40).unwrap();
        assert!(matches!(transfer.lost("broke"), Step::Again(..)));
        transfer
    }

    #[test]
    fn after_a_break_it_asks_for_the_rest_of_the_same_version() {
        let mut transfer = broken("\"a\"");
        let ask = transfer.ask();
        assert_eq!(ask, Ask { first: 40, if_range: Some("\"a\"".into()), if_none_match: None });
        assert_eq!(transfer.answer(&ask, &part(40, 100, "\"a\"")), Step::Read { skip: 0 });
        transfer.took(60).unwrap();
        assert_eq!((transfer.received, transfer.total()), (100, Some(100)));
    }

    #[test]
    fn a_server_without_parts_sends_all_again_and_what_is_here_is_skipped() {
        let mut transfer = broken("\"a\"");
        let ask = transfer.ask();
        assert_eq!(transfer.answer(&ask, &whole(100, "\"a\"")), Step::Read { skip: 40 });
    }

    #[test]
    fn another_version_starts_over() {
        for head in [whole(100, "\"b\""), whole(100, ""), whole(99, "\"a\"")] {
            let mut transfer = broken("\"a\"");
            let ask = transfer.ask();
            assert_eq!(transfer.answer(&ask, &head), Step::StartOver, "{head:?}");
            assert_eq!((transfer.received, transfer.total()), (0, head.length));
        }
    }

    #[test]
    fn without_a_strong_tag_parts_are_not_put_together() {
        for etag in ["", "W/\"a\""] {
            let mut transfer = broken(etag);
            let ask = transfer.ask();
            assert_eq!(ask, Ask::default(), "{etag}");
            assert_eq!(transfer.answer(&ask, &whole(100, etag)), Step::StartOver, "{etag}");
        }
    }

    #[test]
    fn a_wrong_part_is_refused_and_the_whole_asked_for() {
        let wrong = [
            part(41, 100, "\"a\""),
            part(40, 101, "\"a\""),
            part(40, 100, "\"b\""),
            Head { range: None, ..part(40, 100, "\"a\"") },
            Head { status: 416, ..Head::default() },
        ];
        for head in wrong {
            let mut transfer = broken("\"a\"");
            let ask = transfer.ask();
            assert!(matches!(transfer.answer(&ask, &head), Step::Again(..)), "{head:?}");
            assert_eq!(transfer.ask(), Ask::default(), "{head:?}");
        }
        let mut transfer = transfer();
        let ask = transfer.ask();
        for head in [part(0, 100, ""), Head { status: 416, ..Head::default() }] {
            assert!(matches!(transfer.answer(&ask, &head), Step::Refused(_)), "nobody asked for a part");
        }
    }

    #[test]
    fn waits_double_and_end_and_bytes_begin_them_anew() {
        let mut transfer = transfer();
        let ask = transfer.ask();
        transfer.answer(&ask, &whole(100, "\"a\""));
        let wait = |step| if let Step::Again(wait, _) = step { wait.as_millis() } else { 0 };
        assert_eq!([0; 3].map(|_| wait(transfer.lost("x"))), [250, 500, 0]);
        assert_eq!(transfer.lost("gone"), Step::GiveUp("gone".into()));
        transfer.took(1).unwrap();
        assert_eq!(wait(transfer.lost("x")), 250);
        transfer.requests = REQUESTS_MAX;
        assert_eq!(transfer.lost("x"), Step::GiveUp("x".into()));
    }

    #[test]
    fn statuses_are_final_or_worth_another_try() {
        let answer = |status, retry_after_s| {
            let mut transfer = transfer();
            let ask = transfer.ask();
            transfer.answer(&ask, &Head { status, retry_after_s, ..Head::default() })
        };
        for status in [400, 401, 403, 404, 410, 418, 206, 304, 416, 501] {
            let Step::Refused(why) = answer(status, None) else { panic!("{status} is final") };
            assert!(why.contains(&status.to_string()), "{why}");
        }
        for status in [408, 425, 429, 500, 502, 503, 504] {
            assert!(matches!(answer(status, None), Step::Again(..)), "{status}");
        }
        let Step::Again(wait, _) = answer(503, Some(20)) else { panic!("20 s are waited for") };
        assert_eq!(wait.as_secs(), 20);
        let Step::GiveUp(why) = answer(503, Some(31)) else { panic!("31 s are not waited for") };
        assert!(why.contains("31 s"), "{why}");
    }

    #[test]
    fn lengths_beyond_the_limit_are_refused_before_and_during() {
        let mut transfer = transfer();
        let ask = transfer.ask();
        let Step::TooLarge(why) = transfer.answer(&ask, &whole(LIMIT + 1, "")) else { panic!("too large") };
        assert!(why.contains("1 MiB"), "{why}");
        let unknown = Head { length: None, ..whole(0, "") };
        assert_eq!(transfer.answer(&ask, &unknown), Step::Read { skip: 0 });
        transfer.took(LIMIT).unwrap();
        assert!(matches!(transfer.took(1), Err(Step::TooLarge(_))));
    }

    #[test]
    fn an_end_is_final_where_the_server_announced_it() {
        let mut transfer = broken("\"a\"");
        assert!(matches!(transfer.ended(Some(100)), Step::Again(..)), "40 of 100 announced");
        transfer.took(60).unwrap();
        let Step::Refused(why) = transfer.ended(Some(120)) else { panic!("100 of 100 announced") };
        assert!(why.contains("100 bytes of 120"), "{why}");
    }

    #[test]
    fn a_known_version_is_asked_about_once_and_packed_bytes_are_refused() {
        let mut transfer = Transfer::new(Patience::default(), LIMIT, Some("\"k\"".into()));
        let ask = transfer.ask();
        assert_eq!(ask.if_none_match.as_deref(), Some("\"k\""));
        assert_eq!(transfer.answer(&ask, &Head { status: 304, ..Head::default() }), Step::Unchanged);
        let packed = Head { encoding: Some("gzip".into()), ..whole(9, "") };
        assert!(matches!(transfer.answer(&ask, &packed), Step::Refused(why) if why.contains("gzip")));
    }
}
