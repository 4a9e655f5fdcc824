//! Tests with real data, which lies beside the repository.

use std::path::PathBuf;

use client::gpu::Gpu;
use libtest_mimic::{Completion, Failed, Trial};

use crate::gpu::{Passes, device, if_f16};

/// Path of a file in the data folder beside the repository; `None` if it does not exist.
pub fn path(name: &str) -> Option<PathBuf> {
    let path = xtask::workspace::root().join("../shared/data").join(name);
    path.exists().then_some(path)
}

/// A test that needs a data file: ignored if it is missing.
pub fn cpu_trial(
    name: &str,
    data: &'static str,
    test: impl FnOnce(PathBuf) -> Result<(), String> + Send + 'static,
) -> Trial {
    with_file(name, data, move |path| test(path).map(|()| Completion::Completed).map_err(Failed::from))
}

/// A test that needs a device and a data file: ignored if either is missing.
pub fn trial(
    name: &str,
    data: &'static str,
    test: impl FnOnce(&'static Gpu, PathBuf) -> Result<(), String> + Send + 'static,
) -> Trial {
    with_file(name, data, move |path| match device(Passes::Shared) {
        Ok(gpu) => test(gpu, path).map(|()| Completion::Completed).map_err(Failed::from),
        Err(fault) => Ok(Completion::ignored_with(fault)),
    })
}

/// A test of the fragment stage in f16 that needs a data file: ignored where the device has no f16, or the file is
/// missing.
pub fn f16_trial(
    name: &str,
    data: &'static str,
    test: impl FnOnce(PathBuf) -> Result<(), String> + Send + 'static,
) -> Trial {
    with_file(name, data, move |path| if_f16(|| test(path)))
}

fn with_file(
    name: &str,
    data: &'static str,
    test: impl FnOnce(PathBuf) -> Result<Completion, Failed> + Send + 'static,
) -> Trial {
    Trial::ignorable_test(name, move || match path(data) {
        Some(path) => test(path),
        None => Ok(Completion::ignored_with(format!("../shared/data/{data} is not there"))),
    })
}
