//! [`Server`]: requests over HTTP and HTTPS, with errors as sentences.
//!
//! Only this file names the HTTP library. It trusts Mozilla's certificates, which are built in and thus
//! the same on every system, or those in `SSL_CERT_FILE`, as OpenSSL does.

use std::io::{ErrorKind, Read};

use ureq::http::header;
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body, Error, Timeout};

use super::head::Head;
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::transfer::FileRequest;

/// Limit on redirects.
const REDIRECTS_MAX: u32 = 5;

/// The server of a URL.
pub(super) struct Server {
    agent: Agent,
    url: String,
}

impl Server {
    /// The server of the file at `url`.
    ///
    /// # Errors
    /// If the certificates to trust cannot be read.
    pub(super) fn new(url: &str, retry: RetryPolicy) -> Result<Server, RequestError> {
        let config = Agent::config_builder()
            .http_status_as_error(false)
            // An https URL is not fetched over http.
            .https_only(url.get(..6).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https:")))
            .max_redirects(REDIRECTS_MAX)
            .user_agent(concat!("aarc/", env!("CARGO_PKG_VERSION")))
            .accept_encoding("identity")
            .timeout_resolve(Some(retry.response_timeout))
            .timeout_connect(Some(retry.response_timeout))
            .timeout_recv_response(Some(retry.response_timeout))
            .timeout_per_read(Some(retry.read_timeout))
            .timeout_per_write(Some(retry.read_timeout))
            .tls_config(TlsConfig::builder().root_certs(certificates()?).build())
            .build();
        Ok(Server { agent: config.new_agent(), url: url.into() })
    }

    /// Sends a request; returns the head of the response and its body.
    ///
    /// # Errors
    /// If there is no response.
    pub(super) fn get(&self, file: &FileRequest) -> Result<(Head, ResponseBody), RequestError> {
        let mut request = self.agent.get(&self.url);
        if file.offset > 0 {
            request = request.header(header::RANGE, format!("bytes={}-", file.offset));
        }
        let conditions = [(header::IF_RANGE, &file.if_range), (header::IF_NONE_MATCH, &file.if_none_match)];
        for (name, etag) in conditions {
            if let Some(etag) = etag {
                request = request.header(name, etag);
            }
        }
        let response = request.call().map_err(request_error)?;
        let (parts, body) = response.into_parts();
        let header = |name| parts.headers.get(name).and_then(|value| value.to_str().ok());
        Ok((Head::parse(parts.status.as_u16(), header), ResponseBody(body)))
    }
}

/// The body of a response.
pub(super) struct ResponseBody(Body);

impl ResponseBody {
    /// Reads into `buffer`; returns the number of bytes, 0 at the end.
    ///
    /// # Errors
    /// If the connection breaks, or ends before the announced length.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> Result<usize, RequestError> {
        self.0.as_reader().read(buffer).map_err(|error| request_error(Error::from(error)))
    }
}

/// The certificates to trust.
fn certificates() -> Result<RootCerts, RequestError> {
    let Some(path) = std::env::var_os("SSL_CERT_FILE").filter(|path| !path.is_empty()) else {
        return Ok(RootCerts::WebPki);
    };
    let permanent = |error: &dyn std::fmt::Display| {
        RequestError::Permanent(format!("SSL_CERT_FILE={}: {error}", path.to_string_lossy()))
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
            ErrorKind::InvalidData => RequestError::Untrusted(format!("no secure connection: {error}")),
            _ => transient("the connection was lost"),
        },
        Error::Protocol(error) => RequestError::Transient(format!("the server does not speak HTTP: {error}")),
        Error::Rustls(error) => RequestError::Untrusted(format!("no secure connection: {error}")),
        Error::Tls(error) => RequestError::Untrusted(format!("no secure connection: {error}")),
        Error::TooManyRedirects => {
            RequestError::Permanent(format!("the server redirects more than {REDIRECTS_MAX} times"))
        }
        Error::RequireHttpsOnly(_) => {
            RequestError::Permanent("the server redirects from https to http, which is not followed".into())
        }
        Error::BadUri(_) | Error::Http(_) => RequestError::Permanent("not a URL".into()),
        error => RequestError::Transient(error.to_string()),
    }
}
