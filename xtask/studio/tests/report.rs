//! `cargo xtask report`: measurements, files, and refused requests.

mod small_stage;
mod support;
mod tool;

use std::fs;

use serde_json::Value;
use small_stage::stage;
use studio::export::field_file;
use support::{field, info};
use tempfile::tempdir;
use tool::aarc_studio;

/// The number `key` of the point whose selector is `row`.
fn number(points: &[Value], row: &str, key: &str) -> f64 {
    let point = points.iter().find(|point| point["row"] == row).unwrap_or_else(|| panic!("no row {row}"));
    point[key].as_f64().unwrap_or_else(|| panic!("no {key} in {point}"))
}

#[test]
fn the_floor_wins_if_a_ranking_severs_limbs() {
    let folder = tempdir().unwrap();
    assert_eq!(aarc_studio(folder.path(), &["synth", "limbs", "-o", "limbs.ply"]).code, Some(0));
    let args =
        ["report", "limbs.ply", "--rd", "--budgets", "5000", "--size", "160x120", "-o", "out", "--json"];
    let report = aarc_studio(folder.path(), &args).json();
    let field = &report["rd"][0];
    assert_eq!((&field["field"], &field["features"]), (&"limbs".into(), &7.into()));
    let points = field["points"].as_array().expect("points");
    assert_eq!(points.len(), 5, "one budget");

    assert!(number(points, "mass", "recall") < 0.6);
    assert_eq!(number(points, "mass + floor", "recall"), 1.0);
    assert!(number(points, "mass + floor", "psnr_db") > number(points, "mass", "psnr_db"));
    assert_eq!(number(points, "ours", "recall"), 1.0);
    for row in ["LightGaussian", "RadSplat", "mass", "mass + floor"] {
        assert_eq!(number(points, row, "budget"), 5000.0);
        // Selection uses other images than the report, which has few here.
        assert!(number(points, "ours", "psnr_db") > number(points, row, "psnr_db") - 0.2, "{row}");
        let (bytes, mbps) = (number(points, row, "bytes"), number(points, row, "mbps"));
        assert!((mbps - bytes * 8e-6).abs() < 1e-9, "the clip is one second long");
    }
    let rates = field["rates"].as_array().expect("rates");
    let targets: Vec<f64> = rates.iter().map(|rate| rate["target_db"].as_f64().unwrap()).collect();
    assert_eq!(targets, [40.0, 45.0, 50.0, 55.0]);
    for rate in rates {
        let size = |key: &str| rate["simpler"][key].as_f64().unwrap_or_else(|| panic!("no {key} in {rate}"));
        let bytes = rate["bytes"].as_f64().unwrap();
        assert!(rate["self_psnr_db"].as_f64() >= rate["target_db"].as_f64(), "{rate}");
        // So regular a field leaves little to predict.
        assert!(size("order_0") > size("ordered") && size("predicted") > bytes, "{rate}");
        // Small fields are also coded alike.
        assert!(size("alike") >= bytes, "{rate}");
    }
    // `package` makes the same package.
    let args = ["package", "limbs.ply", "--budget", "5000", "-o", "limbs.aarc", "--json"];
    assert_eq!(
        aarc_studio(folder.path(), &args).json()["bytes"].as_f64(),
        Some(number(points, "ours", "bytes"))
    );
    let mut names: Vec<String> = fs::read_dir(folder.path().join("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["rd.csv", "rd.md"], "one budget makes no curve");
}

#[test]
fn budgets_and_the_size_of_the_images_can_be_chosen() {
    let folder = tempdir().unwrap();
    // Every ranking keeps the last rows, so a budget has one package.
    let mut small = field(60, 0, None, false);
    for row in 0..60 {
        small.log_scales[row] = [-4.0 + 0.03 * row as f32; 3];
        small.opacities[row] = 0.3 + 0.01 * row as f32;
    }
    fs::write(folder.path().join("small.ply"), field_file(&small, &info())).unwrap();
    let run = |budgets: &str| {
        let args = ["report", "small.ply", "--rd", "--size", "64x48", "-o", "out", "--json", "--budgets"];
        aarc_studio(folder.path(), &[&args[..], &[budgets]].concat())
    };
    let report = run("15,30").json();
    let report = &report["rd"][0];
    let points = report["points"].as_array().expect("points");
    let budgets: Vec<f64> = points.iter().map(|point| point["budget"].as_f64().unwrap()).collect();
    assert_eq!(budgets, [[30.0; 5], [15.0; 5]].concat());
    let size = serde_json::json!([64, 48]);
    assert_eq!((&report["image_size"], &report["rate_image_size"]), (&size, &size));
    let plot = fs::read_to_string(folder.path().join("out/rd.svg")).unwrap();
    assert_eq!(plot.matches("<circle").count(), 2 * 10, "PSNR and topology of every point");
    assert!(run("30,60").error(2).contains("--budgets 60"), "no field is larger");
}

#[test]
fn a_refinement_is_judged_by_photographs_that_are_held_out() {
    let folder = stage();
    let held = ["--held-cameras", "00,01,02,03,04,05,06,07"];
    fs::write(folder.path().join("field.ply"), field_file(&field(20, 0, None, false), &info())).unwrap();
    let args = ["report", "field.ply", "--refine", "5", "--capture", "stage", "--cameras", "01,02"];
    assert!(aarc_studio(folder.path(), &args).error(2).contains("name cameras with --held-cameras"));
    let all = [&args[..5], &["stage"], &held].concat();
    assert!(aarc_studio(folder.path(), &all).error(3).contains("photograph"), "none is left to refine on");
    assert!(!folder.path().join("report").exists());
}

#[test]
fn bad_requests_are_refused_before_any_work() {
    let folder = tempdir().unwrap();
    let run = |args: &[&str]| aarc_studio(folder.path(), args);
    assert!(run(&["report", "none.ply", "--rd"]).error(3).contains("none.ply"));
    assert!(!folder.path().join("report").exists());
    fs::write(folder.path().join("bad.ply"), "ply\n").unwrap();
    assert!(run(&["report", "bad.ply", "--rd"]).error(3).contains("bad.ply"));
    assert!(run(&["report", "bad.ply", "--rd", "-o", "no/folder"]).error(2).contains("no/folder"));
    assert!(run(&["report", "bad.ply", "--rd", "-o", "bad.ply"]).error(2).contains("bad.ply"));
    assert!(run(&["report", "bad.ply", "-o", "no/folder"]).error(2).contains("no/folder"));
    assert!(run(&["report", "bad.ply"]).error(3).contains("bad.ply"));
    assert!(run(&["report", "bad.ply", "other.ply"]).error(2).contains("one clip or field"));
    assert!(run(&["report", "bad.ply", "--size", "9000x9000"]).error(2).contains("9000x9000"));
    assert!(run(&["report", "bad.ply", "--refine", "9"]).error(2).contains("--capture"));
    assert!(run(&["report", "bad.ply", "--cameras", "00"]).error(2).contains("--fit or --refine"));
    assert_eq!(run(&["report", "--rd"]).code, Some(2), "nothing to report on");
    assert_eq!(run(&["report"]).code, Some(2), "nothing to report on");
    assert!(run(&["report", "bad.ply", "--rd", "--size", "9000x9000"]).error(2).contains("9000x9000"));
    assert_eq!(run(&["report", "bad.ply", "--budgets", "50"]).code, Some(2), "a page has no budgets");
    assert_eq!(run(&["report", "bad.ply", "--rd", "--budgets", "0"]).code, Some(2), "at least one Gaussian");
}
