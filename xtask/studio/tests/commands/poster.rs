//! `poster`: a clip and a take get one in place, everything else of the file stays, and bad requests change nothing.

use std::fs;
use std::path::Path;

use crate::support::{field, info};
use crate::tool::{Outcome, aarc_studio};
use codec::{ClipInfo, Coder, EncodeOptions, Field, Limits, SegmentPackage, Source, encode_take_head};
use serde_json::Value;
use tempfile::tempdir;

fn clip() -> Vec<u8> {
    clip_of(&info())
}

fn clip_of(info: &ClipInfo) -> Vec<u8> {
    let field = Field { log_scales: vec![[-3.0; 3]; 50], ..field(50, 0, Some(1), false) };
    let source = Source { info, field: &field, plate: None };
    codec::encode(&source, &EncodeOptions { coder: Coder::Fixed, ..EncodeOptions::default() }).unwrap()
}

/// A take that plays the clip twice.
fn take_of(info: &ClipInfo) -> Vec<u8> {
    let clip = clip_of(info);
    let contents = codec::contents(&clip, &Limits::default()).unwrap();
    let segment = |start_s| SegmentPackage { start_s, duration_s: 2.0, level: 0, contents: &contents };
    let head = encode_take_head(info, 4.0, &[segment(0.0), segment(2.0)]).unwrap();
    [&head, &clip[..], &clip[..]].concat()
}

fn poster(folder: &Path, args: &str) -> Outcome {
    let args: Vec<&str> = ["poster", "a.aarc"].into_iter().chain(args.split_whitespace()).collect();
    aarc_studio(folder, &args)
}

fn shown(folder: &Path) -> Value {
    poster(folder, "--json").json()["poster"].clone()
}

#[test]
fn a_clip_gets_a_poster_in_place_and_loses_it_again() {
    let folder = tempdir().unwrap();
    let (folder, path) = (folder.path(), folder.path().join("a.aarc"));
    fs::write(&path, clip()).unwrap();
    assert_eq!(shown(folder), Value::Null);
    poster(folder, "--time 0.5 --view -1,2,-3.5:0,0,0.25:40").success();
    let seen = shown(folder);
    assert_eq!(seen["time_s"], 0.5, "{seen}");
    assert_eq!(seen["position"], serde_json::json!([-1.0, 2.0, -3.5]));
    assert!((seen["fov_y_deg"].as_f64().unwrap() - 40.0).abs() < 1e-3, "{seen}");
    // Another time keeps the view, another file leaves this one as it is.
    poster(folder, "--time 0.25 -o b.aarc").success();
    assert_eq!(shown(folder), seen);
    fs::rename(folder.join("b.aarc"), &path).unwrap();
    let target = serde_json::json!([0.0, 0.0, 0.25]);
    assert_eq!((shown(folder)["time_s"].as_f64(), &shown(folder)["target"]), (Some(0.25), &target));
    aarc_studio(folder, &["inspect", "a.aarc"]).success();
    poster(folder, "--remove").success();
    assert!(fs::read(&path).unwrap() == clip(), "the file as it was");
    assert_eq!(fs::read_dir(folder).unwrap().count(), 1, "nothing else is left");
}

#[test]
fn a_take_gets_a_poster_and_keeps_its_segments() {
    let folder = tempdir().unwrap();
    let (folder, path) = (folder.path(), folder.path().join("a.aarc"));
    fs::write(&path, take_of(&info())).unwrap();
    poster(folder, "--time 3.5").success();
    assert_eq!(shown(folder)["time_s"], 3.5);
    let bytes = fs::read(&path).unwrap();
    assert!(bytes.ends_with(&clip()), "the second segment is untouched");
    let take = codec::package(&bytes, &Limits::default()).unwrap();
    assert_eq!((take.segments.len(), take.package_bytes()), (2, bytes.len() as u64));
    aarc_studio(folder, &["inspect", "a.aarc"]).success();
}

#[test]
fn without_viewpoints_the_poster_has_the_opening_view() {
    let folder = tempdir().unwrap();
    let (folder, path) = (folder.path(), folder.path().join("a.aarc"));
    let info = ClipInfo { viewpoints: Vec::new(), ..info() };
    let clip = codec::decode(&clip_of(&info), &Limits::default()).unwrap();
    let opening = clip.surroundings().opening();
    assert_eq!(clip.viewpoints()[0], opening);
    for package in [clip_of(&info), take_of(&info)] {
        fs::write(&path, package).unwrap();
        poster(folder, "--time 1").success();
        let seen = shown(folder);
        for (key, point) in [("position", opening.position), ("target", opening.target)] {
            let shown: [f32; 3] = serde_json::from_value(seen[key].clone()).unwrap();
            assert!(
                (0..3).all(|axis| (shown[axis] - point[axis]).abs() < 1e-5),
                "{key}: {shown:?} {point:?}"
            );
        }
    }
}

