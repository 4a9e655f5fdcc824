//! Tests that draw with the GPU and are ignored on machines without one.

use std::process::ExitCode;

use client::gpu::Gpu;
use libtest_mimic::{Arguments, Completion, Failed, Trial};
use measure::device::Fragments;
pub use measure::device::{Drawing, Passes, draw};
use program::Fault;

/// The device of this machine, with a fragment stage in f32.
///
/// # Errors
/// Why there is none.
pub fn device(passes: Passes) -> Result<&'static Gpu, Fault> {
    measure::device::device(passes, Fragments::Single)
}

/// A test that draws with the GPU: ignored where there is no device.
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

/// A test of drawing both eyes in one pass: ignored where the device cannot.
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

/// A test of the fragment stage in f16: ignored where the device has no f16.
pub fn f16_trial(
    name: impl Into<String>,
    test: impl FnOnce() -> Result<(), String> + Send + 'static,
) -> Trial {
    Trial::ignorable_test(name, move || if_f16(test))
}

/// Runs a test of the fragment stage in f16, where the device has f16.
pub(crate) fn if_f16(test: impl FnOnce() -> Result<(), String>) -> Result<Completion, Failed> {
    match device(Passes::Shared) {
        Ok(gpu) if gpu.has_f16() => test().map(|()| Completion::Completed).map_err(Failed::from),
        Ok(gpu) => Ok(Completion::ignored_with(format!("{} has no f16", gpu.adapter_name))),
        Err(fault) => Ok(Completion::ignored_with(fault)),
    }
}

/// Runs the tests of several files as the standard harness does. Each test is listed, and can be
/// filtered, by the name of its file as well.
pub fn run<const N: usize>(files: [(&str, Vec<Trial>); N]) -> ExitCode {
    run_with(Arguments::from_args(), files)
}

/// Runs the tests of several files one after the other.
pub fn run_in_turn<const N: usize>(files: [(&str, Vec<Trial>); N]) -> ExitCode {
    run_with(Arguments { test_threads: Some(1), ..Arguments::from_args() }, files)
}

fn run_with<const N: usize>(arguments: Arguments, files: [(&str, Vec<Trial>); N]) -> ExitCode {
    if !arguments.list
        && let Ok(gpu) = device(Passes::Shared)
    {
        println!("\ndrawing with {}, {}", gpu.adapter_name, gpu.driver);
    }
    let trials =
        files.into_iter().flat_map(|(file, trials)| trials.into_iter().map(move |t| t.with_kind(file)));
    libtest_mimic::run(&arguments, trials.collect()).exit_code()
}
