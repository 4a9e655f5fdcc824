//! `cargo xtask fit` and its output, on a capture by a ray tracer.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

use crate::small_stage::{fit, kill_when, measured, stage, stage_of};
use crate::tool::aarc_studio;
use codec::PixelFilter;
use formats::import;
use refine::capture::{CalibratedCamera, Holdout};
use serde_json::Value;
use studio::capture::CaptureFiles;
use studio::fields::FitRecord;
use studio::fit::crc;
use tempfile::tempdir;

#[test]
fn a_fit_generalizes_to_held_out_photographs() {
    let folder = stage_of("9");
    let folder = folder.path();
    let json = fit(folder, &["--steps", "800", "--gaussians", "1500", "--anchor", "hull"]);
    assert_eq!((json["steps"].as_u64(), json["non_finite"].as_u64()), (Some(800), Some(0)));
    assert!(json["gaussians"].as_u64() > json["gaussians_at_start"].as_u64(), "{json}");
    let (held_frames, both_held) = (measured(folder, "interp_b"), measured(folder, "interp_a"));
    println!("held frames {held_frames:.2} dB, held cameras in held frames {both_held:.2} dB");
    assert!(held_frames > 18.0 && both_held > 15.0, "{held_frames} {both_held}");
    let table = fs::read_to_string(folder.join("field.fit.csv")).unwrap();
    assert_eq!(table.lines().count(), 51);
    let size = image::image_dimensions(folder.join("field.fit.png")).unwrap();
    assert_eq!(size, (96, 48));
    assert!(!folder.join("field.checkpoint").exists());
    // Its viewpoints are at fitted cameras and look at the figure, which stands on the origin.
    let viewpoints = import(&folder.join("field.ply")).unwrap().hints.viewpoints;
    let held = json["held_cameras"]["cameras"].as_array().unwrap();
    assert!(!viewpoints.is_empty() && !held.is_empty());
    for viewpoint in viewpoints {
        let [x, y, z] = [0, 1, 2].map(|axis| viewpoint.target[axis] - [0.0, 0.9, 0.0][axis]);
        let is_held = held.iter().any(|camera| camera["camera"] == viewpoint.name.as_str());
        assert!(x.hypot(y).hypot(z) < 0.3 && !is_held, "{viewpoint:?}");
    }
    // Nearer than a fifth of the way to the figure, what no other camera sees is left out.
    let distance = |camera: &CalibratedCamera| {
        let [x, y, z] = camera.camera.position();
        x.hypot(y - 0.9).hypot(z)
    };
    let cameras = CaptureFiles::open(&folder.join("stage")).unwrap().capture.cameras;
    let nearest = cameras.iter().map(distance).fold(f64::INFINITY, f64::min);
    let farthest = cameras.iter().map(distance).fold(0.0, f64::max);
    let near = f64::from(import(&folder.join("field.ply")).unwrap().field.near);
    assert!((0.19 * nearest..0.21 * farthest).contains(&near), "{near} for {nearest} to {farthest}");
    // The field can be packaged, and the package says it, too.
    aarc_studio(folder, &["package", "field.ply", "--budget", "800", "--rank", "mass"]).success();
    let packaged = aarc_studio(folder, &["inspect", "field.aarc", "--json"]).json()["near"].as_f64().unwrap();
    assert!((packaged - near).abs() < 1e-5, "{packaged} {near}");

    // Without an anchor, the same number of steps gives a worse field.
    fit(folder, &["--steps", "800", "--gaussians", "1500", "--anchor", "none"]);
    let scattered = measured(folder, "interp_b");
    assert!(scattered < held_frames - 1.0, "{scattered} without an anchor, {held_frames} with one");
}

