//! `cargo xtask test`: every test that this machine can run.
//!
//! Streams Cargo's output, then lists the ignored tests with their reasons, and the totals. A test that
//! cannot run here is *ignored*, never passed: tests that need a graphics adapter or a display report
//! that themselves; a test without its data prints a line that starts with `skipped:` and counts as
//! ignored.

use std::env;
use std::io::{BufRead, BufReader, Write, stdout};
use std::process::{ExitStatus, Stdio};
use std::time::Instant;

use anyhow::{Context, bail};
use xtask::workspace;

use crate::setup::{self, Need, SetupArgs};

/// Run every test that this machine can run
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    setup: SetupArgs,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let needs = [
        (Need::SoundHeaders, "the player cannot be built"),
        (Need::Vulkan, "tests that draw with the GPU are ignored"),
        (Need::WindowLibraries, "tests of the window are ignored"),
        (Need::VirtualDisplay, "tests of the window are ignored"),
        (Need::Slurm, "the tests of job arrays are ignored"),
        (Need::Ffmpeg, "the tests of videos are ignored"),
    ];
    if !setup::satisfy(&args.setup, &needs) {
        return Ok(());
    }
    let start = Instant::now();
    let mut totals = Totals::default();
    let passed = run_tests(&mut totals)?.success();
    println!("{}", totals.report(passed, start.elapsed().as_secs_f64()));
    if !passed {
        bail!("{}", if totals.failed > 0 { "tests failed" } else { "the tests could not be built or run" });
    }
    Ok(())
}

/// Runs and counts all tests of the workspace.
fn run_tests(totals: &mut Totals) -> anyhow::Result<ExitStatus> {
    let library = workspace::onnx_library().filter(|_| env::var_os("ORT_DYLIB_PATH").is_none());
    let mut cargo = workspace::cargo()
        .envs(library.map(|library| ("ORT_DYLIB_PATH", library)))
        .args(["test", "--workspace", "--features", workspace::FEATURES])
        .args(["--no-fail-fast", "--", "--show-output"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot run cargo")?;
    for line in BufReader::new(cargo.stdout.take().expect("piped")).split(b'\n') {
        let line = line.context("cannot read the output of the tests")?;
        let line = String::from_utf8_lossy(&line);
        if totals.read(&line) {
            println!("{line}");
            stdout().flush()?;
        }
    }
    Ok(cargo.wait()?)
}

/// Totals of a test run, read from its output.
#[derive(Debug, Default, PartialEq)]
struct Totals {
    passed: usize,
    failed: usize,
    /// Ignored tests with their reasons.
    ignored: Vec<(String, String)>,
    /// Test of the current output, inside the list of outputs of passed tests.
    output_of: Option<String>,
}

impl Totals {
    /// Reads the next line. Returns whether to show it: outputs of passed tests are hidden.
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
            // A test may print several reasons, but was counted as passed once.
            if self.ignored.last().is_none_or(|(last, _)| *last != name) {
                self.passed = self.passed.saturating_sub(1);
                self.ignored.push((name, reason.to_owned()));
            }
        }
        false
    }

    /// Reads `test NAME ... OUTCOME`, as the standard harness and libtest-mimic print it.
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

    /// The ignored tests with their reasons, and the totals in Cargo's words.
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
    fn outcomes_are_counted_and_outputs_of_passed_tests_hidden() {
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
        let mut totals = Totals::default();
        let shown: Vec<&str> = output.lines().filter(|line| totals.read(line)).collect();
        assert!(shown.contains(&"it broke") && shown.last().unwrap().starts_with("test result: FAILED"));
        assert!(!shown.contains(&"some chatter"));
        assert_eq!((totals.passed, totals.failed), (1, 1));
        let report = totals.report(false, 1.5);
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
