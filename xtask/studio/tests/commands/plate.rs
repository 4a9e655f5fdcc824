//! Captures without masks: a field of what moves, in front of a plate of what does not.

use std::fs;
use std::path::Path;

use crate::small_rig::{NOISE, eval, run, studio, studio_of};
use crate::small_stage::kill_when;
use crate::tool::{ffmpeg, has_ffmpeg};
use refine::capture::Holdout;
use refine::reference::{Order, RenderScene, render};
use serde_json::Value;
use studio::capture::{BackgroundSource, CaptureFiles};
use studio::synth::rig::Perturbations;
use tempfile::tempdir;

const FIT: &str = "--steps 300 --gaussians 600 --sh-degree 0";

/// Removes from the manifest what a fit is to learn of the cameras.
fn ask_for_nothing(folder: &Path) {
    edit_manifest(folder, |line| !line.contains("\"learn\""));
}

/// Keeps the lines of the capture's manifest that `stays` keeps; at least one goes.
fn edit_manifest(folder: &Path, stays: impl Fn(&str) -> bool) {
    let path = folder.join("studio/capture.json");
    let manifest = fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = manifest.lines().filter(|line| stays(line)).collect();
    assert!(lines.len() < manifest.lines().count(), "{manifest}");
    fs::write(&path, lines.join("\n")).unwrap();
}

#[test]
fn what_moves_is_fitted_in_front_of_a_plate() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    let held = CaptureFiles::open(&folder.join("studio")).unwrap().capture.cameras[3].name.clone();
    let json = run(folder, &format!("fit studio -o a.ply --held-cameras {held} --json {FIT}")).json();
    // The held camera is judged with the plate, as `eval` does.
    let after_fit = json["held_cameras"]["mean"]["psnr_full"].as_f64().unwrap();
    let recon = run(folder, &format!("eval a.ply --capture studio --held-cameras {held} --json")).json()["splits"]
        ["recon"]["psnr_full"]
        .as_f64()
        .unwrap();
    assert!((after_fit - recon).abs() < 0.5, "{after_fit} of eight frames, {recon} of all");
    let json = run(folder, &format!("fit studio -o a.ply --json {FIT}")).json();
    assert!(json["held_cameras"].is_null() && json["plate_gaussians"].as_u64().unwrap() > 300, "{json}");
    let table = fs::read_to_string(folder.join("a.fit.csv")).unwrap();
    let column =
        |name: &str| table.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
    let pruned = |line: &str| line.split(',').nth(column("pruned")).unwrap().parse::<usize>().unwrap();
    let most = table.lines().skip(1).map(pruned).max().unwrap();
    assert!(most > 100, "what stands still is thinned: {table}");
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

    // Without the plate, the field remembers that its photographs had mattes.
    let plate_bytes = fs::read(folder.join("a.plate.ply")).unwrap();
    fs::rename(folder.join("a.ply"), folder.join("moved.ply")).unwrap();
    let [before_black, _] = eval(folder, "moved.ply");
    assert!(before_black > 23.0, "{before_black}");
    fs::rename(folder.join("moved.ply"), folder.join("a.ply")).unwrap();

    // A fit that goes on from it keeps the plate.
    for (from, to) in [("a.ply", "b.ply"), ("a.aarc", "c.ply"), ("a.ply", "a.ply")] {
        if from == "a.aarc" {
            run(folder, "package a.ply -o whole.aarc").success();
            fs::rename(folder.join("whole.aarc"), folder.join("a.aarc")).unwrap();
        }
        run(folder, &format!("fit studio --from {from} -o {to} --steps 20")).success();
        let whole = eval(folder, to)[0];
        assert!(whole > 22.0 && folder.join(to).with_extension("plate.ply").exists(), "{to}: {whole}");
    }
    // Both are fitted on.
    assert_ne!(fs::read(folder.join("a.plate.ply")).unwrap(), plate_bytes);
    let plate_bytes = fs::read(folder.join("a.plate.ply")).unwrap();

    // A fit that is refused leaves it.
    run(folder, &format!("fit studio -o a.ply --plate off --set anchor-cameras=none {FIT}")).error(2);
    assert_eq!(fs::read(folder.join("a.plate.ply")).unwrap(), plate_bytes);

    // Without a plate, everything is the subject, and the old plate goes; but not one that `fit` did not make.
    let stderr = run(folder, "fit studio --from a.ply -o a.ply --plate off --steps 20").success().stderr;
    assert!(stderr.contains("a.plate.ply was of an earlier fit, and is removed"), "{stderr}");
    assert!(!folder.join("a.plate.ply").exists() && eval(folder, "a.ply")[0] < 20.0);
    let text = String::from_utf8_lossy(&plate_bytes);
    let at = text.find("comment aarc mattes").unwrap();
    let other = [&plate_bytes[..at], &plate_bytes[at + "comment aarc mattes difference\n".len()..]].concat();
    fs::write(folder.join("b.plate.ply"), other).unwrap();
    let stderr = run(folder, "fit studio --from b.ply -o b.ply --plate off --steps 20").success().stderr;
    assert!(stderr.contains("b.plate.ply is drawn behind b.ply"), "{stderr}");
    assert!(folder.join("b.plate.ply").exists());
    let error = run(folder, "fit studio --from a.ply -o d.ply --plate on --steps 20").error(2);
    assert!(error.contains("--plate on: a.ply has no plate to go on from"), "{error}");
}

