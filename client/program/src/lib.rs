//! What the programs share: [`Fault`] with its exit code, `run`, which ends a program with it, [`output`]
//! files written completely or not at all, and the man page and completions that `generate` renders from
//! a command line.

#![forbid(unsafe_code)]

mod fault;
#[cfg(not(target_os = "android"))]
pub mod generate;
pub mod output;
#[cfg(not(target_os = "android"))]
mod run;

pub use fault::Fault;
#[cfg(not(target_os = "android"))]
pub use run::run;

/// Ends the program silently when the reader of its output stops, as `head` does. Rust's default would
/// make that a panic in `println!`.
#[cfg(not(target_os = "android"))]
pub fn exit_on_closed_pipe() {
    #[cfg(unix)]
    sigpipe::reset();
}
