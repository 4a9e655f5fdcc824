//! `cargo xtask report`: builds the host tool with its feature `measure`, optimised, and hands the
//! command line over.

use std::env;
use std::process::{Command, ExitCode};

use studio::cli;
use xtask::workspace;

pub(crate) fn run() -> ExitCode {
    let status = || -> anyhow::Result<Option<i32>> {
        let program = workspace::build_with("studio", "aarc-studio", "measure", "release")?;
        Ok(Command::new(program).args(env::args_os().skip(1)).status()?.code())
    };
    match status() {
        // A program that a signal ended has no code.
        Ok(code) => code.and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from),
        Err(error) => cli::exit_code(Err(error)),
    }
}