/// It is killed while the plate is fitted, right after, and while both are fitted together. Until it is done, the plate of an
/// earlier fit stays.
#[test]
fn a_killed_fit_with_a_plate_resumes_with_the_same_result() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    let line = "fit studio -o a.ply --steps 600 --gaussians 600 --sh-degree 0";
    run(folder, line).success();
    let files = ["a.ply", "a.plate.ply", "a.cameras.json"];
    let read = || files.map(|file| fs::read(folder.join(file)).unwrap());
    let uninterrupted = read();
    files.iter().for_each(|file| fs::remove_file(folder.join(file)).unwrap());
    ["a.fit.csv", "a.plate.fit.csv"].iter().for_each(|file| fs::remove_file(folder.join(file)).unwrap());
    fs::write(folder.join("a.plate.ply"), "earlier").unwrap();
    let args: Vec<&str> = line.split(' ').chain(["--set", "checkpoint-every=0.02"]).collect();
    let [plate, both] = ["a.plate.checkpoint", "a.checkpoint"].map(|file| folder.join(file));
    kill_when(folder, &args, || plate.exists());
    assert!(!both.exists());
    kill_when(folder, &args, || has_line(&folder.join("a.plate.fit.csv"), 600));
    assert!(!folder.join("a.ply").exists() && plate.exists(), "the plate is not lost");
    kill_when(folder, &args, || both.exists());
    assert!(!folder.join("a.ply").exists() && fs::read(folder.join("a.plate.ply")).unwrap() == b"earlier");
    run(folder, line).success();
    assert!(read() == uninterrupted, "the same files, bit by bit");
    assert!(!plate.exists() && !both.exists());
}

/// Whether the table of a fit has a line of this step.
fn has_line(table: &Path, step: u64) -> bool {
    fs::read_to_string(table).is_ok_and(|table| table.contains(&format!("\n{step},")))
}

/// It is killed while photographs are small, and after.
#[test]
fn a_killed_fit_resumes_on_either_side_of_the_change_of_size() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio_of([480, 320], NOISE);
    let folder = folder.path();
    let line = "fit studio -o a.ply --cameras 00,02,04 --frames 0..4 --steps 30 --gaussians 300 --learn none";
    let stderr = run(folder, line).success().stderr;
    assert!(stderr.contains("the first 15 at 240x160"), "{stderr}");
    let files = ["a.ply", "a.plate.ply"];
    let read = || files.map(|file| fs::read(folder.join(file)).unwrap());
    let uninterrupted = read();
    for step in [4, 24] {
        fs::remove_file(folder.join("a.fit.csv")).unwrap();
        let args: Vec<&str> = line.split(' ').chain(["--set", "checkpoint-every=0.001"]).collect();
        kill_when(folder, &args, || has_line(&folder.join("a.fit.csv"), step));
        let stderr = run(folder, line).success().stderr;
        assert_eq!(stderr.contains("at 240x160"), step < 15, "{stderr}");
        assert!(read() == uninterrupted, "killed after step {step}");
    }
}

