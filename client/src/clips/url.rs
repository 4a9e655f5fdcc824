//! URLs of clips and playlists: how to recognise one, and how to print one.

use std::path::Path;

/// Whether `name` is an `http` or `https` URL rather than a path.
pub(crate) fn is_url(name: &str) -> bool {
    let starts = |scheme: &str| name.get(..scheme.len()).is_some_and(|s| s.eq_ignore_ascii_case(scheme));
    starts("http://") || starts("https://")
}

/// `url` without user name, password, query and fragment, any of which may be secret.
pub(crate) fn redacted(url: &str) -> String {
    let url = url.split(['?', '#']).next().unwrap_or_default();
    let Some((scheme, rest)) = url.split_once("://") else { return url.into() };
    let (host, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
    format!("{scheme}://{}{path}", host.rsplit('@').next().unwrap_or_default())
}

/// A path as it is, or a URL without its secrets.
pub(crate) fn printable(name: &str) -> String {
    if is_url(name) { redacted(name) } else { name.to_owned() }
}

/// The file name of a clip, which titles it; "demo" for the built-in clip.
pub(crate) fn title(name: Option<&str>) -> String {
    let Some(name) = name else { return "demo".into() };
    let path = printable(name);
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
    }

    #[test]
    fn redacted_urls_have_no_secrets() {
        assert_eq!(redacted("https://ann:pass@host:8443/a/b.aarc?key=1#x"), "https://host:8443/a/b.aarc");
        assert_eq!(redacted("http://host"), "http://host");
        assert_eq!(redacted("http://host/a@b"), "http://host/a@b");
    }
}