#[test]
fn what_cannot_be_done_leaves_the_file_as_it_is() {
    let folder = tempdir().unwrap();
    let (folder, path) = (folder.path(), folder.path().join("a.aarc"));
    fs::write(&path, clip()).unwrap();
    for (args, code) in [
        ("--time 99", 2),
        ("--time -1", 2),
        ("--time nan", 2),
        ("--view nowhere", 2),
        ("--view 1,2,3", 2),
        ("--view 1,2:0,0,0", 2),
        ("--view 1,2,3:0,0,0:180", 2),
        ("--view 1,2,3:0,0,0:40:1", 2),
        ("--view 1,2,3:1,2,3", 2),
        ("--view 1,2,3:1,8,-5", 2),
        ("--view 1,2,3:1.0001,8,-5", 2),
        ("--time 0 --remove", 2),
        ("-o b.aarc", 2),
        ("--time 0 -o none/b.aarc", 2),
    ] {
        let outcome = poster(folder, args);
        assert_eq!(outcome.code, Some(code), "{args}: {outcome:?}");
        assert!(fs::read(&path).unwrap() == clip(), "{args}");
    }
    let along = poster(folder, "--view 1,2,3:1,8,-5");
    let expected = "error: --view 1,2,3:1,8,-5: the view is along the clip's up axis 0,0.6,-0.8, so no side of the \
                    picture is up: move one of the points aside\n";
    assert_eq!(along.stderr, expected);
    // As steep as the camera of the player.
    poster(folder, "--view 1,2,3:1.01,8,-5 -o b.aarc").success();
    fs::write(&path, &clip()[..clip().len() - 1]).unwrap();
    assert_eq!(poster(folder, "--time 0").code, Some(3));
    fs::write(&path, "nothing").unwrap();
    assert_eq!(poster(folder, "--time 0").code, Some(3));
}

/// A package with a poster at 1.5 s, whose section is damaged.
fn damaged(package: &[u8]) -> Vec<u8> {
    let poster = codec::Poster { time_s: 1.5, position: [0.0, 1.0, 3.0], target: [0.0; 3], fov_y: 0.7 };
    let mut bytes = codec::with_poster(package, Some(&poster), &Limits::default()).unwrap();
    // Its time is where it is in no other section.
    let time = 1.5f64.to_le_bytes();
    let at = bytes.windows(8).position(|window| window == time).unwrap();
    bytes[at] ^= 1;
    bytes
}

#[test]
fn inspect_shows_the_poster_and_says_that_it_is_damaged() {
    let folder = tempdir().unwrap();
    let (folder, path) = (folder.path(), folder.path().join("a.aarc"));
    for package in [clip(), take_of(&info())] {
        fs::write(&path, &package).unwrap();
        let inspect = |args: &[&str]| aarc_studio(folder, &[&["inspect", "a.aarc"], args].concat());
        assert_eq!(inspect(&["--json"]).json()["poster"], Value::Null);
        poster(folder, "--time 1.5 --view 0,1,3:0,0,0").success();
        let (seen, expected) = (inspect(&["--json"]).json()["poster"].clone(), shown(folder));
        for key in ["time_s", "position", "target"] {
            assert_eq!(seen[key], expected[key], "{key}");
        }
        assert!((seen["fov_y_deg"].as_f64().unwrap() - 51.566).abs() < 1e-3, "{seen}");
        let text = inspect(&[]);
        assert!(text.stdout.contains("at 1.5 s, from [0.0, 1.0, 3.0], looks at"), "{text:?}");
        fs::write(&path, damaged(&package)).unwrap();
        for args in [&["--json"][..], &[]] {
            let outcome = inspect(args);
            assert_eq!(outcome.code, Some(3), "{outcome:?}");
            assert!(
                outcome.stderr.contains("poster") && outcome.stdout.len() > 500,
                "everything is shown: {outcome:?}"
            );
        }
    }
}

#[test]
fn inspect_shows_a_clip_with_damaged_sound() {
    let folder = tempdir().unwrap();
    let info = codec::SoundInfo {
        channels: 1,
        position: None,
        stream: 1,
        start: 0,
        length: 960,
        lead: 0,
        packet_samples: 960,
    };
    let sound = codec::Sound::new(info, [&b"a packet of sound"[..]].into_iter()).unwrap();
    let mut bytes = codec::with_sound(&clip(), Some(&sound)).unwrap();
    let at = bytes.windows(6).position(|window| window == b"packet").unwrap();
    bytes[at] ^= 1;
    fs::write(folder.path().join("a.aarc"), bytes).unwrap();
    let outcome = aarc_studio(folder.path(), &["inspect", "a.aarc"]);
    assert_eq!(outcome.code, Some(3), "{outcome:?}");
    assert!(
        outcome.stdout.contains("sound       damaged sound: ") && outcome.stdout.contains("\nlayer "),
        "{outcome:?}"
    );
    assert!(outcome.stderr.contains("the rest plays"), "{outcome:?}");
    let json: Value =
        serde_json::from_str(&aarc_studio(folder.path(), &["inspect", "a.aarc", "--json"]).stdout).unwrap();
    assert_eq!((&json["audio"], &json["damaged"][0]["section"]), (&Value::Null, &"sound".into()));
}

#[test]
fn a_poster_stays_at_its_instant_in_a_part() {
    let folder = tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.aarc"), take_of(&info())).unwrap();
    let trim = |from: &str, to: &str, json: bool| {
        let args = ["trim", "a.aarc", "--from", from, "--to", to, "-o", "b.aarc", "--json"];
        aarc_studio(folder, &args[..args.len() - usize::from(!json)])
    };
    let time_s = || aarc_studio(folder, &["poster", "b.aarc", "--json"]).json()["poster"]["time_s"].clone();
    assert_eq!(trim("2", "4", true).json()["poster_lost"], false, "there is none");
    poster(folder, "--time 2.5").success();
    for (from, to, expected) in [("0", "3", 2.5), ("0.5", "3", 2.0), ("2", "4", 0.5)] {
        assert_eq!(trim(from, to, true).json()["poster_lost"], false);
        assert_eq!(time_s(), expected, "{from} {to}");
        assert!(aarc_studio(folder, &["inspect", "b.aarc"]).success().stdout.contains("poster"));
    }
    assert!(!trim("0", "3", false).stdout.contains("poster"));
    for (from, to) in [("0", "2"), ("3", "4")] {
        assert_eq!(trim(from, to, true).json()["poster_lost"], true);
        assert_eq!(time_s(), Value::Null);
    }
    assert!(trim("3", "4", false).stdout.contains("the poster was left behind"));
}
