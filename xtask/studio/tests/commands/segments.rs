//! Takes of segments: `join`, `package` of field folders and with `--split`, `trim`, `inspect`, pictures, faults.

use crate::support::{Noise, field, info};
use crate::tool;
use crate::tool::{Outcome, aarc_studio, aarc_studio_with};
use codec::{ClipInfo, Coder, EncodeOptions, Field, Limits, SegmentPackage, Source, Take, encode_take_head};
#[cfg(target_os = "linux")]
use formats::{import, write_field_file};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::{TempDir, tempdir};

/// A dynamic field of small Gaussians that is quick to draw.
fn small(len: usize) -> Field {
    Field { log_scales: vec![[-2.5; 3]; len], ..field(len, 0, Some(2), true) }
}

/// A field of lifetimes from a fraction of a second to all of 8 seconds.
fn long(len: usize) -> Field {
    let mut field = small(len);
    let mut noise = Noise(5);
    let temporal = field.temporal.as_mut().unwrap();
    temporal.s = (0..len)
        .map(|i| match i % 10 {
            9 => f32::INFINITY,
            8 => noise.uniform(0.05, 0.2),
            _ => noise.uniform(0.002, 0.02),
        })
        .collect();
    temporal.tau = (0..len).map(|_| noise.uniform(0.0, 1.0)).collect();
    field.opacities = (0..len).map(|_| noise.uniform(0.3, 1.0)).collect();
    field
}

fn write(path: &Path, field: &Field, duration_s: f32) {
    fs::write(path, write_field_file(field, &ClipInfo { duration_s, ..info() })).unwrap();
}

fn run(folder: &TempDir, line: &str) -> Outcome {
    aarc_studio(folder.path(), &line.split_whitespace().collect::<Vec<_>>())
}

fn read(folder: &TempDir, name: &str) -> Vec<u8> {
    fs::read(folder.path().join(name)).unwrap()
}

fn take_of(bytes: &[u8]) -> Take {
    codec::package(bytes, &Limits::default()).unwrap()
}

/// The picture of an input at a second.
fn picture(folder: &TempDir, input: &str, second: f64) -> Vec<u8> {
    let line = format!("render {input} --time {second} --size 96x72 -o picture.png");
    run(folder, &line).success();
    image::open(folder.path().join("picture.png")).unwrap().to_rgb8().into_raw()
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    let errors: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * a.len() as f64 / errors).log10()
}

fn numbers(object: &Value, list: &str, key: &str) -> Vec<f64> {
    object[list].as_array().unwrap().iter().map(|entry| entry[key].as_f64().unwrap()).collect()
}

/// A field, a package, and a folder with a field and a plate, joined as `take`.
fn joined() -> (TempDir, Value) {
    joined_of([60, 50, 40])
}

/// The same with fields of so many Gaussians.
fn joined_of([a, b, c]: [usize; 3]) -> (TempDir, Value) {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write(&path("a.ply"), &small(a), 1.0);
    write(&path("b.ply"), &small(b), 0.5);
    run(&folder, "package b.ply -o b.aarc --coder fixed").success();
    fs::create_dir(path("c")).unwrap();
    write(&path("c/field.ply"), &small(c), 0.75);
    let plate = Field { log_scales: vec![[-1.0; 3]; 9], ..field(9, 1, None, false) };
    write(&path("c/plate.ply"), &plate, 0.75);
    let report = run(&folder, "join a.ply b.aarc c -o take --json").json();
    (folder, report)
}

#[test]
fn joined_clips_show_each_in_its_turn() {
    let (folder, report) = joined();
    assert_eq!((&report["duration_s"], &report["segments"]), (&json!(2.25), &json!(3)));
    let manifest: Value = serde_json::from_slice(&read(&folder, "take/field.json")).unwrap();
    assert_eq!((&manifest["version"], &manifest["duration_s"]), (&json!(1), &json!(2.25)));
    assert_eq!(numbers(&manifest, "segments", "start_s"), [0.0, 1.0, 1.5]);
    assert_eq!(numbers(&manifest, "segments", "duration_s"), [1.0, 0.5, 0.75]);
    // Without loss.
    let first = import(&folder.path().join("take/segment-0000.ply")).unwrap();
    assert_eq!((first.field, first.hints.viewpoints), (small(60), info().viewpoints));
    let whole = import(&folder.path().join("take/segment-0002.ply")).unwrap();
    assert_eq!(whole.field, small(40));
    let plate = manifest["segments"][2]["plate"].as_str().unwrap();
    assert_eq!(import(&folder.path().join("take").join(plate)).unwrap().field.len(), 9);

    for (second, input, own) in
        [(0.25, "a.ply", 0.25), (1.25, "b.aarc", 0.25), (2.0, "c", 0.5), (2.25, "c", 0.75)]
    {
        assert!(picture(&folder, "take", second) == picture(&folder, input, own), "{second} s");
    }
    // A folder is an input, too, and so is a take.
    run(&folder, "package take -o take.aarc --coder fixed").success();
    run(&folder, "join take take.aarc -o twice").success();
    let manifest: Value = serde_json::from_slice(&read(&folder, "twice/field.json")).unwrap();
    assert_eq!(numbers(&manifest, "segments", "start_s"), [0.0, 1.0, 1.5, 2.25, 3.25, 3.75]);
    assert!(picture(&folder, "twice", 4.25) == picture(&folder, "take.aarc", 2.0));
}

