//! `cargo xtask eval`: the same photographs in every layout of a capture, and what is wrong with
//! one.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::support::{data, info};
use crate::tool::aarc_studio;
use codec::{Camera, ClipInfo, Field, Temporal};
use formats::write_field_file;
use image::{GenericImageView, RgbImage};
use refine::capture::Holdout;
use refine::image::Image;
use refine::reference::{Order, RenderScene, render, render_with_subject};
use serde_json::{Value, json};
use studio::capture::CaptureFiles;
use studio::eval::{means, parse_csv};
use studio::fields::{FitRecord, fitted_field_file};
use tempfile::{TempDir, tempdir};

const SIZE: (u32, u32) = (48, 36);
const FRAMES: usize = 3;

/// Three cameras around the limbs.
fn cameras() -> Vec<Camera> {
    let position = |angle: f64| [4.0 * angle.sin(), 1.0, 4.0 * angle.cos()];
    [0.0, 1.0, 2.5]
        .map(|angle| Camera::look_at(position(angle), [0.0; 3], [0.0, 1.0, 0.0], 1.2, SIZE.0, SIZE.1))
        .to_vec()
}

/// A folder with a field, and photographs of it in `images/CAMERA/FRAME.png`.
fn stage() -> (TempDir, Field) {
    let folder = tempdir().unwrap();
    assert_eq!(aarc_studio(folder.path(), &["synth", "limbs", "-o", "field.ply"]).code, Some(0));
    let field = formats::import(&folder.path().join("field.ply")).unwrap().field;
    photograph(folder.path(), &field);
    (folder, field)
}

/// The same, but of a field that moves.
fn lively_studio() -> (TempDir, Field) {
    let (folder, mut field) = stage();
    field.temporal = Some(Temporal {
        tau: vec![0.0; field.len()],
        s: vec![f32::INFINITY; field.len()],
        motion_order: 1,
        motion: vec![[0.2, 0.1, 0.0]; field.len()],
        rotation_rates: None,
    });
    fs::write(folder.path().join("field.ply"), write_field_file(&field, &clip_info())).unwrap();
    photograph(folder.path(), &field);
    (folder, field)
}

/// Metadata of a clip of `FRAMES` frames.
fn clip_info() -> ClipInfo {
    ClipInfo { duration_s: 0.2, fps: 10.0, ..info() }
}

/// A field that moves before a plate, photographs of both, and the plates that the capture states.
fn studio_with_a_plate() -> (TempDir, Field, Field) {
    let (folder, field) = lively_studio();
    let mut plate = Field { temporal: None, ..field.clone() };
    plate.centers.iter_mut().for_each(|center| center[0] += 0.8);
    fs::write(folder.path().join("field.plate.ply"), write_field_file(&plate, &clip_info())).unwrap();
    for (c, camera) in cameras().iter().enumerate() {
        let background = render(&RenderScene::from(&plate), camera, 0.0, Order::Depth);
        save(&folder.path().join(format!("plates/c{c}.png")), &background);
        for frame in 0..FRAMES {
            let scene = RenderScene::from(&field).with_plate(&plate);
            let image = render(&scene, camera, frame as f64 / (FRAMES - 1) as f64, Order::Depth);
            save(&folder.path().join(format!("images/c{c}/{frame:02}.png")), &image);
        }
    }
    write_manifest(folder.path(), |manifest| {
        manifest["fps"] = 10.into();
        manifest["plates"] = "plates/{camera}.png".into();
    });
    (folder, field, plate)
}

fn photograph(folder: &Path, field: &Field) {
    photograph_later(folder, field, [0.0; 3]);
}

/// Photographs by cameras that are late by these parts of the clip.
fn photograph_later(folder: &Path, field: &Field, late: [f64; 3]) {
    for (c, camera) in cameras().iter().enumerate() {
        for frame in 0..FRAMES {
            let t = frame as f64 / (FRAMES - 1) as f64 + late[c];
            let image = render(&RenderScene::from(field), camera, t, Order::Depth);
            save(&folder.join(format!("images/c{c}/{frame:02}.png")), &image);
        }
    }
}

fn save(path: &Path, image: &Image) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    RgbImage::from_raw(image.width, image.height, image.to_rgb8()).unwrap().save(path).unwrap();
}

fn write_manifest(folder: &Path, change: impl Fn(&mut Value)) {
    let camera = |(i, camera): (usize, &Camera)| {
        json!({"id": format!("c{i}"), "w": camera.width, "h": camera.height, "K": camera.k,
               "w2c": camera.camera_from_world, "held": i == 2})
    };
    let mut manifest = json!({
        "frames": FRAMES, "images": "images/{camera}/{frame:02}.png",
        "cameras": cameras().iter().enumerate().map(camera).collect::<Vec<_>>(),
    });
    change(&mut manifest);
    fs::write(folder.join("capture.json"), manifest.to_string()).unwrap();
}

