//! `cargo xtask fit` into a field folder: the fit slides along a take.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

use crate::small_stage::{field_files, kill_when, measured_take, stage_of, start, wait_for};
use crate::tool::aarc_studio;
use image::{GrayImage, RgbImage};
use serde_json::Value;
use tempfile::TempDir;

/// 1.3 seconds: three parts of about 0.4 s.
const FRAMES: &str = "40";

const FIT: [&str; 12] = [
    "fit",
    "stage",
    "-o",
    "field",
    "--split",
    "0.4",
    "--steps",
    "200",
    "--gaussians",
    "400",
    "--sh-degree",
    "0",
];

fn take() -> TempDir {
    stage_of(FRAMES)
}

fn fitted(folder: &Path) -> Value {
    aarc_studio(folder, &[&FIT[..], &["--json"]].concat()).json()
}

#[test]
fn a_take_becomes_a_field_folder() {
    let folder = take();
    let folder = folder.path();
    let json = fitted(folder);
    assert_eq!((json["parts"].as_u64(), json["resumed_at"].as_u64()), (Some(3), Some(0)), "{json}");
    let files = field_files(folder);
    assert_eq!(files.len() as u64, json["segments"].as_u64().unwrap() + 1, "segments and field.json");
    assert!(files.contains_key(&folder.join("field/field.json")));
    let psnr = measured_take(folder);
    println!("{psnr:.2} dB: {json}");
    assert!(psnr > 14.0, "{psnr}");
    let package = ["package", "field", "-o", "take.aarc", "--coder", "fixed", "--rank", "mass", "--json"];
    let packaged = aarc_studio(folder, &package).json();
    assert_eq!(packaged["segments"].as_array().map(Vec::len), json["segments"].as_u64().map(|n| n as usize));
    let gaussians: usize = files
        .values()
        .filter_map(|file| {
            let text = String::from_utf8_lossy(&file[..file.len().min(4000)]).into_owned();
            text.lines().find_map(|line| line.strip_prefix("element vertex ")?.parse::<usize>().ok())
        })
        .sum();
    let by_level = json["gaussians_by_level"].as_array().unwrap();
    assert_eq!(by_level.iter().map(|n| n.as_u64().unwrap() as usize).sum::<usize>(), gaussians, "{json}");
    // It is finished.
    let error = aarc_studio(folder, &FIT).error(2);
    assert!(error.contains("field: it is finished already; remove it, or name another --out"), "{error}");
    assert_eq!(field_files(folder), files);
}

#[test]
fn a_killed_fit_goes_on_with_the_same_result() {
    let folder = take();
    let folder = folder.path();
    fitted(folder);
    let uninterrupted = field_files(folder);
    fs::remove_dir_all(folder.join("field")).unwrap();
    let work = folder.join("field/fit");

    // In the background: another length of parts is another plan.
    let often = [&FIT[..], &["--set", "checkpoint-every=0.01"]].concat();
    kill_when(folder, &often, || work.join("background.lock").exists());
    let longer: Vec<&str> = FIT.iter().map(|word| if *word == "0.4" { "0.65" } else { *word }).collect();
    let error = aarc_studio(folder, &longer).error(2);
    assert!(error.contains("with other options"), "{error}");
    // In the first part and in the second, beyond a checkpoint.
    for checkpoint in ["part-0000.checkpoint", "part-0001.checkpoint"] {
        kill_when(folder, &often, || work.join(checkpoint).exists());
    }
    assert!(!folder.join("field/field.json").exists(), "nothing half-written");
    let other = [&FIT[..], &["--set", "seed=1"]].concat();
    let error = aarc_studio(folder, &other).error(2);
    assert!(error.contains("with other options was begun there"), "{error}");
    let fewer = [&FIT[..], &["--frames", "0..30"]].concat();
    assert!(aarc_studio(folder, &fewer).error(2).contains("of another capture"));

    let json = fitted(folder);
    assert_eq!(json["resumed_at"], 1, "{json}");
    assert!(field_files(folder) == uninterrupted, "the same files, bit by bit");

    fs::remove_dir_all(folder.join("field")).unwrap();
    kill_when(folder, &FIT, || work.join("part-0000").exists());
    for file in ["part-0000", "background", "plan"] {
        let whole = fs::read(work.join(file)).unwrap();
        for (damaged, length) in [(&whole[..], whole.len() - 1), (b"aarcstp\x00", 8)] {
            fs::write(work.join(file), &damaged[..length]).unwrap();
            let error = aarc_studio(folder, &FIT).error(3);
            let cure =
                if file == "part-0000" { "it to fit that part anew" } else { "its folder to fit anew" };
            let expected = format!("field/fit/{file}: damaged, or of another version; remove {cure}");
            assert!(error.contains(&expected), "{error}");
        }
        fs::write(work.join(file), whole).unwrap();
    }
    fitted(folder);
    assert!(field_files(folder) == uninterrupted);
}

