//! What a fit learns of its cameras: `--learn`, the file that it writes, and the commands that read it.

use std::fs;
use std::path::Path;
use std::thread;
use std::time::Duration;

use crate::small_stage::{kill_when, stage_of};
use crate::tool::aarc_studio;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Seconds by which the manifest says that camera 2 is late, which it is not: 0.6 frames.
const WRONG_S: f64 = 0.024;

/// A synchronous stage whose manifest, with 25 frames a second, is changed by `change`.
fn changed_stage(change: impl Fn(&mut Value)) -> TempDir {
    let folder = stage_of("13");
    let path = folder.path().join("stage/capture.json");
    let mut manifest: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    manifest["fps"] = 25.into();
    change(&mut manifest);
    fs::write(&path, manifest.to_string()).unwrap();
    folder
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

fn cameras(folder: &Path, file: &str) -> Vec<Value> {
    let json: Value = serde_json::from_slice(&fs::read(folder.join(file)).unwrap()).unwrap();
    json["cameras"].as_array().unwrap().clone()
}

/// PSNR of the subject in photographs that the fit saw, as they are and with colours aligned.
fn psnr(folder: &Path, field: &str) -> [f64; 2] {
    let json = aarc_studio(folder, &["eval", field, "--capture", "stage", "--json"]).json();
    ["psnr_fg", "psnr_fg_aligned"].map(|key| json["splits"]["train"][key].as_f64().unwrap())
}

/// Also: the same result after it was killed, and on another number of threads.
#[test]
fn offsets_are_learned_written_and_read() {
    let folder = changed_stage(|manifest| {
        manifest["cameras"][2]["time_offset_s"] = WRONG_S.into();
        manifest["learn"] = json!(["offsets"]);
    });
    let folder = folder.path();
    let fit = "fit stage -o learned.ply --steps 1500 --gaussians 800 --sh-degree 0";
    assert_eq!(aarc_studio(folder, &words(fit)).code, Some(0));
    let off_s = |camera: &Value| camera["time_offset_s"].as_f64().unwrap();
    let learned = cameras(folder, "learned.cameras.json");
    let mean_s = learned.iter().map(off_s).sum::<f64>() / 8.0;
    let worst_s = learned.iter().map(|camera| (off_s(camera) - mean_s).abs()).fold(0.0, f64::max);
    println!("worst {worst_s} s of {WRONG_S} s");
    assert!(worst_s < 0.25 * WRONG_S, "{worst_s}");
    assert!((mean_s - WRONG_S / 8.0).abs() < 1e-9, "the mean stays: {mean_s}");
    // A fit passes on the cameras that it was given, and removes the cameras of an earlier fit.
    let short = "fit stage -o given.ply --steps 5 --gaussians 200 --sh-degree 0 --learn none";
    aarc_studio(folder, &words(&format!("{short} --learned learned.cameras.json"))).success();
    assert_eq!(cameras(folder, "given.cameras.json"), learned);
    let stderr = aarc_studio(folder, &words(short)).success().stderr;
    assert!(stderr.contains("given.cameras.json was of an earlier fit"), "{stderr}");
    assert!(!folder.join("given.cameras.json").exists());
    let plain = "fit stage -o plain.ply --steps 1500 --gaussians 800 --sh-degree 0 --learn none";
    assert_eq!(aarc_studio(folder, &words(plain)).code, Some(0));
    assert!(!folder.join("plain.cameras.json").exists(), "nothing was learned");
    let [plain, with] = ["plain.ply", "learned.ply"].map(|field| psnr(folder, field)[0]);
    assert!(with > plain + 0.2, "{plain} dB, {with} dB with learned offsets");
    // The file is what makes the difference.
    let [kept, field] =
        ["learned.cameras.json", "learned.ply"].map(|file| fs::read(folder.join(file)).unwrap());
    fs::remove_file(folder.join("learned.cameras.json")).unwrap();
    let without = psnr(folder, "learned.ply")[0];
    assert!(with > without + 0.2, "{without} dB without the file, {with} dB with it");

    let is_ready = || {
        let is_begun = folder.join("learned.checkpoint").exists();
        thread::sleep(Duration::from_millis(if is_begun { 100 } else { 0 }));
        is_begun
    };
    fs::remove_file(folder.join("learned.ply")).unwrap();
    kill_when(folder, &[words(fit), vec!["--set", "checkpoint-every=0.05"]].concat(), is_ready);
    assert!(!folder.join("learned.ply").exists(), "killed before its end");
    let resumed = aarc_studio(folder, &[words(fit), vec!["--json"]].concat()).json();
    assert!(resumed["resumed_at"].as_u64().unwrap() > 0, "{resumed}");
    assert!(fs::read(folder.join("learned.ply")).unwrap() == field, "the same field, bit by bit");
    assert!(fs::read(folder.join("learned.cameras.json")).unwrap() == kept, "the same cameras, bit by bit");
}

/// The photographs of one camera are darker.
#[test]
fn colours_of_a_camera_are_learned() {
    let folder = changed_stage(|_| ());
    let folder = folder.path();
    for frame in 0..13 {
        let path = folder.join(format!("stage/images/01/{frame:06}.png"));
        let mut picture = image::open(&path).unwrap().into_rgb8();
        picture.iter_mut().for_each(|c| *c = (f64::from(*c) * 0.7) as u8);
        picture.save(&path).unwrap();
    }
    let fit = "fit stage --steps 1500 --gaussians 800 --sh-degree 0 --frames 0..5";
    for more in ["-o plain.ply", "-o learned.ply --learn colors"] {
        assert_eq!(aarc_studio(folder, &[words(fit), words(more)].concat()).code, Some(0));
    }
    let gain = |camera: &Value| -> f64 {
        (0..3).map(|c| camera["response"]["color"][c][c].as_f64().unwrap()).sum::<f64>() / 3.0
    };
    let gains: Vec<f64> = cameras(folder, "learned.cameras.json").iter().map(gain).collect();
    println!("{gains:.3?}");
    // The field takes a part of the difference as its own, because it starts with the colours of the photographs.
    let others = || (0..8).filter(|camera| *camera != 1);
    assert!(others().all(|camera| gains[1] < gains[camera] - 0.02), "{gains:?}");
    // Photographs stay as bright as the field: a vignette takes a third of its number from the mean of a picture.
    let vignettes: f64 = cameras(folder, "learned.cameras.json")
        .iter()
        .map(|c| c["response"]["vignette"].as_f64().unwrap())
        .sum();
    let brightness = (gains.iter().sum::<f64>() + vignettes / 3.0) / 8.0;
    assert!((brightness - 1.0).abs() < 1e-9, "the mean stays: {gains:?}, {vignettes}");
    let [plain, learned] = ["plain.ply", "learned.ply"].map(|field| psnr(folder, field));
    assert!(plain[1] > plain[0] + 0.1, "alignment takes the camera's colours away: {plain:?}");
    assert!(learned[1] > plain[1] - 0.1, "{plain:?}, {learned:?} with learned colours");
}

#[test]
fn a_field_folder_takes_learned_cameras() {
    let folder = changed_stage(|manifest| manifest["cameras"][2]["time_offset_s"] = WRONG_S.into());
    let folder = folder.path();
    let short = "--steps 30 --gaussians 200 --sh-degree 0";
    let learn = format!("fit stage -o a.ply {short} --learn offsets,colors,exposures,poses,focals");
    assert_eq!(aarc_studio(folder, &words(&learn)).code, Some(0));
    let film = format!("fit stage -o film {short} --split 0.25");
    let error = aarc_studio(folder, &words(&format!("{film} --learn offsets"))).error(2);
    assert!(error.contains("--learned a.cameras.json"), "{error}");
    assert!(!folder.join("film").exists(), "nothing was begun");
    let with = format!("{film} --learned a.cameras.json");
    assert_eq!(aarc_studio(folder, &words(&with)).code, Some(0));
    let [a, film] = ["a.cameras.json", "film/cameras.json"].map(|file| cameras(folder, file));
    for (a, b) in a.iter().zip(&film) {
        let off_s = |camera: &Value| camera["time_offset_s"].as_f64().unwrap();
        assert!((off_s(a) - off_s(b)).abs() < 1e-12, "{a} {b}");
        assert!(a["w2c"].is_array() && a["w2c"] == b["w2c"], "{a} {b}");
    }
    // A package of it has them, too, and so has a folder with one field.
    assert_eq!(aarc_studio(folder, &words("package film -o film.aarc")).code, Some(0));
    fs::create_dir(folder.join("scene")).unwrap();
    for file in ["a.ply", "a.cameras.json"] {
        fs::copy(folder.join(file), folder.join("scene").join(file)).unwrap();
    }
    for (subject, named) in [("film.aarc", "film/cameras.json"), ("scene", "scene/a.cameras.json")] {
        let stderr = aarc_studio(folder, &["eval", subject, "--capture", "stage"]).success().stderr;
        assert!(stderr.contains(&format!("cameras are as {named} has them")), "{subject}: {stderr}");
    }
    let [measured, _] = psnr(folder, "film");
    assert!(measured > 10.0, "{measured}");
}

#[test]
fn wrong_cameras_are_refused() {
    let folder = changed_stage(|_| ());
    let folder = folder.path();
    let fit = "fit stage -o field.ply --steps 10 --gaussians 100";
    let refused = |more: &str, code: i32, what: &str| {
        let error = aarc_studio(folder, &[words(fit), words(more)].concat()).error(code);
        assert!(error.contains(what), "{more}: {error}");
        assert!(!folder.join("field.ply").exists());
    };
    refused("--learn none,offsets", 2, "none stands alone");
    refused("--learn zoom", 2, "zoom");
    refused("--learned nothing.json", 3, "nothing.json");
    fs::write(folder.join("bad.json"), "{\"cameras\": [{}]}").unwrap();
    refused("--learned bad.json", 3, "bad.json");
    let pose = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let camera = |id: &str, focal_factor: f64, vignette: f64| {
        let response = json!({"color": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "vignette": vignette});
        let camera = json!({
            "id": id, "time_offset_s": 0, "w2c": pose, "focal_factor": focal_factor, "response": response,
        });
        fs::write(folder.join("some.json"), json!({"cameras": [camera]}).to_string()).unwrap();
    };
    camera("elsewhere", 1.0, 0.0);
    refused("--learned some.json", 3, "no camera of this capture");
    camera("00", -1.0, 0.0);
    refused("--learned some.json", 3, "camera 00");
    camera("00", 1.0, -1.5);
    refused("--learned some.json", 3, "camera 00: its vignette -1.5");
}
