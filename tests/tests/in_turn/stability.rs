//! The stability suite as tests: each case stays within its bound on this machine's device.

use aarc_tests::gpu::{self, Passes};
use client::gpu::Gpu;
use libtest_mimic::Trial;
use measure::stability::{StabilityCase, cases, run};

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let trial = |case: StabilityCase| {
        let name = format!("{}: {}", case.group, case.name);
        // `cargo xtask report --stability` runs slow ones too.
        let slow = case.slow;
        gpu::trial(name, Passes::Shared, move |gpu| holds(&case, gpu)).with_ignored_flag(slow)
    };
    cases().into_iter().map(trial).collect()
}

fn holds(case: &StabilityCase, gpu: &Gpu) -> Result<(), String> {
    let row = run(case, gpu);
    match row.problem {
        None => Ok(()),
        Some(problem) => Err(format!(
            "{problem}: {} {} where {} is allowed",
            row.deviation.map_or("none".into(), |deviation| deviation.to_string()),
            row.unit,
            row.bound
        )),
    }
}
