//! [`Server`]: requests over HTTP and HTTPS, and what can go wrong with them in words.
//!
//! The only file that names the HTTP library. Certificates are those of Mozilla's list, which is
//! built in and thus the same on every system; `SSL_CERT_FILE` names others, as for OpenSSL.

use std::io::{ErrorKind, Read};
use std::time::SystemTime;

use ureq::http::{HeaderMap, header};
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body, Error, Timeout};

use super::transfer::{Ask, Head, Patience};

/// Most redirects that are followed.
const REDIRECTS_MAX: u32 = 5;

/// Why an exchange failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Trouble {
    /// It may go better the next time.
    Passing(String),
    /// The server's name is not known; where it was known before, this passes, too.
    Unresolved(String),
    /// Whoever answers is not the server, or cannot show that it is: in this network, or by this clock.
    Untrusted(String),
    /// It will not go better.
    Lasting(String),
}

impl Trouble {
    /// The sentence.
    pub(super) fn text(self) -> String {
        let (Trouble::Passing(text)
        | Trouble::Unresolved(text)
        | Trouble::Untrusted(text)
        | Trouble::Lasting(text)) = self;
        text
    }
}

/// Where requests go.
pub(super) struct Server {
    agent: Agent,
    url: String,
}

impl Server {
    /// Of the clip at `url`.
    ///
    /// # Errors
    /// If the certificates to trust cannot be read.
    pub(super) fn new(url: &str, patience: Patience) -> Result<Server, Trouble> {
        let config = Agent::config_builder()
            .http_status_as_error(false)
            // What was asked for in secret is not fetched in the open.
            .https_only(url.get(..6).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https:")))
            .max_redirects(REDIRECTS_MAX)
            .user_agent(concat!("aarc/", env!("CARGO_PKG_VERSION")))
            .accept_encoding("identity")
            .timeout_resolve(Some(patience.answer))
            .timeout_connect(Some(patience.answer))
            .timeout_recv_response(Some(patience.answer))
            .timeout_per_read(Some(patience.silence))
            .timeout_per_write(Some(patience.silence))
            .tls_config(TlsConfig::builder().root_certs(certificates()?).build())
            .build();
        Ok(Server { agent: config.new_agent(), url: url.into() })
    }

    /// Asks, and returns the answer and what to read the bytes from.
    ///
    /// # Errors
    /// If there is no answer.
    pub(super) fn get(&self, ask: &Ask) -> Result<(Head, Bytes), Trouble> {
        let mut request = self.agent.get(&self.url);
        if ask.first > 0 {
            request = request.header(header::RANGE, format!("bytes={}-", ask.first));
        }
        let conditions = [(header::IF_RANGE, &ask.if_range), (header::IF_NONE_MATCH, &ask.if_none_match)];
        for (name, etag) in conditions {
            if let Some(etag) = etag {
                request = request.header(name, etag);
            }
        }
        let response = request.call().map_err(trouble)?;
        let (parts, body) = response.into_parts();
        Ok((head(parts.status.as_u16(), &parts.headers), Bytes(body)))
    }
}

/// The bytes of an answer.
pub(super) struct Bytes(Body);

impl Bytes {
    /// Reads some; 0 at the end.
    ///
    /// # Errors
    /// If the connection breaks, or ends before the announced length.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Trouble> {
        self.0.as_reader().read(buffer).map_err(|error| trouble(Error::from(error)))
    }
}

/// The certificates to trust.
fn certificates() -> Result<RootCerts, Trouble> {
    let Some(path) = std::env::var_os("SSL_CERT_FILE").filter(|path| !path.is_empty()) else {
        return Ok(RootCerts::WebPki);
    };
    let lasting = |error: &dyn std::fmt::Display| {
        Trouble::Lasting(format!("SSL_CERT_FILE={}: {error}", path.to_string_lossy()))
    };
    let text = std::fs::read(&path).map_err(|error| lasting(&error))?;
    let mut certificates = Vec::new();
    for item in parse_pem(&text) {
        if let PemItem::Certificate(certificate) = item.map_err(|error| lasting(&error))? {
            certificates.push(certificate);
        }
    }
    Ok(certificates.into())
}

/// What matters of an answer.
fn head(status: u16, headers: &HeaderMap) -> Head {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok()).map(str::trim);
    Head {
        status,
        length: text(header::CONTENT_LENGTH).and_then(|length| length.parse().ok()),
        range: text(header::CONTENT_RANGE).and_then(content_range),
        etag: text(header::ETAG)
            .filter(|etag| etag.starts_with(['"', 'W']) && etag.len() > 1)
            .map(String::from),
        encoding: text(header::CONTENT_ENCODING)
            .filter(|encoding| !encoding.eq_ignore_ascii_case("identity"))
            .map(String::from),
        retry_after_s: text(header::RETRY_AFTER).and_then(|time| retry_after_s(time, text(header::DATE))),
    }
}

