//! `cargo xtask report`: measurements, files, and refused requests.

use std::fs;

use crate::small_stage::stage;
use crate::support::{field, info};
use crate::tool::aarc_studio;
use codec::Field;
use formats::write_field_file;
use serde_json::{Value, json};
use tempfile::tempdir;

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
        let bytes = |key: &str| rate[key].as_u64().unwrap_or_else(|| panic!("no {key} in {rate}"));
        // The target is met in other views.
        let [reached, target] = ["self_psnr_db", "target_db"].map(|key| rate[key].as_f64().unwrap());
        assert!((target - 2.0..target + 3.0).contains(&reached), "{rate}");
        // Small fields are also coded alike.
        assert!(bytes("alike") >= bytes("bytes") && bytes("jointly") > 0, "{rate}");
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
    assert_eq!(names, ["report.html", "report.json"]);
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert!(page.contains("One budget makes no curve") && page.contains("<td>mass + floor</td>"), "{page}");
    let numbers = fs::read_to_string(folder.path().join("out/report.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&numbers).unwrap(), report);
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
    fs::write(folder.path().join("small.ply"), write_field_file(&small, &info())).unwrap();
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
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_eq!(page.matches("<circle").count(), 2 * 10, "PSNR and topology of every point");
    assert!(run("30,60").error(2).contains("--budgets 60"), "no field is larger");
}

/// A take of two segments, whose first has two layers, compared with its fields and with others.
#[test]
fn a_take_is_measured_over_time() {
    let folder = tempdir().unwrap();
    let small = |len: usize| Field { log_scales: vec![[-3.0; 3]; len], ..field(len, 0, Some(1), false) };
    for (name, len) in [("a", 6000), ("b", 300)] {
        fs::write(folder.path().join(name).with_extension("ply"), write_field_file(&small(len), &info()))
            .unwrap();
    }
    let run = |line: &str| aarc_studio(folder.path(), &line.split_whitespace().collect::<Vec<_>>());
    run("join a.ply b.ply -o take").success();
    run("join b.ply a.ply -o turned").success();
    run("package take -o take.aarc --coder fixed").success();
    let report = run("report take.aarc take --size 64x48 -o out --json").json();
    assert_eq!((&report["subject"], &report["setup"]["reference"]), (&"take".into(), &"take".into()));
    let cut = f64::from(info().duration_s);
    assert_eq!(report["cuts_s"], json!([cut]));
    let over_time = report["over_time"].as_array().unwrap();
    assert!(over_time.windows(2).all(|pair| pair[0]["t_s"].as_f64() < pair[1]["t_s"].as_f64()));
    let at_cut: Vec<&Value> = over_time.iter().filter(|instant| instant["is_cut"] == true).collect();
    assert_eq!(at_cut.len(), 2, "before the cut and at it");
    let all = |key: &str| at_cut.iter().map(|instant| instant[key].clone()).collect::<Vec<_>>();
    // Without those that cannot be seen.
    let inspected = run("inspect take.aarc --json").json();
    let segment = |i: usize| &inspected["segments"][i];
    let gaussians = [0, 1].map(|i| json!(segment(i)["gaussians"].as_u64().unwrap()));
    assert_eq!((all("segments"), all("resident")), (vec![json!(1); 2], gaussians.to_vec()));
    let fragments = |instant: &Value| instant["fragments_per_pixel"].as_f64().unwrap();
    assert!(fragments(at_cut[0]) > 5.0 * fragments(at_cut[1]), "{at_cut:?}");
    assert!(report["worst"]["psnr_db"].as_f64().unwrap() > 35.0, "{}", report["worst"]);
    let decoded: u64 =
        report["course"]["rows"].as_array().unwrap().iter().map(|row| row["decoded"].as_u64().unwrap()).sum();
    assert_eq!(Some(decoded), report["setup"]["gaussians"].as_u64());
    assert_eq!(report["course"], inspected["course"]);

    let layers = report["knobs"].as_array().unwrap();
    let values = |key: &str| layers.iter().map(|layer| layer[key].clone()).collect::<Vec<_>>();
    assert_eq!(values("value"), ["1", "2, all"]);
    let size = fs::metadata(folder.path().join("take.aarc")).unwrap().len() as f64;
    let counts = |i: usize, key: &str| layers[i]["counts"][key].as_f64().unwrap();
    let first_layers =
        segment(0)["layers"][0]["gaussians"].as_f64().unwrap() + gaussians[1].as_f64().unwrap();
    assert_eq!(
        (counts(0, "gaussians_decoded"), counts(1, "gaussians_decoded")),
        (first_layers, decoded as f64)
    );
    assert!(counts(0, "package_bytes") < size && counts(1, "package_bytes") == size);
    assert!(layers[0]["error_db"].as_f64().unwrap() < 60.0 && layers[1]["error_db"].is_null(), "{layers:?}");
    // Half of the instants are of the second segment, whose only layer is all of it.
    let of_layers = report["layers_over_time"].as_array().unwrap();
    let differs: Vec<bool> = of_layers.iter().map(|instant| !instant["psnr_db"][0].is_null()).collect();
    assert_eq!(differs, [[true; 8], [false; 8]].concat());
    let left_out: Vec<&str> =
        report["left_out"].as_array().unwrap().iter().map(|part| part["part"].as_str().unwrap()).collect();
    for part in ["plate", "rotation over time", "motion of power 2", "SH degree 1", "levels above the lowest"]
    {
        assert!(left_out.contains(&part), "no {part} in {left_out:?}");
    }
    assert!(!left_out.contains(&"layers after the first"));

    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 4, "two rows of charts, errors over time, layers");
    assert!(page.contains("#969696") && page.contains("mark its 1 cut."), "the cut is marked");

    let words = run("report take.aarc turned --size 64x48 -o turned-out").success().stdout;
    let worst: f64 = words.split("worst ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(worst < 20.0 && words.contains("against turned"), "{words}");
    let words = run("report take.aarc --size 64x48 -o alone").success().stdout;
    assert!(words.contains("error    not compared: name the field folder"), "{words}");
}

#[test]
fn a_take_is_compared_with_its_photographs() {
    let folder = stage();
    let run = |line: &str| aarc_studio(folder.path(), &line.split_whitespace().collect::<Vec<_>>());
    run("fit stage -o field.ply --steps 300 --gaussians 400 --sh-degree 0").success();
    run("package field.ply --split 0.04 -o take.aarc --coder fixed --rank mass").success();
    let report = run("report take.aarc --size 64x48 --capture stage -o out --json").json();
    let photographs = &report["photographs"];
    assert_eq!(photographs["cameras"], json!(["01", "04", "06"]));
    let frames = photographs["frames"].as_array().unwrap();
    assert_eq!((frames.len(), &frames[0]["flicker"]), (5, &Value::Null));
    let number = |value: &Value| value.as_f64().unwrap();
    assert!(frames.iter().all(|frame| number(&frame["psnr_db"]) > 12.0), "{photographs}");
    assert!(
        frames[1..].iter().all(|frame| (0.1..60.0).contains(&number(&frame["flicker"]))),
        "{photographs}"
    );
    assert!(number(&photographs["median_at_cuts_db"]) > 12.0 && photographs["flicker_at_cuts"].is_number());
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert!(page.contains("Photographs over time") && page.contains("flicker (of 255)"));

    let error = run("report take.aarc --capture stage --frames 0..3 -o out").error(2);
    assert!(error.contains("stage: it lasts 0.067 s, and the take 0.133 s"), "{error}");
    let error = run("report field.ply --capture stage -o out").error(2);
    assert!(error.contains("--capture: field.ply is one field, without cuts; leave it out"), "{error}");
}

#[test]
fn a_field_folder_and_a_field_that_was_split_have_reports() {
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("a.ply"), write_field_file(&field(200, 0, Some(1), false), &info()))
        .unwrap();
    let run = |line: &str| aarc_studio(folder.path(), &line.split_whitespace().collect::<Vec<_>>());
    run("join a.ply a.ply -o take").success();
    let report = run("report take --size 64x48 -o out --json").json();
    assert_eq!(report["setup"]["segments"], 2);
    assert!(report["worst"]["psnr_db"].as_f64().unwrap() > 40.0, "{}", report["worst"]);
    assert_eq!((&report["knobs"], &report["layers_over_time"]), (&json!([]), &json!([])));
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert!(page.contains("Every segment has one layer") && page.contains("layers after the first"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "the package is gone");

    run("package a.ply --split 0.25 -o split.aarc --coder fixed").success();
    let report = run("report split.aarc a.ply --size 64x48 -o out2 --json").json();
    assert!(report["setup"]["segments"].as_u64().unwrap() > 3, "{}", report["setup"]);
    assert!(report["worst"]["psnr_db"].as_f64().unwrap() > 35.0, "{}", report["worst"]);

    // Another field, and options that are of clips.
    let refused = run("report split.aarc take").error(2);
    assert!(refused.contains("name the field that the take was packaged from"), "{refused}");
    assert!(run("report split.aarc split.aarc").error(3).contains("segments, where one field is expected"));
    assert!(run("report take a.ply").error(2).contains("compared with itself"));
    assert!(run("report split.aarc a.ply a.ply").error(2).contains("several segments and the field"));
    assert!(run("report split.aarc --rd").error(3).contains("`export --ply`"));
    assert!(run("report take --rd").error(3).contains("name a field file in it"));
    let mut bytes = fs::read(folder.path().join("split.aarc")).unwrap();
    let last = bytes.len() - 10;
    bytes[last] ^= 1;
    fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
    assert!(run("report bad.aarc").error(3).contains("segment "));
    fs::write(folder.path().join("bad.aarc"), &bytes[..last]).unwrap();
    assert!(run("report bad.aarc").error(3).contains("cut short"));
}

#[test]
fn bad_requests_are_refused_before_any_work() {
    let folder = tempdir().unwrap();
    let run = |args: &[&str]| aarc_studio(folder.path(), args);
    assert!(run(&["report", "bad.ply", "--size", "9000x9000"]).error(2).contains("9000x9000"));
    assert!(run(&["report", "bad.ply", "--cameras", "00"]).error(2).contains("--fit or --capture"));
    assert_eq!(run(&["report", "--rd"]).code, Some(2), "nothing to report on");
    assert_eq!(run(&["report"]).code, Some(2), "nothing to report on");
    assert!(run(&["report", "bad.ply", "--rd", "--size", "9000x9000"]).error(2).contains("9000x9000"));
    assert_eq!(run(&["report", "bad.ply", "--budgets", "50"]).code, Some(2), "a page has no budgets");
    assert_eq!(run(&["report", "bad.ply", "--rd", "--budgets", "0"]).code, Some(2), "at least one Gaussian");
}
