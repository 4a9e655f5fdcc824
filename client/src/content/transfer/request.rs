//! [`Server`]: requests over HTTP and HTTPS, with errors as sentences.
//!
//! Only this file and `wire` name the HTTP library. It trusts Mozilla's certificates, which are built in and thus the
//! same on every system, or the certificates in `SSL_CERT_FILE`, as OpenSSL does. Redirects are followed here, and
//! their bodies are not read: they may be endless.

use std::io::{ErrorKind, Read};
use std::sync::Arc;
use std::time::Instant;

use ureq::http::header;
use ureq::http::uri::Uri;
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::unversioned::resolver::DefaultResolver;
use ureq::unversioned::transport::{ConnectProxyConnector, Connector, TcpConnector};
use ureq::{Agent, Body, Error, Timeout};

use super::head::Head;
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::state::FileRequest;
use super::watch::Watch;
use super::wire::{HANDSHAKE_RESET, Secure, Wire};
use crate::content::{has_user_info, is_secure, is_url, resolve};

/// Limit on redirects.
const REDIRECTS_MAX: u32 = 5;

/// The server of a URL.
pub(super) struct Server {
    agent: Agent,
    url: String,
    watch: Arc<Watch>,
}

/// A response that is no redirect.
pub(super) struct Response {
    pub(super) head: Head,
    pub(super) body: ResponseBody,
    /// The URL of the file, where redirects led.
    pub(super) url: String,
}

impl Server {
    /// The server of the file at `url`. Requests end when `watch` says so.
    ///
    /// # Errors
    /// If the certificates to trust cannot be read.
    pub(super) fn new(url: &str, retry: RetryPolicy, watch: &Arc<Watch>) -> Result<Server, RequestError> {
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .user_agent(concat!("aarc/", env!("CARGO_PKG_VERSION")))
            .accept_encoding("identity")
            .timeout_resolve(Some(retry.response_timeout))
            .timeout_connect(Some(retry.response_timeout))
            .timeout_send_request(Some(retry.response_timeout))
            .timeout_recv_response(Some(retry.response_timeout))
            .timeout_per_read(Some(retry.read_timeout))
            .tls_config(TlsConfig::builder().root_certs(certificates()?).build())
            .build();
        let connector =
            ().chain(ConnectProxyConnector::default())
                .chain(TcpConnector::default())
                .chain(Wire(watch.clone()))
                .chain(Secure::default());
        let agent = Agent::with_parts(config, connector, DefaultResolver::default());
        Ok(Server { agent, url: url.into(), watch: watch.clone() })
    }

    /// Sends a request, follows redirects, and returns the response.
    ///
    /// # Errors
    /// If there is no response.
    pub(super) fn get(&self, file: &FileRequest) -> Result<Response, RequestError> {
        self.watch.begin(Instant::now());
        let mut url = self.url.clone();
        for _ in 0..=REDIRECTS_MAX {
            let (head, body) = self.send(&url, file).map_err(|error| self.request_error(error))?;
            let Some(location) = &head.location else { return Ok(Response { head, body, url }) };
            url = redirected(&url, location)?;
        }
        Err(RequestError::Permanent(format!(
            "the server redirects more than {REDIRECTS_MAX} times: name the URL that it leads to"
        )))
    }

    fn send(&self, url: &str, file: &FileRequest) -> Result<(Head, ResponseBody), Error> {
        let uri: Uri = url.parse().map_err(|_| Error::BadUri(String::new()))?;
        let mut request = self.agent.get(uri);
        if let Some(range) = file.range() {
            request = request.header(header::RANGE, range);
        }
        let conditions = [(header::IF_RANGE, &file.if_range), (header::IF_NONE_MATCH, &file.if_none_match)];
        for (name, etag) in conditions {
            if let Some(etag) = etag {
                request = request.header(name, etag);
            }
        }
        let response = request.call()?;
        let (parts, body) = response.into_parts();
        let header = |name| parts.headers.get(name).and_then(|value| value.to_str().ok());
        Ok((Head::parse(parts.status.as_u16(), header), ResponseBody(body)))
    }

    /// Reads a part of `body` into `buffer`; returns the number of bytes, 0 at the end.
    ///
    /// # Errors
    /// If the connection breaks, or ends before the announced length.
    pub(super) fn read(&self, body: &mut ResponseBody, buffer: &mut [u8]) -> Result<usize, RequestError> {
        body.0.as_reader().read(buffer).map_err(|error| self.request_error(Error::from(error)))
    }

    /// An error of the HTTP library as a sentence.
    fn request_error(&self, error: Error) -> RequestError {
        if self.watch.is_late(Instant::now()) {
            let rate = self.watch.least_bytes_per_s();
            return RequestError::Transient(format!("the server sends fewer than {rate} bytes a second"));
        }
        request_error(error)
    }
}

