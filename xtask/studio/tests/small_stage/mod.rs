//! A small stage, fits of it, and how well they show it.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::Path;

use serde_json::Value;
use tempfile::{TempDir, tempdir};

use crate::tool::aarc_studio;

/// A folder with a stage of eight cameras and five frames.
pub(crate) fn stage() -> TempDir {
    let folder = tempdir().unwrap();
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "8", "--frames", "5", "--size", "48x48"];
    assert_eq!(aarc_studio(folder.path(), &stage).code, Some(0));
    folder
}

/// Fits it to `field.ply`.
pub(crate) fn fit(folder: &Path, more: &[&str]) -> Value {
    let args = [&["fit", "stage", "-o", "field.ply", "--sh-degree", "0", "--holdout", "odd", "--json"], more]
        .concat();
    aarc_studio(folder, &args).json()
}

/// PSNR of the subject in a split.
pub(crate) fn measured(folder: &Path, split: &str) -> f64 {
    let json = aarc_studio(folder, &["eval", "field.ply", "--capture", "stage", "--json"]).json();
    json["splits"][split]["psnr_fg"].as_f64().unwrap()
}
