//! [`Head`]: status and headers of a response, as far as a transfer uses them.

use std::time::SystemTime;

/// Status and headers of a response.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Head {
    pub(super) status: u16,
    /// `Content-Length`.
    pub(super) length: Option<u64>,
    /// `Content-Range`: offset of the first byte and, if given, the total number of bytes.
    pub(super) range: Option<(u64, Option<u64>)>,
    pub(super) etag: Option<String>,
    /// `Content-Encoding` other than identity.
    pub(super) encoding: Option<String>,
    /// `Retry-After` in seconds.
    pub(super) retry_after_s: Option<u64>,
    /// `Location` of a redirect.
    pub(super) location: Option<String>,
    /// Whether `Cache-Control` forbids to store the response.
    pub(super) is_not_stored: bool,
}

impl Head {
    /// Parses the headers; `headers` takes a name in lower case and returns the texts of all headers of that name. A
    /// malformed header counts as absent.
    pub(super) fn parse<'h>(status: u16, headers: impl Fn(&'static str) -> Vec<&'h str>) -> Head {
        let text = |name| headers(name).first().copied().map(str::trim);
        let forbids =
            |text: &&'h str| text.split(',').any(|part| part.trim().eq_ignore_ascii_case("no-store"));
        Head {
            status,
            length: text("content-length").and_then(|length| length.parse().ok()),
            range: text("content-range").and_then(content_range),
            etag: text("etag")
                .filter(|etag| etag.starts_with(['"', 'W']) && etag.len() > 1 && etag.is_ascii())
                .map(String::from),
            encoding: text("content-encoding")
                .filter(|encoding| !encoding.eq_ignore_ascii_case("identity"))
                .map(String::from),
            retry_after_s: text("retry-after").and_then(|time| retry_after_s(time, text("date"))),
            location: text("location").filter(|_| matches!(status, 301..=303 | 307 | 308)).map(String::from),
            is_not_stored: headers("cache-control").iter().any(forbids),
        }
    }

    /// The status code with its name.
    pub(super) fn status_text(&self) -> String {
        let name = match self.status {
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
            511 => "Network Authentication Required",
            _ => return self.status.to_string(),
        };
        format!("{} {name}", self.status)
    }
}

/// Seconds of `Retry-After`, which holds a number of seconds or a date.
fn retry_after_s(text: &str, now: Option<&str>) -> Option<u64> {
    if let Ok(seconds) = text.parse() {
        return Some(seconds);
    }
    let date = |text: &str| httpdate::parse_http_date(text).ok();
    // The server's clock, if it sends one: ours may be wrong.
    let now = now.and_then(date).unwrap_or_else(SystemTime::now);
    Some(date(text)?.duration_since(now).unwrap_or_default().as_secs())
}

/// FIRST of `bytes FIRST-LAST/TOTAL`, and TOTAL unless it is `*`.
fn content_range(text: &str) -> Option<(u64, Option<u64>)> {
    let (range, total) = text.strip_prefix("bytes ")?.split_once('/')?;
    let first = range.split_once('-')?.0.trim().parse().ok()?;
    Some((first, total.trim().parse().ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(status: u16, headers: &[(&str, &'static str)]) -> Head {
        Head::parse(status, |name| {
            headers.iter().filter(|(other, _)| *other == name).map(|(_, text)| *text).collect()
        })
    }

    #[test]
    fn ranges_are_parsed_and_malformed_ones_ignored() {
        assert_eq!(content_range("bytes 5-9/10"), Some((5, Some(10))));
        assert_eq!(content_range("bytes 0-9/*"), Some((0, None)));
        for text in ["", "bytes", "bytes */10", "lines 5-9/10", "bytes 5-9", "bytes -5/10", "bytes x-9/10"] {
            assert_eq!(content_range(text), None, "{text}");
        }
    }

    #[test]
    fn a_malformed_etag_is_ignored() {
        for etag in ["", "none", "\"", "\"\u{e4}\""] {
            assert_eq!(head(200, &[("etag", etag)]).etag, None, "{etag}");
        }
    }

    #[test]
    fn only_redirects_have_a_location() {
        for status in [301, 302, 303, 307, 308] {
            assert_eq!(head(status, &[("location", " /a ")]).location.as_deref(), Some("/a"));
            assert_eq!(head(status, &[]).location, None);
        }
        for status in [200, 201, 300, 304, 404] {
            assert_eq!(head(status, &[("location", "/a")]).location, None);
        }
    }

    #[test]
    fn one_of_several_directives_forbids_to_store() {
        for (texts, expected) in [
            (&["no-store"][..], true),
            (&["private, No-Store ,max-age=0"], true),
            (&["private", "no-store"], true),
            (&["no-cache, max-age=0", "no-storeroom"], false),
            (&[], false),
        ] {
            let headers: Vec<_> = texts.iter().map(|text| ("cache-control", *text)).collect();
            assert_eq!(head(200, &headers).is_not_stored, expected, "{texts:?}");
        }
    }

    #[test]
    fn known_statuses_have_names() {
        let text = |status| Head { status, ..Head::default() }.status_text();
        for status in [400, 401, 403, 404, 407, 408, 410, 416, 425, 429, 500, 502, 503, 504, 511] {
            assert!(text(status).starts_with(&format!("{status} ")), "{}", text(status));
        }
        assert_eq!((text(404), text(418)), ("404 Not Found".into(), "418".into()));
    }

    #[test]
    fn headers_are_parsed() {
        let parsed = head(
            200,
            &[
                ("content-length", " 12 "),
                ("etag", "\"a\""),
                ("content-encoding", "Identity"),
                ("retry-after", "20"),
            ],
        );
        let expected = Head {
            status: 200,
            length: Some(12),
            etag: Some("\"a\"".into()),
            retry_after_s: Some(20),
            ..Head::default()
        };
        assert_eq!(parsed, expected);
    }

    #[test]
    fn a_date_of_retry_after_counts_from_the_date_of_the_server() {
        let at = |time: &str, now: Option<&str>| retry_after_s(time, now);
        let now = Some("Wed, 21 Oct 2015 07:27:35 GMT");
        assert_eq!(at("Wed, 21 Oct 2015 07:28:00 GMT", now), Some(25));
        assert_eq!(at("Wed, 21 Oct 2015 07:27:00 GMT", now), Some(0), "in the past");
        assert_eq!(at("Wed, 21 Oct 2015 07:28:00 GMT", None), Some(0), "in the past of this clock, too");
        assert_eq!(at("soon", now), None);
        let later = SystemTime::now() + std::time::Duration::from_secs(3600);
        let seconds = at(&httpdate::fmt_http_date(later), Some("no date")).unwrap();
        assert!((3500..=3600).contains(&seconds), "{seconds}");
    }
}
