//! `cargo xtask ingest` makes masks: compared with the masks of a rig whose truth is known, resumed, and with plates of
//! their own. Without ffmpeg all tests are skipped.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use crate::tool::{ffmpeg, has_ffmpeg, ingest, refused};
use image::{GrayImage, RgbImage};
use serde_json::Value;
use studio::capture::CaptureFiles;
use studio::synth::rig::{Perturbations, Rig, RigSettings, write};
use tempfile::{TempDir, tempdir};

const CAMERAS: usize = 3;

/// A rig whose cameras differ in exposure and white balance, with noise, and a figure that casts a shadow.
fn rig(size: [u32; 2], shadow: bool) -> TempDir {
    let folder = tempdir().unwrap();
    let settings = RigSettings {
        cameras: CAMERAS,
        seconds: 2.0,
        fps: 15.0,
        size,
        seed: 5,
        crf: 18,
        shadow,
        masks: true,
        perturbations: Perturbations { rotated: true, ..Perturbations::ALL },
    };
    write(&folder.path().join("rig"), &Rig::new(&settings).unwrap(), || ()).unwrap();
    folder
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
        let [found, truth] =
            [path, folder.join(format!("rig/masks/{id}/{nearest:06}.png"))].map(|p| gray(&p));
        assert_eq!(found.dimensions(), truth.dimensions());
        let pixels = || found.pixels().zip(truth.pixels()).map(|(a, b)| (a.0[0] >= 128, b.0[0] >= 128));
        let either = pixels().filter(|(a, b)| *a || *b).count();
        ious.push(pixels().filter(|(a, b)| *a && *b).count() as f64 / either.max(1) as f64);
    }
    // At a variable rate, a third of the frames has no picture that is near enough.
    let frames = manifest["frames"].as_u64().unwrap() as usize;
    assert!(
        ious.len() > frames / 2 && (camera == CAMERAS - 1 || ious.len() == frames),
        "{camera}: {}",
        ious.len()
    );
    ious
}

/// Mean of the masks of all cameras, and the mean of the worst camera.
fn mean_and_least(folder: &Path) -> (f64, f64) {
    let means: Vec<f64> = (0..CAMERAS)
        .map(|camera| {
            let ious = ious(folder, camera);
            ious.iter().sum::<f64>() / ious.len() as f64
        })
        .collect();
    let least = means.iter().copied().fold(1.0, f64::min);
    (means.iter().sum::<f64>() / CAMERAS as f64, least)
}

#[test]
fn masks_of_a_rig_are_those_of_its_truth() {
    if !has_ffmpeg() {
        return;
    }
    for (size, shadow, bound) in [(160, false, 0.88), (160, true, 0.8), (320, true, 0.86)] {
        let folder = rig([size, size * 3 / 4], shadow);
        let folder = folder.path();
        let outcome = ingest(folder, "--plates rig/plates --json");
        let (mean, least) = mean_and_least(folder);
        println!("{size} wide, shadow {shadow}, with plates: IoU {mean:.4}, worst camera {least:.4}");
        assert!(mean > bound, "{size} {shadow}: {mean}");
        let json = outcome.json();
        assert_eq!(json["mattes"][0]["source"], "empty_picture");
        assert!(
            json["mattes"][1]["shares"].as_array().unwrap().len() > 20
                && !json.to_string().contains("thumbnails")
        );
        let files = CaptureFiles::open(&folder.join("studio")).unwrap();
        assert!(files.files().any(|path| path.to_string_lossy().contains("masks/01/")));
        let plate = files.plate_photo(1).unwrap().unwrap().image.to_rgb8();
        assert_eq!(plate, image::open(folder.join("rig/plates/01.png")).unwrap().into_rgb8().into_raw());
        // The figure strikes on the spot, so without plates part of it is in them.
        ingest(folder, "").success();
        let (mean, least) = mean_and_least(folder);
        println!("{size} wide, shadow {shadow}, without: IoU {mean:.4}, worst camera {least:.4}");
        assert!(mean > 0.5, "{size} {shadow}: {mean}");
    }
}