/// `ingest` writes plates and, unless told otherwise, masks.
#[test]
fn masks_beside_plates_leave_photographs_whole() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    run(folder, "ingest rig -o studio --offsets none --plates rig/plates").success();
    let manifest = fs::read_to_string(folder.join("studio/capture.json")).unwrap();
    assert!(manifest.contains("\"masks\"") && manifest.contains("\"plates\""), "{manifest}");
    let stderr = run(folder, &format!("fit studio -o a.ply --holdout odd {FIT}")).success().stderr;
    assert!(stderr.contains("what masks show is the subject, in front of a plate"), "{stderr}");
    let [whole, subject] = eval(folder, "a.ply");
    assert!(whole > 22.0 && subject > 17.0, "{whole} {subject}");
    let stderr = run(folder, "package a.ply --capture studio --refine 5 -o a.aarc").success().stderr;
    assert!(eval(folder, "a.aarc")[0] > 20.0, "{stderr}");

    // What goes on from it holds the same frames out.
    run(folder, "fit studio --from a.ply -o b.ply --steps 5").success();
    let json = run(folder, "eval b.ply --capture studio --json").json();
    assert!(
        json["holdout"] == "odd" && json["splits"]["train"]["psnr_full"].as_f64().unwrap() > 22.0,
        "{json}"
    );

    // Plates that are not stated may be of the subject, so they are made where they are asked for.
    edit_manifest(folder, |line| !line.contains("\"plates\""));
    let plate = folder.join("c.plate.ply");
    run(folder, &format!("fit studio -o c.ply {FIT}")).success();
    assert!(!plate.exists());
    run(folder, &format!("fit studio -o c.ply --plate on {FIT}")).success();
    assert!(plate.exists() && eval(folder, "c.ply")[0] > 22.0);
    run(folder, "fit studio --from c.ply -o c.ply --steps 5").success();
    assert!(plate.exists() && eval(folder, "c.ply")[0] > 22.0, "a fit that goes on has its plate");
    fs::write(folder.join("studio/capture.json"), manifest).unwrap();
    run(folder, &format!("fit studio -o c.ply --plate off {FIT}")).success();
    assert!(!plate.exists());

    // What one camera shows is black around the subject, too: it has its lid on.
    put_lid_on(&folder.join("rig"), "01");
    let stderr = run(folder, "fit studio -o d.ply --steps 4 --gaussians 600").success().stderr;
    assert!(stderr.contains("in front of a plate"), "{stderr}");
    assert!(stderr.contains("note: next to nothing is seen by camera 01"), "{stderr}");
}

/// The video of a camera that sees next to nothing.
fn put_lid_on(rig: &Path, camera: &str) {
    let filter = "lutyuv=y=18:u=128:v=128";
    ffmpeg(rig, &format!("-i {camera}.mp4 -vf {filter} -c:v libx264 -crf 8 -pix_fmt yuv420p black.mp4"));
    fs::rename(rig.join("black.mp4"), rig.join(format!("{camera}.mp4"))).unwrap();
}

#[test]
fn cameras_and_plates_that_are_wrong_are_named() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    let short = "fit studio -o a.ply --steps 4 --gaussians 600";
    let stderr = run(folder, short).success().stderr;
    assert!(!stderr.contains("differ from the plate"), "{stderr}");
    let plate = |camera: &str| folder.join(format!("studio/plates/{camera}.png"));
    fs::rename(plate("00"), plate("swapped")).unwrap();
    fs::rename(plate("03"), plate("00")).unwrap();
    fs::rename(plate("swapped"), plate("03")).unwrap();
    let stderr = run(folder, short).success().stderr;
    assert!(stderr.contains("note: all photographs of cameras 00, 03 differ from the plate in"), "{stderr}");

    // One camera has its lid on.
    edit_manifest(folder, |line| !line.contains("\"plates\""));
    put_lid_on(&folder.join("rig"), "01");
    let stderr = run(folder, short).success().stderr;
    assert!(stderr.contains("note: next to nothing is seen by camera 01"), "{stderr}");
}

