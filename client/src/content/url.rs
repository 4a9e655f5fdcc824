//! URLs of clips and playlists: how to recognise, resolve (RFC 3986, 5.2) and print one.

use std::path::Path;

use percent_encoding::{AsciiSet, CONTROLS, utf8_percent_encode};

/// Characters that are percent-encoded before a URL is requested, as all beyond ASCII are: those that browsers encode in
/// a path or in a query (WHATWG URL, 1.3), and others that no URL holds. So spellings that browsers make one are one.
const FORBIDDEN: &AsciiSet = &CONTROLS
    .add(b' ')
    .add(b'"')
    .add(b'\'')
    .add(b'<')
    .add(b'>')
    .add(b'^')
    .add(b'`')
    .add(b'{')
    .add(b'|')
    .add(b'}');

/// Characters that are percent-encoded in a path as it is on disk: also those that have a meaning in URLs, or to servers.
const RESERVED: &AsciiSet = &FORBIDDEN.add(b'#').add(b'%').add(b'+').add(b'?').add(b'[').add(b'\\').add(b']');

/// Why a URL of another scheme is not opened.
pub(crate) const UNKNOWN_SCHEME: &str =
    "clips come from paths and from http:// and https:// URLs, so name one of those";

/// The components of a URL that has a host.
struct Components<'a> {
    scheme: &'a str,
    /// User name and password.
    user_info: Option<&'a str>,
    /// Host and port.
    host: &'a str,
    path: &'a str,
    /// From its question mark.
    #[cfg_attr(not(any(feature = "net", feature = "xr")), allow(dead_code, reason = "redirects have one"))]
    query: &'a str,
}

impl<'a> Components<'a> {
    /// The components of `url`; `None` if it has no scheme and host, as a path.
    fn parse(url: &'a str) -> Option<Components<'a>> {
        let scheme = scheme(url)?;
        let rest = url[scheme.len()..].strip_prefix("://")?;
        let rest = rest.split('#').next().unwrap_or_default();
        let (authority, rest) = rest.split_at(rest.find(['/', '\\', '?']).unwrap_or(rest.len()));
        let (path, query) = rest.split_at(rest.find('?').unwrap_or(rest.len()));
        let (user_info, host) = match authority.rsplit_once('@') {
            Some((user_info, host)) => (Some(user_info), host),
            None => (None, authority),
        };
        Some(Components { scheme, user_info, host, path, query })
    }

    /// The path up to its last slash.
    fn folder(&self) -> &'a str {
        self.path.rsplit_once('/').map_or("", |(folder, _)| folder)
    }
}

/// The scheme of a URL, such as `https`; `None` for a path.
pub(crate) fn scheme(name: &str) -> Option<&str> {
    let (scheme, rest) = name.split_once(':')?;
    let is_scheme = scheme.len() > 1
        && scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    (is_scheme && rest.starts_with("//")).then_some(scheme)
}

/// Whether `name` is an `http` or `https` URL rather than a path.
pub(crate) fn is_url(name: &str) -> bool {
    scheme(name)
        .is_some_and(|scheme| ["http", "https"].iter().any(|known| scheme.eq_ignore_ascii_case(known)))
}

/// Whether `url` is fetched encrypted.
pub(crate) fn is_secure(url: &str) -> bool {
    scheme(url).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https"))
}

/// Whether `url` holds a user name or password.
pub(crate) fn has_user_info(url: &str) -> bool {
    Components::parse(url).is_some_and(|url| url.user_info.is_some())
}

/// The host of `url`, without its port and the brackets of an address.
#[cfg(feature = "net")]
pub(crate) fn host_name(url: &str) -> Option<&str> {
    let (host, _) = split_port(Components::parse(url)?.host);
    Some(host.trim_matches(['[', ']']))
}

/// A host and its port, which may be empty.
fn split_port(host: &str) -> (&str, &str) {
    host.rsplit_once(':').filter(|(_, port)| !port.ends_with(']')).unwrap_or((host, ""))
}

/// The URL under which `url` is requested: without user name, password and fragment, and with blanks and characters
/// beyond ASCII percent-encoded, as browsers do.
#[cfg(any(feature = "net", feature = "xr"))]
pub(crate) fn request_url(url: &str) -> String {
    let Some(Components { scheme, host, path, query, .. }) = Components::parse(url) else {
        return url.into();
    };
    let [path, query] = [path, query].map(|part| utf8_percent_encode(part, FORBIDDEN));
    format!("{scheme}://{host}{path}{query}")
}