#[test]
fn a_rig_is_as_large_as_its_subject_says() {
    if !has_ffmpeg() {
        return;
    }
    let folder = rig([320, 240], false);
    let json = ingest(folder.path(), "--plates rig/plates --height 3.4 --json").json();
    // The figure is 1.7 m tall, and its feet stand apart.
    let metres = json["placement"]["metres_per_unit"].as_f64().unwrap();
    println!("{metres} metres per unit");
    assert!((metres / 2.0 - 1.0).abs() < 0.05, "{metres}");
    assert_eq!(
        json_file(&folder.path().join("studio/capture.json"))["metres_per_unit"].as_f64(),
        Some(metres)
    );
    let refused_with = |options: &str, code| refused(ingest(folder.path(), options), code);
    assert!(
        refused_with("--height 1.7 --mattes off", 2).contains("--height measures the subject in its mattes")
    );
}

/// A rig of two cameras that a bright square crosses for two seconds, before a noisy wall.
fn crossed() -> TempDir {
    let folder = tempdir().unwrap();
    let rig = folder.path().join("rig");
    fs::create_dir_all(folder.path().join("empty")).unwrap();
    fs::create_dir(&rig).unwrap();
    let wall = RgbImage::from_fn(128, 96, |x, y| {
        let hash = (x / 9).wrapping_mul(0x9e37_79b9) ^ (y / 7).wrapping_mul(0x85eb_ca6b);
        let hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
        image::Rgb([8, 16, 24].map(|bits| 60 + (hash >> bits) as u8 / 4))
    });
    for name in ["a", "b"] {
        wall.save(folder.path().join(format!("empty/{name}.png"))).unwrap();
        let line = format!(
            "-loop 1 -framerate 10 -t 2 -i ../empty/{name}.png -f lavfi -i color=0xf0d010:s=24x24:r=10:d=2 -filter_complex \
             [0][1]overlay=x=60*t:y=40:shortest=1,noise=alls=6:allf=t -c:v libx264 -crf 12 -pix_fmt yuv420p {name}.mp4"
        );
        ffmpeg(&rig, &line);
    }
    let camera = |name: &str| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [ 128.0, 96.0]\nmatrix = [ [ 90.0, 0.0, 63.5], [ 0.0, 90.0, 47.5], [ 0.0, 0.0, 1.0]]\n\
             distortions = [ 0.0, 0.0, 0.0, 0.0]\nrotation = [ 0.0, 0.0, 0.0]\ntranslation = [ 0.0, 0.0, 3.0]\nfisheye = false\n\n"
        )
    };
    fs::write(rig.join("calibration.toml"), camera("a") + &camera("b")).unwrap();
    folder
}

/// Intersection over union of a mask and the square of its frame.
fn iou_with_square(path: &Path, frame: u32) -> f64 {
    let is_in = |x: u32, y: u32| (6 * frame..6 * frame + 24).contains(&x) && (40..64).contains(&y);
    let mask = gray(path);
    let pixels = || mask.enumerate_pixels().map(|(x, y, alpha)| (alpha.0[0] >= 128, is_in(x, y)));
    pixels().filter(|(a, b)| *a && *b).count() as f64 / pixels().filter(|(a, b)| *a || *b).count() as f64
}