#[test]
fn a_take_costs_no_more_than_its_clips() {
    let (folder, _) = joined_of([600, 500, 400]);
    let report = run(&folder, "package take -o take.aarc --json").json();
    let bytes = read(&folder, "take.aarc");
    let take = take_of(&bytes);
    assert_eq!((&report["bytes"], take.package_bytes()), (&json!(bytes.len()), bytes.len() as u64));
    assert_eq!((take.duration_s, take.info.viewpoints.len()), (2.25, 2));
    fs::create_dir(folder.path().join("last")).unwrap();
    fs::rename(folder.path().join("take/segment-0002.ply"), folder.path().join("last/field.ply")).unwrap();
    fs::rename(folder.path().join("take/segment-0002-plate.ply"), folder.path().join("last/plate.ply"))
        .unwrap();
    let mut alone = 0;
    for (i, input) in ["take/segment-0000.ply", "take/segment-0001.ply", "last"].into_iter().enumerate() {
        run(&folder, &format!("package {input} -o alone.aarc")).success();
        let clip = read(&folder, "alone.aarc");
        alone += clip.len();
        // The clip in the take, but for its viewpoints.
        let entry = &take.segments[i];
        let end = entry.offset as usize + entry.bytes();
        let own = codec::decode(&bytes[entry.offset as usize..end], &Limits::default()).unwrap();
        let clip = codec::decode(&clip, &Limits::default()).unwrap();
        // People stand elsewhere in the take, so that numbers are rounded otherwise.
        assert_eq!((own.merged().len(), own.plate.is_some()), (clip.merged().len(), clip.plate.is_some()));
        assert!(own.info.viewpoints.is_empty());
        let [in_take, alone] = [("take.aarc", entry.start_s + 0.25), ("alone.aarc", 0.25)]
            .map(|(input, second)| picture(&folder, input, second));
        assert!(psnr(&in_take, &alone) > 45.0, "segment {i}");
    }
    let ratio = bytes.len() as f64 / alone as f64;
    assert!(ratio <= 1.01, "{ratio}");
    // The worst segment and the median one.
    let psnrs = numbers(&report, "segments", "self_psnr_db");
    assert_eq!(report["self_psnr_db"].as_f64(), psnrs.iter().copied().reduce(f64::min));
    assert!(
        psnrs.iter().all(|psnr| *psnr >= 50.7) && psnrs.contains(&report["median_psnr_db"].as_f64().unwrap())
    );
}

/// A field of 8 seconds as `long.ply` and, split, as `split.aarc`, with the report.
fn split_take(unit_s: f64, options: &str) -> (TempDir, Value) {
    let folder = tempdir().unwrap();
    write(&folder.path().join("long.ply"), &long(700), 8.0);
    let report =
        run(&folder, &format!("package long.ply --split {unit_s} -o split.aarc --json {options}")).json();
    (folder, report)
}

#[test]
fn a_budget_holds_at_every_instant() {
    let (folder, report) = split_take(1.0, "--budget 150 --coder fixed --rank opacity --no-floor");
    let take = take_of(&read(&folder, "split.aarc"));
    assert!(take.segments.len() > 8, "{}", take.segments.len());
    let levels: std::collections::BTreeSet<u8> = take.segments.iter().map(|segment| segment.level).collect();
    assert!(levels.len() > 2, "{levels:?}");
    assert!((140..=150).contains(&take.resident_max()), "{}", take.resident_max());
    assert_eq!(report["resident_max"], take.resident_max());
    let out: usize = take.segments.iter().map(codec::Segment::gaussians).sum();
    assert_eq!(report["gaussians_out"], out);
    let dropped: u64 =
        report["dropped"].as_object().unwrap().values().map(|rows| rows.as_u64().unwrap()).sum();
    assert_eq!(report["gaussians_in"].as_u64().unwrap(), out as u64 + dropped);
    assert_eq!(report["ranking"], "opacity");
    let refused = run(&folder, "package long.ply --split 1 -o few.aarc --budget 3").error(2);
    assert!(refused.contains("without a Gaussian; choose a larger one"), "{refused}");
}

#[test]
fn one_ranking_holds_in_all_segments_and_threads_change_nothing() {
    let (folder, report) = split_take(2.5, "--budget 220 --coder fixed");
    let tried = report["tried"].as_array().unwrap();
    let chosen: Vec<&Value> = tried.iter().filter(|ranking| ranking["chosen"] == true).collect();
    assert_eq!((tried.len() > 3, chosen.len()), (true, 1), "{tried:?}");
    let segments = report["segments"].as_array().unwrap();
    assert!(segments.iter().all(|segment| segment["ranking"] == chosen[0]["ranking"]));
    let best = tried.iter().map(|ranking| ranking["psnr_db"].as_f64().unwrap()).fold(0.0, f64::max);
    assert_eq!(chosen[0]["psnr_db"].as_f64(), Some(best));
    let args = "package long.ply --split 2.5 -o other.aarc --budget 220 --coder fixed";
    let args: Vec<&str> = args.split(' ').collect();
    aarc_studio_with(folder.path(), &args, &[("RAYON_NUM_THREADS", "1")]).success();
    assert!(read(&folder, "other.aarc") == read(&folder, "split.aarc"), "other bytes on one thread");
}

