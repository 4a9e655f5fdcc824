//! `cargo xtask ingest` makes masks: compared with those of a rig whose truth is known, resumed, and with plates of their own.
//! Without ffmpeg all tests are skipped.

mod tool;

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::SystemTime;

use image::{GrayImage, RgbImage};
use serde_json::Value;
use studio::capture::CaptureFiles;
use studio::synth::rig::{Perturbations, Rig, RigSettings, write};
use tempfile::{TempDir, tempdir};
use tool::{Outcome, aarc_studio, has_ffmpeg};

const CAMERAS: usize = 3;

/// A rig whose cameras differ in exposure and white balance, with noise, and a figure that casts a shadow.
fn rig(size: [u32; 2]) -> TempDir {
    let folder = tempdir().unwrap();
    let settings = RigSettings {
        cameras: CAMERAS,
        seconds: 2.0,
        fps: 15.0,
        size,
        seed: 5,
        crf: 18,
        shadow: true,
        masks: true,
        perturbations: Perturbations { rotated: true, ..Perturbations::ALL },
    };
    write(&folder.path().join("rig"), &Rig::new(&settings).unwrap(), || ()).unwrap();
    folder
}

fn ingest(folder: &Path, options: &str) -> Outcome {
    let line = format!("ingest rig -o studio {options}");
    aarc_studio(folder, &line.split_whitespace().collect::<Vec<_>>())
}

fn json_file(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn gray(path: &Path) -> GrayImage {
    image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_luma8()
}

/// Intersection over union with the truth of each mask of a camera.
fn ious(folder: &Path, camera: usize) -> Vec<f64> {
    let truth = &json_file(&folder.join("rig/truth.json"))["cameras"][camera];
    let manifest = json_file(&folder.join("studio/capture.json"));
    let (id, fps) = (truth["id"].as_str().unwrap(), manifest["fps"].as_f64().unwrap());
    let start_s = manifest["cameras"][camera]["start_s"].as_f64().unwrap();
    let times_s: Vec<f64> =
        truth["times_s"].as_array().unwrap().iter().map(|time_s| time_s.as_f64().unwrap()).collect();
    let mut ious = Vec::new();
    for frame in 0..manifest["frames"].as_u64().unwrap() {
        let path = folder.join(format!("studio/masks/{id}/{frame:06}.png"));
        // A camera of a variable rate has gaps.
        if !path.exists() {
            continue;
        }
        let off = |i: &usize| (start_s + times_s[*i] - times_s[0] - frame as f64 / fps).abs();
        let nearest = (0..times_s.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
        let [found, truth] = [path, folder.join(format!("rig/masks/{id}/{nearest:06}.png"))].map(|p| gray(&p));
        assert_eq!(found.dimensions(), truth.dimensions());
        let pixels = || found.pixels().zip(truth.pixels()).map(|(a, b)| (a.0[0] >= 128, b.0[0] >= 128));
        let either = pixels().filter(|(a, b)| *a || *b).count();
        ious.push(pixels().filter(|(a, b)| *a && *b).count() as f64 / either.max(1) as f64);
    }
    ious
}

#[test]
fn masks_of_a_rig_are_those_of_its_truth() {
    if !has_ffmpeg() {
        return;
    }
    let size = std::env::var("SIDE").ok().map_or(160, |x| x.parse().unwrap());
    let folder = rig([size, size * 3 / 4]);
    let folder = folder.path();
    let outcome = ingest(folder, &std::env::var("OPT").unwrap_or("--plates rig/plates".into()));
    println!("{outcome:?}");
    for camera in 0..CAMERAS {
        let ious = ious(folder, camera);
        let mean = ious.iter().sum::<f64>() / ious.len() as f64;
        let least = ious.iter().copied().fold(1.0, f64::min);
        println!("camera {camera}: IoU {mean:.4} of {} masks, at least {least:.4}", ious.len());
    }
    if let Ok(save) = std::env::var("SAVE") {
        Command::new("cp").args(["-r", folder.to_str().unwrap(), &save]).status().unwrap();
    }
}