/// The body of a response.
#[derive(Debug)]
pub(super) struct ResponseBody(Body);

/// The URL that a redirect from `url` leads to.
///
/// # Errors
/// If it is not to be followed.
fn redirected(url: &str, location: &str) -> Result<String, RequestError> {
    let target = resolve(url, location);
    let refused = |what: &str| {
        let what = format!("the server redirects {what}: name the URL of the file itself");
        Err(RequestError::Permanent(what))
    };
    if is_secure(url) && !is_secure(&target) {
        return refused("from https to http, which is not followed");
    }
    if !is_url(&target) {
        return refused("to a URL that is neither http nor https");
    }
    if has_user_info(&target) {
        return refused("to a URL with a user name, which is not followed");
    }
    Ok(target)
}

/// The certificates to trust.
fn certificates() -> Result<RootCerts, RequestError> {
    let Some(path) = std::env::var_os("SSL_CERT_FILE").filter(|path| !path.is_empty()) else {
        return Ok(RootCerts::WebPki);
    };
    let permanent = |error: &dyn std::fmt::Display| {
        RequestError::Permanent(format!(
            "SSL_CERT_FILE={}: {error}: name a file of certificates in PEM",
            path.to_string_lossy()
        ))
    };
    let text = std::fs::read(&path).map_err(|error| permanent(&error))?;
    let mut certificates = Vec::new();
    for item in parse_pem(&text) {
        if let PemItem::Certificate(certificate) = item.map_err(|error| permanent(&error))? {
            certificates.push(certificate);
        }
    }
    Ok(certificates.into())
}

/// The error of a certificate.
fn untrusted(error: &dyn std::fmt::Display) -> RequestError {
    RequestError::Untrusted(format!(
        "no secure connection: {error}: check the clock and the URL, or name the server's certificate with \
         SSL_CERT_FILE"
    ))
}

/// An error of the HTTP library as a sentence.
fn request_error(error: Error) -> RequestError {
    let transient = |text: &str| RequestError::Transient(text.into());
    match error {
        Error::HostNotFound => RequestError::UnknownHost("the server's name is not known".into()),
        Error::Timeout(Timeout::Resolve) => {
            RequestError::UnknownHost("the name service does not answer".into())
        }
        Error::Timeout(Timeout::Connect | Timeout::RecvResponse) => transient("the server does not answer"),
        Error::Timeout(_) => transient("the server fell silent"),
        Error::Io(error) => match error.kind() {
            ErrorKind::ConnectionRefused => transient("the server takes no connections"),
            ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
                transient("there is no way to the server")
            }
            ErrorKind::TimedOut => transient("the server does not answer"),
            // The standard library has no kind for a name that does not resolve.
            _ if error.to_string().contains("lookup address") => {
                RequestError::UnknownHost("the server's name is not known".into())
            }
            // The TLS library reports a refused certificate this way.
            ErrorKind::InvalidData => untrusted(&error),
            _ => transient("the connection was lost"),
        },
        Error::Protocol(error) => RequestError::Transient(format!("the server does not speak HTTP: {error}")),
        Error::Rustls(error) => untrusted(&error),
        Error::Tls(HANDSHAKE_RESET) => {
            RequestError::Transient(format!("no secure connection: {HANDSHAKE_RESET}"))
        }
        Error::Tls(error) => RequestError::Untrusted(format!("no secure connection: {error}")),
        Error::BadUri(_) | Error::Http(_) => {
            RequestError::Permanent("not a URL: write it as http://HOST/PATH, with %20 for a blank".into())
        }
        error => RequestError::Transient(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn redirects_lead_to_no_other_scheme_and_no_user() {
        let target = |location: &str| redirected("http://a/b?key", location).map_err(RequestError::text);
        assert_eq!(target("c").unwrap(), "http://a/c");
        assert_eq!(target("https://d").unwrap(), "https://d");
        for (location, why) in [
            ("file:///etc", "neither http nor https"),
            ("ftp://a/b", "neither"),
            ("//u:key@a/b", "user name"),
        ] {
            let error = target(location).unwrap_err();
            assert!(error.contains(why) && !error.contains("key"), "{location}: {error}");
        }
        let down = redirected("https://a/b", "http://a/b?key").map_err(RequestError::text).unwrap_err();
        assert!(down.contains("from https to http") && !down.contains("key"), "{down}");
    }

    /// As the TLS library reports it.
    #[test]
    fn a_refused_certificate_is_not_tried_again() {
        let error = std::io::Error::new(ErrorKind::InvalidData, "invalid peer certificate: Expired");
        let error = request_error(Error::Io(error));
        assert!(matches!(&error, RequestError::Untrusted(why) if why.contains("SSL_CERT_FILE")), "{error:?}");
    }
}
