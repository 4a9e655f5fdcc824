//! `cargo xtask synth rig`: the videos show and sound what the truth says. Without ffmpeg most tests are skipped.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::tool;
use crate::tool::{aarc_studio, aarc_studio_with, has_ffmpeg};
use refine::capture::PhotoId;
use refine::image::Image;
use serde_json::{Value, json};
use studio::capture::CaptureFiles;
use studio::synth::rig::{Perturbations, Rig, RigSettings, write};
use tempfile::{TempDir, tempdir};

/// Samples a second of the sound.
const RATE: f64 = 48_000.0;

fn settings(perturbations: Perturbations) -> RigSettings {
    RigSettings {
        cameras: 4,
        seconds: 1.5,
        fps: 30.0,
        size: [96, 64],
        seed: 3,
        crf: 12,
        shadow: false,
        masks: false,
        perturbations,
    }
}

/// A rig, its folder `rig`, and what that says of it.
struct Written {
    rig: Rig,
    folder: TempDir,
    truth: Value,
}

fn written(settings: &RigSettings) -> Written {
    let folder = tempdir().unwrap();
    let rig = Rig::new(settings).unwrap();
    let mut pictures = 0;
    write(&folder.path().join("rig"), &rig, || pictures += 1).unwrap();
    assert_eq!(pictures, rig.pictures());
    let truth = json_file(&folder.path().join("rig/truth.json"));
    Written { rig, folder, truth }
}

impl Written {
    fn path(&self) -> PathBuf {
        self.folder.path().join("rig")
    }

    fn number(&self, camera: usize, key: &str) -> f64 {
        self.truth["cameras"][camera][key].as_f64().unwrap_or_else(|| panic!("{key} of {camera}"))
    }

    /// Times of a camera's frames.
    fn times_s(&self, camera: usize) -> Vec<f64> {
        let times_s = self.truth["cameras"][camera]["times_s"].as_array().unwrap();
        times_s.iter().map(|time_s| time_s.as_f64().unwrap()).collect()
    }

    /// Opens the videos as a capture that starts at second 0, with what the truth says of the cameras.
    fn capture(&self, frames: usize) -> CaptureFiles {
        let camera = |truth: &Value| {
            let mut camera = json!({ "video": format!("{}.mp4", truth["id"].as_str().unwrap()) });
            for key in ["id", "w", "h", "K", "w2c", "start_s"] {
                camera[key] = truth[key].clone();
            }
            camera
        };
        let cameras: Vec<Value> = self.truth["cameras"].as_array().unwrap().iter().map(camera).collect();
        let manifest = json!({ "fps": self.truth["settings"]["fps"], "frames": frames, "cameras": cameras });
        fs::write(self.path().join("capture.json"), manifest.to_string()).unwrap();
        CaptureFiles::open(&self.path()).unwrap()
    }
}