fn write_easyvolcap(folder: &Path) {
    let (mut intrinsics, mut extrinsics) =
        ("%YAML:1.0\n---\nnames:\n".to_owned(), "%YAML:1.0\n---\n".to_owned());
    for (i, camera) in cameras().iter().enumerate() {
        writeln!(intrinsics, "  - \"c{i}\"").unwrap();
        let matrix = |name: &str, rows: &[Vec<f64>]| {
            let data: Vec<String> = rows.iter().flatten().map(|x| format!("{x:.17e}")).collect();
            let (r, c) = (rows.len(), rows[0].len());
            let list = data.join(", ");
            format!(
                "{name}_c{i}: !!opencv-matrix\n   rows: {r}\n   cols: {c}\n   dt: d\n   data: [ {list} ]\n"
            )
        };
        let m = &camera.camera_from_world;
        let rotation: Vec<Vec<f64>> = (0..3).map(|r| m[r][..3].to_vec()).collect();
        let translation: Vec<Vec<f64>> = (0..3).map(|r| vec![m[r][3]]).collect();
        extrinsics += &matrix("Rot", &rotation);
        extrinsics += &matrix("T", &translation);
        extrinsics += &matrix("K", &camera.k.map(|row| row.to_vec()));
    }
    // Intrinsics are where the names are.
    let split = |text: &str, key: &str| {
        text.split_inclusive("]\n").filter(|part| part.contains(key)).collect::<Vec<_>>().concat()
    };
    let k = split(&extrinsics, "K_c");
    fs::write(folder.join("intri.yml"), intrinsics + &k).unwrap();
    fs::write(folder.join("extri.yml"), extrinsics).unwrap();
}

fn write_transforms(folder: &Path) {
    write_transforms_at(folder, [0.0, 0.5, 1.0]);
}

/// Frames at these times.
fn write_transforms_at(folder: &Path, times: [f64; FRAMES]) {
    let mut frames = Vec::new();
    for (c, camera) in cameras().iter().enumerate() {
        let m = &camera.camera_from_world;
        let p = camera.position();
        // OpenGL looks backwards with y up.
        let row = |r: usize| json!([m[0][r], -m[1][r], -m[2][r], p[r]]);
        let pose = json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]);
        for (frame, time) in times.iter().enumerate() {
            let path = format!("./images/c{c}/{frame:02}");
            frames.push(json!({"file_path": path, "time": time, "transform_matrix": pose}));
        }
    }
    let angle = 2.0 * (0.5 * f64::from(SIZE.0) / cameras()[0].k[0][0]).atan();
    let transforms = json!({"camera_angle_x": angle, "frames": frames});
    fs::write(folder.join("transforms.json"), transforms.to_string()).unwrap();
}