#[test]
fn a_split_field_and_its_plate_look_like_the_whole() {
    let folder = tempdir().unwrap();
    let scene = folder.path().join("scene");
    fs::create_dir(&scene).unwrap();
    // No Gaussian lives long enough for a segment that spans the take.
    let mut brief = long(300);
    brief.temporal.as_mut().unwrap().s.fill(0.01);
    write(&scene.join("field.ply"), &brief, 8.0);
    let plate = Field { log_scales: vec![[-0.5; 3]; 20], ..field(20, 1, None, false) };
    write(&scene.join("plate.ply"), &plate, 8.0);
    run(&folder, "package scene --split 1 -o split.aarc --quality 60").success();
    let take = take_of(&read(&folder, "split.aarc"));
    assert_eq!((take.segments[0].start_s, take.segments[0].duration_s), (0.0, 8.0));
    assert_eq!(take.segments[0].gaussians(), 21, "the plate and one Gaussian");
    for second in [0.0, 1.0, 3.3, 4.0, 7.9, 8.0] {
        let db = psnr(&picture(&folder, "split.aarc", second), &picture(&folder, "scene", second));
        assert!(db > 50.0, "{second} s: {db}");
    }
    // As one field again.
    run(&folder, "export split.aarc --ply -o again.ply").success();
    let again = import(&folder.path().join("again.ply")).unwrap();
    assert_eq!((again.field.len(), again.hints.duration_s), (300, Some(8.0)));
    run(&folder, "export split.aarc --splatv -o again.splatv").success();
    let frozen = run(&folder, "export split.aarc --ply --at 4 -o at.ply").success();
    let alive = import(&folder.path().join("at.ply")).unwrap().field.len();
    assert!(alive > 5 && frozen.stdout.contains(&format!("{alive} Gaussians")), "{}", frozen.stdout);
    let seen = (0..again.field.len()).filter(|&i| again.field.opacity_at(i, 0.5) >= codec::ALPHA_MIN).count();
    assert_eq!(alive, seen);
}

#[test]
fn exports_say_how_many_gaussians_they_show_too_long() {
    let (folder, _) = joined();
    let outcome = run(&folder, "export take --ply -o whole.ply").success();
    assert!(outcome.stderr.contains("before or after the span of their segment"), "{}", outcome.stderr);
    let (first, whole) = (small(60), import(&folder.path().join("whole.ply")).unwrap().field);
    for i in 0..first.len() {
        let (a, b) = (first.position_at(i, 0.5), whole.position_at(i, 0.5 / 2.25));
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
        assert!((first.opacity_at(i, 0.5) - whole.opacity_at(i, 0.5 / 2.25)).abs() < 1e-5);
    }
}

#[test]
fn a_trimmed_take_has_its_segments_byte_for_byte() {
    let (folder, _) = split_take(1.0, "--coder fixed");
    let bytes = read(&folder, "split.aarc");
    let whole = take_of(&bytes);
    let report = run(&folder, "trim split.aarc --from 2.5 --to 5 -o part.aarc --json").json();
    let part_bytes = read(&folder, "part.aarc");
    let part = take_of(&part_bytes);
    assert_eq!((part.duration_s, &report["bytes"]), (2.5, &json!(part_bytes.len())));
    assert!(part.segments.len() < whole.segments.len());
    for segment in &part.segments {
        let source = whole
            .segments
            .iter()
            .find(|source| source.start_s - 2.5 == segment.start_s && source.head_crc == segment.head_crc)
            .unwrap();
        let bytes_of = |bytes: &[u8], segment: &codec::Segment| {
            bytes[segment.offset as usize..segment.offset as usize + segment.bytes()].to_vec()
        };
        assert!(bytes_of(&part_bytes, segment) == bytes_of(&bytes, source));
    }
    let overlapping =
        whole.segments.iter().filter(|segment| segment.start_s < 5.0 && segment.end_s() > 2.5).count();
    assert_eq!(part.segments.len(), overlapping);
    assert_eq!((&report["hidden_before_s"], &report["hidden_after_s"]), (&json!(2.5), &json!(3.0)));
    for second in [0.0, 1.0, 2.5] {
        assert!(
            picture(&folder, "part.aarc", second) == picture(&folder, "split.aarc", 2.5 + second),
            "{second} s"
        );
    }
    let words = run(&folder, "trim part.aarc --from 0.7 --to 2.5 -o end.aarc").success().stdout;
    assert!(
        words.contains("1.8 of 2.5 s") && words.contains("up to 3.2 s before the part and 3 s after it"),
        "{words}"
    );
    assert!(picture(&folder, "end.aarc", 1.8) == picture(&folder, "split.aarc", 5.0));
    // What it does not show, it does not show when it is joined.
    run(&folder, "join part.aarc end.aarc -o parts").success();
    let parts: Value = serde_json::from_slice(&read(&folder, "parts/field.json")).unwrap();
    assert!(numbers(&parts, "segments", "start_s").iter().all(|start| *start >= 0.0));
    for (second, input, own) in [(1.0, "part.aarc", 1.0), (3.0, "end.aarc", 0.5)] {
        let db = psnr(&picture(&folder, "parts", second), &picture(&folder, input, own));
        assert!(db > 55.0, "{second} s: {db}");
    }
}

