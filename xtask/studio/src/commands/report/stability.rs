//! Runs the stability suite, and gathers what it prints.

use std::path::PathBuf;

use crate::machine::machine;
use crate::report::stability::{Header, Row, Stability};
use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};

use super::program;

/// Runs all cases, and one along each of `fields`.
pub(super) fn run(fields: &[PathBuf]) -> anyhow::Result<Stability> {
    // Drawn on a terminal's standard error only.
    let bar = ProgressBar::new(1).with_style(ProgressStyle::with_template("{bar:30} {pos} of {len}  {msg}")?);
    let mut header: Option<Header> = None;
    let mut rows: Vec<Row> = Vec::new();
    program::run("stability", "dev", fields, |line| {
        if header.is_none() {
            let first: Header = serde_json::from_str(line)?;
            bar.set_length(first.cases as u64);
            header = Some(first);
            return Ok(());
        }
        rows.push(serde_json::from_str(line)?);
        bar.inc(1);
        bar.set_message(rows[rows.len() - 1].case.clone());
        Ok(())
    })?;
    bar.finish_and_clear();
    let Header { adapter, driver, .. } = header.context("the stability suite said nothing")?;
    Ok(Stability { machine: machine(), adapter, driver, stability: rows })
}
