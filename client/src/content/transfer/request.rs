//! [`Server`]: requests over HTTP and HTTPS, with errors as sentences.
//!
//! Only this file, `proxy` and `wire` name the HTTP library. It trusts Mozilla's certificates, which are built in and
//! thus the same on every system, or the certificates in `SSL_CERT_FILE`, as OpenSSL does. Redirects are followed here,
//! and their bodies are not read: they may be endless.

use std::io::{ErrorKind, Read};
use std::sync::Arc;
use std::time::Instant;

use ureq::http::header;
use ureq::http::uri::Uri;
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::unversioned::resolver::DefaultResolver;
use ureq::unversioned::transport::{ConnectProxyConnector, Connector, SocksConnector, TcpConnector};
use ureq::{Agent, Body, Error, Proxy, Timeout};

use super::head::Head;
use super::proxy::{Forward, Proxied, Proxies, ProxyError};
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::state::{FileRequest, PROXY_LOG_IN};
use super::watch::Watch;
use super::wire::{HANDSHAKE_RESET, Secure, Wire};
use crate::content::{has_user_info, is_secure, is_url, request_url, resolve};

/// Limit on redirects.
const REDIRECTS_MAX: u32 = 5;

/// The server of a URL.
pub(super) struct Server {
    agent: Agent,
    proxies: Proxies,
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
    /// The server of the file at `url`, by the proxies of the environment. Requests end when `watch` says so.
    ///
    /// # Errors
    /// If the certificates to trust cannot be read.
    pub(super) fn new(url: &str, retry: RetryPolicy, watch: &Arc<Watch>) -> Result<Server, RequestError> {
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .user_agent(concat!("aarc/", env!("CARGO_PKG_VERSION")))
            .accept_encoding("identity")
            .proxy(None)
            .timeout_resolve(Some(retry.response_timeout))
            .timeout_connect(Some(retry.response_timeout))
            .timeout_send_request(Some(retry.response_timeout))
            .timeout_recv_response(Some(retry.response_timeout))
            .timeout_per_read(Some(retry.read_timeout))
            .tls_config(TlsConfig::builder().root_certs(certificates()?).build())
            .build();
        let connector =
            ().chain(Proxied(Forward(config.clone())))
                .chain(Proxied(ConnectProxyConnector::default()))
                .chain(Proxied(SocksConnector::default()))
                .chain(TcpConnector::default())
                .chain(Wire(watch.clone()))
                .chain(Secure::default());
        let agent = Agent::with_parts(config, connector, DefaultResolver::default());
        let proxies = Proxies::new(|name| std::env::var(name).ok());
        Ok(Server { agent, proxies, url: request_url(url), watch: watch.clone() })
    }

    /// Sends a request, follows redirects, and returns the response.
    ///
    /// # Errors
    /// If there is no response.
    pub(super) fn get(&self, file: &FileRequest) -> Result<Response, RequestError> {
        self.watch.begin(Instant::now());
        let mut url = self.url.clone();
        for _ in 0..=REDIRECTS_MAX {
            let proxy = self.proxies.find(&url)?;
            let (head, body) = self.send(&url, proxy, file).map_err(|error| self.request_error(error))?;
            let Some(location) = &head.location else { return Ok(Response { head, body, url }) };
            url = redirected(&url, location)?;
        }
        Err(RequestError::Permanent(format!(
            "the server redirects more than {REDIRECTS_MAX} times: name the URL that it leads to"
        )))
    }