/// Frame 0 of each camera, as text or as COLMAP's binary.
fn write_colmap(folder: &Path, binary: bool) {
    let sparse = folder.join("sparse/0");
    fs::create_dir_all(&sparse).unwrap();
    let (mut cameras_txt, mut images_txt) = (String::from("# cameras\n"), String::from("# images\n"));
    let (mut cameras_bin, mut images_bin) = (3u64.to_le_bytes().to_vec(), 3u64.to_le_bytes().to_vec());
    for (i, camera) in cameras().iter().enumerate() {
        let m = &camera.camera_from_world;
        let column = |c: usize| glam::DVec3::new(m[0][c], m[1][c], m[2][c]);
        let q = glam::DQuat::from_mat3(&glam::DMat3::from_cols(column(0), column(1), column(2)));
        let (k, t) = (&camera.k, column(3));
        let [w, h] = [SIZE.0, SIZE.1];
        let name = format!("c{i}/00.png");
        writeln!(cameras_txt, "{i} PINHOLE {w} {h} {} {} {} {}", k[0][0], k[1][1], k[0][2], k[1][2]).unwrap();
        writeln!(images_txt, "{i} {} {} {} {} {} {} {} {i} {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z)
            .unwrap();
        cameras_bin.extend((i as u32).to_le_bytes().into_iter().chain(1u32.to_le_bytes()));
        cameras_bin.extend([w, h].iter().flat_map(|side| u64::from(*side).to_le_bytes()));
        cameras_bin.extend([k[0][0], k[1][1], k[0][2], k[1][2]].iter().flat_map(|x| x.to_le_bytes()));
        images_bin.extend((i as u32).to_le_bytes());
        images_bin.extend([q.w, q.x, q.y, q.z, t.x, t.y, t.z].iter().flat_map(|x| x.to_le_bytes()));
        images_bin.extend((i as u32).to_le_bytes().into_iter().chain(name.bytes()).chain([0]));
        images_bin.extend(0u64.to_le_bytes());
    }
    match binary {
        true => {
            fs::write(sparse.join("cameras.bin"), cameras_bin).unwrap();
            fs::write(sparse.join("images.bin"), images_bin).unwrap();
        }
        false => {
            fs::write(sparse.join("cameras.txt"), cameras_txt).unwrap();
            fs::write(sparse.join("images.txt"), images_txt).unwrap();
        }
    }
}

/// The field against its own photographs: the difference is their rounding.
#[track_caller]
fn assert_exact(folder: &Path, expected: &[(&str, u64)]) {
    let splits = aarc_studio(folder, &["eval", "field.ply", "--capture", ".", "--holdout", "odd", "--json"])
        .json()["splits"]
        .clone();
    let names: Vec<(&str, u64)> = expected.to_vec();
    for (name, images) in &names {
        assert_eq!(splits[name]["images"], *images, "{splits}");
        // Equal images have no PSNR, which JSON says with null.
        assert!(splits[name]["psnr_full"].is_null(), "{splits}");
        assert_eq!(splits[name]["ssim"], 1.0);
    }
    assert_eq!(splits.as_object().unwrap().len(), names.len(), "{splits}");
}

/// A field of short lives, its field folder, and a take that it is split into, with each frame in several
/// segments.
#[test]
fn a_take_is_compared_like_its_field() {
    let (folder, mut field) = lively_studio();
    let temporal = field.temporal.as_mut().unwrap();
    for (i, (tau, s)) in temporal.tau.iter_mut().zip(&mut temporal.s).enumerate() {
        *tau = (i % 97) as f32 / 96.0;
        *s = if i % 3 == 0 { 0.05 } else { f32::INFINITY };
    }
    fs::write(folder.path().join("field.ply"), write_field_file(&field, &clip_info())).unwrap();
    photograph(folder.path(), &field);
    write_manifest(folder.path(), |_| {});
    let run = |line: &str| aarc_studio(folder.path(), &line.split_whitespace().collect::<Vec<_>>());
    run("join field.ply -o folder").success();
    run("package field.ply --split 0.02 --coder fixed -o take.aarc").success();
    let segments = run("inspect take.aarc --json").json()["course"]["rows"][0]["segments"].as_u64().unwrap();
    assert!(segments > 2, "{segments}");
    let psnr = |subject: &str| {
        let eval = run(&format!("eval {subject} --capture . -o out-{subject} --json")).json();
        // Absent where no picture differs.
        let psnr = |split: &str| eval["splits"][split]["psnr_full"].as_f64().unwrap_or(f64::INFINITY);
        ["train", "recon"].map(psnr)
    };
    let of_field = psnr("field.ply");
    // Photographs have 8 bits.
    assert!(of_field.iter().all(|db| *db > 55.0), "{of_field:?}");
    assert_eq!(psnr("folder"), of_field);
    let of_take = psnr("take.aarc");
    assert!(of_take.iter().all(|db| *db > 38.0), "{of_take:?}");
    let written = |name: &str| folder.path().join("out-take.aarc").join(name).is_file();
    assert!(["eval.md", "eval.csv", "quarter_frames.png"].into_iter().all(written));
    // Half of it is another clip.
    run("trim take.aarc --from 0 --to 0.1 -o half.aarc").success();
    run("join half.aarc half.aarc -o twice").success();
    let of_another = psnr("twice");
    assert!(of_another.iter().zip(&of_take).all(|(another, take)| *another < take - 10.0), "{of_another:?}");
}

#[test]
fn every_layout_shows_the_same() {
    let (folder, _) = stage();
    let folder = folder.path();
    let every_other = [("train", 6), ("interp_b", 3)];
    write_easyvolcap(folder);
    assert_exact(folder, &every_other);
    fs::remove_file(folder.join("intri.yml")).unwrap();
    write_transforms(folder);
    assert_exact(folder, &every_other);
    fs::remove_file(folder.join("transforms.json")).unwrap();
    for binary in [false, true] {
        write_colmap(folder, binary);
        assert_exact(folder, &[("train", 3)]);
        fs::remove_dir_all(folder.join("sparse")).unwrap();
    }
    write_manifest(folder, |_| ());
    assert_exact(folder, &[("train", 4), ("interp_b", 2), ("recon", 2), ("interp_a", 1)]);
}

#[test]
fn pictures_are_judged_and_shown() {
    let (folder, field) = stage();
    let folder = folder.path();
    write_manifest(folder, |_| ());
    // The scene as it was in the first frame, at all times, from two cameras.
    for (c, camera) in cameras().iter().enumerate().take(2) {
        for frame in 0..FRAMES {
            let image = render(&RenderScene::from(&field), camera, 0.0, Order::Depth);
            save(&folder.join(format!("still/c{c}/{frame:02}.png")), &image);
        }
    }
    let args = [
        "eval",
        "still",
        "--capture",
        ".",
        "--json",
        "-o",
        "out",
        "--holdout",
        "none",
        "--held-cameras",
        "c1",
    ];
    let outcome = aarc_studio(folder, &args);
    assert!(outcome.stderr.contains("3 of 9 photographs have no picture"), "{}", outcome.stderr);
    let json = outcome.json();
    assert_eq!(
        (&json["splits"]["train"]["images"], &json["splits"]["recon"]["images"]),
        (&3.into(), &3.into())
    );
    assert_eq!(json["held_cameras"], json!(["c1", "c2"]));
    let written = |name: &str| fs::read_to_string(folder.join("out").join(name)).unwrap();
    assert_eq!(written("eval.csv").lines().count(), 7);
    assert!(written("eval.md").contains("| recon | 3 |"));
    assert_eq!(serde_json::from_str::<Value>(&written("eval.json")).unwrap(), json);
    let strips = fs::read_dir(folder.join("out"))
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|ending| ending == "png"));
    assert_eq!(strips.count(), 4);
}

/// What the field shows at `t`, as pictures of all frames.
#[test]
fn a_photograph_is_compared_with_its_own_time() {
    let (folder, field) = lively_studio();
    let folder = folder.path();
    photograph_later(folder, &field, [0.1, 0.3, -0.2]);
    let psnr = |offsets_s: [f64; 3]| {
        write_manifest(folder, |manifest| {
            manifest["fps"] = 10.into();
            (0..3).for_each(|c| manifest["cameras"][c]["time_offset_s"] = offsets_s[c].into());
        });
        let args = ["eval", "field.ply", "--capture", ".", "--holdout", "odd", "--json"];
        let json = aarc_studio(folder, &args).json();
        // Without a number, all pictures are equal to their photographs.
        ["train", "interp_b", "recon", "interp_a"]
            .map(|split| json["splits"][split]["psnr_full"].as_f64().unwrap_or(f64::INFINITY))
    };
    // The clip lasts 0.2 s.
    let (synchronous, actual) = (psnr([0.0; 3]), psnr([0.02, 0.06, -0.04]));
    assert!(actual.iter().all(|psnr| *psnr > 55.0), "{actual:?}");
    assert!(synchronous.iter().all(|psnr| *psnr < 50.0), "{synchronous:?}");
}