#[test]
fn a_clip_can_be_trimmed_to_its_last_instant() {
    let folder = tempdir().unwrap();
    // No sum of seconds in binary.
    write(&folder.path().join("a.ply"), &small(50), 1.7);
    run(&folder, "package a.ply -o a.aarc --coder fixed").success();
    run(&folder, "trim a.aarc --from 0.3 --to 1.7 -o part.aarc").success();
    let part = take_of(&read(&folder, "part.aarc"));
    assert_eq!((part.segments.len(), part.segments[0].bytes()), (1, read(&folder, "a.aarc").len()));
    assert!(part.holds(0, part.duration_s));
    // Times are rounded to a millionth of a second.
    assert!(psnr(&picture(&folder, "part.aarc", 1.4), &picture(&folder, "a.aarc", 1.7)) > 60.0);
    let one = run(&folder, "inspect part.aarc --json").json();
    assert_eq!(
        numbers(&one, "segments", "gaussians"),
        [numbers(&run(&folder, "inspect a.aarc --json").json(), "segments", "gaussians")[0]]
    );
    let json = run(&folder, "inspect a.aarc --json").json();
    assert_eq!(
        (numbers(&json, "segments", "start_s"), numbers(&json, "segments", "bytes")),
        (vec![0.0], vec![json["bytes"].as_f64().unwrap()])
    );
}

/// What is of one segment is one field, wherever it comes from, and no number of it is rounded.
#[test]
fn a_take_of_one_segment_is_shown_and_read_as_any_other() {
    let (folder, _) = joined();
    run(&folder, "package take -o take.aarc").success();
    run(&folder, "join a.ply -o one").success();
    run(&folder, "package one -o one.aarc").success();
    write(&folder.path().join("odd.ply"), &small(50), 1.7);
    run(&folder, "package odd.ply -o odd.aarc").success();
    let shown = |file: &str| run(&folder, &format!("inspect {file} --json")).json();
    let keys = |file: &str| shown(file).as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!((keys("odd.aarc"), keys("one.aarc")), (keys("take.aarc"), keys("take.aarc")));
    for file in ["odd.aarc", "one.aarc", "take.aarc"] {
        let (json, bytes) = (shown(file), read(&folder, file));
        let sum = |list: &str, key: &str| numbers(&json, list, key).iter().sum::<f64>();
        // The table of segments is in no section.
        let sections = json["head_bytes"].as_f64().unwrap() + sum("sections", "bytes");
        assert_eq!(sections, bytes.len() as f64, "{file}");
        assert!(sum("attributes", "coded_bytes") > 0.5 * sum("sections", "bytes"), "{file}");
        let alive = numbers(&json, "alive", "alive");
        assert!(
            alive.iter().all(|alive| (1.0..=json["gaussians"].as_f64().unwrap()).contains(alive)),
            "{file}"
        );
    }

    run(&folder, "export odd.aarc --ply -o whole.ply").success();
    let clip = codec::decode(&read(&folder, "odd.aarc"), &Limits::default()).unwrap();
    assert!(read(&folder, "whole.ply") == write_field_file(&clip.merged(), &clip.info));
    run(&folder, "report one --rd --budgets 20 --size 32x24 -o of-folder").success();
    run(&folder, "report one.aarc --rd --budgets 20 --size 32x24 -o of-package").success();
    let refused = run(&folder, "report take.aarc --rd").error(3);
    assert!(refused.contains("take.aarc: 3 segments, where one field is expected"), "{refused}");
}

/// Fields may state different near distances; their take has the largest, and each package and export states its own.
#[test]
fn a_take_has_the_largest_near_distance_of_its_fields() {
    let folder = tempdir().unwrap();
    for (name, near) in [("a.ply", 0.25), ("b.ply", 0.5), ("c.ply", 0.0)] {
        write(&folder.path().join(name), &Field { near, ..small(30) }, 1.0);
    }
    let near_of = |file: &str| import(&folder.path().join(file)).unwrap().field.near;
    let shown = |file: &str| run(&folder, &format!("inspect {file} --json")).json()["near"].clone();
    run(&folder, "join a.ply b.ply c.ply -o take").success();
    let parts = [0, 1, 2].map(|number| near_of(&format!("take/segment-{number:04}.ply")));
    assert_eq!(parts, [0.25, 0.5, 0.0]);
    run(&folder, "package take -o take.aarc").success();
    assert_eq!((take_of(&read(&folder, "take.aarc")).near, shown("take.aarc")), (0.5, json!(0.5)));
    let words = run(&folder, "inspect take.aarc").success().stdout;
    assert!(words.contains("fades nearer than 0.5 units to the eye"), "{words}");
    run(&folder, "export take.aarc --ply -o all.ply").success();
    assert_eq!(near_of("all.ply"), 0.5);
    // The segments state it themselves, so that what is cut out of the take looks the same.
    run(&folder, "trim take.aarc --from 0 --to 1 -o first.aarc").success();
    assert_eq!(shown("first.aarc"), json!(0.5));

    run(&folder, "package a.ply -o a.aarc").success();
    assert_eq!(shown("a.aarc"), json!(0.25));
    let words = run(&folder, "inspect a.aarc").success().stdout;
    assert!(words.contains("fades nearer than 0.25 units to the eye"), "{words}");
    run(&folder, "export a.aarc --ply -o whole.ply").success();
    run(&folder, "export a.aarc --ply --at 0.5 -o at.ply").success();
    run(&folder, "export a.aarc --sequence -o frames").success();
    assert_eq!(["whole.ply", "at.ply"].map(near_of), [0.25; 2]);
    let scene = formats::SceneFiles::at(&folder.path().join("frames")).unwrap();
    assert_eq!(scene.read(Default::default()).unwrap().subject.field.near, 0.25);
    run(&folder, "package c.ply -o c.aarc").success();
    assert_eq!(shown("c.aarc"), Value::Null);
}

