//! `aarc-studio`: the host tool, which makes, inspects and renders packages.

use std::process::ExitCode;

use clap::Parser;
use studio::cli::{self, Cli};

fn main() -> ExitCode {
    program::exit_on_closed_pipe();
    cli::exit_code(Cli::parse().command.run())
}
