//! Fits of captures with little to fit to: each gives a field of finite numbers that shows the photographs, or one
//! sentence.

use std::fs;
use std::path::{Path, PathBuf};

use crate::small_stage::{stage, stage_of};
use crate::tool::aarc_studio;
use codec::{Camera, Field};
use formats::import;
use image::{GrayImage, RgbImage};
use refine::reference::{Order, RenderScene, render};
use serde_json::{Value, json};
use tempfile::tempdir;

/// Frames of [`stage`].
const FRAMES: usize = 5;

/// Steps that include some changes of density.
const FIT: [&str; 10] =
    ["fit", "stage", "-o", "field.ply", "--steps", "400", "--gaussians", "400", "--sh-degree", "1"];

/// Fits the stage, checks the field, and returns the evaluation.
#[track_caller]
fn fitted(folder: &Path, more: &[&str]) -> Value {
    let json = aarc_studio(folder, &[&FIT[..], &["--json"], more].concat()).json();
    assert_eq!(json["non_finite"], 0, "{json}");
    assert!(json["loss"].as_f64().is_some_and(f64::is_finite), "{json}");
    let imported = import(&folder.join("field.ply")).unwrap();
    assert!(imported.account.repairs.is_empty(), "{}", imported.account.repairs);
    imported.field.check().unwrap();
    let cameras = more.iter().position(|word| *word == "--cameras").map_or(&[][..], |at| &more[at..at + 2]);
    let eval =
        aarc_studio(folder, &[&["eval", "field.ply", "--capture", "stage", "--json"], cameras].concat());
    let json = eval.json();
    let number = |key: &str| json["splits"]["train"][key].as_f64();
    // Infinite if every picture is exact.
    let psnr = number("psnr_fg").unwrap_or(f64::INFINITY);
    println!("{more:?}: {psnr:.2} dB of the subject");
    assert!(psnr > 14.0 && number("ssim").is_some_and(|ssim| ssim > 0.5), "{psnr} dB: {json}");
    // And it can be packaged.
    let package = ["package", "field.ply", "-o", "clip.aarc", "--coder", "fixed", "--json"];
    assert!(aarc_studio(folder, &package).json()["bytes"].as_u64().unwrap() > 0);
    json
}

fn file(folder: &Path, kind: &str, camera: usize, frame: usize) -> PathBuf {
    folder.join(format!("stage/{kind}/{camera:02}/{frame:06}.png"))
}

/// Makes the photographs of a frame black and their masks empty.
fn blacken(folder: &Path, frame: usize) {
    for camera in 0..8 {
        RgbImage::new(48, 48).save(file(folder, "images", camera, frame)).unwrap();
        GrayImage::new(48, 48).save(file(folder, "masks", camera, frame)).unwrap();
    }
}

#[test]
fn a_camera_lacks_photographs() {
    let folder = stage();
    let folder = folder.path();
    // Camera 00 has the first frame alone, camera 01 none of the middle.
    for (camera, frames) in [(0, 1..FRAMES), (1, 1..4)] {
        frames.for_each(|frame| fs::remove_file(file(folder, "images", camera, frame)).unwrap());
    }
    let json = fitted(folder, &[]);
    assert_eq!(json["splits"]["train"]["images"], 7 * FRAMES - 4 - 3);
}

#[test]
fn a_frame_lacks_photographs() {
    let folder = stage();
    let folder = folder.path();
    // One camera took the third frame, none the fourth.
    for camera in 0..8 {
        fs::remove_file(file(folder, "images", camera, 3)).unwrap();
        if camera > 0 {
            fs::remove_file(file(folder, "images", camera, 2)).unwrap();
        }
    }
    let json = fitted(folder, &[]);
    assert_eq!(json["splits"]["train"]["images"], 7 * 3 + 1);
}

