//! Builds a program of the package `aarc-tests`, which has a renderer, runs it, and hands on what it
//! prints.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::process::{ChildStderr, Command, Stdio};
use std::thread;

use anyhow::{Context, bail};
use program::Fault;

#[path = "../../../../src/workspace.rs"]
#[allow(dead_code, unreachable_pub, reason = "until measurement runs in this process")]
mod workspace;

/// Runs `program`, built by `profile`, and calls `on_line` with each line that it prints.
///
/// # Errors
/// [`Fault`] as the program says with its exit code, what `on_line` returns, and whatever else ends
/// the program early.
pub(super) fn run<A: AsRef<OsStr>>(
    program: &str,
    profile: &str,
    args: impl IntoIterator<Item = A>,
    mut on_line: impl FnMut(&str) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let path = workspace::build(program, profile)?;
    let mut child = Command::new(path)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot run {program}"))?;
    let printed = BufReader::new(child.stdout.take().expect("piped"));
    let said = child.stderr.take().expect("piped");
    let said = thread::spawn(|| error_of(said));
    // What is not read any more ends the program.
    let read = printed.lines().try_for_each(|line| on_line(&line?));
    let status = child.wait()?;
    let error = said.join().expect("no panic").unwrap_or_else(|| format!("{program} ended with {status}"));
    match status.code() {
        Some(2) => Err(Fault::Usage(error).into()),
        Some(3) => Err(Fault::Data(error).into()),
        Some(5) => Err(Fault::Device(error).into()),
        Some(0) => read,
        // If nobody could use what it printed, that is why it failed.
        _ => read.and_then(|()| bail!(error)),
    }
}

/// The sentence that a program ends with; whatever else it says goes on to standard error.
fn error_of(said: ChildStderr) -> Option<String> {
    let mut error = None;
    for line in BufReader::new(said).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line);
        match line.strip_prefix("error: ") {
            Some(sentence) => error = Some(sentence.trim_end().to_owned()),
            None => eprintln!("{line}"),
        }
    }
    error
}