/// A capture in kilometres, in millimetres, and in metres about a far origin, as geographic coordinates have it.
#[test]
fn a_fit_depends_neither_on_the_unit_nor_on_the_origin() {
    let folder = stage();
    let folder = folder.path();
    let path = folder.join("stage/capture.json");
    let metres: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let psnr = |unit: f64, origin: [f64; 3]| {
        let mut manifest = metres.clone();
        manifest["metres_per_unit"] = (1.0 / unit).into();
        for camera in manifest["cameras"].as_array_mut().unwrap() {
            for axis in 0..3 {
                let number = |column: usize| camera["w2c"][axis][column].as_f64().unwrap();
                let offset: f64 = (0..3).map(|column| number(column) * origin[column]).sum();
                camera["w2c"][axis][3] = (unit * number(3) - offset).into();
            }
        }
        fs::write(&path, manifest.to_string()).unwrap();
        fit(folder, &["--steps", "300", "--gaussians", "600"]);
        // The figure's middle, 0.9 m above the floor, as far from the eye as its cameras are.
        let viewpoint = import(&folder.join("field.ply")).unwrap().hints.viewpoints.swap_remove(0);
        let arm = [0, 1, 2].map(|axis| f64::from(viewpoint.position[axis] - viewpoint.target[axis]) / unit);
        let distance = arm.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((2.0..4.5).contains(&distance), "{viewpoint:?}");
        measured(folder, "train")
    };
    let expected = psnr(1.0, [0.0; 3]);
    assert!(expected > 15.0, "{expected}");
    for (unit, origin) in [(1e-3, [0.0; 3]), (1e3, [0.0; 3]), (1.0, [448_262.5, 130.0, 5_411_932.25])] {
        let psnr = psnr(unit, origin);
        assert!((psnr - expected).abs() < 0.5, "{unit} {origin:?}: {psnr} dB, {expected} dB in metres");
    }
}