#[test]
fn what_crosses_the_picture_is_found_without_plates() {
    if !has_ffmpeg() {
        return;
    }
    let folder = crossed();
    let folder = folder.path();
    let outcome = ingest(folder, "--offsets none");
    let text = outcome.success().stdout;
    assert!(
        text.contains("mattes      the subject covers 4.") && text.contains("fit studio -o field.ply\n"),
        "{text}"
    );
    let mask = |frame: u32| folder.join(format!("studio/masks/a/{frame:06}.png"));
    for frame in 0..16 {
        let iou = iou_with_square(&mask(frame), frame);
        assert!(iou > 0.95, "{frame}: {iou}");
    }
    let page = fs::read_to_string(folder.join("studio/ingest.html")).unwrap();
    assert!(page.contains("plate: median of the video") && page.contains("The subject covers 4."));

    // A camera whose masks are there is left alone; of one that lacks a mask, that is made again.
    let changed = |path: &Path| -> SystemTime { fs::metadata(path).unwrap().modified().unwrap() };
    let (before, deleted) = (changed(&mask(3)), fs::read(mask(5)).unwrap());
    assert!(
        ingest(folder, "--offsets none").success().stdout.contains("each video (kept from an earlier run)")
    );
    fs::remove_file(mask(5)).unwrap();
    assert!(!ingest(folder, "--offsets none").success().stdout.contains("each video (kept"));
    assert_eq!((fs::read(mask(5)).unwrap(), changed(&mask(3))), (deleted, before));
    fs::remove_file(folder.join("studio/plates/b.png")).unwrap();
    ingest(folder, "--offsets none").success();
    assert!(folder.join("studio/plates/b.png").is_file());
    // Another rate is another set of frames.
    ingest(folder, "--offsets none --fps 5").success();
    assert!(iou_with_square(&mask(3), 6) > 0.95);
    assert!(mask(9).exists() && !mask(10).exists());

    ingest(folder, "--offsets none --mattes off").success();
    let manifest = json_file(&folder.join("studio/capture.json"));
    assert!(manifest.get("masks").is_none() && manifest["plates"] == "plates/{camera}.png", "{manifest}");
}

#[test]
fn plates_are_of_the_size_and_exposure_of_the_videos() {
    if !has_ffmpeg() {
        return;
    }
    let folder = crossed();
    let (folder, empty) = (folder.path(), folder.path().join("empty"));
    let run = || ingest(folder, "--offsets none --plates empty");
    run().success();
    assert!(iou_with_square(&folder.join("studio/masks/b/000004.png"), 4) > 0.95);
    let whole = image::open(empty.join("b.png")).unwrap().into_rgb8();
    let exposed = |factor: f64| {
        let mut plate = whole.clone();
        plate.pixels_mut().for_each(|p| p.0 = p.0.map(|c| (f64::from(c) * factor).min(255.0) as u8));
        plate.save(empty.join("b.png")).unwrap();
    };
    exposed(0.7);
    let json = ingest(folder, "--offsets none --plates empty --json").json();
    let gain = json["mattes"][1]["gains"][1].as_f64().unwrap();
    assert!((gain * 0.7 - 1.0).abs() < 0.02, "{gain}");
    assert!(json["warnings"].to_string().contains("times as bright as its plate in red, green and blue"));
    assert!(iou_with_square(&folder.join("studio/masks/b/000004.png"), 4) > 0.95);
    exposed(0.4);
    let error = refused(run(), 3);
    assert!(
        error.contains("empty/b.png: ")
            && error.contains("times as bright as this plate, beyond a factor of 2"),
        "{error}"
    );
    // Without mattes it is of no use, but harms nothing.
    let json = ingest(folder, "--offsets none --plates empty --mattes off --json").json();
    assert!(json["warnings"].to_string().contains("beyond a factor of 2 it gives no mattes"), "{json}");
    image::imageops::thumbnail(&whole, 64, 48).save(empty.join("b.png")).unwrap();
    let error = refused(run(), 3);
    assert!(
        error.contains("empty/b.png: 64x48 pixels, but ") && error.contains("b.mp4 has 128x96"),
        "{error}"
    );
    fs::write(empty.join("b.png"), b"no picture").unwrap();
    assert!(refused(run(), 3).contains("empty/b.png: "));
    fs::remove_file(empty.join("b.png")).unwrap();
    assert!(refused(run(), 3).contains("there is no plate of b in it; put b.png or b.mp4 there"));
    // A video of the empty place does as well, with the noise of the camera.
    ffmpeg(
        &empty,
        "-loop 1 -framerate 10 -t 1 -i a.png -vf noise=alls=6:allf=t -c:v libx264 -crf 12 -pix_fmt yuv420p b.mov",
    );
    run().success();
    let iou = iou_with_square(&folder.join("studio/masks/b/000004.png"), 4);
    assert!(iou > 0.95, "{iou}");
    assert!(
        refused(ingest(folder, "--offsets none --plates nowhere"), 3).contains("nowhere: there is no such")
    );
}

