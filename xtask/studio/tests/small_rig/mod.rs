//! A small rig of cameras in a room, filmed without masks.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::Path;

use studio::synth::rig::{Perturbations, Rig, RigSettings, write};
use tempfile::{TempDir, tempdir};

use crate::tool::{Outcome, aarc_studio};

/// What differs between the cameras of a small rig: noise.
pub(crate) const NOISE: Perturbations = Perturbations { noise: 1.0, ..Perturbations::NONE };

/// A capture `studio` of videos without masks, with plates; the masks of the figure are beside it, in `rig`.
pub(crate) fn studio() -> TempDir {
    studio_of([64, 48], NOISE)
}

/// The same, with pictures of this size and cameras that differ so.
pub(crate) fn studio_of(size: [u32; 2], perturbations: Perturbations) -> TempDir {
    let folder = tempdir().unwrap();
    let settings = RigSettings {
        cameras: 6,
        seconds: 1.0,
        fps: 15.0,
        size,
        seed: 0,
        crf: 12,
        shadow: false,
        masks: true,
        perturbations,
    };
    write(&folder.path().join("rig"), &Rig::new(&settings).unwrap(), || {}).unwrap();
    run(folder.path(), "ingest rig -o studio --offsets none --plates rig/plates --mattes off").success();
    folder
}

/// Runs a command line without spaces in its words.
pub(crate) fn run(folder: &Path, line: &str) -> Outcome {
    aarc_studio(folder, &line.split(' ').collect::<Vec<_>>())
}

/// PSNR in dB of the whole pictures of a field and of the subject, over the photographs that were fitted to.
pub(crate) fn eval(folder: &Path, field: &str) -> [f64; 2] {
    let json = run(folder, &format!("eval {field} --capture studio --json")).json();
    ["psnr_full", "psnr_fg"].map(|key| json["splits"]["train"][key].as_f64().unwrap())
}
