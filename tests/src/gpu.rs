//! Tests that draw with the GPU, and are ignored where there is none.

use std::process::ExitCode;

use client::gpu::Gpu;
use libtest_mimic::{Arguments, Completion, Failed, Trial};
pub use measure::device::{Drawing, Passes, device, draw};

/// A test that needs a device, and several where it needs them at once: ignored where there is
/// none.
pub fn trial(
    name: impl Into<String>,
    passes: Passes,
    test: impl FnOnce(&'static Gpu) -> Result<(), String> + Send + 'static,
) -> Trial {
    Trial::ignorable_test(name, move || match device(passes) {
        Ok(gpu) => test(gpu).map(|()| Completion::Completed).map_err(Failed::from),
        Err(fault) => Ok(Completion::ignored_with(fault)),
    })
}

/// A test of a device that draws both eyes in one pass: ignored where it cannot.
pub fn multiview_trial(
    name: impl Into<String>,
    test: impl FnOnce(&'static Gpu) -> Result<(), String> + Send + 'static,
) -> Trial {
    Trial::ignorable_test(name, move || match device(Passes::Shared) {
        Ok(gpu) if gpu.caps.multiview => test(gpu).map(|()| Completion::Completed).map_err(Failed::from),
        Ok(gpu) => {
            let (adapter, driver) = (&gpu.adapter_name, &gpu.driver);
            Ok(Completion::ignored_with(format!("{adapter}, {driver}, does not draw multiview right")))
        }
        Err(fault) => Ok(Completion::ignored_with(fault)),
    })
}

/// Runs the tests of a file as the standard harness would.
pub fn run(trials: Vec<Trial>) -> ExitCode {
    run_with(Arguments::from_args(), trials)
}

/// The same, one after the other.
pub fn run_in_turn(trials: Vec<Trial>) -> ExitCode {
    run_with(Arguments { test_threads: Some(1), ..Arguments::from_args() }, trials)
}

fn run_with(arguments: Arguments, trials: Vec<Trial>) -> ExitCode {
    if !arguments.list
        && let Ok(gpu) = device(Passes::Shared)
    {
        println!("\ndrawing with {}, {}", gpu.adapter_name, gpu.driver);
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}