    fn send(
        &self,
        url: &str,
        proxy: Option<Proxy>,
        file: &FileRequest,
    ) -> Result<(Head, ResponseBody), Error> {
        let uri: Uri = url.parse().map_err(|_| Error::BadUri(String::new()))?;
        let mut request = self.agent.get(uri).config().proxy(proxy).build();
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
        let headers = |name| {
            let values = parts.headers.get_all(name).iter();
            values.filter_map(|value| std::str::from_utf8(value.as_bytes()).ok()).collect()
        };
        Ok((Head::parse(parts.status.as_u16(), headers), ResponseBody(body)))
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
        match error {
            Error::Other(error) => match error.downcast::<ProxyError>() {
                Ok(error) => proxy_error(*error),
                Err(error) => request_error(Error::Other(error), "server"),
            },
            error => request_error(error, "server"),
        }
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
    Ok(request_url(&target))
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
    RequestError::Blocked(format!(
        "no secure connection: {error}: check the clock and the URL, or name the server's certificate with \
         SSL_CERT_FILE"
    ))
}

/// An error of a proxy as a sentence.
fn proxy_error(error: ProxyError) -> RequestError {
    let status = error.status();
    match (status, error.0) {
        (Some(407), _) => RequestError::Blocked(PROXY_LOG_IN.into()),
        (Some(status @ 400..500), _) => {
            RequestError::Blocked(format!("the proxy refuses ({status}): ask for its rules, or use another"))
        }
        (Some(status), _) => RequestError::Transient(format!("the proxy answers {status}")),
        (None, Error::Io(error))
            if matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::InvalidData) =>
        {
            RequestError::Blocked(format!("the proxy refuses: {error}"))
        }
        (None, Error::Io(error)) if error.kind() == ErrorKind::Other => {
            RequestError::Transient(format!("the proxy does not connect: {error}"))
        }
        (None, error) => request_error(error, "proxy"),
    }
}