#[test]
fn two_processes_do_not_fit_to_one_folder() {
    let folder = take();
    let folder = folder.path();
    let mut first = start(folder, &FIT);
    wait_for(&folder.join("field/fit/lock"));
    // Until it holds the lock.
    thread::sleep(Duration::from_millis(50));
    let error = aarc_studio(folder, &FIT).error(2);
    assert!(
        error.contains("field: another process fits to it; wait for that, or name another --out"),
        "{error}"
    );
    assert!(first.wait().unwrap().success(), "the first goes on");
    assert!(measured_take(folder) > 14.0);
}

#[test]
fn photographs_vanish_while_it_fits() {
    let folder = take();
    let folder = folder.path();
    fitted(folder);
    let uninterrupted = field_files(folder);
    fs::remove_dir_all(folder.join("field")).unwrap();

    let fit = start(folder, &FIT);
    // The photographs of the last part are not read before the second one begins.
    wait_for(&folder.join("field/fit/part-0000.fit.csv"));
    let photograph = folder.join("stage/images/00/000039.png");
    fs::rename(&photograph, folder.join("aside.png")).unwrap();
    let output = fit.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("images/00/000039.png"), "{said}");
    assert!(!folder.join("field/field.json").exists());

    fs::rename(folder.join("aside.png"), &photograph).unwrap();
    let json = fitted(folder);
    assert!(json["resumed_at"].as_u64() > Some(0), "what was fitted stays: {json}");
    assert!(field_files(folder) == uninterrupted);
}

#[test]
fn the_subject_leaves_and_a_camera_fails() {
    let folder = take();
    let folder = folder.path();
    let file = |kind: &str, camera: usize, frame: usize| {
        folder.join(format!("stage/{kind}/{camera:02}/{frame:06}.png"))
    };
    for camera in 0..8 {
        for frame in 10..30 {
            RgbImage::new(48, 48).save(file("images", camera, frame)).unwrap();
            GrayImage::new(48, 48).save(file("masks", camera, frame)).unwrap();
        }
    }
    for frame in 25..40 {
        fs::remove_file(file("images", 2, frame)).unwrap();
    }
    fitted(folder);
    let psnr = measured_take(folder);
    assert!(psnr > 14.0, "{psnr}");
    // It is gone.
    let at = |time: &str| {
        let render = ["render", "field", "--time", time, "--size", "48x48", "-o", "picture.png"];
        assert_eq!(aarc_studio(folder, &render).code, Some(0));
        let picture = image::open(folder.join("picture.png")).unwrap().into_rgb8();
        let lit = picture.pixels().filter(|pixel| pixel.0.iter().any(|c| *c > 64)).count();
        println!("{lit} pixels at {time} s");
        lit
    };
    assert!(at("0.1") > 40 && at("0.65") < 10 && at("1.2") > 40);

    for camera in 0..8 {
        for frame in (0..10).chain(30..40) {
            RgbImage::new(48, 48).save(file("images", camera, frame)).unwrap();
            GrayImage::new(48, 48).save(file("masks", camera, frame)).unwrap();
        }
    }
    fs::remove_dir_all(folder.join("field")).unwrap();
    let none =
        Command::new(env!("CARGO_BIN_EXE_aarc-studio")).current_dir(folder).args(FIT).output().unwrap();
    let said = String::from_utf8_lossy(&none.stderr);
    assert!(
        none.status.code() == Some(3)
            && said.contains("no anchor: ")
            && said.contains("no part of the take has a Gaussian"),
        "{said}"
    );
}

