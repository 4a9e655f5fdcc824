//! Runs the stability suite.

use indicatif::{ProgressBar, ProgressStyle};
use measure::device::{Fragments, Passes, device};
use measure::stability::{along, cases, run_suite};

use crate::machine::machine;
use crate::report::ReportSubject;
use crate::report::stability::Stability;

/// Runs all cases, and one along each of `subjects`.
pub(super) fn run(subjects: &[ReportSubject]) -> anyhow::Result<Stability> {
    let gpu = device(Passes::Shared, Fragments::AsPlayers)?;
    let of_subject = |ReportSubject { scene, field, plate }: &ReportSubject| {
        along(&scene.name, &scene.info, field, plate.as_ref())
    };
    let cases: Vec<_> = cases().into_iter().chain(subjects.iter().map(of_subject)).collect();
    // Drawn only where standard error is a terminal.
    let style = ProgressStyle::with_template("{bar:30} {pos} of {len}  {msg}")?;
    let bar = ProgressBar::new(cases.len() as u64).with_style(style);
    let mut results = Vec::new();
    run_suite(cases, gpu, |result| {
        bar.inc(1);
        bar.set_message(result.case.clone());
        results.push(result);
    });
    bar.finish_and_clear();
    let (adapter, driver) = (gpu.adapter_name.clone(), gpu.driver.clone());
    Ok(Stability { machine: machine(), adapter, driver, stability: results })
}
