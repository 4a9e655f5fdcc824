//! [`is_web_page`]: whether a server sends a web page in place of a file.

/// What to say of a web page, as networks send in place of anything else until the user logs in.
pub(crate) const WEB_PAGE: &str = "the server sends a web page: open the URL in a browser, the network may ask for a log-in, or name the URL of the file \
     itself";

/// Whether a file begins as HTML does, which neither packages nor playlists do.
pub(crate) fn is_web_page(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    bytes.trim_ascii_start().starts_with(b"<")
}