/// The URL of the path `entry` relative to the folder of the URL `base`, without user name, password, query
/// and fragment of `base`. The path is written as on disk: characters with a meaning in URLs are encoded.
pub(crate) fn join(base: &str, entry: &str) -> String {
    let Some(base) = Components::parse(base) else { return entry.into() };
    let folder = if entry.starts_with('/') { "" } else { base.folder() };
    let entry = entry.split('/').filter(|part| !part.is_empty()).map(|part| match part {
        "." | ".." => part.into(),
        part => utf8_percent_encode(part, RESERVED).to_string(),
    });
    let path = format!("{folder}/{}", entry.collect::<Vec<_>>().join("/"));
    format!("{}://{}{}", base.scheme, base.host, without_dots(&path))
}

/// The URL that `reference`, of a redirect from the URL `base`, stands for. It has no fragment; a user name and a
/// password come from `reference` alone.
#[cfg(feature = "net")]
pub(crate) fn resolve(base: &str, reference: &str) -> String {
    let reference = reference.split('#').next().unwrap_or_default();
    let Some(base) = Components::parse(base).filter(|_| scheme(reference).is_none()) else {
        return reference.into();
    };
    let Components { scheme, host, path, query, .. } = base;
    if reference.starts_with("//") {
        return format!("{scheme}:{reference}");
    }
    if reference.is_empty() {
        return format!("{scheme}://{host}{path}{query}");
    }
    let (reference, query) = reference.split_at(reference.find('?').unwrap_or(reference.len()));
    let path = match reference {
        "" => path.to_owned(),
        path if path.starts_with('/') => without_dots(path),
        path => without_dots(&format!("{}/{path}", base.folder())),
    };
    format!("{scheme}://{host}{path}{query}")
}

/// An absolute path without dot segments (RFC 3986, 5.2.4). Empty segments stay.
fn without_dots(path: &str) -> String {
    let mut kept = Vec::new();
    let mut segments = path.strip_prefix('/').unwrap_or(path).split('/').peekable();
    while let Some(segment) = segments.next() {
        match segment {
            "." => {}
            ".." => drop(kept.pop()),
            segment => {
                kept.push(segment);
                continue;
            }
        }
        // It stands for a folder.
        if segments.peek().is_none() {
            kept.push("");
        }
    }
    format!("/{}", kept.join("/"))
}

/// The URL `name` for logs, messages and titles: without user name, password, query and fragment, which may be secret;
/// only its scheme if they cannot be told from the host. A path as it is.
pub(crate) fn redacted(name: &str) -> String {
    let Some(Components { scheme, user_info, host, path, .. }) = Components::parse(name) else {
        return name.into();
    };
    let (host_name, port) = split_port(host);
    let is_host = host_name.chars().all(|c| c.is_alphanumeric() || ".-_~%[]:".contains(c))
        && (host_name.starts_with('[') || !host_name.contains(':'))
        && port.chars().all(|c| c.is_ascii_digit());
    // A question mark or number sign in a password ends the host too early.
    let is_cut = user_info.is_none() && path.is_empty() && name.contains('@');
    match is_host && !is_cut {
        true => format!("{scheme}://{host}{path}"),
        false => format!("{scheme}://..."),
    }
}

