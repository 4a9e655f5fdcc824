//! [`run`]: from the result of a program's work to its error line and exit code.

use std::fmt::Display;
use std::io::{Write, stderr};
use std::panic::{self, AssertUnwindSafe};
use std::process::ExitCode;

/// Does the work of a program: prints its error, if any, in one line, and returns the exit code, which `code_of` gives
/// for an error. A panic is a defect: its message is printed, and the exit code is 1.
pub fn run<E: Display>(work: impl FnOnce() -> Result<(), E>, code_of: impl Fn(&E) -> u8) -> ExitCode {
    match panic::catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(error)) => {
            // Nothing can be reported if standard error is closed.
            let _ = writeln!(stderr(), "error: {error:#}");
            ExitCode::from(code_of(&error))
        }
        Err(_) => ExitCode::FAILURE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Fault;

    #[test]
    fn success_faults_and_panics_have_exit_codes() {
        let code = |work: fn() -> Result<(), Fault>| run(work, Fault::exit_code);
        assert_eq!(code(|| Ok(())), ExitCode::SUCCESS);
        assert_eq!(code(|| Err(Fault::Network("nothing came".into()))), ExitCode::from(4));
        assert_eq!(code(|| panic!("a defect")), ExitCode::FAILURE);
    }
}
