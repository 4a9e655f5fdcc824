//! Builds and runs the program of the stability suite, and gathers what it prints.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use xtask::fault::Fault;
use xtask::machine::machine;
use xtask::report::stability::{Header, Row, Stability};
use xtask::workspace;

/// Runs all cases, and one along each of `fields`.
pub(super) fn run(fields: &[PathBuf]) -> anyhow::Result<Stability> {
    let program = workspace::build("stability", "dev")?;
    let mut suite = Command::new(program)
        .args(fields)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot run the stability suite")?;
    let mut lines = BufReader::new(suite.stdout.take().expect("piped")).lines();
    let measured = lines.next().map(|line| -> anyhow::Result<Stability> {
        let header: Header = serde_json::from_str(&line?)?;
        let bar = ProgressBar::new(header.cases as u64);
        // Drawn on a terminal's standard error only.
        bar.set_style(ProgressStyle::with_template("{bar:30} {pos} of {len}  {msg}")?);
        let mut rows: Vec<Row> = Vec::new();
        for line in lines {
            rows.push(serde_json::from_str(&line?)?);
            bar.inc(1);
            bar.set_message(rows[rows.len() - 1].case.clone());
        }
        bar.finish_and_clear();
        let Header { adapter, driver, .. } = header;
        Ok(Stability { machine: machine(), adapter, driver, stability: rows })
    });
    let status = suite.wait()?;
    let no_device = i32::from(Fault::Device(String::new()).exit_code());
    match measured {
        Some(measured) if status.success() => measured,
        _ if status.code() == Some(no_device) => {
            Err(Fault::Device("no stability without a graphics device; its message is above".into()).into())
        }
        _ => bail!("the stability suite failed; its message is above: {status}"),
    }
}