/// The file name of a clip, which titles it; "demo" for the built-in clip.
pub(crate) fn title(name: Option<&str>) -> String {
    let Some(name) = name else { return "demo".into() };
    let path = redacted(name);
    let file = Path::new(&path).file_name().map(|file| file.to_string_lossy().into_owned());
    file.unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_is_titled_by_its_file_name() {
        assert_eq!(title(Some("a/b/clip.aarc")), "clip.aarc");
        assert_eq!(title(Some("..")), "..");
        assert_eq!(title(Some("https://host/a/clip.aarc?key=secret#t")), "clip.aarc");
    }

    #[test]
    fn urls_differ_from_paths() {
        for name in ["http://a/b.aarc", "https://a", "HTTPS://A"] {
            assert!(is_url(name), "{name}");
        }
        for name in ["a.aarc", "/https://a", "http:/a", "ftp://a", "https", "\u{e9}\u{e9}\u{e9}\u{e9}"] {
            assert!(!is_url(name), "{name}");
        }
        for name in ["ftp://a", "file:///a", "content://a/b"] {
            assert!(scheme(name).is_some(), "{name}");
        }
        for name in ["a.aarc", "c:/a", "c://a", "a b://c", "://a", "1a://b", "data:a"] {
            assert_eq!(scheme(name), None, "{name}");
        }
        assert!(is_secure("HTTPS://a") && !is_secure("http://a") && !is_secure("a"));
        assert!(
            has_user_info("http://a@b") && has_user_info("http://a:c@b/d") && !has_user_info("http://b/a@d")
        );
    }

    #[test]
    fn printed_urls_have_no_secrets() {
        for (url, printed) in [
            ("https://ann:pass@host:8443/a/b.aarc?key=1#x", "https://host:8443/a/b.aarc"),
            ("http://host", "http://host"),
            ("http://host/a@b", "http://host/a@b"),
            ("http://[::1]:80/a?key", "http://[::1]:80/a"),
            ("http://[::1]?key", "http://[::1]"),
            ("ftp://ann:pass@host/a?key", "ftp://host/a"),
            // A password with characters that should have been encoded.
            ("https://ann:pa/ss@host/a", "https://..."),
            ("https://ann:pa?ss@host/a", "https://..."),
            ("https://ann:pa#ss@host/a", "https://..."),
            ("https://ann:12#ss@host/a", "https://..."),
            ("https://ann:pa@ss@host/a", "https://host/a"),
            ("a/b?c#d@e", "a/b?c#d@e"),
        ] {
            assert_eq!(redacted(url), printed, "{url}");
        }
    }

    #[test]
    #[cfg(feature = "net")]
    fn references_are_resolved_against_a_url() {
        let resolved = |reference: &str| resolve("https://ann:x@h:8/a/b/c?q=1", reference);
        for (reference, url) in [
            ("http://o/d?e#f", "http://o/d?e"),
            ("//o/d", "https://o/d"),
            ("/d/../e?g", "https://h:8/e?g"),
            ("d", "https://h:8/a/b/d"),
            ("../d/", "https://h:8/a/d/"),
            ("../../../..", "https://h:8/"),
            ("?z", "https://h:8/a/b/c?z"),
            ("#f", "https://h:8/a/b/c?q=1"),
            ("ftp://o/d", "ftp://o/d"),
            // An empty segment is one like any other.
            ("/proxy/https://o//d/../e/", "https://h:8/proxy/https://o//e/"),
            ("d//../e/.", "https://h:8/a/b/d/e/"),
        ] {
            assert_eq!(resolved(reference), url, "{reference}");
        }
        assert_eq!(resolve("http://h", "a"), "http://h/a");
    }

    #[test]
    #[cfg(feature = "net")]
    fn a_request_has_no_secrets_and_only_characters_of_urls() {
        for (url, requested) in [
            ("https://ann:x@h:8/a%20b?key=1&c=d#e", "https://h:8/a%20b?key=1&c=d"),
            (
                "http://h/t\u{e4}nze und mehr.aarc?q={1 2}",
                "http://h/t%C3%A4nze%20und%20mehr.aarc?q=%7B1%202%7D",
            ),
            ("http://h/it's^2|.aarc?a='^'", "http://h/it%27s%5E2%7C.aarc?a=%27%5E%27"),
            ("http://h", "http://h"),
            ("a b", "a b"),
        ] {
            assert_eq!(request_url(url), requested, "{url}");
        }
        for (url, host) in
            [("http://ann@h.o:8/a", "h.o"), ("http://[::1]:8/a", "::1"), ("http://[::1]", "::1")]
        {
            assert_eq!(host_name(url), Some(host), "{url}");
        }
    }

    #[test]
    fn paths_are_joined_to_the_folder_of_a_url() {
        let joined = |entry: &str| join("https://ann:x@h:8/shows/x%20y/today.json?key=a/b", entry);
        for (entry, url) in [
            ("a.aarc", "https://h:8/shows/x%20y/a.aarc"),
            ("../b/c d#1.aarc", "https://h:8/shows/b/c%20d%231.aarc"),
            ("/e.aarc", "https://h:8/e.aarc"),
            ("//e//f.aarc", "https://h:8/e/f.aarc"),
            ("../../../a.aarc", "https://h:8/a.aarc"),
            ("./ä/100%.aarc", "https://h:8/shows/x%20y/%C3%A4/100%25.aarc"),
            ("take (1)+[it's].aarc", "https://h:8/shows/x%20y/take%20(1)%2B%5Bit%27s%5D.aarc"),
        ] {
            assert_eq!(joined(entry), url, "{entry}");
            #[cfg(any(feature = "net", feature = "xr"))]
            assert_eq!(request_url(url), url);
        }
    }
}
