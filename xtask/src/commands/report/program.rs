//! Builds a program of the package `aarc-tests`, which has a renderer, runs it, and hands on what it
//! prints.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use xtask::fault::Fault;
use xtask::workspace;

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
        .spawn()
        .with_context(|| format!("cannot run {program}"))?;
    let printed = BufReader::new(child.stdout.take().expect("piped"));
    // What is not read any more ends the program.
    let read = printed.lines().try_for_each(|line| on_line(&line?));
    let status = child.wait()?;
    let told = "its message is above".to_owned();
    match status.code() {
        Some(0) => read,
        Some(2) => Err(Fault::Usage(told).into()),
        Some(3) => Err(Fault::Data(told).into()),
        Some(5) => Err(Fault::Device(format!("no report without a graphics device: {told}")).into()),
        _ => bail!("{program} failed, {told}: {status}"),
    }
}