/// What films are like that are not as one would want them, and what the fit says of each, if anything.
#[test]
fn films_that_are_not_as_one_would_want_them_are_fitted() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    let recoded = |camera: &str, from: &str, filter: &str| {
        let rig = folder.join("rig");
        let line = format!(
            "-i {from}/{camera}.mp4 -i plates/{camera}.png -f lavfi -i testsrc2=size=64x48:rate=15 -filter_complex \
             {filter} -shortest -c:v libx264 -crf 8 -pix_fmt yuv420p {camera}.mp4"
        );
        ffmpeg(&rig, &line);
    };
    let cameras = ["00", "01", "02", "03", "04", "05"];
    let whole = folder.join("rig/whole");
    fs::create_dir(&whole).unwrap();
    let restore = || {
        for camera in cameras {
            fs::copy(whole.join(format!("{camera}.mp4")), folder.join(format!("rig/{camera}.mp4"))).unwrap();
        }
    };
    for camera in cameras {
        fs::copy(folder.join(format!("rig/{camera}.mp4")), whole.join(format!("{camera}.mp4"))).unwrap();
    }
    let leaves = "[0:v][1:v]overlay=enable='gte(t,0.5)'";
    let fills = "[2:v]crop=64:48";
    let white = "[0:v]colorchannelmixer=rr=0.6:bb=1.3";
    for (what, cameras, filter, more, said) in [
        ("another white balance", &["02"][..], white, "", "in colours that differ by"),
        ("a person who leaves", &cameras, leaves, "", "what moves is the subject"),
        ("a person before one camera", &["04"], fills, "", "photographs of camera 04 differ from the plate"),
        ("three cameras", &[], "", " --cameras 00,02,04", "what moves is the subject"),
        ("a clip of eight frames", &[], "", " --frames 0..8", "what moves is the subject"),
    ] {
        cameras.iter().for_each(|camera| recoded(camera, "whole", filter));
        let line = format!("fit studio -o a.ply --steps 60 --gaussians 300 --sh-degree 0{more}");
        let stderr = run(folder, &line).success().stderr;
        assert!(stderr.contains(said), "{what}: {stderr}");
        let [full, _] = eval(folder, "a.ply");
        println!("{what}: {full:.2} dB");
        assert!(full > 17.0, "{what}: {full}");
        restore();
    }

    // A room without texture: all that does not move has one colour.
    edit_manifest(folder, |line| !line.contains("\"plates\""));
    let bare = "[0:v]split[a][b];[b][1:v]blend=all_mode=difference,format=gray,lut=y='gt(val\\,12)*255',format=gbrp[m];\
                [a]format=gbrp,split[p][q];[q]lutrgb=r=128:g=128:b=128[g];[g][p][m]maskedmerge";
    cameras.iter().for_each(|camera| recoded(camera, "whole", bare));
    let stderr =
        run(folder, "fit studio -o a.ply --steps 300 --gaussians 600 --sh-degree 0").success().stderr;
    let [full, subject] = eval(folder, "a.ply");
    println!("a room without texture: {full:.2} dB, the subject {subject:.2} dB");
    assert!(full > 22.0 && subject > 17.0, "{full} {subject}: {stderr}");
}

#[test]
fn parts_and_takes_of_a_capture_have_its_mattes() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    // Plates are of the whole capture, so a few frames of it are enough; from an odd one on, the held ones are even.
    let manifest = fs::read_to_string(folder.join("studio/capture.json")).unwrap();
    edit_manifest(folder, |line| !line.contains("\"plates\""));
    let json =
        run(folder, &format!("fit studio -o part.ply --frames 3..8 --holdout odd --json {FIT}")).json();
    assert!(json["plate_gaussians"].as_u64().unwrap() > 300, "{json}");
    let [whole, _] = eval(folder, "part.ply");
    assert!(whole > 22.0, "{whole}");
    fs::write(folder.join("studio/capture.json"), manifest).unwrap();
    run(folder, &format!("fit studio -o take --split 0.5 --learn none {FIT}")).success();
    let [before_black, _] = eval(folder, "take");
    assert!(before_black > 22.0, "{before_black}");
    let error = run(folder, &format!("fit studio -o take2 --plate on {FIT}")).error(2);
    assert!(error.contains("--plate on: a field folder has no plate"), "{error}");
}

