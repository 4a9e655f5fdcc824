//! The player's modules that its transfers use for messages, and to measure a server.

#[path = "../../../client/src/content/digest.rs"]
mod digest;
#[path = "../../../client/src/content/progress.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod progress;
#[path = "../../../client/src/content/url.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod url;

pub(crate) use digest::digest;
pub use progress::Progress;
pub(crate) use progress::Traffic;
pub(crate) use url::{redacted, request_url};