#[test]
fn what_ingest_did_not_make_stays() {
    if !has_ffmpeg() {
        return;
    }
    let folder = crossed();
    let folder = folder.path();
    for foreign in ["studio/masks/a/000000.png", "studio/plates/b.png", "studio/capture.json"] {
        let path = folder.join(foreign);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, "of another program").unwrap();
        let error = refused(ingest(folder, "--offsets none"), 2);
        assert!(error.contains("not from an earlier run of ingest"), "{foreign}: {error}");
        assert_eq!(fs::read(&path).unwrap(), b"of another program");
        fs::remove_dir_all(folder.join("studio")).unwrap();
    }
    // Masks of another program beside its own plates stay, too.
    ingest(folder, "--offsets none --mattes off").success();
    let foreign = folder.join("studio/masks/a/000000.png");
    fs::create_dir_all(foreign.parent().unwrap()).unwrap();
    fs::write(&foreign, "of another program").unwrap();
    assert!(
        refused(ingest(folder, "--offsets none"), 2)
            .contains("studio/masks/a: it is not from an earlier run")
    );
    assert_eq!(fs::read(&foreign).unwrap(), b"of another program");
    fs::remove_dir_all(folder.join("studio/masks")).unwrap();
    // It replaces its own files, also the files of a run that was killed before it had written all.
    ingest(folder, "--offsets none").success();
    fs::remove_file(folder.join("studio/ingest/mattes-a.json")).unwrap();
    ingest(folder, "--offsets none").success();
}

#[test]
fn mattes_of_next_to_nothing_or_too_much_are_said() {
    if !has_ffmpeg() {
        return;
    }
    let folder = crossed();
    let (folder, rig) = (folder.path(), folder.path().join("rig"));
    ffmpeg(&rig, "-loop 1 -framerate 10 -t 2 -i ../empty/a.png -c:v libx264 -pix_fmt yuv420p a.mp4");
    // A wall of another place.
    let mut plate = image::open(folder.join("empty/b.png")).unwrap().into_rgb8();
    image::imageops::rotate180_in_place(&mut plate);
    plate.save(folder.join("empty/b.png")).unwrap();
    let warnings = ingest(folder, "--offsets none --plates empty --json").json()["warnings"].to_string();
    assert!(
        warnings.contains("a: the subject covers 0 % of its pictures; if it is there, it hardly moves"),
        "{warnings}"
    );
    // The subject of one camera cannot be measured, so what an earlier run wrote stays.
    let manifest = || fs::read(folder.join("studio/capture.json")).unwrap();
    let before = manifest();
    let error = refused(ingest(folder, "--offsets none --plates empty --height 1.7"), 3);
    assert!(
        error.contains("--height 1.7: the subject cannot be measured") && error.contains("--metres-per-unit"),
        "{error}"
    );
    assert!(manifest() == before);
    // That of other options would not fit the masks.
    refused(ingest(folder, "--offsets none --plates empty --height 1.7 --fps 5"), 3);
    assert!(!folder.join("studio/capture.json").exists());
    assert!(
        warnings.contains("b: the subject covers ")
            && warnings.contains("whether the camera or the background moves"),
        "{warnings}"
    );
}
