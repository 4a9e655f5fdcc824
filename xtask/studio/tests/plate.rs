//! Captures without masks: a field of what moves, in front of a plate of what does not.

mod tool;

use std::fs;
use std::path::Path;

use serde_json::Value;
use studio::synth::rig::{Perturbations, Rig, RigSettings, write};
use tempfile::{TempDir, tempdir};
use tool::{Outcome, aarc_studio, ffmpeg, has_ffmpeg};

const FIT: &str = "--steps 300 --gaussians 600 --sh-degree 0";

/// A capture of videos without masks, with plates, and the masks of the figure beside.
fn studio() -> TempDir {
    let folder = tempdir().unwrap();
    let settings = RigSettings {
        cameras: 6,
        seconds: 1.0,
        fps: 15.0,
        size: [64, 48],
        seed: 0,
        crf: 12,
        shadow: false,
        masks: true,
        perturbations: Perturbations { noise: 1.0, ..Perturbations::NONE },
    };
    write(&folder.path().join("rig"), &Rig::new(&settings).unwrap(), || {}).unwrap();
    run(folder.path(), "ingest rig -o studio --offsets none --plates rig/plates --mattes off").success();
    folder
}

fn run(folder: &Path, arguments: &str) -> Outcome {
    aarc_studio(folder, &arguments.split(' ').collect::<Vec<_>>())
}

/// PSNR of the whole pictures and of the subject.
fn eval(folder: &Path, field: &str) -> [f64; 2] {
    let json = run(folder, &format!("eval {field} --capture studio --json")).json();
    ["psnr_full", "psnr_fg"].map(|key| json["splits"]["train"][key].as_f64().unwrap())
}

#[test]
fn what_moves_is_fitted_in_front_of_a_plate() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    let json = run(folder, &format!("fit studio -o a.ply --json {FIT}")).json();
    assert!(json["plate_gaussians"].as_u64().unwrap() > 300, "{json}");
    let [whole, subject] = eval(folder, "a.ply");
    println!("with the plate: {whole:.2} dB, the subject {subject:.2} dB");
    assert!(whole > 22.0 && subject > 17.0, "{whole} {subject}");

    // The package has it, and can be made without.
    let plate = |options: &str| -> Value {
        run(folder, &format!("package a.ply -o {options}")).success();
        run(folder, "inspect a.aarc --json").json()["plate"].clone()
    };
    assert!(plate("a.aarc").is_object());
    fs::remove_file(folder.join("a.aarc")).unwrap();
    assert!(plate("a.aarc --drop plate").is_null());

    // Without a plate, everything is the subject, and the old plate goes.
    run(folder, &format!("fit studio -o a.ply --plate off {FIT}")).success();
    assert!(!folder.join("a.plate.ply").exists());
}

#[test]
fn a_capture_in_which_nothing_moves_is_refused() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    // The plates show the first frames.
    for camera in 0..6 {
        let line = format!(
            "-loop 1 -t 1.3 -i plates/{camera:02}.png -r 15 -c:v libx264 -crf 8 -pix_fmt yuv420p {camera:02}.mp4"
        );
        ffmpeg(&folder.join("rig"), &line);
    }
    let error = run(folder, &format!("fit studio -o b.ply {FIT}")).error(3);
    assert!(error.contains("nothing moves in front of the plates"), "{error}");
}
