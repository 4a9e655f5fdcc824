//! What the programs share: [`Fault`] with its exit code, how a command line is parsed, `run`, which ends a
//! program with an exit code, [`output`] files written completely or not at all, [`images`] of a run,
//! camera files, and the man page and completions that `generate` renders from a command line.

#![forbid(unsafe_code)]

#[cfg(feature = "camera")]
mod camera;
mod fault;
#[cfg(not(target_os = "android"))]
pub mod generate;
pub mod images;
#[cfg(feature = "camera")]
mod lens;
pub mod output;
#[cfg(not(target_os = "android"))]
mod run;
#[cfg(feature = "camera")]
mod subject;
mod text;
mod usage;

#[cfg(feature = "camera")]
pub use camera::read_camera;
pub use fault::{Fault, exit_code};
#[cfg(feature = "camera")]
pub use lens::{Lens, Standpoint};
#[cfg(not(target_os = "android"))]
pub use run::run;
#[cfg(feature = "camera")]
pub use subject::Subject;
pub use text::{counted, read_error};
#[cfg(not(target_os = "android"))]
pub use usage::parse;
pub use usage::usage_line;

/// Ends the program silently when the reader of its output stops, as `head` does. Rust's default would
/// make that a panic in `println!`.
#[cfg(not(target_os = "android"))]
pub fn exit_on_closed_pipe() {
    #[cfg(unix)]
    sigpipe::reset();
}
