//! The player's modules that its downloader uses.

#[path = "../../../client/src/clips/advice.rs"]
mod advice;

#[path = "../../../client/src/clips/progress.rs"]
#[allow(unreachable_pub, reason = "a module of the player")]
mod progress;

#[path = "../../../client/src/clips/source_options.rs"]
#[allow(dead_code, unreachable_pub, reason = "a module of the player, which uses the rest")]
mod source_options;

pub(crate) use advice::advice;
pub use progress::Progress;
pub(crate) use source_options::Servers;
