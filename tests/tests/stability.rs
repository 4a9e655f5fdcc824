//! The stability suite as tests: each case within its bound, on the device of this machine.

use std::process::ExitCode;

use aarc_tests::gpu::{self, Passes};
use client::gpu::Gpu;
use measure::stability::{StabilityCase, cases, run};
use peak_alloc::PeakAlloc;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

fn main() -> ExitCode {
    let trial = |case: StabilityCase| {
        let name = format!("{}: {}", case.group, case.name);
        // `cargo xtask report --stability` runs those, too.
        let slow = case.slow;
        gpu::trial(name, Passes::Shared, move |gpu| holds(&case, gpu)).with_ignored_flag(slow)
    };
    // One after the other: they measure the heap.
    gpu::run_in_turn(cases().into_iter().map(trial).collect())
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