/// Each photograph has a camera and a time of its own, and the field knows them.
#[test]
fn free_cameras_see_their_own_times() {
    let (folder, field) = lively_studio();
    let folder = folder.path();
    let times = [0.0, 0.3, 1.0];
    for (c, camera) in cameras().iter().enumerate() {
        for (frame, t) in times.iter().enumerate() {
            let image = render(&RenderScene::from(&field), camera, *t, Order::Depth);
            save(&folder.join(format!("images/c{c}/{frame:02}.png")), &image);
        }
    }
    write_transforms_at(folder, times);
    let record = CaptureFiles::open(folder).unwrap().fit_record(Holdout::Odd);
    assert_eq!((record.frames.clone(), record.seconds), (Some(0..3), None), "its seconds are assumed");
    fs::write(folder.join("field.ply"), fitted_field_file(&field, &clip_info(), &record)).unwrap();
    assert_exact(folder, &[("train", 6), ("interp_b", 3)]);
    write_transforms_at(folder, [0.0, 0.4, 1.0]);
    let error = aarc_studio(folder, &["eval", "field.ply", "--capture", "."]).error(2);
    assert!(error.contains("field.ply was fitted to photographs at other times than . states"), "{error}");
}

fn freeze(folder: &Path, field: &Field, name: &str, t: f64) {
    for (c, camera) in cameras().iter().enumerate() {
        let image = render(&RenderScene::from(field), camera, t, Order::Depth);
        (0..FRAMES).for_each(|frame| save(&folder.join(format!("{name}/c{c}/{frame:02}.png")), &image));
    }
}