#[test]
fn what_stands_still_is_one_segment_over_the_take() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let stage =
        ["synth", "stage", "-o", "stage", "--cameras", "8", "--frames", "60", "--size", "48x48", "--props"];
    assert_eq!(aarc_studio(folder, &stage).code, Some(0));
    let json = fitted(folder);
    let by_level = json["gaussians_by_level"].as_array().unwrap();
    let (dynamic, background) = (by_level[0].as_u64().unwrap(), by_level.last().unwrap().as_u64().unwrap());
    println!("{dynamic} move, {background} stand still");
    assert!(by_level.len() > 1 && background > 100 && dynamic > background, "{json}");
    let manifest: Value =
        serde_json::from_slice(&fs::read(folder.join("field/field.json")).unwrap()).unwrap();
    let segments = manifest["segments"].as_array().unwrap();
    let viewpoints = |segment: &Value| {
        let file = folder.join("field").join(segment["file"].as_str().unwrap());
        formats::import(&file).unwrap().hints.viewpoints
    };
    let first = viewpoints(&segments[0]);
    assert!(!first.is_empty() && segments.iter().all(|segment| viewpoints(segment) == first), "of the take");
    let top = segments.iter().find(|segment| segment["level"] != 0).unwrap();
    assert_eq!((&top["start_s"], &top["duration_s"]), (&0.0.into(), &manifest["duration_s"]));
    let field = formats::import(&folder.join("field").join(top["file"].as_str().unwrap())).unwrap().field;
    let temporal = field.temporal.expect("windows are wide, not endless");
    let narrowest = temporal.s.iter().copied().fold(f32::INFINITY, f32::min);
    assert!(temporal.motion_order == 0 && narrowest > 10.0, "{narrowest}: it never moves and is always on");

    // No camera takes a photograph for longer than a part, and it stands there still.
    for camera in 0..8 {
        for frame in 9..36 {
            fs::remove_file(folder.join(format!("stage/images/{camera:02}/{frame:06}.png"))).unwrap();
        }
    }
    fs::remove_dir_all(folder.join("field")).unwrap();
    let json = fitted(folder);
    let background = json["gaussians_by_level"].as_array().unwrap().last().unwrap().as_u64().unwrap();
    assert!(background > 100, "{json}");
}

#[test]
fn parts_may_be_longer_than_the_take_and_shorter_than_an_interval() {
    let folder = stage_of("5");
    let folder = folder.path();
    let fit =
        ["fit", "stage", "-o", "field", "--steps", "40", "--gaussians", "300", "--sh-degree", "0", "--json"];
    for (split, parts) in [("100", 1), ("0.02", 7)] {
        let json = aarc_studio(folder, &[&fit[..], &["--split", split]].concat()).json();
        assert_eq!(json["parts"], parts, "{json}");
        assert!(measured_take(folder) > 10.0, "{split}: {}", measured_take(folder));
        fs::remove_dir_all(folder.join("field")).unwrap();
    }
    // Its segments record the frames that were held out.
    aarc_studio(folder, &[&fit[..], &["--holdout", "odd", "--split", "0.05"]].concat()).success();
    let eval = aarc_studio(folder, &["eval", "field", "--capture", "stage", "--json"]).json();
    assert_eq!(eval["splits"]["interp_b"]["images"], 2 * 7, "{eval}");
    fs::remove_dir_all(folder.join("field")).unwrap();
    // What is in the folder of the fit is its own.
    fs::create_dir_all(folder.join("field/fit")).unwrap();
    fs::write(folder.join("field/fit/mine.txt"), b"precious").unwrap();
    let error = aarc_studio(folder, &fit).error(2);
    assert!(error.contains("field/fit: it is of no fit; move it, or name another --out"), "{error}");
    fs::write(folder.join("field/fit/lock"), b"").unwrap();
    fs::write(folder.join("field/fit/plan-notes.txt"), b"precious").unwrap();
    fs::create_dir(folder.join("field/fit/part-backup")).unwrap();
    aarc_studio(folder, &fit).success();
    for mine in ["mine.txt", "plan-notes.txt"] {
        assert_eq!(fs::read(folder.join("field/fit").join(mine)).unwrap(), b"precious");
    }
    assert!(folder.join("field/fit/part-backup").is_dir());
    fs::remove_dir_all(folder.join("field")).unwrap();
    let one = [&fit[..], &["--frames", "0..2", "--holdout", "odd"]].concat();
    let error = aarc_studio(folder, &one).error(2);
    assert!(error.contains("field: one frame to fit to has no time to slide along"), "{error}");
    // One camera gives no hull.
    let alone = aarc_studio(folder, &[&fit[..], &["--cameras", "00", "--split", "0.1"]].concat());
    assert!(alone.code == Some(3) && alone.stderr.contains("no anchor: "), "{}", alone.stderr);
}
