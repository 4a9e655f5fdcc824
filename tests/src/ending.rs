//! How the programs of this crate end: as those of the workspace do.

use std::process::ExitCode;

/// Success, or the sentence on standard error and the exit code of its kind.
pub fn code(outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    eprintln!("error: {error:#}");
    let client = error.downcast_ref::<client::fault::Fault>().map(client::fault::Fault::exit_code);
    let xtask = || error.downcast_ref::<studio::fault::Fault>().map(studio::fault::Fault::exit_code);
    ExitCode::from(client.or_else(xtask).unwrap_or(1))
}