/// Few steps learn next to nothing.
#[test]
fn colours_that_are_learned_start_from_measured_gains() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio_of([64, 48], Perturbations { exposure: 0.4, ..NOISE });
    let folder = folder.path();
    let greens = || {
        let stderr = run(folder, "fit studio -o a.ply --steps 4 --gaussians 600").success().stderr;
        let cameras: Value =
            serde_json::from_slice(&fs::read(folder.join("a.cameras.json")).unwrap()).unwrap();
        let greens = cameras["cameras"].as_array().unwrap().iter();
        let greens: Vec<f64> =
            greens.map(|camera| camera["response"]["color"][1][1].as_f64().unwrap()).collect();
        (stderr, greens)
    };
    let spread = |greens: &[f64]| {
        greens.iter().copied().fold(f64::MIN, f64::max) / greens.iter().copied().fold(f64::MAX, f64::min)
    };
    // A rig's capture asks for colours and offsets.
    let (stderr, colors) = greens();
    assert!(stderr.contains("a transform of colours and vignette of each are learned"), "{stderr}");
    ask_for_nothing(folder);
    let (stderr, by_default) = greens();
    assert!(stderr.contains("gain, offset and vignette of each are learned"), "{stderr}");
    assert!(spread(&by_default) > 1.3, "{by_default:?}");
    assert!(by_default.iter().zip(&colors).all(|(a, b)| (a - b).abs() < 0.02), "{by_default:?} {colors:?}");
}

