//! `aarc-studio`: the host tool, which makes, inspects and renders packages.

use std::process::ExitCode;

use studio::cli::{self, Cli};

/// Counts the heap for the stability suite.
#[cfg(feature = "measure")]
#[global_allocator]
static HEAP: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

fn main() -> ExitCode {
    program::exit_on_closed_pipe();
    let cli: Cli = match program::parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    program::run(|| cli.run(), cli::exit_code)
}