/// So many static rows all over a sphere around a place on the x axis.
fn shell(len: usize, radius: f32, x: f32, log_scale: f32) -> Field {
    let mut noise = Noise(9);
    let mut center = || {
        let arm = [(); 3].map(|()| noise.uniform(-1.0, 1.0));
        let norm = arm.iter().map(|x| x * x).sum::<f32>().sqrt();
        [x + radius * arm[0] / norm, radius * arm[1] / norm, radius * arm[2] / norm]
    };
    let centers = (0..len).map(|_| center()).collect();
    let (log_scales, opacities) = (vec![[log_scale; 3]; len], vec![0.9; len]);
    Field { centers, log_scales, opacities, near: 0.0, ..field(len, 0, None, false) }
}

/// A take of 2 s in `take`: a room, and from some second on who is in it for a second. No field states a viewpoint.
fn write_take(folder: &TempDir, room: Option<&Field>, person_s: f64) {
    let path = folder.path().join("take");
    fs::create_dir_all(&path).unwrap();
    let mut segments = Vec::new();
    let mut segment = |file: &str, field: &Field, start_s: f64, duration_s: f32| {
        let info = ClipInfo { duration_s, viewpoints: Vec::new(), ..info() };
        fs::write(path.join(file), write_field_file(field, &info)).unwrap();
        let level = u8::from(duration_s > 1.0);
        segments.push(json!({"file": file, "start_s": start_s, "duration_s": duration_s, "level": level}));
    };
    room.iter().for_each(|room| segment("room.ply", room, 0.0, 2.0));
    segment("person.ply", &shell(400, 0.5, 3.0, -3.0), person_s, 1.0);
    let manifest = json!({"version": 1, "duration_s": 2, "fps": 25, "segments": segments});
    fs::write(path.join("field.json"), manifest.to_string()).unwrap();
}

#[test]
fn a_take_opens_by_the_segments_that_are_shown_first() {
    let folder = tempdir().unwrap();
    let is_at_person = || {
        run(&folder, "package take -o take.aarc --coder fixed").success();
        let [x, y, z] = take_of(&read(&folder, "take.aarc")).info.viewpoints[0].target;
        (x - 3.0).abs() < 0.3 && y.abs() < 0.3 && z.abs() < 0.3
    };
    write_take(&folder, Some(&shell(400, 6.0, 0.0, -0.5)), 0.0);
    assert!(is_at_person());
    // Nothing is shown at the start.
    write_take(&folder, None, 1.0);
    assert!(is_at_person());
}

/// A room is a segment of its own, and might as well be a hollow body, which people see from outside.
#[test]
fn all_segments_of_a_take_are_judged_from_where_people_stand_in_it() {
    let folder = tempdir().unwrap();
    let (walls, outside) = (shell(400, 6.0, 0.0, -0.5), shell(400, 7.0, 0.0, -0.5));
    let room = Field {
        centers: [walls.centers.clone(), outside.centers].concat(),
        rotations: [walls.rotations.clone(), outside.rotations].concat(),
        log_scales: [walls.log_scales.clone(), outside.log_scales].concat(),
        opacities: [walls.opacities.clone(), outside.opacities].concat(),
        sh: [walls.sh.clone(), outside.sh].concat(),
        ..walls
    };
    write_take(&folder, Some(&room), 0.0);
    run(&folder, "package take -o take.aarc --coder fixed --budget 600").success();
    let bytes = read(&folder, "take.aarc");
    let take = take_of(&bytes);
    let of_room = take.segments.iter().find(|segment| segment.duration_s == 2.0).unwrap();
    let bytes = &bytes[of_room.offset as usize..][..of_room.bytes()];
    let kept = codec::decode(bytes, &Limits::default()).unwrap().merged();
    let is_inside = |center: &&[f32; 3]| center.iter().map(|x| x * x).sum::<f32>() < 6.5 * 6.5;
    let inside = kept.centers.iter().filter(is_inside).count();
    assert_eq!(kept.len(), 400);
    assert!(inside > 300, "{inside} of {}", kept.len());
}

