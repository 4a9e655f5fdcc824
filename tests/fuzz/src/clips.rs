//! The player's modules that its downloader uses.

#[path = "../../../client/src/clips/advice.rs"]
mod advice;

#[path = "../../../client/src/clips/progress.rs"]
#[allow(unreachable_pub, reason = "a module of the player")]
mod progress;

pub(crate) use advice::advice;
pub use progress::Progress;