/// An error of the HTTP library as a sentence about `peer`.
fn request_error(error: Error, peer: &str) -> RequestError {
    let transient = |text: &str| RequestError::Transient(format!("the {peer} {text}"));
    let unknown_host = |text: String| match peer {
        "server" => RequestError::UnknownHost(text),
        _ => RequestError::Transient(text),
    };
    match error {
        Error::HostNotFound => unknown_host(format!("the {peer}'s name is not known")),
        Error::Timeout(Timeout::Resolve) => unknown_host("the name service does not answer".into()),
        Error::Timeout(Timeout::Connect | Timeout::RecvResponse) => transient("does not answer"),
        Error::Timeout(_) => transient("fell silent"),
        Error::Io(error) => match error.kind() {
            ErrorKind::ConnectionRefused => transient("takes no connections"),
            ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
                RequestError::Transient(format!("there is no way to the {peer}"))
            }
            ErrorKind::TimedOut => transient("does not answer"),
            // The standard library has no kind for a name that does not resolve.
            _ if error.to_string().contains("lookup address") => {
                unknown_host(format!("the {peer}'s name is not known"))
            }
            // The TLS library reports a refused certificate this way.
            ErrorKind::InvalidData => untrusted(&error),
            _ => RequestError::Transient("the connection was lost".into()),
        },
        Error::Protocol(error) => transient(&format!("does not speak HTTP: {error}")),
        Error::Rustls(error) => untrusted(&error),
        Error::Tls(HANDSHAKE_RESET) => {
            RequestError::Transient(format!("no secure connection: {HANDSHAKE_RESET}"))
        }
        Error::Tls(error) => RequestError::Blocked(format!("no secure connection: {error}")),
        Error::BadUri(_) | Error::Http(_) => {
            RequestError::Permanent("not a URL: write it as http://HOST/PATH".into())
        }
        error => RequestError::Transient(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::{Ipv4Addr, TcpListener, TcpStream};
    use std::thread::JoinHandle;

    use super::*;

    /// Serves one connection on a port of this machine.
    fn serve<T: Send + 'static>(
        answer: impl FnOnce(&mut TcpStream) -> T + Send + 'static,
    ) -> (u16, JoinHandle<T>) {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        (port, std::thread::spawn(move || answer(&mut listener.accept().unwrap().0)))
    }

    /// Reads a request and answers it; returns its lines.
    fn answer(stream: &mut TcpStream, status: &str) -> Vec<String> {
        let lines = BufReader::new(stream.try_clone().unwrap()).lines().map(Result::unwrap);
        let lines = lines.take_while(|line| !line.is_empty()).collect();
        write!(stream, "HTTP/1.1 {status}\r\nContent-Length: 4\r\nConnection: close\r\n\r\nfile").unwrap();
        lines
    }

    /// The file at `url` by the proxy that all variables name.
    fn get(url: &str, proxy: &str) -> Result<Vec<u8>, RequestError> {
        let retry = RetryPolicy::default();
        let proxies = Proxies::new(|name| (name == "ALL_PROXY").then(|| proxy.into()));
        let server = Server { proxies, ..Server::new(url, retry, &Arc::new(Watch::new(&retry)))? };
        let mut response = server.get(&FileRequest::default())?;
        let mut bytes = vec![0; 100];
        let count = server.read(&mut response.body, &mut bytes)?;
        bytes.truncate(count);
        Ok(bytes)
    }

    #[test]
    fn an_http_proxy_is_asked_for_http_urls_and_tunnels_https() {
        let (port, proxy) = serve(|stream| answer(stream, "200 OK"));
        let file =
            get("http://ann:no@clips.invalid/a?b", &format!("http://bob:k%20y@127.0.0.1:{port}")).unwrap();
        assert_eq!(file, b"file");
        let request = proxy.join().unwrap().join("\n").to_ascii_lowercase();
        assert!(request.starts_with("get http://clips.invalid/a?b http/1.1\n"), "{request}");
        assert!(request.contains("\nhost: clips.invalid"), "{request}");
        assert!(request.contains("\nproxy-authorization: basic ym9iomsgeq=="), "{request}");
        assert!(!request.contains("\nauthorization"), "a user of the server is not sent: {request}");

        for (status, expected) in [
            ("407 x", RequestError::Blocked(PROXY_LOG_IN.into())),
            (
                "403 x",
                RequestError::Blocked("the proxy refuses (403): ask for its rules, or use another".into()),
            ),
            ("502 x", RequestError::Transient("the proxy answers 502".into())),
        ] {
            let (port, proxy) = serve(move |stream| answer(stream, status));
            let refused = get("https://clips.invalid/a", &format!("127.0.0.1:{port}")).unwrap_err();
            assert_eq!(refused, expected);
            assert!(proxy.join().unwrap()[0].starts_with("CONNECT clips.invalid:443 "));
        }
    }

    #[test]
    fn a_socks_proxy_connects_or_says_why_not() {
        for (reply, expected) in [
            (0, Ok(b"file".to_vec())),
            (5, Err(RequestError::Transient("the proxy does not connect: connection refused".into()))),
        ] {
            let (port, proxy) = serve(move |stream| {
                let mut greeting = [0; 3];
                stream.read_exact(&mut greeting).unwrap();
                stream.write_all(&[5, 0]).unwrap();
                let mut target = [0; 20];
                stream.read_exact(&mut target).unwrap();
                stream.write_all(&[5, reply, 0, 1, 0, 0, 0, 0, 0, 0]).unwrap();
                let request = if reply == 0 { answer(stream, "200 OK") } else { Vec::new() };
                (target, request)
            });
            assert_eq!(get("http://clips.invalid/a", &format!("socks5h://127.0.0.1:{port}")), expected);
            let (target, request) = proxy.join().unwrap();
            assert_eq!(&target[3..], b"\x03\x0dclips.invalid\x00\x50");
            assert!(reply != 0 || request[0] == "GET /a HTTP/1.1", "{request:?}");
        }
    }

    #[test]
    fn a_proxy_that_is_not_there_is_not_passed_by() {
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap().port();
        for scheme in ["http", "socks5", "socks5h", "socks4"] {
            for url in ["http://127.0.0.1:9/a", "https://127.0.0.1:9/a"] {
                let error = get(url, &format!("{scheme}://127.0.0.1:{port}")).unwrap_err();
                let expected = RequestError::Transient("the proxy takes no connections".into());
                assert_eq!(error, expected, "{scheme}: {url}");
            }
        }
    }

    #[test]
    fn redirects_lead_to_no_other_scheme_and_no_user() {
        let target = |location: &str| redirected("http://a/b?key", location).map_err(RequestError::text);
        assert_eq!(target("c").unwrap(), "http://a/c");
        assert_eq!(target("https://d").unwrap(), "https://d");
        assert_eq!(target("/t\u{e4}nze 1").unwrap(), "http://a/t%C3%A4nze%201");
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
        let error = request_error(Error::Io(error), "server");
        assert!(matches!(&error, RequestError::Blocked(why) if why.contains("SSL_CERT_FILE")), "{error:?}");
    }
}