/// A fit ends with what `eval` measures, here of all frames.
#[test]
fn a_fit_ends_with_the_cameras_that_it_held() {
    let folder = stage();
    let folder = folder.path();
    let held = fit(folder, &["--steps", "60", "--gaussians", "300"])["held_cameras"].clone();
    aarc_studio(folder, &["eval", "field.ply", "--capture", "stage", "-o", "out"]).success();
    let csv = fs::read_to_string(folder.join("out/eval.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column = |key: &str| rows[0].iter().position(|name| *name == key).unwrap();
    let cameras = held["cameras"].as_array().unwrap();
    let is_held = |row: &&Vec<&str>| ["recon", "interp_a"].contains(&row[column("split")]);
    assert!(!cameras.is_empty() && rows.iter().filter(is_held).count() == 5 * cameras.len(), "{held}");
    let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / numbers.len() as f64;
    for key in ["psnr_full", "psnr_full_aligned", "psnr_moving", "psnr_moving_aligned"] {
        let of_cameras: Vec<f64> = cameras.iter().map(|camera| camera[key].as_f64().unwrap()).collect();
        for (camera, psnr) in cameras.iter().zip(&of_cameras) {
            let of_camera = rows.iter().filter(|row| row[column("camera")] == camera["camera"]);
            let judged: Vec<f64> = of_camera.filter_map(|row| row[column(key)].parse().ok()).collect();
            assert!((mean(&judged) - psnr).abs() < 1e-3, "{key}: {judged:?} {psnr}");
            assert_eq!(camera["images"], 5);
        }
        assert!((held["mean"][key].as_f64().unwrap() - mean(&of_cameras)).abs() < 1e-9, "{held}");
    }
    let name = cameras[0]["camera"].as_str().unwrap();
    let fit = |more: &str| {
        let line = format!("fit stage -o field.ply --steps 5 --gaussians 200 --sh-degree 0 {more}");
        aarc_studio(folder, &line.split(' ').filter(|word| !word.is_empty()).collect::<Vec<_>>()).success()
    };
    let text = fit("").stdout;
    assert!(text.contains(&format!("| {name} | 5 | ")) && text.contains("\n| mean | "), "{text}");
    // Without held cameras there is no table.
    let train = rows.iter().filter(|row| row[column("split")] == "train");
    let fitted: BTreeSet<&str> = train.map(|row| row[column("camera")]).collect();
    let fitted = Vec::from_iter(fitted).join(",");
    assert!(!fit(&format!("--cameras {fitted}")).stdout.contains("| held camera |"));
    // A photograph that is read only after the fit does not undo it: of the held ones, the table of the fit has eight.
    fs::write(folder.join(format!("stage/images/{name}/000002.png")), b"no picture").unwrap();
    let outcome = fit("--holdout odd");
    assert!(outcome.stderr.contains("note: held cameras are not judged: "), "{}", outcome.stderr);
}

#[test]
fn a_killed_fit_resumes_with_the_same_result() {
    let folder = stage();
    let folder = folder.path();
    let args =
        ["fit", "stage", "-o", "field.ply", "--steps", "2000", "--gaussians", "600", "--sh-degree", "0"];
    let json = [&args[..], &["--json"]].concat();
    aarc_studio(folder, &json).json();
    let uninterrupted = fs::read(folder.join("field.ply")).unwrap();
    for path in ["field.ply", "field.fit.csv"] {
        fs::remove_file(folder.join(path)).unwrap();
    }

    // Kills it beyond the first density control and between two lines of the table.
    let is_ready = || {
        let table = fs::read_to_string(folder.join("field.fit.csv")).unwrap_or_default();
        let step = table.lines().last().and_then(|line| line.split(',').next()?.parse::<u64>().ok());
        let is_ready = step.is_some_and(|step| step >= 700);
        thread::sleep(Duration::from_millis(if is_ready { 100 } else { 0 }));
        is_ready
    };
    // The default is minutes.
    kill_when(folder, &[&args[..], &["--set", "checkpoint-every=0.05"]].concat(), is_ready);
    assert!(!folder.join("field.ply").exists(), "nothing half-written");

    // A fit with other options does not resume from it.
    let other = [&args[..], &["--set", "seed=1"]].concat();
    let error = aarc_studio(folder, &other).error(2);
    assert!(error.contains("field.checkpoint is of a fit with other options"), "{error}");
    let output = Command::new(env!("CARGO_BIN_EXE_aarc-studio"))
        .current_dir(folder)
        .args(&json)
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .unwrap();
    let resumed: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(resumed["resumed_at"].as_u64().unwrap() >= 600, "{resumed}");
    assert!(
        fs::read(folder.join("field.ply")).unwrap() == uninterrupted,
        "the same field on one thread, bit by bit"
    );

    for (contents, what) in [
        (&b"aarcfit\x0d and then nonsense"[..], "the checkpoint is damaged"),
        (b"aarcfit\x08 of an earlier program", "no checkpoint of this version; remove it to start"),
    ] {
        fs::write(folder.join("field.checkpoint"), contents).unwrap();
        let error = aarc_studio(folder, &args).error(3);
        assert!(error.contains(&format!("field.checkpoint: {what}")), "{error}");
        assert!(fs::read(folder.join("field.checkpoint")).unwrap() == contents, "it stays");
    }
}

#[test]
fn the_fragment_term_saves_fragments() {
    let folder = stage();
    let folder = folder.path();
    let fit = |more: &str| -> Value {
        let args = "fit stage -o field.ply --steps 300 --gaussians 600 --json";
        aarc_studio(folder, &format!("{args} {more}").split_whitespace().collect::<Vec<_>>()).json()
    };
    let number = |json: &Value, key: &str| json[key].as_f64().unwrap();
    let [without, default, high] = ["--rule paper", "", "--set fragment-weight=0.01"].map(fit);
    assert_eq!([&without, &default, &high].map(|json| number(json, "fragment_weight")), [0.0, 0.001, 0.01]);
    let fragments = [&without, &default, &high].map(|json| number(json, "fragments_per_lit_pixel"));
    println!("fragments per lit pixel: {fragments:.1?}");
    assert!(fragments[2] < 0.9 * fragments[1] && fragments[1] < fragments[0], "{fragments:?}");
}

#[test]
fn a_fit_starts_from_a_field() {
    let folder = stage();
    let folder = folder.path();
    fit(folder, &["--steps", "100", "--gaussians", "600"]);
    let before = measured(folder, "train");
    fs::rename(folder.join("field.ply"), folder.join("first.ply")).unwrap();
    let more = "fit stage -o field.ply --steps 200 --gaussians 600 --holdout odd --from first.ply";
    assert_eq!(aarc_studio(folder, &more.split(' ').collect::<Vec<_>>()).code, Some(0));
    let after = measured(folder, "train");
    assert!(after > before + 0.5, "{before} before, {after} after");

    let from = ["fit", "stage", "-o", "other.ply", "--steps", "1", "--from", "first.ply"];
    let error = aarc_studio(folder, &[&from[..], &["--frames", "0..3"]].concat()).error(2);
    assert!(error.contains("--frames 0..3: first.ply was fitted to frames 0..5"), "{error}");
    // A new field has the mip filter; one that a fit starts from keeps its own.
    let filter = |name: &str| import(&folder.join(name)).unwrap().field.filter;
    assert_eq!([filter("first.ply"), filter("field.ply")], [PixelFilter::Mip; 2]);
    let bytes = fs::read(folder.join("first.ply")).unwrap();
    let at = bytes.windows(10).position(|window| window == b"filter mip").unwrap();
    fs::write(folder.join("blur.ply"), [&bytes[..at], b"filter blur", &bytes[at + 10..]].concat()).unwrap();
    let from_blur = ["fit", "stage", "-o", "other.ply", "--steps", "1", "--from", "blur.ply"];
    assert_eq!(aarc_studio(folder, &from_blur).code, Some(0));
    assert_eq!(filter("other.ply"), PixelFilter::Blur);
    // A static field fits any clip and stays static.
    let export = ["export", "first.ply", "--ply", "--at", "0", "-o", "static.ply"];
    assert_eq!(aarc_studio(folder, &export).code, Some(0));
    let outcome =
        aarc_studio(folder, &["fit", "stage", "-o", "other.ply", "--steps", "1", "--from", "static.ply"]);
    assert!(
        outcome.code == Some(0) && outcome.stderr.contains("static.ply does not move"),
        "{}",
        outcome.stderr
    );
}

#[test]
fn a_field_records_its_holdout() {
    let folder = stage();
    let folder = folder.path();
    let fit = ["fit", "stage", "-o", "field.ply", "--steps", "1", "--gaussians", "50", "--sh-degree", "0"];
    for (more, holdout, held) in [(&[][..], "none", Value::Null), (&["--holdout", "odd"], "odd", 14.into())] {
        assert_eq!(aarc_studio(folder, &[&fit, more].concat()).code, Some(0));
        let eval = aarc_studio(folder, &["eval", "field.ply", "--capture", "stage", "--json"]);
        assert_eq!(eval.stderr, "", "nothing is assumed");
        let json = eval.json();
        assert_eq!(
            (&json["holdout"], &json["splits"]["interp_b"]["images"]),
            (&holdout.into(), &held),
            "{json}"
        );
    }
}

/// A field of some frames is evaluated, refined and fitted further at these, and a capture that has changed is refused.
#[test]
fn a_field_keeps_to_its_own_frames() {
    let folder = stage();
    let folder = folder.path();
    let few = ["--steps", "20", "--gaussians", "300"];
    fit(folder, &[&few[..], &["--frames", "1..4"]].concat());
    let record = |name: &str| FitRecord::from_hints(&import(&folder.join(name)).unwrap().hints).unwrap();
    let FitRecord { frames, seconds, timing, .. } = record("field.ply");
    assert_eq!((frames, seconds), (Some(1..4), Some([1.0 / 30.0, 3.0 / 30.0])));
    assert_eq!(timing, Some(crc(b"0\n500000\n1000000\n")), "as xtask/FIELD.md specifies it");

    let eval = |field: &str, more: &[&str]| {
        aarc_studio(folder, &[&["eval", field, "--capture", "stage", "--json"], more].concat())
    };
    let note = "field.ply was fitted to frames 1..4, so only these are used";
    let own = eval("field.ply", &[]);
    assert_eq!(own.stderr, format!("note: {note}\n"));
    let own = own.json();
    assert_eq!((&own["frames"], &own["holdout"]), (&serde_json::json!([1, 4]), &"odd".into()));
    assert_eq!(
        (&own["splits"]["train"]["images"], &own["splits"]["interp_b"]["images"]),
        (&14.into(), &7.into())
    );
    let named = eval("field.ply", &["--frames", "1..4"]);
    assert_eq!(named.stderr, "");
    assert_eq!(named.json(), own);
    // A file of an earlier program, without the record.
    let bytes = fs::read(folder.join("field.ply")).unwrap();
    let end = bytes.windows(10).position(|window| window == b"end_header").unwrap();
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let is_old = |line: &&str| {
        !["frames", "seconds", "timing"].iter().any(|key| line.contains(&format!("aarc {key} ")))
    };
    let header: String = header.split_inclusive('\n').filter(is_old).collect();
    fs::write(folder.join("old.ply"), [header.as_bytes(), &bytes[end..]].concat()).unwrap();
    assert_eq!(record("old.ply"), FitRecord { holdout: Some(Holdout::Odd), ..FitRecord::default() });
    assert!(
        eval("old.ply", &[])
            .error(2)
            .contains("old.ply is of 3 frames (duration_s times fps), the capture of 5")
    );
    assert_eq!(eval("old.ply", &["--frames", "1..4"]).json()["splits"], own["splits"]);

    let from =
        ["fit", "stage", "-o", "further.ply", "--steps", "1", "--from", "field.ply", "--holdout", "odd"];
    let outcome = aarc_studio(folder, &from);
    assert!(outcome.code == Some(0) && outcome.stderr.contains(note), "{}", outcome.stderr);
    assert_eq!(record("further.ply"), record("field.ply"));
    let refine = ["package", "field.ply", "-o", "a.aarc", "--refine", "1", "--capture", "stage", "--json"];
    let outcome = aarc_studio(folder, &refine);
    assert!(outcome.stderr.contains(note), "{}", outcome.stderr);
    assert_eq!(outcome.json()["refined"]["photographs"], 14);

    let manifest = folder.join("stage/capture.json");
    let stated = fs::read_to_string(&manifest).unwrap();
    let other = |from: &str, to: &str| {
        assert!(stated.contains(from), "{stated}");
        fs::write(&manifest, stated.replacen(from, to, 1)).unwrap();
        eval("field.ply", &[]).error(2)
    };
    let error = other("\"fps\": 30", "\"fps\": 60");
    assert!(
        error.contains("was fitted to 0.033 to 0.1 s, and frames 1..4 of stage are at 0.017 to 0.05 s"),
        "{error}"
    );
    let error = other("\"id\": \"00\"", "\"time_offset_s\": 0.01, \"id\": \"00\"");
    assert!(error.contains("was fitted to photographs at other times than stage states"), "{error}");
    // Without a frame rate the seconds are unknown.
    fs::write(&manifest, stated.replace("\"fps\": 30,", "")).unwrap();
    assert_eq!(eval("field.ply", &[]).json(), own);
}

#[test]
fn an_assumed_frame_rate_is_noted_once_and_before_the_fit() {
    let folder = stage();
    let folder = folder.path();
    let manifest = folder.join("stage/capture.json");
    let stated = fs::read_to_string(&manifest).unwrap();
    fs::write(&manifest, stated.replace("\"fps\": 30,", "")).unwrap();
    let notes = |args: &[&str]| -> Vec<String> {
        let stderr = aarc_studio(folder, args).stderr;
        stderr.lines().filter(|line| line.contains("frames per second")).map(str::to_owned).collect()
    };
    let fit = ["fit", "stage", "-o", "field.ply", "--steps", "1", "--gaussians", "50"];
    let expected = ["note: 30 frames per second are assumed; --set fps=N states another number"];
    assert_eq!(notes(&fit), expected);
    assert!(notes(&[&fit[..], &["--set", "fps=25"]].concat()).is_empty());
    // No fit can start from one camera, so that the note comes before the error.
    let lines = |args: &[&str]| -> Vec<String> {
        let outcome = aarc_studio(folder, args);
        assert_eq!(outcome.code, Some(3), "{}", outcome.stderr);
        outcome.stderr.lines().map(str::to_owned).collect()
    };
    let failed = lines(&["fit", "stage", "-o", "other.ply", "--cameras", "00", "--backend", "cpu"]);
    assert!(failed.len() == 2 && failed[0] == expected[0], "{failed:?}");
    let failed = lines(&["package", "stage", "--cameras", "00"]);
    let note = "note: 30 frames per second are assumed; duration_s and fps in scene.json state others";
    assert!(failed.len() == 2 && failed[0] == note, "{failed:?}");
    fs::write(&manifest, stated).unwrap();
    assert!(notes(&fit).is_empty(), "the capture states it");
}

/// Refinement improves a pruned field, in held-out frames too.
#[test]
fn a_pruned_field_is_refined() {
    let folder = stage();
    let folder = folder.path();
    fit(folder, &["--steps", "500", "--gaussians", "1500", "--anchor", "hull"]);
    let package = |scene: &str, more: &[&str]| {
        let args = ["package", scene, "--budget", "500", "--rank", "mass", "--no-floor", "--json"];
        aarc_studio(folder, &[&args, more].concat())
    };
    let held = |clip: &str| {
        let args = ["eval", clip, "--capture", "stage", "--holdout", "odd", "--json"];
        let json = aarc_studio(folder, &args).json();
        json["splits"]["interp_b"]["psnr_fg"].as_f64().unwrap()
    };
    let json = package("field.ply", &["-o", "pruned.aarc"]).json();
    assert!(json["refined"].is_null(), "{json}");
    let refine = ["-o", "refined.aarc", "--refine", "400", "--capture", "stage"];
    let json = package("field.ply", &refine).json();
    assert_eq!((&json["gaussians_out"], &json["refined"]["steps"]), (&500.into(), &400.into()));
    let (before, after) = (held("pruned.aarc"), held("refined.aarc"));
    println!("held frames {before:.2} dB pruned, {after:.2} dB refined");
    assert!(after > before + 1.0, "{before} pruned, {after} refined");
    let number = |key: &str| json["refined"][key].as_f64().unwrap();
    assert!(number("held_after_db") > number("held_before_db") + 1.0, "{json}");
    let first_layer = |clip: &str| {
        let json = aarc_studio(folder, &["inspect", clip, "--json"]).json();
        json["layers"][0]["gaussians"].as_u64().unwrap()
    };
    assert_eq!(first_layer("refined.aarc"), first_layer("pruned.aarc"));

    // A folder with both field and capture needs no --capture, and gives the same package.
    fs::copy(folder.join("field.ply"), folder.join("stage/field.ply")).unwrap();
    let own = package("stage", &["-o", "own.aarc", "--refine", "400"]);
    assert_eq!(own.code, Some(0), "{}", own.stderr);
    assert!(fs::read(folder.join("own.aarc")).unwrap() == fs::read(folder.join("refined.aarc")).unwrap());
    fs::remove_file(folder.join("stage/field.ply")).unwrap();

    let error = |code, scene: &str, more: &[&str]| package(scene, more).error(code);
    let other = ["--refine", "9", "--capture", "stage", "--frames", "0..3"];
    assert!(error(2, "field.ply", &other).contains("--frames 0..3: field.ply was fitted to frames 0..5"));
    fs::create_dir(folder.join("scene")).unwrap();
    fs::copy(folder.join("field.ply"), folder.join("scene/field.ply")).unwrap();
    assert!(error(3, "scene", &["--refine", "9"]).contains("scene: no capture"));
}

#[test]
fn a_capture_becomes_a_package() {
    let folder = tempdir().unwrap();
    let folder = folder.path();
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "4", "--frames", "1", "--size", "16x16"];
    assert_eq!(aarc_studio(folder, &stage).code, Some(0));
    fs::write(folder.join("stage/scene.json"), r#"{"metres_per_unit": 2.5}"#).unwrap();
    let json = aarc_studio(folder, &["package", "stage", "--json"]).json();
    assert!(!json["assumed"].as_array().unwrap().iter().any(|key| key == "metres_per_unit"), "{json}");
    assert!(aarc_studio(folder, &["package", "stage"]).error(2).contains("stage.ply is there already"));
    let json = aarc_studio(folder, &["inspect", "stage.aarc", "--json"]).json();
    assert_eq!(json["motion_order"], 0, "one frame does not move");
}

#[cfg(not(feature = "gpu"))]
#[test]
fn a_build_without_gpu_back_end_names_the_feature() {
    let folder = stage();
    let error = aarc_studio(folder.path(), &["fit", "stage", "--backend", "gpu"]).error(2);
    assert!(error.contains("--features gpu"), "{error}");
}

#[cfg(not(feature = "onnx"))]
#[test]
fn a_build_without_networks_names_the_feature() {
    let folder = stage();
    let error = aarc_studio(folder.path(), &["depths", "stage", "--backbone", "net", "-o", "maps"]).error(2);
    assert!(error.contains("--features onnx"), "{error}");
}

#[test]
fn a_field_folder_lies_outside_its_capture() {
    let folder = stage();
    let folder = folder.path();
    let stage = folder.join("stage");
    fs::create_dir(stage.join("fields")).unwrap();
    std::os::unix::fs::symlink("stage", folder.join("link")).unwrap();
    let names = || -> Vec<_> {
        let mut names: Vec<_> =
            fs::read_dir(&stage).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let before = names();
    let error = |folder: &Path, capture, out| aarc_studio(folder, &["fit", capture, "-o", out]).error(2);
    for (capture, out) in
        [("stage", "stage"), ("stage", "stage/"), ("link", "stage/images/.."), ("stage", "link")]
    {
        let error = error(folder, capture, out);
        assert!(error.contains(&format!("{out} is what the output is made from: name another")), "{error}");
    }
    for (capture, out) in
        [("stage", "stage/fields"), ("stage", "stage/new"), ("stage", "stage/a/new"), ("link", "stage/new")]
    {
        let error = error(folder, capture, out);
        assert!(
            error.contains(&format!("{out} would lie within {capture}, which it is made from")),
            "{error}"
        );
    }
    assert!(error(&stage, ".", "new").contains("new would lie within ."));
    assert!(error(&stage, ".", ".").contains(". is what the output is made from"));
    assert_eq!(names(), before, "nothing is written to the capture");
    // One beside it is refused for another reason.
    for out in ["stage2", "stage/../new"] {
        let error = aarc_studio(folder, &["fit", "stage", "-o", out, "--anchor", "none"]).error(2);
        assert!(error.contains("a field folder starts from an anchor"), "{error}");
    }
}

#[test]
fn the_checkpoint_is_checked_before_the_photographs() {
    let folder = stage();
    let folder = folder.path();
    let error = || aarc_studio(folder, &["fit", "stage", "-o", "field.ply"]).error(3);
    fs::write(folder.join("stage/images/00/000000.png"), b"no photograph").unwrap();
    assert!(error().contains("images/00/000000.png"));
    fs::write(folder.join("field.checkpoint"), b"no checkpoint").unwrap();
    assert!(error().contains("field.checkpoint: no checkpoint of this version"));
    // A checkpoint that cannot be read is no absent one.
    fs::remove_file(folder.join("field.checkpoint")).unwrap();
    std::os::unix::fs::symlink("field.checkpoint", folder.join("field.checkpoint")).unwrap();
    let unreadable = error();
    assert!(
        unreadable.contains("field.checkpoint: ") && unreadable.contains("remove it to start"),
        "{unreadable}"
    );
}
