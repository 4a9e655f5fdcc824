//! The player's modules that its downloader uses.

#[path = "../../../client/src/clips/progress.rs"]
#[allow(unreachable_pub, reason = "a module of the player")]
mod progress;

pub use progress::Progress;
