//! [`RequestError`]: why a request failed, and whether a retry may succeed.

/// Why a request failed, as a sentence for the viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum RequestError {
    /// A retry may succeed.
    Transient(String),
    /// The server's name does not resolve. Transient if it resolved before.
    UnknownHost(String),
    /// On this network, at the time of this clock, nothing leads to the server: its certificate is not trusted, or a
    /// proxy refuses.
    Blocked(String),
    /// A retry will not succeed.
    Permanent(String),
}

impl RequestError {
    /// The sentence.
    pub(super) fn text(self) -> String {
        let (RequestError::Transient(text)
        | RequestError::UnknownHost(text)
        | RequestError::Blocked(text)
        | RequestError::Permanent(text)) = self;
        text
    }
}
