//! A small stage, fits of it, and how well they show it.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::{TempDir, tempdir};

use crate::tool::{aarc_studio, outcome};

/// A folder with a stage of eight cameras and five frames.
pub(crate) fn stage() -> TempDir {
    stage_of("5")
}

/// A folder with a stage of eight cameras. The motion takes the whole clip: more frames are closer together.
pub(crate) fn stage_of(frames: &str) -> TempDir {
    let folder = tempdir().unwrap();
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "8", "--frames", frames, "--size", "48x48"];
    assert_eq!(aarc_studio(folder.path(), &stage).code, Some(0));
    folder
}

/// Fits it to `field.ply`.
pub(crate) fn fit(folder: &Path, more: &[&str]) -> Value {
    let args = [&["fit", "stage", "-o", "field.ply", "--sh-degree", "0", "--holdout", "odd", "--json"], more]
        .concat();
    aarc_studio(folder, &args).json()
}

/// Starts the tool in `folder`.
pub(crate) fn start(folder: &Path, args: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_aarc-studio"));
    command.current_dir(folder).args(args).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

pub(crate) fn wait_for(path: &Path) {
    let start = Instant::now();
    while !path.exists() {
        assert!(start.elapsed() < Duration::from_secs(240), "{} is not there", path.display());
        thread::sleep(Duration::from_millis(2));
    }
}

/// Runs the tool in `folder` and kills it as soon as `is_ready`, unless it ended before.
pub(crate) fn kill_when(folder: &Path, args: &[&str], is_ready: impl Fn() -> bool) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_aarc-studio"))
        .current_dir(folder)
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !is_ready() && child.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < Duration::from_secs(240), "not ready after {:?}", start.elapsed());
        thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

/// PSNR of the subject in a split.
pub(crate) fn measured(folder: &Path, split: &str) -> f64 {
    psnr_of("field.ply", folder, split)
}

/// PSNR of the subject of the field folder `field` in the photographs that were fitted to.
pub(crate) fn measured_take(folder: &Path) -> f64 {
    psnr_of("field", folder, "train")
}

/// The files of the field folder `field`.
pub(crate) fn field_files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    outcome::contents(&folder.join("field"))
}

/// PSNR of the subject of a field file or folder in a split.
pub(crate) fn psnr_of(field: &str, folder: &Path, split: &str) -> f64 {
    let json = aarc_studio(folder, &["eval", field, "--capture", "stage", "--json"]).json();
    json["splits"][split]["psnr_fg"].as_f64().unwrap()
}