#[test]
fn held_frames_are_compared_with_a_blend_of_the_photographs_around_them() {
    let (folder, _) = lively_studio();
    let folder = folder.path();
    write_manifest(folder, |_| ());
    // Frame 1 is halfway.
    for c in 0..3 {
        let [mut blend, last] =
            [0, 2].map(|frame| picture(&folder.join(format!("images/c{c}/{frame:02}.png"))));
        blend.iter_mut().zip(last.iter()).for_each(|(a, b)| *a = a.midpoint(*b));
        let path = folder.join(format!("blend/c{c}/01.png"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        blend.save(path).unwrap();
    }
    let eval = |line: &str| {
        let line = format!("eval {line} --capture .");
        aarc_studio(folder, &line.split_whitespace().collect::<Vec<_>>())
    };
    let json = eval("field.ply --holdout odd --json").json();
    let of_pictures = eval("blend --holdout odd --json").json();
    let blended = &json["baselines"]["blended_photographs"];
    assert_eq!(blended.as_object().unwrap().keys().collect::<Vec<_>>(), ["interp_b"]);
    let [row, expected] = [&blended["interp_b"], &of_pictures["splits"]["interp_b"]];
    assert_eq!(row["images"], 2);
    let measures = row.as_object().unwrap().iter().filter(|(_, value)| value.is_number());
    for (key, value) in measures {
        // Half levels are rounded otherwise.
        let off = (value.as_f64().unwrap() - expected[key].as_f64().unwrap()).abs();
        assert!(off < 0.05, "{key}: {row} {expected}");
    }
    assert!(row["psnr_moving"].as_f64() < row["psnr_full"].as_f64(), "{row}");
    assert!(json["splits"]["interp_b"]["psnr_full"].is_null(), "the field is exact");
    assert_eq!(
        &of_pictures["baselines"]["blended_photographs"], blended,
        "read, as only held frames have a picture"
    );
    let text = eval("field.ply --holdout odd").stdout;
    assert!(text.contains("| interp_b, photographs blended | 2 |"), "{text}");
    assert!(eval("field.ply --holdout none --json").json().get("baselines").is_none());
}

/// Photographs whose colours are changed by camera, or by frame.
#[test]
fn colours_are_aligned_by_camera_and_what_moves_is_measured() {
    let (folder, field) = lively_studio();
    let folder = folder.path();
    write_manifest(folder, |_| ());
    for (name, by_camera, by_frame) in [("tinted", 0.15, 0.0), ("flickering", 0.0, 0.15)] {
        for (c, camera) in cameras().iter().enumerate() {
            for frame in 0..FRAMES {
                let t = frame as f64 / (FRAMES - 1) as f64;
                let mut image = render(&RenderScene::from(&field), camera, t, Order::Depth);
                let gray = 0.5 + by_camera * (c as f64 - 1.0) + by_frame * (frame as f64 - 1.0);
                image
                    .pixels
                    .iter_mut()
                    .for_each(|pixel| (0..3).for_each(|i| pixel[i] = gray + 0.2 * pixel[i]));
                save(&folder.join(format!("{name}/c{c}/{frame:02}.png")), &image);
            }
        }
    }
    let eval = |subject: &str, more: &str| {
        let line = format!("eval {subject} --capture . --holdout odd {more}");
        aarc_studio(folder, &line.split_whitespace().collect::<Vec<_>>())
    };
    let all = ["train", "interp_b", "recon", "interp_a"];
    let values = |json: &Value, key: &str| all.map(|split| json["splits"][split][key].as_f64().expect(key));
    let [tinted, flickering] = ["tinted", "flickering"].map(|subject| eval(subject, "--json").json());
    for part in ["fg", "full", "moving"] {
        let psnr = |json: &Value| values(json, &format!("psnr_{part}"));
        let aligned = |json: &Value| values(json, &format!("psnr_{part}_aligned"));
        assert!(psnr(&tinted).iter().all(|db| *db < 16.0), "{part} {tinted}");
        assert!(aligned(&tinted).iter().all(|db| *db > 40.0), "{part} {tinted}");
        // The middle frame has the mean colours: only its neighbours keep an error.
        let flickering = aligned(&flickering);
        assert!([flickering[0], flickering[2]].iter().all(|db| *db < 25.0), "{part} {flickering:?}");
    }
    // The field is exact, and so is what moves in it, which a picture that stands still misses.
    let exact = eval("field.ply", "--json").json();
    assert!(exact["splits"]["train"]["psnr_moving"].is_null(), "{exact}");
    freeze(folder, &field, "first", 0.0);
    let first = eval("first", "--json -o out").json();
    let [full, moving] = ["psnr_full", "psnr_moving"].map(|key| values(&first, key)[1]);
    assert!(moving < full - 3.0, "{moving} {full}");
    let written = |name: &str| fs::read_to_string(folder.join("out").join(name)).unwrap();
    let header = "image,camera,frame,split,psnr_fg,psnr_fg_aligned,psnr_full,psnr_full_aligned,psnr_moving,\
                  psnr_moving_aligned,ssim,lpips,subject_intersection,subject_union";
    let csv = written("eval.csv");
    assert_eq!(csv.lines().next(), Some(header));
    assert!(csv.lines().all(|line| line.split(',').count() == 14), "{csv}");
    let row = format!(" | {full:.2} | {:.2} | {moving:.2} | ", values(&first, "psnr_full_aligned")[1]);
    assert!(written("eval.md").contains(&row), "{row} {}", written("eval.md"));
    // The measures are parsed from this file in reports.
    let capture_files = CaptureFiles::open(folder).unwrap();
    let parsed = means(&parse_csv(&csv, &capture_files).unwrap());
    for (row, split) in parsed.iter().zip(all) {
        let measure = |key: &str| first["splits"][split][key].as_f64().unwrap();
        let pairs = [
            (row.psnr_fg_aligned.unwrap(), measure("psnr_fg_aligned")),
            (row.psnr_full_aligned, measure("psnr_full_aligned")),
            (row.psnr_moving.unwrap(), measure("psnr_moving")),
            (row.psnr_moving_aligned.unwrap(), measure("psnr_moving_aligned")),
        ];
        assert!(pairs.iter().all(|(parsed, json)| (parsed - json).abs() < 1e-3), "{split}: {pairs:?}");
    }
    // One frame has no median over time.
    let still = eval("first", "--json --frames 2..3").json();
    let train = &still["splits"]["train"];
    assert!(train["psnr_moving"].is_null() && train["psnr_moving_aligned"].is_null(), "{still}");
    assert!(train["psnr_full_aligned"].as_f64().is_some(), "{still}");
}

/// Each photograph has a camera of its own, which is of another device only if the layout says so.
#[test]
fn colours_are_aligned_by_device_where_each_photograph_has_a_camera() {
    let (folder, _) = stage();
    let folder = folder.path();
    for c in 0..3 {
        let mut image = picture(&folder.join(format!("images/c{c}/00.png")));
        image.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|level| 40 * (c + 1) + level / 5));
        // As both layouts name the photographs.
        for name in [format!("images/c{c}"), format!("c{c}")] {
            let of_camera = folder.join("tinted").join(name);
            fs::create_dir_all(&of_camera).unwrap();
            image.save(of_camera.join("00.png")).unwrap();
        }
    }
    let aligned = |devices: [Option<u32>; 3]| {
        let capture_files = CaptureFiles::open(folder).unwrap();
        let found: Vec<Option<u32>> =
            capture_files.capture.cameras.iter().map(|camera| camera.device).collect();
        assert_eq!(found, devices);
        let json = aarc_studio(folder, &["eval", "tinted", "--capture", ".", "--json"]).json();
        json["splits"]["train"]["psnr_full_aligned"].as_f64().unwrap()
    };
    write_transforms(folder);
    let transforms = fs::read_to_string(folder.join("transforms.json")).unwrap();
    let mut transforms: Value = serde_json::from_str(&transforms).unwrap();
    // The first photograph of each camera: a rig takes them at one time, and someone who walks around one after another.
    let frames = transforms["frames"].as_array_mut().unwrap();
    frames.retain(|frame| frame["time"] == 0.0);
    let mut write = |change: &dyn Fn(usize, &mut Value)| {
        transforms["frames"]
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .enumerate()
            .for_each(|(i, frame)| change(i, frame));
        fs::write(folder.join("transforms.json"), transforms.to_string()).unwrap();
    };
    write(&|_, _| {});
    let of_rig = aligned([None; 3]);
    write(&|_, frame| frame["time"] = Value::Null);
    let of_walk = aligned([Some(0); 3]);
    assert!(of_rig > 35.0 && of_walk < 25.0, "{of_rig} {of_walk}");
    write(&|i, frame| frame["k1"] = (1e-9 * i as f64).into());
    assert!(aligned([None; 3]) > 35.0, "intrinsics of their own");
    fs::remove_file(folder.join("transforms.json")).unwrap();
    write_colmap(folder, false);
    assert!(aligned([Some(0), Some(1), Some(2)]) > 35.0);
    let images = fs::read_to_string(folder.join("sparse/0/images.txt")).unwrap();
    let images = images.replace(" 1 c1/", " 0 c1/").replace(" 2 c2/", " 0 c2/");
    fs::write(folder.join("sparse/0/images.txt"), images).unwrap();
    assert!(aligned([Some(0); 3]) < 25.0);
}