#[test]
fn inspect_lists_segments_and_the_course() {
    let (folder, _) = joined();
    run(&folder, "package take -o take.aarc --coder fixed").success();
    let bytes = read(&folder, "take.aarc");
    let take = take_of(&bytes);
    let shown = run(&folder, "inspect take.aarc --json").json();
    assert_eq!(numbers(&shown, "segments", "start_s"), [0.0, 1.0, 1.5]);
    assert_eq!(numbers(&shown, "segments", "duration_s"), [1.0, 0.5, 0.75]);
    let sizes: Vec<f64> = take.segments.iter().map(|segment| segment.bytes() as f64).collect();
    assert_eq!(numbers(&shown, "segments", "bytes"), sizes);
    let gaussians: usize = take.segments.iter().map(codec::Segment::gaussians).sum();
    assert_eq!((&shown["gaussians"], &shown["bytes"]), (&json!(gaussians - 9), &json!(bytes.len())));
    assert_eq!((&shown["plate"]["gaussians"], &shown["motion_order"]), (&json!(9), &json!(2)));
    let layers = json!([{"gaussians": gaussians - 9, "bytes": bytes.len(), "complete": true}]);
    assert_eq!(shown["layers"], layers);
    assert!(shown["left_out"].as_array().unwrap().iter().any(|part| part["part"] == "motion of power 3"));
    let course = &shown["course"];
    assert_eq!(
        (&course["startup_bytes"], &course["resident_max"]),
        (&json!(sizes[0] as u64), &json!(take.resident_max()))
    );
    // Both others begin within a second.
    let peak = (sizes[1] + sizes[2]) * 8e-6;
    assert!(
        (course["peak_mbps"].as_f64().unwrap() - peak).abs() < 1e-9 && course["peak_s"] == 1.0,
        "{course}"
    );
    let rows = |key| numbers(course, "rows", key);
    assert_eq!((rows("from_s"), rows("to_s")), (vec![0.0, 1.0, 2.0], vec![1.0, 2.0, 2.25]));
    assert_eq!((rows("segments"), rows("bytes")), (vec![1.0; 3], vec![sizes[0], sizes[1] + sizes[2], 0.0]));
    let held = |i: usize| take.segments[i].gaussians() as f64;
    assert_eq!(rows("gaussians"), [held(0), held(1).max(held(2)), held(2)]);
    let words = run(&folder, "inspect take.aarc").success().stdout;
    assert!(words.contains("coder fixed, 3 segments\n") && words.contains("over one second"), "{words}");
}

#[test]
fn one_damaged_segment_is_named_and_the_others_are_shown() {
    let (folder, _) = joined();
    run(&folder, "package take -o take.aarc --coder fixed").success();
    let good = read(&folder, "take.aarc");
    let take = take_of(&good);
    let mut bytes = good.clone();
    let middle = &take.segments[1];
    bytes[middle.offset as usize + middle.bytes() - 20] ^= 0x10;
    fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
    let outcome = run(&folder, "inspect bad.aarc");
    assert_eq!(outcome.code, Some(3), "{}", outcome.stderr);
    assert!(
        outcome.stderr.contains("bad.aarc: 1 of 3 segments damaged, number 1 first: "),
        "{}",
        outcome.stderr
    );
    let listed = outcome.stdout.lines().filter(|line| line.contains("segment 1, from 1 s: damaged")).count();
    assert_eq!(listed, 1, "{}", outcome.stdout);
    assert!(picture(&folder, "bad.aarc", 0.5) == picture(&folder, "take.aarc", 0.5));
    let refused = run(&folder, "render bad.aarc --time 1.2 -o a.png").error(3);
    assert!(
        refused.contains("bad.aarc: segment 1, from 1 s: damaged") && refused.contains("get the file again"),
        "{refused}"
    );
    // Trimmed, the rest is whole.
    run(&folder, "trim bad.aarc --from 1.6 --to 2.25 -o rest.aarc").success();
    run(&folder, "inspect rest.aarc").success();
    // A damaged head, of the take and of a segment.
    bytes = good.clone();
    bytes[100] ^= 1;
    fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
    assert!(run(&folder, "inspect bad.aarc").error(3).contains("damaged"));
    bytes = good.clone();
    bytes[middle.offset as usize + 30] ^= 1;
    fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
    let refused = run(&folder, "trim bad.aarc --from 0 --to 1.2 -o rest.aarc").error(3);
    assert!(refused.contains("segment 1, from 1 s"), "{refused}");
    // Segments in each other's place.
    bytes = good[..take.head_bytes].to_vec();
    for i in [1, 0, 2] {
        let segment = &take.segments[i];
        bytes.extend_from_slice(&good[segment.offset as usize..segment.offset as usize + segment.bytes()]);
    }
    fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
    let outcome = run(&folder, "inspect bad.aarc");
    assert!(outcome.stderr.contains("2 of 3 segments damaged, number 0 first"), "{}", outcome.stderr);
    // Bytes too many.
    fs::write(folder.path().join("bad.aarc"), [&good[..], b"more"].concat()).unwrap();
    assert!(run(&folder, "inspect bad.aarc").error(3).contains("4 extra bytes after"));
}

