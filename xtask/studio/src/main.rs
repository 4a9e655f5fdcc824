//! `aarc-studio`: the host tool, which makes, inspects and renders packages.

use std::process::ExitCode;

use clap::CommandFactory;
use studio::cli::Cli;

/// Counts the heap for the stability suite.
#[cfg(feature = "measure")]
#[global_allocator]
static HEAP: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

fn main() -> ExitCode {
    program::exit_on_closed_pipe();
    let cli: Cli = match program::parse(Cli::command()) {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    program::run(|| cli.run(), |error| program::exit_code(error.as_ref()))
}
