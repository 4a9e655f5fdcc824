//! [`Proxies`]: which proxy the environment names for a URL, and the connections through it.
//!
//! `http://` URLs are requested from an HTTP proxy itself ([`Forward`]); `https://` URLs, and everything through a
//! SOCKS proxy, pass through a tunnel that the HTTP library opens. [`Proxied`] tells faults of a proxy from faults of
//! the server.

use std::fmt;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use ureq::config::Config;
use ureq::http::uri::Scheme;
use ureq::unversioned::transport::{Buffers, ConnectionDetails, Connector, NextTimeout, Transport};
use ureq::{Error, Proxy, ProxyProtocol};

use super::request_error::RequestError;
use crate::content::{host_name, is_secure};

/// The proxies of the environment, as curl reads them: `http_proxy` or `https_proxy` by the scheme of the URL, else
/// `all_proxy`, but none for the hosts of `no_proxy`. Names in capitals count, too.
#[derive(Clone, Default)]
pub(super) struct Proxies {
    http: Option<Named>,
    https: Option<Named>,
    exceptions: String,
}

/// A variable and its value, which may hold a password.
#[derive(Clone)]
struct Named {
    variable: String,
    value: String,
}

impl Proxies {
    /// The proxies that the variables name; `variable` returns one by its name.
    pub(super) fn new(variable: impl Fn(&str) -> Option<String>) -> Proxies {
        let named = |names: [&str; 2]| {
            let names = names.into_iter().flat_map(|name| [name.to_owned(), name.to_ascii_uppercase()]);
            let mut named = names.filter_map(|name| Some(Named { value: variable(&name)?, variable: name }));
            named.find(|named| !named.value.trim().is_empty())
        };
        Proxies {
            http: named(["http_proxy", "all_proxy"]),
            https: named(["https_proxy", "all_proxy"]),
            exceptions: variable("no_proxy").or_else(|| variable("NO_PROXY")).unwrap_or_default(),
        }
    }

    /// The proxy for `url`, if there is one.
    ///
    /// # Errors
    /// If its variable names no proxy that is known.
    pub(super) fn find(&self, url: &str) -> Result<Option<Proxy>, RequestError> {
        let named = if is_secure(url) { &self.https } else { &self.http };
        let Some(Named { variable, value }) = named.as_ref().filter(|_| !self.is_exception(url)) else {
            return Ok(None);
        };
        let unknown = |_| {
            RequestError::Blocked(format!(
                "{variable} names no proxy: write it as http://HOST:PORT or socks5h://HOST:PORT"
            ))
        };
        Proxy::new(value.trim()).map(Some).map_err(unknown)
    }

    /// Whether the host of `url` is an exception, or within a domain that is one.
    fn is_exception(&self, url: &str) -> bool {
        let host = host_name(url).unwrap_or_default().to_ascii_lowercase();
        let is_within = |entry: &str| {
            let domain = entry.trim().trim_start_matches('*').trim_start_matches('.').to_ascii_lowercase();
            let is_all = domain.is_empty() && entry.trim() == "*";
            let outer = host.strip_suffix(&domain).filter(|_| !domain.is_empty());
            is_all || outer.is_some_and(|outer| outer.is_empty() || outer.ends_with('.'))
        };
        self.exceptions.split([',', ' ', '\t']).any(is_within)
    }
}

/// Whether the HTTP proxy of a request is asked for the URL itself.
fn is_forwarded(details: &ConnectionDetails<'_>, proxy: &Proxy) -> bool {
    let is_http = matches!(proxy.protocol(), ProxyProtocol::Http | ProxyProtocol::Https);
    is_http && details.uri.scheme() == Some(&Scheme::HTTP)
}

/// Connects to the HTTP proxy of `http://` URLs. Holds the configuration of that connection, without a proxy.
#[derive(Debug)]
pub(super) struct Forward(pub(super) Config);

impl Connector<()> for Forward {
    type Out = Forwarded;

    fn connect(&self, details: &ConnectionDetails<'_>, _: Option<()>) -> Result<Option<Forwarded>, Error> {
        let Some(proxy) = details.config.proxy().filter(|proxy| is_forwarded(details, proxy)) else {
            return Ok(None);
        };
        let to_proxy = ConnectionDetails {
            uri: proxy.uri(),
            addrs: details.resolver.resolve(proxy.uri(), &self.0, details.timeout)?,
            config: &self.0,
            request_level: details.request_level,
            resolver: details.resolver,
            now: details.now,
            timeout: details.timeout,
            current_time: details.current_time.clone(),
            run_connector: details.run_connector.clone(),
            register_shutdown: details.register_shutdown.clone(),
        };
        let inner = (details.run_connector)(&to_proxy)?;
        let host = details.uri.authority().map_or("", |authority| authority.as_str());
        let user = proxy.username().map(|user| {
            let user = BASE64_STANDARD.encode(format!("{user}:{}", proxy.password().unwrap_or_default()));
            format!("Proxy-Authorization: Basic {user}\r\n")
        });
        Ok(Some(Forwarded { inner, host: format!("http://{host}"), user: user.unwrap_or_default() }))
    }
}