/// Where other bytes stand in place of a segment, that is said, and not what a parser makes of them.
#[test]
fn a_missing_segment_is_named_for_what_it_is() {
    let (folder, _) = joined();
    run(&folder, "package take -o take.aarc --coder fixed").success();
    let good = read(&folder, "take.aarc");
    let take = take_of(&good);
    let middle = &take.segments[1];
    let (from, to) = (middle.offset as usize, middle.offset as usize + middle.bytes());
    let announced =
        format!("not the one in the table: a head with CRC-32 {:08x} expected, ", middle.head_crc);
    let text = b"HTTP/1.1 404 Not Found\r\n";
    let others: [(&str, Vec<u8>); 3] = [
        ("only zeros found", vec![0; to - from]),
        ("other bytes found", text.iter().copied().cycle().take(to - from).collect()),
        // A package of another version, cut or filled up.
        ("one with CRC-32", {
            let mut other = good[from..to].to_vec();
            let head_bytes = u32::from_le_bytes(other[8..12].try_into().unwrap()) as usize;
            other[4] = 9;
            other[head_bytes - 1] ^= 1;
            other
        }),
    ];
    for (what, other) in others {
        let bytes = [&good[..from], &other, &good[to..]].concat();
        fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
        let inspected = run(&folder, "inspect bad.aarc");
        for line in [
            inspected.stderr,
            run(&folder, "trim bad.aarc --from 0 --to 1.2 -o part.aarc").error(3),
            run(&folder, "render bad.aarc --time 1.2 -o a.png").error(3),
        ] {
            let cause = line.contains("segment 1, from 1 s: ") && line.contains(&announced);
            assert!(cause && line.contains(what), "{what}: {line}");
        }
    }
    assert!(!folder.path().join("part.aarc").exists());
}

#[test]
fn trim_refuses_a_segment_of_which_a_section_is_damaged() {
    let (folder, _) = joined();
    run(&folder, "package take -o take.aarc --coder fixed").success();
    let mut bytes = read(&folder, "take.aarc");
    let middle = take_of(&bytes).segments[1].clone();
    let start = middle.offset as usize;
    let head = codec::contents(&bytes[start..start + middle.bytes()], &Limits::default()).unwrap();
    let at = start + head.sections.last().unwrap().offset;
    bytes[start + middle.bytes() - 20] ^= 0x10;
    fs::write(folder.path().join("bad.aarc"), &bytes).unwrap();
    let refused = run(&folder, "trim bad.aarc --from 0 --to 1.2 -o part.aarc").error(3);
    assert!(
        refused.contains("segment 1, from 1 s: damaged chunk of Gaussians: CRC-32 is")
            && refused.contains(&format!("at byte {at}; get the file again")),
        "{refused}"
    );
    assert!(!folder.path().join("part.aarc").exists());
    // It is left out of this part.
    run(&folder, "trim bad.aarc --from 0 --to 1 -o part.aarc").success();
}

#[test]
fn inspect_names_gaps_in_time() {
    let (folder, _) = joined();
    let path = folder.path().join("take/field.json");
    let mut manifest: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    manifest["segments"][1]["duration_s"] = json!(0.25);
    manifest["segments"][2]["duration_s"] = json!(0.5);
    fs::write(&path, manifest.to_string()).unwrap();
    run(&folder, "package take -o take.aarc --coder fixed").success();
    assert_eq!(run(&folder, "inspect take.aarc --json").json()["gaps"], json!([[1.25, 1.5], [2.0, 2.25]]));
    let words = run(&folder, "inspect take.aarc").success().stdout;
    for gap in ["no segment shows 1.25 to 1.5 s", "no segment shows 2 to 2.25 s"] {
        assert_eq!(words.lines().filter(|line| line.starts_with("gap") && line.ends_with(gap)).count(), 1);
    }
    // A take without any, whose cuts are no exact sums.
    write(&folder.path().join("third.ply"), &small(40), 1.0 / 3.0);
    run(&folder, "join third.ply third.ply third.ply -o thirds").success();
    run(&folder, "package thirds -o thirds.aarc --coder fixed").success();
    assert_eq!(run(&folder, "inspect thirds.aarc --json").json()["gaps"], json!([]));
    assert!(!run(&folder, "inspect thirds.aarc").success().stdout.contains("no segment shows"));
}

#[test]
fn one_segment_is_counted_in_the_singular() {
    let folder = tempdir().unwrap();
    write(&folder.path().join("a.ply"), &small(50), 1.0);
    run(&folder, "join a.ply -o one").success();
    let Outcome { stdout, stderr, .. } = run(&folder, "package one -o one.aarc --coder fixed").success();
    assert!(stdout.contains("field folder of 1 segment\n"), "{stdout}");
    assert!(stderr.contains("note: 1 segment, "), "{stderr}");
}

