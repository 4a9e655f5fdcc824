//! [`Server`]: requests over HTTP and HTTPS, and what can go wrong with them in words.
//!
//! The only file that names the HTTP library. Certificates are those of Mozilla's list, which is
//! built in and thus the same on every system; `SSL_CERT_FILE` names others, as for OpenSSL.

use std::io::{ErrorKind, Read};

use ureq::http::header;
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body, Error, Timeout};

use super::head::Head;
use super::transfer::{Ask, Patience};
use super::trouble::Trouble;

/// Most redirects that are followed.
const REDIRECTS_MAX: u32 = 5;

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
        let header = |name| parts.headers.get(name).and_then(|value| value.to_str().ok());
        Ok((Head::read(parts.status.as_u16(), header), Bytes(body)))
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