/// Seconds of `Retry-After`, which is a number of them, or a date.
fn retry_after_s(text: &str, now: Option<&str>) -> Option<u64> {
    if let Ok(seconds) = text.parse() {
        return Some(seconds);
    }
    let date = |text: &str| httpdate::parse_http_date(text).ok();
    // By the server's clock, where it tells: this one may be wrong.
    let now = now.and_then(date).unwrap_or_else(SystemTime::now);
    Some(date(text)?.duration_since(now).unwrap_or_default().as_secs())
}

/// The first byte of `bytes FIRST-LAST/TOTAL`, and the total unless it is `*`.
fn content_range(text: &str) -> Option<(u64, Option<u64>)> {
    let (range, total) = text.strip_prefix("bytes ")?.split_once('/')?;
    let first = range.split_once('-')?.0.trim().parse().ok()?;
    Some((first, total.trim().parse().ok()))
}

/// An error of the library in words.
fn trouble(error: Error) -> Trouble {
    let passing = |text: &str| Trouble::Passing(text.into());
    match error {
        Error::HostNotFound => Trouble::Unresolved("the server's name is not known".into()),
        Error::Timeout(Timeout::Resolve) => Trouble::Unresolved("the name service does not answer".into()),
        Error::Timeout(Timeout::Connect | Timeout::RecvResponse) => passing("the server does not answer"),
        Error::Timeout(_) => passing("the server fell silent"),
        Error::Io(error) => match error.kind() {
            ErrorKind::ConnectionRefused => passing("the server takes no connections"),
            ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
                passing("there is no way to the server")
            }
            ErrorKind::TimedOut => passing("the server does not answer"),
            // The standard library has no kind for it.
            _ if error.to_string().contains("lookup address") => {
                Trouble::Unresolved("the server's name is not known".into())
            }
            // So the TLS library reports what it does not like.
            ErrorKind::InvalidData => Trouble::Untrusted(format!("no secure connection: {error}")),
            _ => passing("the connection was lost"),
        },
        Error::Protocol(error) => Trouble::Passing(format!("the server does not speak HTTP: {error}")),
        Error::Rustls(error) => Trouble::Untrusted(format!("no secure connection: {error}")),
        Error::Tls(error) => Trouble::Untrusted(format!("no secure connection: {error}")),
        Error::TooManyRedirects => {
            Trouble::Lasting(format!("the server redirects more than {REDIRECTS_MAX} times"))
        }
        Error::RequireHttpsOnly(_) => {
            Trouble::Lasting("the server redirects from https to http, which is not followed".into())
        }
        Error::BadUri(_) | Error::Http(_) => Trouble::Lasting("not an address".into()),
        error => Trouble::Passing(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_and_nonsense_is_not() {
        assert_eq!(content_range("bytes 5-9/10"), Some((5, Some(10))));
        assert_eq!(content_range("bytes 0-9/*"), Some((0, None)));
        for text in ["", "bytes", "bytes */10", "lines 5-9/10", "bytes 5-9", "bytes -5/10", "bytes x-9/10"] {
            assert_eq!(content_range(text), None, "{text}");
        }
    }

    #[test]
    fn an_empty_version_is_none() {
        for etag in ["", "none", "\""] {
            let headers = HeaderMap::from_iter([(header::ETAG, etag.parse().unwrap())]);
            assert_eq!(head(200, &headers).etag, None, "{etag}");
        }
    }

    #[test]
    fn what_the_headers_say() {
        let mut headers = HeaderMap::new();
        for (name, value) in [
            (header::CONTENT_LENGTH, " 12 "),
            (header::ETAG, "\"a\""),
            (header::CONTENT_ENCODING, "Identity"),
            (header::RETRY_AFTER, "20"),
        ] {
            headers.insert(name, value.parse().unwrap());
        }
        let expected = Head {
            status: 200,
            length: Some(12),
            etag: Some("\"a\"".into()),
            retry_after_s: Some(20),
            ..Head::default()
        };
        assert_eq!(head(200, &headers), expected);
    }

    #[test]
    fn a_date_to_wait_for_is_by_the_clock_of_the_server() {
        let at = |time: &str, now: Option<&str>| retry_after_s(time, now);
        let now = Some("Wed, 21 Oct 2015 07:27:35 GMT");
        assert_eq!(at("Wed, 21 Oct 2015 07:28:00 GMT", now), Some(25));
        assert_eq!(at("Wed, 21 Oct 2015 07:27:00 GMT", now), Some(0), "that is over");
        assert_eq!(at("Wed, 21 Oct 2015 07:28:00 GMT", None), Some(0), "that is long over");
        assert_eq!(at("soon", now), None);
        let later = SystemTime::now() + std::time::Duration::from_secs(3600);
        let seconds = at(&httpdate::fmt_http_date(later), Some("no date")).unwrap();
        assert!((3500..=3600).contains(&seconds), "{seconds}");
    }
}
