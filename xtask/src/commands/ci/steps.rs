//! [`Steps`]: runs the steps of `cargo xtask ci` and collects their outcomes.

use std::fmt::Display;
use std::process::{Command, Stdio};
use std::time::Instant;

/// The outcomes of the steps so far.
#[derive(Default)]
pub(super) struct Steps {
    /// Print the output of a step when it has ended, not between the output of other steps.
    pub(super) is_captured: bool,
    pub(super) failed: Vec<String>,
    pub(super) skipped: Vec<String>,
}

impl Steps {
    /// Runs a step and returns whether it passed.
    pub(super) fn run(&mut self, name: &str, command: &mut Command) -> bool {
        let start = Instant::now();
        eprintln!("ci: {name}");
        command.stdin(Stdio::null());
        let status = if self.is_captured {
            command.output().map(|output| {
                eprint!("{}", String::from_utf8_lossy(&[output.stdout, output.stderr].concat()));
                output.status
            })
        } else {
            command.status()
        };
        let passed = status.is_ok_and(|status| status.success());
        let seconds = start.elapsed().as_secs_f64();
        eprintln!("ci: {name}: {} after {seconds:.1} s", if passed { "ok" } else { "FAILED" });
        if !passed {
            self.failed.push(name.to_owned());
        }
        passed
    }

    /// Adds the outcomes of other steps.
    pub(super) fn extend(&mut self, others: Steps) {
        self.failed.extend(others.failed);
        self.skipped.extend(others.skipped);
    }

    /// Records and prints a failure.
    pub(super) fn fail(&mut self, name: &str, error: &impl Display) {
        eprintln!("ci: {name}: FAILED: {error:#}");
        self.failed.push(name.to_owned());
    }

    /// Records a step that cannot run, and why.
    pub(super) fn skip(&mut self, name: &str, reason: &str) {
        self.skipped.push(format!("{name}: {reason}"));
    }
}