#[test]
fn several_scenes_have_a_mean_and_a_deviation() {
    let scenes = [lively_studio(), lively_studio()];
    let folders = scenes.each_ref().map(|(folder, field)| {
        write_manifest(folder.path(), |_| ());
        freeze(folder.path(), field, "first", 0.0);
        freeze(folder.path(), field, "last", 1.0);
        folder.path().to_str().unwrap()
    });
    let subjects = [format!("{}/first", folders[0]), format!("{}/last", folders[1])];
    let [first, last] = [0, 1].map(|i| {
        let json =
            aarc_studio(Path::new(folders[i]), &["eval", &subjects[i], "--capture", folders[i], "--json"])
                .json();
        json["splits"]["train"]["exact"].as_u64()
    });
    // Frame 0 is exact in the first, frame 2 in the last, from two cameras.
    assert_eq!((first, last), (Some(2), Some(2)));
    let here = tempdir().unwrap();
    let args = ["eval", &subjects[0], &subjects[1], "--capture", folders[0], "--capture", folders[1]];
    let run = |more: &[&str]| aarc_studio(here.path(), &[&args[..], &["--holdout", "odd"], more].concat());
    let json = run(&["--json", "-o", "out"]).json();
    assert_eq!(json["scenes"].as_object().unwrap().len(), 2);
    let held = &json["splits"]["interp_b"];
    let psnr = |scene: usize| {
        let name = Path::new(folders[scene]).file_name().unwrap().to_str().unwrap();
        json["scenes"][name]["splits"]["interp_b"]["psnr_full"].as_f64().unwrap()
    };
    let close = |key: &str, expected: f64| {
        let found = held["psnr_full"][key].as_f64().unwrap();
        assert!((found - expected).abs() < 1e-9, "{key}: {found} {expected}");
    };
    close("mean", 0.5 * (psnr(0) + psnr(1)));
    close("deviation", 0.5 * (psnr(0) - psnr(1)).abs());
    assert_eq!((&held["scenes"], &held["images"]), (&2.into(), &4.into()));
    assert_eq!(fs::read_dir(here.path().join("out")).unwrap().count(), 4, "a folder each, and two tables");
    assert!(run(&[]).stdout.contains("Over 2 scenes:"));
    assert!(run(&["--capture", folders[0]]).error(2).contains("2 SUBJECTs and 3 --capture"));
    let twice = ["eval", &subjects[0], &subjects[0], "--capture", folders[0], "--capture", folders[0]];
    assert!(aarc_studio(here.path(), &twice).error(2).contains("two captures are called"));
}

#[test]
fn masks_cut_the_subject_out() {
    let (folder, _) = stage();
    let folder = folder.path();
    write_manifest(folder, |manifest| manifest["masks"] = "masks/{camera}/{frame}.png".into());
    for c in 0..3 {
        for frame in 0..FRAMES {
            let path = folder.join(format!("masks/c{c}/{frame}.png"));
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            let mask = image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| {
                image::Luma([if x < 20 && frame > 0 { 255 } else { 0 }])
            });
            mask.save(path).unwrap();
        }
    }
    let splits =
        aarc_studio(folder, &["eval", "field.ply", "--capture", ".", "--json"]).json()["splits"].clone();
    assert_eq!(splits["train"]["without_subject"], 2);
    assert!(splits["train"]["psnr_fg"].is_null(), "the subject is equal: {splits}");
    assert!(splits["train"]["psnr_full"].as_f64().unwrap() < 40.0, "what is cut off is missed: {splits}");
}

/// Size of a picture that was written.
fn picture(path: &Path) -> RgbImage {
    image::open(path).unwrap().to_rgb8()
}

#[test]
fn a_field_is_rendered_between_frames_and_from_new_viewpoints() {
    let (folder, _) = stage();
    let folder = folder.path();
    write_manifest(folder, |_| ());
    let args = ["eval", "field.ply", "--capture", ".", "--holdout", "odd", "--json", "-o", "out"];
    let json = aarc_studio(folder, &args).json();
    assert!(json.get("ladder").is_none(), "a field has no layers");
    // Nine columns lead from frame 0 to frame 2, which are fitted to; three of them were photographed.
    let quarters = picture(&folder.join("out/quarter_frames.png"));
    let (width, height) = (quarters.width() / 9, quarters.height() / 2);
    assert_eq!((width * 9, height * 2), quarters.dimensions());
    let part = |column: u32, row: u32| {
        image::imageops::crop_imm(&quarters, column * width, row * height, width, height)
    };
    let is_black = |column| part(column, 0).pixels().all(|(_, _, pixel)| pixel.0 == [0; 3]);
    assert_eq!((0..9).filter(|column| !is_black(*column)).collect::<Vec<_>>(), [0, 4, 8]);
    for column in [0, 4, 8] {
        let [top, bottom] = [0, 1].map(|row| part(column, row).to_image());
        assert_eq!(top, bottom, "the field is exact");
    }
    let views = picture(&folder.join("out/free_views.png"));
    // Between two cameras; above, below, near.
    assert_eq!(views.dimensions(), (3 * SIZE.0, 2 * SIZE.1));
    let brightness = |row: u32, view: u32| -> u32 {
        let part = image::imageops::crop_imm(&views, view * SIZE.0, row * SIZE.1, SIZE.0, SIZE.1);
        part.pixels().map(|(_, _, pixel)| pixel.0.iter().map(|c| u32::from(*c)).sum::<u32>()).sum()
    };
    assert!(brightness(0, 0) > 10_000 && brightness(0, 1) + brightness(0, 2) == 0);
    assert!((0..3).all(|view| brightness(1, view) > 10_000) && brightness(1, 2) > 2 * brightness(1, 0));
}