#[test]
fn one_frame_and_two_cameras() {
    let folder = stage();
    let folder = folder.path();
    let one = fitted(folder, &["--frames", "2..3"]);
    assert_eq!((&one["frames"], &one["splits"]["train"]["images"]), (&json!([2, 3]), &7.into()));
    assert!(import(&folder.join("field.ply")).unwrap().field.temporal.is_none(), "one frame does not move");
    let two = fitted(folder, &["--cameras", "00,02"]);
    assert_eq!(two["splits"]["train"]["images"], 2 * FRAMES);
    let both = fitted(folder, &["--cameras", "00,02", "--frames", "2..3"]);
    assert_eq!(both["splits"]["train"]["images"], 2);
    // The first and the last frame are fitted to, or the first alone.
    fitted(folder, &["--frames", "0..3", "--holdout", "odd"]);
    let held = fitted(folder, &["--frames", "0..2", "--holdout", "odd"]);
    assert_eq!(held["splits"]["interp_b"]["images"], 7);
}

#[test]
fn nothing_moves() {
    let folder = stage();
    let folder = folder.path();
    for kind in ["images", "masks"] {
        for camera in 0..8 {
            for frame in 1..FRAMES {
                fs::copy(file(folder, kind, camera, 0), file(folder, kind, camera, frame)).unwrap();
            }
        }
    }
    fitted(folder, &["--holdout", "odd"]);
}

#[test]
fn the_subject_leaves_the_picture() {
    let folder = stage();
    let folder = folder.path();
    blacken(folder, 3);
    blacken(folder, 4);
    let json = fitted(folder, &[]);
    assert_eq!(json["splits"]["train"]["without_subject"], 14);
    assert!(json["splits"]["train"]["psnr_full"].is_number(), "black photographs are left out: {json}");
    blacken(folder, 0);
    fitted(folder, &[]);
    // It is in no frame.
    blacken(folder, 1);
    blacken(folder, 2);
    let error = aarc_studio(folder, &FIT).error(3);
    assert!(error.contains("no anchor: "), "{error}");
}

#[test]
fn cameras_are_not_synchronous() {
    let folder = stage();
    let folder = folder.path();
    let manifest = folder.join("stage/capture.json");
    let mut json: Value = serde_json::from_slice(&fs::read(&manifest).unwrap()).unwrap();
    // Up to the length of the clip, 4 / 30 s.
    for (camera, offset_s) in [(0, 0.1333), (1, -0.1333), (2, 0.016), (4, -0.001)] {
        json["cameras"][camera]["time_offset_s"] = offset_s.into();
    }
    fs::write(&manifest, json.to_string()).unwrap();
    fitted(folder, &["--holdout", "odd"]);
}

/// Rewrites the stage in nerfstudio's layout, with these of its frames, each at a time from 0 to 1.
fn retime(folder: &Path, frames: [(usize, f64); FRAMES]) {
    // A folder with a manifest is read by it.
    let (manifest, aside) = (folder.join("stage/capture.json"), folder.join("capture.json"));
    if manifest.exists() {
        fs::rename(manifest, &aside).unwrap();
    }
    let capture: Value = serde_json::from_slice(&fs::read(&aside).unwrap()).unwrap();
    let mut listed = Vec::new();
    for camera in capture["cameras"].as_array().unwrap() {
        let number = |matrix: &str, row: usize, column: usize| camera[matrix][row][column].as_f64().unwrap();
        let m = |row, column| number("w2c", row, column);
        // Camera to world, and OpenGL looks backwards with y up.
        let row = |r: usize| {
            let position = -(0..3).map(|i| m(i, r) * m(i, 3)).sum::<f64>();
            [m(0, r), -m(1, r), -m(2, r), position]
        };
        let pose = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        for (frame, time) in frames {
            let path = |kind: &str| format!("{kind}/{}/{frame:06}.png", camera["id"].as_str().unwrap());
            listed.push(json!({
                "file_path": path("images"), "mask_path": path("masks"), "time": time, "transform_matrix": pose,
                "fl_x": number("K", 0, 0), "fl_y": number("K", 1, 1), "cx": number("K", 0, 2), "cy": number("K", 1, 2),
            }));
        }
    }
    fs::write(folder.join("stage/transforms.json"), json!({"frames": listed}).to_string()).unwrap();
}