fn json_file(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Relative paths and contents of all files below a folder but the videos.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = PathBuf::from(path.file_name().unwrap());
        if path.is_dir() {
            found.extend(files(&path).into_iter().map(|(below, bytes)| (name.join(below), bytes)));
        } else if path.extension().is_none_or(|extension| extension != "mp4") {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

#[test]
fn a_rig_is_deterministic_and_says_what_perturbs_it() {
    if !has_ffmpeg() {
        return;
    }
    let small = RigSettings { size: [32, 24], seconds: 1.0, masks: true, ..settings(Perturbations::ALL) };
    let first = written(&small);
    let folder = first.folder.path();
    let options = ["--cameras", "4", "--seconds", "1", "--size", "32x24", "--masks", "--perturb", "seed=3"];
    let outcome = aarc_studio(folder, &[&["synth", "rig", "-o", "again"], &options[..]].concat()).success();
    let pictures = first.rig.pictures();
    assert!(
        outcome.stdout.contains(&format!("again: 4 videos, {pictures} pictures of 32x24; in ")),
        "{}",
        outcome.stdout
    );
    let of_first = files(&first.path());
    assert!(of_first == files(&folder.join("again")), "the same truth, calibration and masks");
    // Calibration and truth, four plates, masks.
    assert_eq!(of_first.len(), 2 + 4 + pictures, "no temporary file is left");
    assert_eq!(fs::read_dir(folder).unwrap().count(), 2, "and no temporary folder");

    let is_perturbed = |truth: &Value| {
        let cameras = truth["cameras"].as_array().unwrap();
        let is_other =
            |key: &str, value: f64| cameras.iter().all(|camera| camera[key].as_f64() != Some(value));
        [
            is_other("drift_ppm", 0.0),
            is_other("gain", 1.0),
            is_other("noise", 0.0),
            is_other("sound_skew_s", 0.0),
            cameras.iter().any(|camera| camera["start_s"] != 0.0),
            cameras.iter().any(|camera| camera["white_balance"] != json!([1.0, 1.0, 1.0])),
            cameras[1]["rotated_degrees"] == 90,
            cameras[2]["variable_rate"] == true,
            !cameras[0]["sound_noise_db"].is_null(),
        ]
    };
    assert_eq!(is_perturbed(&first.truth), [true; 9]);
    let clean = |more: &[&str]| {
        let command = ["synth", "rig", "-o", "clean", "--perturb", "none"];
        aarc_studio(folder, &[&command[..], &options, more].concat()).success();
        let truth = json_file(&folder.join("clean/truth.json"));
        fs::remove_dir_all(folder.join("clean")).unwrap();
        is_perturbed(&truth)
    };
    assert_eq!(clean(&[]), [false; 9]);
    assert_eq!(
        clean(&["--perturb", "exposure=0.2,variable-rate=on"]),
        [false, true, false, false, false, false, false, true, false]
    );
}

/// PSNR of the brightness, which videos keep at full resolution, of a photograph and a traced picture.
fn brightness_psnr(photo: &Image, colors: &[u8]) -> f64 {
    let luma = |[r, g, b]: [f64; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let pairs = photo.pixels.iter().zip(colors.chunks_exact(3));
    let error = pairs.map(|(&[r, g, b, _], traced)| {
        let traced = [0, 1, 2].map(|c| f64::from(traced[c]) / 255.0);
        (luma([r, g, b]) - luma(traced)).powi(2)
    });
    -10.0 * (error.sum::<f64>() / photo.pixels.len() as f64).log10()
}

#[test]
fn photographs_are_the_traced_pictures_at_their_own_times() {
    if !has_ffmpeg() {
        return;
    }
    // Noise would hide small movements.
    let perturbations = Perturbations { noise: 0.0, ..Perturbations::ALL };
    let written = written(&RigSettings { masks: true, ..settings(perturbations) });
    let capture_files = written.capture(40);
    for camera in 0..4 {
        let (view, times_s) = (written.rig.view(camera), written.times_s(camera));
        assert!(times_s[0] <= 0.0 && *times_s.last().unwrap() >= 1.5, "{times_s:?}");
        let mut seen = Vec::new();
        for frame in (0..40).step_by(3) {
            let photo_id = PhotoId { frame, camera };
            if !capture_files.capture.photos.contains(&photo_id) {
                // A gap of a variable rate.
                assert_eq!(camera, 2);
                continue;
            }
            let time_s = capture_files.capture.time_s(photo_id);
            let off = |i: &usize| (times_s[*i] - time_s).abs();
            let number = (0..times_s.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            // The manifest knows no drift.
            assert!(off(&number) < 4.0 * 20e-6 + 2e-6, "camera {camera}, frame {frame}: {}", off(&number));
            let photo = capture_files.photo(photo_id).unwrap().image;
            let psnr = |number: usize| brightness_psnr(&photo, &view.picture(number).colors);
            let [before, at, after] = [number.max(1) - 1, number, number + 1].map(psnr);
            assert!(at > 45.0, "camera {camera}, frame {frame}: {at}");
            assert!((number == 0 || at > before + 1.0) && at > after + 1.0, "{before} {at} {after}");
            seen.push(number);
        }
        assert!(seen.len() > 10 && seen.windows(2).all(|pair| pair[0] < pair[1]), "{seen:?}");
        let mask = image::open(written.path().join(format!("masks/{camera:02}/000017.png"))).unwrap();
        let mask = mask.into_luma8();
        let traced = view.picture(17).mask;
        assert!(*mask.as_raw() == traced && mask.dimensions() == (96, 64));
        let covered = traced.iter().filter(|mask| **mask > 127).count();
        assert!((200..2000).contains(&covered), "{covered}");
    }
}

/// ffmpeg likes to round rates to common ones.
#[test]
fn videos_of_any_rate_present_their_frames_when_they_were_taken() {
    if !has_ffmpeg() {
        return;
    }
    for fps in [239.76, 23.976, 14.999, 1.0] {
        let settings = RigSettings { fps, size: [18, 16], cameras: 3, ..settings(Perturbations::ALL) };
        let written = written(&settings);
        for camera in 0..3 {
            let mut command = Command::new("ffprobe");
            command.args(["-v", "error", "-select_streams", "v", "-show_entries", "packet=pts_time"]);
            command.args(["-of", "csv=p=0"]).arg(written.path().join(format!("{camera:02}.mp4")));
            let output = String::from_utf8(command.output().unwrap().stdout).unwrap();
            let mut presented_s: Vec<f64> = output.split_whitespace().map(|s| s.parse().unwrap()).collect();
            presented_s.sort_by(f64::total_cmp);
            let rate = 1.0 + 1e-6 * written.number(camera, "drift_ppm");
            let start_s = written.number(camera, "start_s");
            let times_s = written.times_s(camera);
            assert_eq!(presented_s.len(), times_s.len());
            for (presented_s, time_s) in presented_s.iter().zip(times_s) {
                // ffprobe writes microseconds.
                let expected_s = (time_s - start_s) / rate;
                assert!((presented_s - expected_s).abs() < 1e-6, "{fps}: {presented_s} {expected_s}");
            }
        }
    }
}

#[test]
fn a_clean_rig_is_synchronous_before_a_static_room() {
    if !has_ffmpeg() {
        return;
    }
    let written = written(&settings(Perturbations::NONE));
    let capture_files = written.capture(45);
    assert!(capture_files.capture.deviations_s.is_empty(), "all are on time");
    for camera in 0..4 {
        let view = written.rig.view(camera);
        let pictures = [0, 20, 40].map(|frame| view.picture(frame));
        let (mut room, mut figure) = (0, 0);
        for i in 0..96 * 64 {
            let colors = pictures.each_ref().map(|picture| &picture.colors[3 * i..3 * i + 3]);
            if pictures.iter().all(|picture| picture.mask[i] == 0) {
                assert!(colors[0] == colors[1] && colors[1] == colors[2], "the room does not move");
                room += 1;
            } else {
                figure += usize::from(colors[0] != colors[2]);
            }
        }
        assert!(room > 3000 && figure > 200, "{room} {figure}");
    }
}

/// Equal times show equal poses, under every perturbation of the cameras.
#[test]
fn the_figure_moves_in_the_time_of_all_cameras() {
    let perturbations = Perturbations { starts_s: 2.0, ..Perturbations::NONE };
    let [early, clean] =
        [perturbations, Perturbations::NONE].map(|perturbations| Rig::new(&settings(perturbations)).unwrap());
    assert!(early.pictures() > clean.pictures() + 60, "cameras start before second 0");
    for camera in 0..4 {
        let (early, clean) = (early.view(camera), clean.view(camera));
        let shown = clean.picture(20).mask;
        // Starts are whole frames; the same instant is one of the frames from the 20th on.
        let same = (20..81).filter(|frame| {
            let mask = early.picture(*frame).mask;
            mask.iter().zip(&shown).all(|(a, b)| a.abs_diff(*b) <= 16)
        });
        assert_eq!(same.count(), 1, "camera {camera}");
    }
}

/// A shadow changes the floor beside the figure.
#[test]
fn a_shadow_falls_on_the_floor() {
    let with = Rig::new(&RigSettings { shadow: true, ..settings(Perturbations::NONE) }).unwrap();
    let without = Rig::new(&settings(Perturbations::NONE)).unwrap();
    let [with, without] = [&with, &without].map(|rig| rig.view(0).picture(9));
    assert_eq!(with.mask, without.mask);
    let darker = with.colors.iter().zip(&without.colors).filter(|(a, b)| a < b).count();
    assert!(darker > 200 && with.colors.iter().zip(&without.colors).all(|(a, b)| a <= b), "{darker}");
}

/// The sound of a video, decoded.
fn sound(path: &Path) -> Vec<f64> {
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-i"]).arg(path);
    command.args(["-map", "0:a", "-ac", "1", "-ar", "48000", "-f", "s16le", "-"]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let samples = output.stdout.chunks_exact(2);
    samples.map(|pair| f64::from(i16::from_le_bytes([pair[0], pair[1]])) / 32768.0).collect()
}

#[test]
fn sound_of_two_cameras_is_as_far_apart_as_the_truth_says() {
    if !has_ffmpeg() {
        return;
    }
    let written = written(&RigSettings { size: [32, 24], ..settings(Perturbations::ALL) });
    let sounds: Vec<Vec<f64>> =
        (0..4).map(|camera| sound(&written.path().join(format!("{camera:02}.mp4")))).collect();
    // When a camera's file has what sounds at its place at a time.
    let heard_s = |camera: usize, time_s: f64| {
        let number = |key: &str| written.number(camera, key);
        (time_s + number("sound_delay_s") - number("start_s")) / (1.0 + 1e-6 * number("drift_ppm"))
            + number("sound_skew_s")
    };
    let clap_s = written.truth["sound"]["clap_s"].as_f64().unwrap();
    for (camera, sound) in sounds.iter().enumerate() {
        let onset = (heard_s(camera, clap_s) * RATE).round() as usize;
        let around = onset - 4800..onset + 4800;
        let loudest = around.max_by(|a, b| sound[*a].abs().total_cmp(&sound[*b].abs())).unwrap();
        assert!((onset..onset + 400).contains(&loudest), "camera {camera}: {loudest}, {onset} expected");
    }
    let length = (0.4 * RATE) as usize;
    for (a, b) in [(0, 1), (0, 2), (1, 3), (2, 3)] {
        // The clap and speech around it, of the second camera at different lags.
        let [first, second] = [a, b].map(|camera| (heard_s(camera, clap_s - 0.1) * RATE).round() as i64);
        let window = &sounds[a][first as usize..][..length];
        let correlation = |lag: i64| -> f64 {
            let other = &sounds[b][(second + lag) as usize..][..length];
            window.iter().zip(other).map(|(x, y)| x * y).sum()
        };
        let best = (-4000..4000).max_by(|a, b| correlation(*a).total_cmp(&correlation(*b))).unwrap();
        assert!(best.abs() <= 3, "cameras {a} and {b}: {best} samples off");
        // Neither the way of the sound nor the skew is small enough to be left out.
        let skew_s = written.number(a, "sound_skew_s") - written.number(b, "sound_skew_s");
        let delay_s = written.number(a, "sound_delay_s") - written.number(b, "sound_delay_s");
        assert!((skew_s + delay_s).abs() * RATE > 20.0, "{a} {b}: {skew_s} {delay_s}");
    }
}

#[test]
fn the_calibration_is_that_of_the_truth() {
    if !has_ffmpeg() {
        return;
    }
    let written = written(&RigSettings { size: [32, 24], seconds: 1.0, ..settings(Perturbations::ALL) });
    let text = fs::read_to_string(written.path().join("calibration.toml")).unwrap();
    let sections: Vec<&str> = text.split("[cam_").skip(1).collect();
    assert_eq!(sections.len(), 4);
    for (camera, section) in sections.iter().enumerate() {
        // Each value is valid JSON.
        let value = |key: &str| -> Value {
            let line = section.lines().find_map(|line| line.strip_prefix(&format!("{key} = "))).unwrap();
            serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"))
        };
        let truth = &written.truth["cameras"][camera];
        assert_eq!((value("name"), value("size")), (truth["id"].clone(), json!([32.0, 24.0])));
        for axis in 0..3 {
            assert_eq!(value("translation")[axis], truth["w2c"][axis][3]);
        }
        let center = value("matrix")[0][2].as_f64().unwrap();
        assert_eq!(center + 0.5, truth["K"][0][2].as_f64().unwrap(), "pixel centres at whole numbers");
        // The rotation leaves its axis as it is.
        let axis: Vec<f64> =
            value("rotation").as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        for r in 0..3 {
            let turned: f64 = (0..3).map(|c| truth["w2c"][r][c].as_f64().unwrap() * axis[c]).sum();
            assert!((turned - axis[r]).abs() < 1e-9, "{turned} {axis:?}");
        }
    }
}

#[test]
fn bad_requests_end_with_one_line() {
    let folder = tempdir().unwrap();
    let folder = folder.path();
    let error =
        |more: &[&str]| aarc_studio(folder, &[&["synth", "rig", "-o", "rig"], more].concat()).error(2);
    assert!(error(&["--cameras", "0"]).contains("0 cameras: use 1 to 256"));
    assert!(error(&["--size", "31x24"]).contains("31x24 pixels: videos have even sides"));
    assert!(error(&["--fps", "300"]).contains("fps 300: use 1 to 240"));
    assert!(error(&["--seconds", "inf"]).contains("seconds inf: use 1 to 3000"));
    assert!(error(&["--perturb", "exposure=2"]).contains("exposure 2: use 0 to 0.9"));
    assert!(error(&["--perturb", "sound-noise=-30"]).contains("sound noise -30: use -20 to 100"));
    assert!(error(&["--perturb", "noise=loud"]).contains("noise is a number"));
    assert!(error(&["--perturb", "rotated=1"]).contains("rotated is on or off"));
    assert!(error(&["--perturb", "rain=1"]).contains("rain: nothing of this name perturbs"));
    assert!(error(&["--perturb", "noise"]).contains("such as exposure=0.2"));
    assert!(error(&["--perturb", "seed=-1"]).contains("seed is a whole number"));
    assert!(error(&["--perturb", "crf=300"]).contains("use 0 to 51"));
    fs::create_dir(folder.join("rig")).unwrap();
    fs::write(folder.join("rig/mine.txt"), "mine").unwrap();
    assert!(error(&[]).contains("cannot write rig: there is something already, name another folder"));
    let without = aarc_studio_with(folder, &["synth", "rig", "-o", "new"], &[("PATH", "/nowhere")]).error(2);
    assert!(without.contains("videos need ffmpeg, version 5.1 or newer; install ffmpeg"), "{without}");
    assert_eq!(files(folder).len(), 1, "nothing is written");
    assert_eq!(fs::read_dir(folder).unwrap().count(), 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_nothing() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempdir().unwrap();
    let folder = folder.path();
    let rig = [
        "synth",
        "rig",
        "-o",
        "rig",
        "--cameras",
        "1",
        "--seconds",
        "1",
        "--size",
        "320x240",
        "--perturb",
        "crf=0",
    ];
    // Enough for the sound, not for the pictures.
    let error = tool::with_small_disk(folder, 300, &rig).error(2);
    assert!(
        error.contains("cannot write rig/00.mp4: ffmpeg ended (") && !error.contains(".writing-"),
        "{error}"
    );
    assert_eq!(fs::read_dir(folder).unwrap().count(), 0);
}