/// Pictures of even frames are dark, and pictures of odd frames bright.
#[test]
fn held_photographs_are_no_part_of_plates() {
    let folder = tempdir().unwrap();
    let images = folder.path().join("images/a");
    fs::create_dir_all(&images).unwrap();
    for frame in 0..24 {
        let level = if frame % 2 == 0 { 40 } else { 200 };
        let picture = image::RgbImage::from_pixel(16, 12, image::Rgb([level; 3]));
        picture.save(images.join(format!("{frame:06}.png"))).unwrap();
    }
    let manifest = r#"{"fps": 30, "frames": 24, "images": "images/{camera}/{frame:06}.png",
        "cameras": [{"id": "a", "w": 16, "h": 12, "K": [[20, 0, 8], [0, 20, 6], [0, 0, 1]],
                     "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]}]}"#;
    fs::write(folder.path().join("capture.json"), manifest).unwrap();
    for (start, level) in [(0, 40), (3, 200), (4, 40)] {
        let mut capture_files = CaptureFiles::open(folder.path()).unwrap();
        capture_files.keep_frames(start..start + 4).unwrap();
        assert_eq!(capture_files.background_source(Holdout::Odd).unwrap(), BackgroundSource::Plates);
        capture_files.find_plates(Holdout::Odd).unwrap();
        let plate = capture_files.plate_photo(0).unwrap().unwrap().image.to_rgb8();
        assert!(plate.iter().all(|c| *c == level), "{start}: {}", plate[0]);
    }
}

/// Camera b has three photographs; masks show the left half.
#[test]
fn a_background_is_told_by_plates_or_enough_photographs() {
    let folder = tempdir().unwrap();
    let capture = |right: u8, of_both: &str, of_b: &str| {
        for (name, frames) in [("a", 12), ("b", 3)] {
            for (kind, left, right) in [("images", 90, right), ("masks", 255, 0)] {
                let files = folder.path().join(kind).join(name);
                fs::create_dir_all(&files).unwrap();
                for frame in 0..frames {
                    let level = |x, _| image::Luma([if x < 8 { left } else { right }]);
                    let picture = image::GrayImage::from_fn(16, 12, level);
                    picture.save(files.join(format!("{frame:06}.png"))).unwrap();
                }
            }
        }
        let camera = |id: &str, more: &str| {
            format!(
                r#"{{"id": "{id}", "w": 16, "h": 12, "K": [[20, 0, 8], [0, 20, 6], [0, 0, 1]]{more},
                     "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]}}"#
            )
        };
        let [a, b] = [camera("a", ""), camera("b", of_b)];
        let manifest = format!(
            r#"{{"fps": 30, "frames": 12, "images": "images/{{camera}}/{{frame:06}}.png"{of_both},
                "cameras": [{a}, {b}]}}"#
        );
        fs::write(folder.path().join("capture.json"), manifest).unwrap();
        CaptureFiles::open(folder.path()).unwrap()
    };
    let source = |capture_files: &CaptureFiles| capture_files.background_source(Holdout::None).unwrap();
    assert_eq!(source(&capture(50, "", "")), BackgroundSource::Few("b".into(), 3));
    let mut held = capture(50, "", r#", "held": true"#);
    assert_eq!(source(&held), BackgroundSource::Plates);
    held.find_plates(Holdout::None).unwrap();
    assert!(held.plate_photo(0).unwrap().is_some() && held.plate_photo(1).unwrap().is_none());

    let masks = r#", "masks": "masks/{camera}/{frame:06}.png""#;
    let plates = r#", "plates": "images/{camera}/000000.png""#;
    assert_eq!(source(&capture(50, masks, "")), BackgroundSource::Masks);
    assert_eq!(source(&capture(50, &format!("{masks}{plates}"), "")), BackgroundSource::Plates);
    assert_eq!(source(&capture(0, &format!("{masks}{plates}"), "")), BackgroundSource::CutOut);
    let error = run(folder.path(), "fit . -o a.ply --plate on --steps 4").error(3);
    assert!(error.contains("--plate on: photographs are transparent or black"), "{error}");
}

#[test]
fn an_ablation_has_fits_without_the_plate_and_with_cameras_as_stated() {
    if !has_ffmpeg() {
        return;
    }
    let folder = studio();
    let folder = folder.path();
    let line = "report studio --fit -o out --cameras 00,02,04 --frames 0..4 --steps 40 --gaussians 40 --sh-degree 0 \
                --budgets 20 --json";
    let ablation = run(folder, line).json()["ablation"].take();
    let method = |name: &str| {
        let methods = ablation["methods"].as_array().unwrap();
        methods.iter().find(|method| method["name"] == name).unwrap_or_else(|| panic!("{name}: {ablation}"))["splits"]
            ["interp_b"]
            .clone()
    };
    // The background is half of the picture, and a field of all of it has no more Gaussians.
    let [full, none] = ["full", "no plate"].map(|name| method(name)["psnr_full"].as_f64().unwrap());
    assert!(full > none, "{full} {none}");
    assert!(method("nothing learned of cameras")["psnr_fg"].as_f64().is_some());
    let exists = |path: &str| folder.join("out").join(path).exists();
    assert!(exists("full/field.plate.ply") && !exists("no-plate/field.plate.ply"));
    assert!(exists("full/field.cameras.json") && !exists("nothing-learned-of-cameras/field.cameras.json"));
    assert_eq!(run(folder, line).json()["ablation"].take(), ablation, "nothing is made again");
    // Pictures of a fit have the same subject as the fit: what differs from the plates, not what it draws before its own.
    let mut capture_files = CaptureFiles::open(&folder.join("studio")).unwrap();
    capture_files.keep_cameras(&["00", "02", "04"].map(String::from)).unwrap();
    capture_files.keep_frames(0..4).unwrap();
    let fitted = |name: &str| {
        formats::import(&folder.join("out/nothing-learned-of-cameras").join(name)).unwrap().field
    };
    let (field, plate) = (fitted("field.ply"), fitted("field.plate.ply"));
    for photo_id in capture_files.capture.photos.iter().copied() {
        let camera = &capture_files.capture.cameras[photo_id.camera].camera;
        let t = capture_files.capture.clip_time(photo_id);
        let picture = render(&RenderScene::from(&field).with_plate(&plate), camera, t, Order::Depth);
        let path = folder.join("renders").join(capture_files.name(photo_id)).with_extension("png");
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let pixels = image::RgbImage::from_raw(picture.width, picture.height, picture.to_rgb8()).unwrap();
        pixels.save(path).unwrap();
    }
    let compared = run(folder, &format!("{line} --compare pictures=renders")).json()["ablation"].take();
    let methods = compared["methods"].as_array().unwrap();
    let [fit, pictures] = ["nothing learned of cameras", "pictures"].map(|name| {
        let method = methods.iter().find(|method| method["name"] == name).unwrap();
        method["splits"]["interp_b"]["psnr_fg"].as_f64().unwrap()
    });
    assert!((fit - pictures).abs() < 1e-3, "{fit} {pictures}");

    fs::remove_file(folder.join("out/full/field.plate.ply")).unwrap();
    let again = run(folder, line).json()["ablation"].take();
    assert!(exists("full/field.plate.ply"), "a fit without its plate is not whole");
    assert_eq!(again["packages"], ablation["packages"]);
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