/// A connection to a proxy whose requests name the whole URL (RFC 9112, 3.2.2).
pub(super) struct Forwarded {
    inner: Box<dyn Transport>,
    /// Scheme and host of the URL.
    host: String,
    /// The header that names the user of the proxy, if there is one.
    user: String,
}

impl fmt::Debug for Forwarded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Forwarded").field(&self.host).finish()
    }
}

impl Transport for Forwarded {
    fn buffers(&mut self) -> &mut dyn Buffers {
        self.inner.buffers()
    }

    fn transmit_output(&mut self, amount: usize, timeout: NextTimeout) -> Result<(), Error> {
        const METHOD: &[u8] = b"GET ";
        let output = self.inner.buffers().output();
        // A request has no body, so each begins with its method.
        let Some((target, headers)) = output[..amount].strip_prefix(METHOD).and_then(split_line) else {
            return self.inner.transmit_output(amount, timeout);
        };
        let request = [METHOD, self.host.as_bytes(), target, self.user.as_bytes(), headers].concat();
        let room = output.get_mut(..request.len()).ok_or_else(|| Error::BadUri(String::new()))?;
        room.copy_from_slice(&request);
        self.inner.transmit_output(request.len(), timeout)
    }

    fn await_input(&mut self, timeout: NextTimeout) -> Result<bool, Error> {
        self.inner.await_input(timeout)
    }

    fn is_open(&mut self) -> bool {
        self.inner.is_open()
    }
}

/// The first line with its end, and the rest.
fn split_line(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let end = bytes.windows(2).position(|pair| pair == b"\r\n")?;
    Some(bytes.split_at(end + 2))
}

/// A connector whose errors are errors of the proxy.
#[derive(Debug)]
pub(super) struct Proxied<C>(pub(super) C);

impl<In: Transport, C: Connector<In>> Connector<In> for Proxied<C> {
    type Out = C::Out;

    fn connect(&self, details: &ConnectionDetails<'_>, chained: Option<In>) -> Result<Option<C::Out>, Error> {
        self.0.connect(details, chained).map_err(|error| Error::Other(Box::new(ProxyError(error))))
    }
}

/// An error of a proxy.
#[derive(Debug)]
pub(super) struct ProxyError(pub(super) Error);

impl ProxyError {
    /// The status of a proxy that answers, but opens no tunnel.
    pub(super) fn status(&self) -> Option<u16> {
        let Error::ConnectProxyFailed(reason) = &self.0 else { return None };
        reason.split(|c: char| !c.is_ascii_digit()).find_map(|number| number.parse().ok())
    }
}

impl fmt::Display for ProxyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for ProxyError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// The host of the proxy for `url`, or what is wrong with it.
    fn found(variables: &[(&str, &str)], url: &str) -> Result<String, String> {
        let variable = |name: &str| {
            variables.iter().find(|(other, _)| *other == name).map(|(_, value)| (*value).to_owned())
        };
        let proxy = Proxies::new(variable).find(url).map_err(RequestError::text)?;
        Ok(proxy
            .map(|proxy| format!("{:?} {}:{}", proxy.protocol(), proxy.host(), proxy.port()))
            .unwrap_or_default())
    }

    #[test]
    fn the_scheme_of_a_url_chooses_its_proxy() {
        let variables = [
            ("HTTPS_PROXY", "http://secure:1"),
            ("http_proxy", "plain:2"),
            ("HTTP_PROXY", "http://other:3"),
            ("ALL_PROXY", "socks5h://ann:key@all:4"),
        ];
        let (https, http) = ("https://h/a", "http://h/a");
        for (variables, url, proxy) in [
            (&variables[..], https, "Http secure:1"),
            (&variables[..], http, "Http plain:2"),
            (&variables[2..], http, "Http other:3"),
            (&variables[2..], https, "Socks5h all:4"),
            (&variables[..1], http, ""),
            (&[("http_proxy", " "), ("all_proxy", "socks4://s")], http, "Socks4 s:1080"),
            (&[], http, ""),
        ] {
            assert_eq!(found(variables, url).unwrap(), proxy, "{url}");
        }
        let unknown = found(&[("ALL_PROXY", "ftp://ann:key@all")], http).unwrap_err();
        assert!(unknown.starts_with("ALL_PROXY names no proxy") && !unknown.contains("key"), "{unknown}");
    }

    #[test]
    fn exceptions_are_hosts_and_their_domains() {
        let is_direct = |exceptions: &str, url: &str| {
            found(&[("ALL_PROXY", "http://p"), ("NO_PROXY", exceptions)], url).unwrap().is_empty()
        };
        for (exceptions, url) in [
            ("example.org", "http://example.org:8000/a"),
            ("a, .Example.org", "https://clips.example.ORG/a"),
            ("*.example.org", "http://clips.example.org"),
            ("*", "http://h/a"),
            ("h  i,\tj", "http://i/a"),
            ("h  i,\tj", "http://j/a"),
            ("127.0.0.1,::1", "http://[::1]:80/a"),
        ] {
            assert!(is_direct(exceptions, url), "{exceptions}: {url}");
        }
        for (exceptions, url) in [
            ("example.org", "http://otherexample.org/a"),
            ("", "http://h"),
            (", ", "http://h"),
            ("h", "http://i/h"),
        ] {
            assert!(!is_direct(exceptions, url), "{exceptions}: {url}");
        }
    }
}