#[test]
fn a_package_is_judged_layer_by_layer() {
    let (folder, _) = stage();
    let folder = folder.path();
    write_manifest(folder, |_| ());
    let args = [
        "package",
        "field.ply",
        "-o",
        "clip.aarc",
        "--budget",
        "6000",
        "--coder",
        "fixed",
        "--rank",
        "mass",
        "--no-floor",
    ];
    assert_eq!(aarc_studio(folder, &args).code, Some(0));
    let args = ["eval", "clip.aarc", "--capture", ".", "--json", "-o", "out"];
    let unrecorded = aarc_studio(folder, &args);
    let note = "note: clip.aarc records no holdout, so no frame counts as held out; --holdout names";
    assert_eq!(unrecorded.stderr.matches(note).count(), 1, "{}", unrecorded.stderr);
    let json = unrecorded.json();
    assert_eq!((&json["holdout"], &json["splits"]["interp_b"]), (&"none".into(), &Value::Null));
    let json = aarc_studio(folder, &[&args[..], &["--holdout", "odd"]].concat()).json();
    let prefixes = &json["ladder"];
    // The held camera in the held frame.
    assert_eq!((&prefixes["split"], &prefixes["images"]), (&"interp_a".into(), &1.into()));
    let steps = prefixes["rungs"].as_array().unwrap();
    let number = |step: usize, key: &str| steps[step][key].as_f64().unwrap();
    assert_eq!((steps.len(), number(0, "gaussians"), number(1, "gaussians")), (2, 5000.0, 6000.0));
    assert_eq!(number(1, "bytes"), fs::metadata(folder.join("clip.aarc")).unwrap().len() as f64);
    assert!(number(0, "bytes") < number(1, "bytes") && number(0, "psnr_full") < number(1, "psnr_full"));
    // The last step is the package itself.
    assert_eq!(prefixes["rungs"][1]["psnr_full"], json["splits"]["interp_a"]["psnr_full"]);
    let table = fs::read_to_string(folder.join("out/eval.md")).unwrap();
    assert!(table.contains("| 5000 | ") && table.contains("| 6000 | "), "{table}");
    assert_eq!(picture(&folder.join("out/ladder.png")).width() % 3, 0);
}

/// Masks of what moves, all black in frame 0, for a field that was fitted without them.
#[test]
fn masks_measure_what_is_drawn_before_the_plate() {
    let (folder, field, _) = studio_with_a_plate();
    let folder = folder.path();
    // Pixels of the subject in each frame, over the fitted cameras.
    let mut pixels = [0; FRAMES];
    for (c, camera) in cameras().iter().enumerate() {
        for (frame, pixels) in pixels.iter_mut().enumerate() {
            let t = frame as f64 / (FRAMES - 1) as f64;
            let alpha = render(&RenderScene::from(&field), camera, t, Order::Depth).pixels;
            let is_drawn: Vec<bool> = alpha.iter().map(|pixel| pixel[3] > 0.5).collect();
            if c < 2 {
                *pixels += is_drawn.iter().filter(|is_drawn| **is_drawn).count();
            }
            let level = |is_drawn: &bool| if *is_drawn && frame > 0 { 255 } else { 0 };
            let mask =
                image::GrayImage::from_raw(SIZE.0, SIZE.1, is_drawn.iter().map(level).collect()).unwrap();
            let path = folder.join(format!("masks/c{c}/{frame}.png"));
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            mask.save(path).unwrap();
        }
    }
    let eval = |subject: &str, more: &str| {
        let line = format!("eval {subject} --capture . --holdout odd --json {more}");
        aarc_studio(folder, &line.split_whitespace().collect::<Vec<_>>()).json()
    };
    let without = eval("field.ply", "");
    assert!(without["splits"]["train"]["subject_iou"].is_null(), "{without}");
    let manifest = fs::read_to_string(folder.join("capture.json")).unwrap();
    let mut manifest: Value = serde_json::from_str(&manifest).unwrap();
    manifest["masks"] = "masks/{camera}/{frame}.png".into();
    fs::write(folder.join("capture.json"), manifest.to_string()).unwrap();
    // Its photographs had no masks.
    let record = FitRecord { has_mattes: true, ..FitRecord::default() };
    fs::write(folder.join("field.ply"), fitted_field_file(&field, &clip_info(), &record)).unwrap();
    fs::write(folder.join("alone.ply"), write_field_file(&field, &clip_info())).unwrap();
    let of_train = pixels[2] as f64 / (pixels[0] + pixels[2]) as f64;
    for subject in ["field.ply", "alone.ply"] {
        let json = eval(subject, "-o out");
        let splits = &json["splits"];
        let iou = |split: &str| splits[split]["subject_iou"].as_f64().unwrap();
        assert!(iou("interp_b") == 1.0 && (iou("train") - of_train).abs() < 1e-12, "{of_train} {splits}");
        assert_eq!(splits["train"]["without_subject"], 2, "masks tell the subject: {splits}");
        assert!(
            json["baselines"]["blended_photographs"]["interp_b"]["subject_iou"].is_null(),
            "it draws nothing"
        );
        let written = |name: &str| fs::read_to_string(folder.join("out").join(name)).unwrap();
        assert!(written("eval.md").contains(" | 1.0000 |"), "{}", written("eval.md"));
        let parsed = parse_csv(&written("eval.csv"), &CaptureFiles::open(folder).unwrap()).unwrap();
        assert_eq!(means(&parsed)[0].subject_iou, Some(iou("train")));
    }
}

/// PSNR where an alpha is of the subject.
fn psnr_where(alpha: &[f64], a: &Image, b: &RgbImage) -> f64 {
    let pixels = alpha.iter().zip(&a.pixels).zip(b.pixels()).filter(|((alpha, _), _)| **alpha > 0.5);
    let squares =
        pixels.flat_map(|((_, a), b)| [0, 1, 2].map(|c| (a[c] - f64::from(b.0[c]) / 255.0).powi(2)));
    let squares: Vec<f64> = squares.collect();
    -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).log10()
}

