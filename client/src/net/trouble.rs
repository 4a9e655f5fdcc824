//! [`Trouble`]: why an exchange with a server failed, and whether it may go better.

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