/// The second held frame is a quarter of the way between the two fitted ones. Taken for equally spaced, it would be
/// halfway.
#[test]
fn frames_are_not_equally_spaced() {
    let folder = stage_of("33");
    let folder = folder.path();
    let frames = [10, 11, 12, 13, 16];
    let held = |times: [f64; FRAMES]| {
        retime(folder, std::array::from_fn(|i| (frames[i], times[i])));
        let json = fitted(folder, &["--holdout", "odd"]);
        json["splits"]["interp_b"]["psnr_fg"].as_f64().unwrap()
    };
    let as_taken = held(frames.map(|frame| (frame - 10) as f64 / 6.0));
    let even = held([0.0, 0.25, 0.5, 0.75, 1.0]);
    assert!(as_taken > even + 0.5, "{as_taken} {even} dB");
}

/// A room of colours, photographed from its middle.
#[test]
fn cameras_stand_within_what_they_photograph() {
    let folder = tempdir().unwrap();
    let mut room = Field::default();
    for row in 0..2000 {
        let height = 1.0 - (2 * row + 1) as f64 / 2000.0;
        let (sin, cos) = (2.399_963 * f64::from(row)).sin_cos();
        let level = (1.0 - height * height).sqrt();
        let at = [level * cos, height, level * sin];
        room.centers.push(at.map(|x| (3.0 * x) as f32));
        room.sh.push(at.map(|x| (3.0 * x).sin() as f32));
    }
    room.rotations = vec![[1.0, 0.0, 0.0, 0.0]; room.len()];
    room.log_scales = vec![[-2.0; 3]; room.len()];
    room.opacities = vec![0.95; room.len()];
    let camera = |i: usize| {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / 12.0).sin_cos();
        let position = [0.4 * cos, 0.2 * (i % 3) as f64, 0.4 * sin];
        let target = [3.0 * cos, 0.8 * (i % 2) as f64, 3.0 * sin];
        Camera::look_at(position, target, [0.0, 1.0, 0.0], 1.2, 64, 48)
    };
    let cameras: Vec<Value> = (0..12)
        .map(|i| {
            let camera = camera(i);
            let picture = render(&RenderScene::from(&room), &camera, 0.0, Order::Depth);
            let file = folder.path().join(format!("room/images/{i:02}/000000.png"));
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            RgbImage::from_raw(64, 48, picture.to_rgb8()).unwrap().save(&file).unwrap();
            json!({
                "id": format!("{i:02}"), "w": 64, "h": 48, "K": camera.k, "w2c": camera.camera_from_world,
                "held": i == 5,
            })
        })
        .collect();
    let images = "images/{camera}/{frame:06}.png";
    let manifest = json!({ "fps": 30, "frames": 1, "images": images, "cameras": cameras });
    fs::write(folder.path().join("room/capture.json"), manifest.to_string()).unwrap();
    let line = "fit room -o room.ply --steps 600 --gaussians 1500 --sh-degree 0 --json";
    let json = aarc_studio(folder.path(), &line.split(' ').collect::<Vec<_>>()).json();
    assert_eq!(json["non_finite"], 0, "{json}");
    let line = "eval room.ply --capture room --json";
    let splits = aarc_studio(folder.path(), &line.split(' ').collect::<Vec<_>>()).json()["splits"].take();
    let [fitted, held] = ["train", "recon"].map(|split| splits[split]["psnr_full"].as_f64().unwrap());
    println!("fitted {fitted:.2} dB, held {held:.2} dB");
    assert!(fitted > 20.0 && held > 15.0, "{splits}");
}