/// Without masks, the subject is what the field draws before its plate: in each row of the tables and each instant of a take.
#[test]
fn all_rows_are_over_the_same_subject() {
    let (folder, mut field, plate) = studio_with_a_plate();
    let folder = folder.path();
    let run = |line: &str| aarc_studio(folder, &line.split_whitespace().collect::<Vec<_>>());
    let blended = run("eval field.ply --capture . --holdout odd --json").json()["baselines"]["blended_photographs"]
        ["interp_b"]["psnr_fg"]
        .as_f64()
        .unwrap();
    let expected = [0, 1].map(|c| {
        let [first, held, last] =
            [0, 1, 2].map(|frame| picture(&folder.join(format!("images/c{c}/{frame:02}.png"))));
        let mut blend = Image::new(SIZE.0, SIZE.1);
        for (pixel, (a, b)) in blend.pixels.iter_mut().zip(first.pixels().zip(last.pixels())) {
            let level = |c: usize| f64::from(a.0[c].midpoint(b.0[c])) / 255.0;
            *pixel = [level(0), level(1), level(2), 1.0];
        }
        let scene = RenderScene::from(&field).with_plate(&plate);
        psnr_where(&render_with_subject(&scene, &cameras()[c], 0.5, Order::Depth).1, &blend, &held)
    });
    let expected = 0.5 * (expected[0] + expected[1]);
    assert!((blended - expected).abs() < 0.05, "{blended} {expected}");

    run("package field.ply -o clip.aarc --budget 6000 --coder fixed --rank mass --no-floor").success();
    let json = run("eval clip.aarc --capture . --holdout odd --json -o out").json();
    let steps = json["ladder"]["rungs"].as_array().unwrap();
    assert!(steps.len() > 1 && steps[0]["psnr_fg"] != steps[1]["psnr_fg"], "{json}");
    assert_eq!(steps.last().unwrap()["psnr_fg"], json["splits"]["interp_a"]["psnr_fg"]);

    // Short lives, so that there are segments.
    let temporal = field.temporal.as_mut().unwrap();
    for (i, (tau, s)) in temporal.tau.iter_mut().zip(&mut temporal.s).enumerate().filter(|(i, _)| i % 3 == 0)
    {
        (*tau, *s) = ((i % 97) as f32 / 96.0, 0.05);
    }
    fs::write(folder.join("field.ply"), write_field_file(&field, &clip_info())).unwrap();
    run("package field.ply --split 0.1 -o take.aarc --coder fixed --rank mass").success();
    run("eval take.aarc --capture . -o out").success();
    let csv = fs::read_to_string(folder.join("out/eval.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let report = run("report take.aarc --capture . --size 48x36 -o report --json").json();
    for frame in 0..FRAMES {
        let of_frame = rows.iter().filter(|row| row[2] == frame.to_string());
        let psnr: Vec<f64> = of_frame.map(|row| row[4].parse().unwrap()).collect();
        let mean = psnr.iter().sum::<f64>() / psnr.len() as f64;
        let over_time = report["photographs"]["frames"][frame]["psnr_db"].as_f64().unwrap();
        assert!((over_time - mean).abs() < 1e-3, "{frame}: {over_time} {mean}");
    }
}

/// Depth maps that were rendered with the photographs tell the conventions of the cameras: what
/// one camera sees lies within what another sees.
#[test]
fn cameras_of_a_real_capture_agree() {
    let Some(folder) = data("stage-knight") else { return };
    let capture_files = CaptureFiles::open(&folder).unwrap();
    let capture = &capture_files.capture;
    assert_eq!((capture.cameras.len(), capture.frames(), capture.photos.len()), (32, 33, 32 * 33));
    let photo_id = |camera: usize| {
        *capture.photos.iter().find(|photo_id| (photo_id.camera, photo_id.frame) == (camera, 7)).unwrap()
    };
    assert_eq!(capture_files.name(photo_id(8)), "08/000007");
    let seen = capture_files.photo(photo_id(8)).unwrap().image;
    let depth = capture_files.depth(&folder.join("depths"), photo_id(0)).unwrap().expect("depths");
    let (from, to) = (&capture.cameras[0].camera, &capture.cameras[8].camera);
    let (mut inside, mut points) = (0, 0);
    for (i, z) in depth.depths.iter().map(|z| f64::from(*z)).enumerate().filter(|(_, z)| *z > 0.0) {
        let (x, y) = (i as u32 % depth.width, i as u32 / depth.width);
        let at = |i: usize, pixel: u32| (f64::from(pixel) + 0.5 - from.k[i][2]) / from.k[i][i] * z;
        let seen_from = [at(0, x), at(1, y), z];
        let m = &from.camera_from_world;
        let moved = [0, 1, 2].map(|r| seen_from[r] - m[r][3]);
        let world = [0, 1, 2].map(|c| (0..3).map(|r| m[r][c] * moved[r]).sum::<f64>());
        let m = &to.camera_from_world;
        let p = [0, 1, 2].map(|r| (0..3).map(|c| m[r][c] * world[c]).sum::<f64>() + m[r][3]);
        let pixel = |i: usize| (p[i] / p[2] * to.k[i][i] + to.k[i][2]) as u32;
        points += 1;
        inside += usize::from(seen.pixel(pixel(0), pixel(1))[3] > 0.0);
    }
    assert!(points > 1000 && inside * 100 > points * 99, "{inside} of {points}");
}

#[test]
fn blender_scenes_hold_their_test_cameras() {
    let Some(folder) = data("nerf-chair-400") else { return };
    let capture_files = CaptureFiles::open(&folder).unwrap();
    let held = capture_files.capture.cameras.iter().filter(|camera| camera.held).count();
    assert_eq!((capture_files.capture.cameras.len(), held, capture_files.capture.frames()), (110, 10, 1));
    let photo = capture_files.photo(capture_files.capture.photos[0]).unwrap();
    assert_eq!((photo.image.width, photo.image.pixel(0, 0)[3]), (400, 0.0), "alpha is the mask");
}
