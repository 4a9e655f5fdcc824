//! The player's modules that its transfers use for messages.

#[path = "../../../client/src/clips/progress.rs"]
#[allow(unreachable_pub, reason = "a module of the player")]
mod progress;
#[path = "../../../client/src/clips/url.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod url;

pub use progress::Progress;
pub(crate) use url::redacted;
