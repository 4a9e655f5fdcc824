//! `cargo xtask test`: every test that this machine can run.
//!
//! Cargo's output is passed on as it comes, and closed with a list of what was not tested and why,
//! and one line of totals. A test that cannot run here is *ignored*, never passed: tests that need
//! a graphics adapter or a display report that themselves; a test that lacks its data prints a
//! line that starts with `skipped:`, and is counted among the ignored.

use std::io::{BufRead, BufReader, Write, stdout};
use std::process::{ExitStatus, Stdio};
use std::time::Instant;

use anyhow::{Context, bail};
use xtask::workspace;

use crate::setup::{self, Need};

/// Run every test that this machine can run.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    setup::satisfy(&[
        (Need::Vulkan, "tests that draw with the GPU are ignored"),
        (Need::WindowLibraries, "tests of the window are ignored"),
        (Need::VirtualDisplay, "tests of the window are ignored"),
        (Need::Slurm, "the test of a job array is ignored"),
    ]);
    let start = Instant::now();
    let mut tally = Tally::default();
    let passed = run_tests(&mut tally)?.success();
    println!("{}", tally.report(passed, start.elapsed().as_secs_f64()));
    if !passed {
        bail!("{}", if tally.failed > 0 { "tests failed" } else { "the tests could not be built or run" });
    }
    Ok(())
}

/// Runs all tests of the workspace and counts them.
fn run_tests(tally: &mut Tally) -> anyhow::Result<ExitStatus> {
    let mut cargo = workspace::cargo()
        .args(["test", "--workspace", "--features", workspace::FEATURES])
        .args(["--no-fail-fast", "--", "--show-output"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot run cargo")?;
    for line in BufReader::new(cargo.stdout.take().expect("piped")).split(b'\n') {
        let line = line.context("cannot read the output of the tests")?;
        let line = String::from_utf8_lossy(&line);
        if tally.read(&line) {
            println!("{line}");
            stdout().flush()?;
        }
    }
    Ok(cargo.wait()?)
}

/// What the lines of a test run say.
#[derive(Debug, Default, PartialEq)]
struct Tally {
    passed: usize,
    failed: usize,
    /// Tests that did not test anything, with the reason that they gave.
    ignored: Vec<(String, String)>,
    /// The test whose output is being read, inside the list of outputs of passed tests.
    output_of: Option<String>,
}

impl Tally {
    /// Takes in the next line; whether it is worth showing. The outputs of passed tests are not.
    fn read(&mut self, line: &str) -> bool {
        if line.starts_with("test result: ") || line == "failures:" {
            self.output_of = None;
        } else if line == "successes:" {
            self.output_of = Some(String::new());
        }
        let Some(test) = &mut self.output_of else {
            self.read_outcome(line);
            return true;
        };
        if let Some(name) = line.strip_prefix("---- ").and_then(|rest| rest.strip_suffix(" stdout ----")) {
            *test = name.to_owned();
        } else if let Some(reason) = line.strip_prefix("skipped: ") {
            let name = test.clone();
            // A test may give several reasons; it was counted as passed once.
            if self.ignored.last().is_none_or(|(last, _)| *last != name) {
                self.passed = self.passed.saturating_sub(1);
                self.ignored.push((name, reason.to_owned()));
            }
        }
        false
    }

    /// Reads `test NAME ... OUTCOME`, as the standard harness and its substitute print it.
    fn read_outcome(&mut self, line: &str) {
        let Some((name, outcome)) = line.strip_prefix("test ").and_then(|rest| rest.split_once(" ... "))
        else {
            return;
        };
        if outcome == "ok" {
            self.passed += 1;
        } else if outcome == "FAILED" {
            self.failed += 1;
        } else if let Some(reason) = outcome.strip_prefix("ignored") {
            let reason = reason.trim_matches([',', ' ', '(', ')']);
            let reason = if reason.is_empty() { "marked so in its source" } else { reason };
            self.ignored.push((name.trim().to_owned(), reason.to_owned()));
        }
    }

    /// What was not tested and why, and the totals as Cargo words them.
    fn report(&self, success: bool, seconds: f64) -> String {
        let mut text = String::new();
        let mut reasons: Vec<&str> = self.ignored.iter().map(|(_, reason)| reason.as_str()).collect();
        reasons.sort_unstable();
        reasons.dedup();
        if !reasons.is_empty() {
            text.push_str("\nnot tested here:\n");
        }
        for reason in reasons {
            let names: Vec<&str> =
                self.ignored.iter().filter(|(_, r)| r == reason).map(|(name, _)| name.as_str()).collect();
            text.push_str(&format!("    {reason}: {}\n", names.join(", ")));
        }
        let outcome = if success { "ok" } else { "FAILED" };
        text.push_str(&format!(
            "\ntest result: {outcome}. {} passed; {} failed; {} ignored; 0 measured; 0 filtered out; finished in {seconds:.2}s\n",
            self.passed,
            self.failed,
            self.ignored.len()
        ));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_are_counted_and_outputs_of_passed_tests_left_out() {
        let output = "\
running 6 tests
test a::quick ... ok
test a::with_data ... ok
test matrix/sh3     ... ignored (no adapter)
test slow ... ignored, takes an hour
test plain ... ignored
test bad ... FAILED

successes:

---- a::with_data stdout ----
some chatter
skipped: no folder of data
skipped: no second folder


successes:
    a::quick
    a::with_data

failures:

---- bad stdout ----
it broke

failures:
    bad

test result: FAILED. 2 passed; 1 failed; 3 ignored; 0 measured; 0 filtered out; finished in 0.00s";
        let mut tally = Tally::default();
        let shown: Vec<&str> = output.lines().filter(|line| tally.read(line)).collect();
        assert!(shown.contains(&"it broke") && shown.last().unwrap().starts_with("test result: FAILED"));
        assert!(!shown.contains(&"some chatter"));
        assert_eq!((tally.passed, tally.failed), (1, 1));
        let report = tally.report(false, 1.5);
        for expected in [
            "no adapter: matrix/sh3\n",
            "takes an hour: slow\n",
            "marked so in its source: plain\n",
            "no folder of data: a::with_data\n",
            "test result: FAILED. 1 passed; 1 failed; 4 ignored; 0 measured; 0 filtered out; finished in 1.50s\n",
        ] {
            assert!(report.contains(expected), "{expected:?} is not in {report}");
        }
    }
}