#[test]
fn a_take_that_was_cut_short_shows_what_is_there() {
    let (folder, _) = joined();
    run(&folder, "package take -o take.aarc --coder fixed").success();
    let bytes = read(&folder, "take.aarc");
    let take = take_of(&bytes);
    fs::write(folder.path().join("short.aarc"), &bytes[..take.segments[1].offset as usize + 300]).unwrap();
    let shown = run(&folder, "inspect short.aarc --json").json();
    let complete: Vec<&Value> =
        shown["segments"].as_array().unwrap().iter().map(|segment| &segment["complete"]).collect();
    assert_eq!(complete, [true, false, false]);
    assert!(picture(&folder, "short.aarc", 0.5) == picture(&folder, "take.aarc", 0.5));
    let refused = run(&folder, "render short.aarc --time 1.2 -o a.png").error(3);
    assert!(refused.contains("cut short, has 0 of the 1 segment needed"), "{refused}");
    let outcome = run(&folder, "export short.aarc --ply -o a.ply").success();
    assert!(outcome.stderr.contains("cut short, has 1 of the 3 segments needed"), "{}", outcome.stderr);
    let refused = run(&folder, "trim short.aarc --from 1 --to 2 -o part.aarc").error(3);
    assert!(refused.contains("segment 1"), "{refused}");
}

/// Before anything is packaged.
#[test]
fn two_plates_at_one_instant_are_refused() {
    let (folder, _) = joined();
    let path = folder.path().join("take/field.json");
    let mut manifest: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    manifest["segments"][1]["plate"] = manifest["segments"][2]["plate"].clone();
    fs::write(&path, manifest.to_string()).unwrap();
    run(&folder, "package take -o one-after-another.aarc --coder fixed").success();
    manifest["segments"][1]["duration_s"] = json!(0.75);
    fs::write(&path, manifest.to_string()).unwrap();
    let refused = run(&folder, "package take -o take.aarc --coder fixed").error(3);
    assert!(refused.contains("segments 1 and 2 have a plate at 1.5 s"), "{refused}");
    assert!(refused.contains("remove the plate"), "{refused}");
}

#[test]
fn takes_of_one_and_of_a_thousand_segments() {
    let folder = tempdir().unwrap();
    // With viewpoints: without any, a part opens with what is in view at its own start.
    let info = ClipInfo { duration_s: 0.25, ..info() };
    let options = EncodeOptions { coder: Coder::Fixed, ..EncodeOptions::default() };
    for count in [1, 1000] {
        let package =
            codec::encode(&Source { info: &info, field: &small(12), plate: None }, &options).unwrap();
        let contents = codec::contents(&package, &Limits::default()).unwrap();
        let segment = |i| SegmentPackage {
            start_s: 0.125 * f64::from(i),
            duration_s: 0.25,
            level: 0,
            contents: &contents,
        };
        let segments: Vec<SegmentPackage> = (0..count).map(segment).collect();
        let duration_s = 0.125 * f64::from(count + 1);
        let mut bytes = encode_take_head(&info, duration_s, &segments).unwrap();
        (0..count).for_each(|_| bytes.extend_from_slice(&package));
        fs::write(folder.path().join("take.aarc"), &bytes).unwrap();
        let shown = run(&folder, "inspect take.aarc --json").json();
        assert_eq!(shown["segments"].as_array().unwrap().len(), count as usize);
        assert_eq!(
            shown["course"]["resident_max"],
            json!(contents.layers[0].total() * (count as usize).min(2))
        );
        assert!(shown["course"]["rows"].as_array().unwrap().len() <= 60);
        picture(&folder, "take.aarc", duration_s);
        let (from, to) = (duration_s * 0.5, duration_s * 0.75);
        run(&folder, &format!("trim take.aarc --from {from} --to {to} -o part.aarc")).success();
        assert!(picture(&folder, "part.aarc", 0.0) == picture(&folder, "take.aarc", from));
    }
    // As many inputs, some of them the same.
    write(&folder.path().join("a.ply"), &small(3), 0.1);
    let inputs = ["a.ply"; 1000].join(" ");
    run(&folder, &format!("join {inputs} -o thousand")).success();
    let manifest: Value = serde_json::from_slice(&read(&folder, "thousand/field.json")).unwrap();
    assert_eq!(manifest["segments"].as_array().unwrap().len(), 1000);
    assert!(picture(&folder, "thousand", 55.03) == picture(&folder, "a.ply", 0.03));
    run(&folder, "join a.ply -o one").success();
    run(&folder, "package one -o one.aarc --coder fixed").success();
    assert_eq!(take_of(&read(&folder, "one.aarc")).segments.len(), 1);
}

#[cfg(target_os = "linux")]
#[test]
fn nothing_is_left_where_the_disk_is_full() {
    let (folder, _) = joined();
    write(&folder.path().join("large.ply"), &small(2000), 1.0);
    run(&folder, "package take -o take.aarc --coder fixed").success();
    let before = tool::outcome::contents(folder.path());
    for (line, what) in [
        ("join a.ply large.ply -o full", "cannot write full/segment-0001.ply"),
        ("join large.ply -o full", "cannot write full/segment-0000.ply"),
        ("package take -o full.aarc --coder fixed", "cannot write full.aarc"),
        ("trim take.aarc --from 0 --to 2 -o full.aarc", "cannot write full.aarc"),
    ] {
        let kilobytes = if line.starts_with("join") { 32 } else { 2 };
        let refused =
            tool::with_small_disk(folder.path(), kilobytes, &line.split_whitespace().collect::<Vec<_>>())
                .error(2);
        assert!(refused.contains(what) && refused.contains("name another place"), "{line}: {refused}");
        assert!(!refused.contains(".writing-"), "{refused}");
        assert!(tool::outcome::contents(folder.path()) == before, "{line}: something is left");
    }
}
