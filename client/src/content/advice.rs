//! [`advice`]: the end of a message about a package.

use codec::Error;

/// What to do about a package that cannot be decoded; `again` is what to do about a damaged one.
pub(crate) fn advice(error: &Error, again: &'static str) -> &'static str {
    match error {
        Error::Format { .. } => again,
        Error::Version { .. } => "update the player, or package the field again",
        Error::Limits { .. } => "package it with a smaller --budget",
    }
}
