//! How the programs of this crate end: as those of the workspace do.

use std::process::ExitCode;

use program::Fault;

/// Success, or the sentence on standard error and the exit code of its kind.
pub fn code(outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    eprintln!("error: {error:#}");
    ExitCode::from(error.downcast_ref::<Fault>().map_or(1, Fault::exit_code))
}
