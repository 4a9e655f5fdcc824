//! Captures without masks: a field of what moves, in front of a plate of what does not.

use std::fs;
use std::path::Path;

use crate::small_stage::kill_when;
use crate::tool::{Outcome, aarc_studio, ffmpeg, has_ffmpeg};
use refine::capture::Holdout;
use serde_json::Value;
use studio::capture::CaptureFiles;
use studio::synth::rig::{Perturbations, Rig, RigSettings, write};
use tempfile::{TempDir, tempdir};

const FIT: &str = "--steps 300 --gaussians 600 --sh-degree 0";

/// A capture of videos without masks, with plates, and the masks of the figure beside.
fn studio() -> TempDir {
    studio_of(Perturbations { noise: 1.0, ..Perturbations::NONE })
}

fn studio_of(perturbations: Perturbations) -> TempDir {
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
        perturbations,
    };
    write(&folder.path().join("rig"), &Rig::new(&settings).unwrap(), || {}).unwrap();
    run(folder.path(), "ingest rig -o studio --offsets none --plates rig/plates --mattes off").success();
    folder
}

fn run(folder: &Path, arguments: &str) -> Outcome {
    aarc_studio(folder, &arguments.split(' ').collect::<Vec<_>>())
}

/// From now on, the capture asks a fit to learn nothing of its cameras.
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

/// It is killed while the plate is fitted, right after, and while both are fitted together.
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
    fs::remove_file(folder.join("a.fit.csv")).unwrap();
    let args: Vec<&str> = line.split(' ').chain(["--set", "checkpoint-every=0.02"]).collect();
    let [plate, both] = ["a.plate.checkpoint", "a.checkpoint"].map(|file| folder.join(file));
    kill_when(folder, &args, || plate.exists());
    assert!(!folder.join("a.plate.ply").exists() && !both.exists());
    kill_when(folder, &args, || folder.join("a.plate.ply").exists());
    assert!(!folder.join("a.ply").exists() && plate.exists(), "the plate is not lost");
    let fitted = fs::read(folder.join("a.plate.ply")).unwrap();
    kill_when(folder, &args, || both.exists());
    assert!(!folder.join("a.ply").exists() && fs::read(folder.join("a.plate.ply")).unwrap() == fitted);
    run(folder, line).success();
    assert!(read() == uninterrupted, "the same files, bit by bit");
    assert!(!plate.exists() && !both.exists());
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
    let rig = folder.join("rig");
    ffmpeg(&rig, "-i 01.mp4 -vf lutyuv=y=18:u=128:v=128 -c:v libx264 -crf 8 -pix_fmt yuv420p black.mp4");
    fs::rename(rig.join("black.mp4"), rig.join("01.mp4")).unwrap();
    let stderr = run(folder, short).success().stderr;
    assert!(stderr.contains("note: next to nothing is seen by camera 01"), "{stderr}");
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
    let folder = studio_of(Perturbations { noise: 1.0, exposure: 0.4, ..Perturbations::NONE });
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
        assert!(capture_files.can_be_matted(Holdout::Odd).unwrap());
        capture_files.find_plates(Holdout::Odd).unwrap();
        let plate = capture_files.plate_photo(0).unwrap().unwrap().image.to_rgb8();
        assert!(plate.iter().all(|c| *c == level), "{start}: {}", plate[0]);
    }
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
