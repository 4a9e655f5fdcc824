//! `cargo xtask ingest`: starts of videos by sound to a fraction of a millisecond, and what is wrong in one sentence. Without
//! ffmpeg most tests are skipped.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use crate::support::{Noise, data};
use crate::tool::{aarc_studio, aarc_studio_with, ffmpeg, has_ffmpeg, ingest, refused};
use serde_json::Value;
use studio::capture::CaptureFiles;
use tempfile::{TempDir, tempdir};

/// Samples a second of the sound.
const RATE: usize = 48_000;

/// Seconds of sound before the first and after the last camera runs.
const SPARE_S: f64 = 2.0;

/// Noise in syllables, `seconds` long, of a power of about 1 where it is loud.
fn speech(seed: u64, seconds: f64) -> Vec<f32> {
    let mut noise = Noise(seed);
    let count = (seconds * RATE as f64) as usize;
    let mut smooth = 0.0;
    let mut loudness = 0.0;
    (0..count)
        .map(|i| {
            if i % (RATE / 6) == 0 {
                loudness = noise.uniform(0.0, 1.0);
            }
            // A voice has less power in high tones.
            smooth += 0.4 * (noise.uniform(-3.0, 3.0) - smooth);
            loudness * smooth
        })
        .collect()
}

/// What a microphone records of `sound` from sample `start` on, by a clock that runs `drift_ppm` slow, with noise `decibels` below
/// it.
fn recorded(
    sound: &[f32],
    start: usize,
    seconds: f64,
    drift_ppm: f64,
    (seed, decibels): (u64, f32),
) -> Vec<f32> {
    let power = sound.iter().map(|x| x * x).sum::<f32>() / sound.len() as f32;
    // Uniform noise of width 1 has a power of 1/12.
    let amplitude = (12.0 * power * 10f32.powf(-0.1 * decibels)).sqrt();
    let mut noise = Noise(seed);
    let sample = |i: usize| {
        let at = start as f64 + i as f64 * (1.0 + 1e-6 * drift_ppm);
        let (first, part) = (at as usize, at.fract() as f32);
        sound[first] + (sound[first + 1] - sound[first]) * part
    };
    (0..(seconds * RATE as f64) as usize).map(|i| sample(i) + amplitude * noise.uniform(-0.5, 0.5)).collect()
}

/// A WAV file of 16 bits.
fn wav(path: &Path, samples: &[f32]) {
    let bytes: Vec<u8> = samples.iter().flat_map(|x| ((x * 6000.0) as i16).to_le_bytes()).collect();
    let (rate, len) = (RATE as u32, bytes.len() as u32);
    let mut file = b"RIFF".to_vec();
    file.extend((36 + len).to_le_bytes());
    file.extend(b"WAVEfmt \x10\0\0\0\x01\0\x01\0");
    file.extend(rate.to_le_bytes());
    file.extend((2 * rate).to_le_bytes());
    file.extend(b"\x02\0\x10\0data");
    file.extend(len.to_le_bytes());
    file.extend(bytes);
    fs::write(path, file).unwrap();
}

/// The calibration of a ring of cameras with pictures of 64x48.
fn calibration(names: &[&str]) -> String {
    let mut text = String::new();
    for (i, name) in names.iter().enumerate() {
        let angle = i as f64 * std::f64::consts::TAU / names.len() as f64;
        // Turned about y and 3 units before the origin.
        let _ = write!(
            text,
            "[cam_{i}]\nname = \"{name}\"\nsize = [ 64.0, 48.0]\nmatrix = [ [ 60.0, 0.0, 31.5], [ 0.0, 60.0, 23.5], [ 0.0, 0.0, \
             1.0]]\ndistortions = [ -0.1, 0.01, 0.0, 0.0]\nrotation = [ 0.0, {angle:?}, 0.0]\ntranslation = [ 0.0, 0.0, \
             3.0]\nfisheye = false\n\n"
        );
    }
    text + "[metadata]\nerror = 0.0\n"
}

/// Pictures that differ from frame to frame.
fn pictures(seconds: f64) -> String {
    format!("-f lavfi -i testsrc=size=64x48:rate=25:duration={seconds}")
}

const ENCODED: &str = "-c:v libx264 -preset ultrafast -pix_fmt yuv420p";

/// A rig of silent cameras that run for a second.
fn silent(names: &[&str]) -> TempDir {
    let folder = tempdir().unwrap();
    let rig = folder.path().join("rig");
    fs::create_dir(&rig).unwrap();
    for name in names {
        ffmpeg(&rig, &format!("{} {ENCODED} {name}.mp4", pictures(1.0)));
    }
    fs::write(rig.join("calibration.toml"), calibration(names)).unwrap();
    folder
}

/// A rig of cameras with these sounds.
fn sounding(sounds: &[Vec<f32>]) -> TempDir {
    let folder = tempdir().unwrap();
    let rig = folder.path().join("rig");
    fs::create_dir(&rig).unwrap();
    let names: Vec<String> = (0..sounds.len()).map(|i| format!("cam{i:02}")).collect();
    for (name, sound) in names.iter().zip(sounds) {
        wav(&rig.join("sound.wav"), sound);
        let seconds = sound.len() as f64 / RATE as f64;
        ffmpeg(&rig, &format!("{} -i sound.wav {ENCODED} -c:a aac -b:a 128k {name}.mp4", pictures(seconds)));
    }
    fs::remove_file(rig.join("sound.wav")).unwrap();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    fs::write(rig.join("calibration.toml"), calibration(&names)).unwrap();
    folder
}

fn manifest(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("studio/capture.json")).unwrap()).unwrap()
}

fn starts_s(json: &Value) -> Vec<f64> {
    json["starts"]["starts_s"].as_array().unwrap().iter().map(|start_s| start_s.as_f64().unwrap()).collect()
}

#[test]
fn sound_says_when_twelve_cameras_start() {
    if !has_ffmpeg() {
        return;
    }
    let sound = speech(1, 4.0 + 2.0 * SPARE_S);
    // Not whole samples of the rate at which they are compared.
    let starts: Vec<usize> = (0..12).map(|i| i * 8011 % 95_000).collect();
    let recording = |(i, start): (usize, &usize)| recorded(&sound, *start, 4.0, 0.0, (100 + i as u64, 10.0));
    let folder = sounding(&starts.iter().enumerate().map(recording).collect::<Vec<_>>());
    let folder = folder.path();
    let json = ingest(folder, "--json").json();
    assert_eq!(json["starts"]["source"], "sound");
    let found = starts_s(&json);
    let errors: Vec<f64> =
        found.iter().zip(&starts).map(|(found, start)| found - *start as f64 / RATE as f64).collect();
    let (low, high) =
        errors.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
    println!("worst pair: {:.4} ms", 1e3 * (high - low));
    assert!(high - low < 2e-4, "{errors:?}");
    assert_eq!(found.iter().copied().fold(f64::NEG_INFINITY, f64::max), 0.0, "the last camera starts it");

    // The other commands read it, and the page loads nothing.
    let capture_files = CaptureFiles::open(&folder.join("studio")).unwrap();
    assert_eq!((capture_files.capture.cameras.len(), capture_files.fps()), (12, 25.0));
    assert_eq!(capture_files.missing_count(), 0);
    assert!(manifest(folder)["cameras"][3]["video"] == "../rig/cam03.mp4");
    assert_eq!(manifest(folder)["learn"], serde_json::json!(["offsets", "colors"]));
    let page = fs::read_to_string(folder.join("studio/ingest.html")).unwrap();
    assert_eq!(page.matches("<img").count(), 12 * (5 + 4), "and a plate with three mattes");
    assert!(page.contains("<svg") && page.trim_end().ends_with("</html>"));
    for foreign in ["src=\"http", "href=", "@import", "url(", "NaN"] {
        assert!(!page.contains(foreign), "{foreign}");
    }

    // A second run keeps all, and one after a video changed makes anew what depends on it.
    let written =
        |name: &str| fs::metadata(folder.join("studio/ingest").join(name)).unwrap().modified().unwrap();
    let names =
        ["probe-cam01.mp4.json", "sound-cam01.mp4.s16", "sound-cam02.mp4.s16", "sound.json", "epipolar.json"];
    let before = names.map(written);
    assert!(ingest(folder, "--json").json() == json);
    assert_eq!(names.map(written), before);
    let video = fs::File::options().append(true).open(folder.join("rig/cam01.mp4")).unwrap();
    video.set_modified(SystemTime::now() + std::time::Duration::from_secs(9)).unwrap();
    // What an interrupted or damaged run left does no harm.
    fs::write(folder.join("studio/ingest/epipolar.json"), "{\"key\": ").unwrap();
    fs::remove_file(folder.join("studio/ingest/sound-cam02.mp4.s16")).unwrap();
    assert!(ingest(folder, "--json").json() == json);
    let after = names.map(written);
    assert!(after.iter().zip(&before).all(|(after, before)| after > before));
}

#[test]
fn sound_of_another_event_is_refused() {
    if !has_ffmpeg() {
        return;
    }
    let [sound, other] = [1, 2].map(|seed| speech(seed, 8.0));
    let recording = |sound: &[f32], i: usize| recorded(sound, 9000 * i, 4.0, 0.0, (9000 + i as u64, 10.0));
    let folder = sounding(&[recording(&sound, 0), recording(&other, 1), recording(&sound, 2)]);
    let error = refused(ingest(folder.path(), ""), 3);
    assert!(
        error.contains("cam01: its sound is not that of the other cameras: the correlation peaks at "),
        "{error}"
    );
    assert!(
        error.contains(" times its median, and 12 are needed; ") && error.contains("--offsets FILE"),
        "{error}"
    );
    assert!(!folder.path().join("studio/capture.json").exists());
    // Stated starts need no sound.
    fs::write(folder.path().join("starts.txt"), "cam00 0\ncam01 0.1875\n# late\ncam02 0.375\n").unwrap();
    let json = ingest(folder.path(), "--offsets starts.txt --json").json();
    assert_eq!(
        (json["starts"]["source"].as_str(), starts_s(&json)),
        (Some("file"), vec![-0.375, -0.1875, 0.0])
    );
}

#[test]
fn a_clock_that_drifts_is_said() {
    if !has_ffmpeg() {
        return;
    }
    let sound = speech(3, 14.0);
    let drifts = [0.0, 30.0, -400.0, 0.0];
    let recording =
        |(i, drift): (usize, &f64)| recorded(&sound, 20_000 + 4801 * i, 8.0, *drift, (9000 + i as u64, 20.0));
    let folder = sounding(&drifts.iter().enumerate().map(recording).collect::<Vec<_>>());
    let json = ingest(folder.path(), "--json").json();
    let found = json["starts"]["sound"]["drifts_ppm"].as_array().unwrap();
    for (found, drift) in found.iter().zip(drifts) {
        // Within a block, a drift beyond the model blurs the peak.
        let tolerance = if drift.abs() > 200.0 { 40.0 } else { 5.0 };
        assert!((found.as_f64().unwrap() - drift).abs() < tolerance, "{found} for {drift}");
    }
    let warnings = json["warnings"].to_string();
    assert!(
        warnings.contains("cam02: its clock drifts by -") && warnings.contains("more than 200"),
        "{warnings}"
    );
    assert!(!warnings.contains("cam01"), "{warnings}");
}

#[test]
fn nothing_is_guessed_without_sound() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["left", "right"]);
    let folder = folder.path();
    let error = refused(ingest(folder, ""), 3);
    assert!(error.contains("no sound in left, right") && error.contains("--offsets none"), "{error}");
    let said = ingest(folder, "--offsets none").success().stdout;
    for step in ["videos ", "cameras ", "starts ", "pictures ", "calibration ", "capture ", "page ", "next "]
    {
        assert!(said.lines().any(|line| line.starts_with(step)), "{step}: {said}");
    }
    assert!(said.contains("up is assumed") && said.contains("is assumed to be a metre"), "{said}");
    assert_eq!(manifest(folder).get("metres_per_unit"), None);
    let said = ingest(folder, "--offsets none --origin 4000000,0,0").success().stdout;
    assert_eq!(said.matches("note: studio: the subject is far from the origin").count(), 1, "{said}");
    for (text, problem) in [("left 0", "no line for the video right"), ("left 0\nright 9", "it ends 8.04")] {
        fs::write(folder.join("starts.txt"), text).unwrap();
        let error = refused(ingest(folder, "--offsets starts.txt"), 3);
        assert!(error.contains(problem), "{error}");
    }
    let error = refused(ingest(folder, "--offsets absent.txt"), 3);
    assert!(error.contains("absent.txt: there is no such file"), "{error}");
}

#[test]
fn timecodes_say_when_videos_start() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b"]);
    let rig = folder.path().join("rig");
    for (name, timecode) in [("a", "10:00:00:00"), ("b", "10:00:00:05")] {
        ffmpeg(&rig, &format!("{} {ENCODED} -timecode {timecode} {name}.mp4", pictures(1.0)));
    }
    let starts = || {
        let json = ingest(folder.path(), "--json").json();
        assert_eq!(json["starts"]["source"], "timecode");
        (starts_s(&json)[0], json["fps"].as_f64().unwrap())
    };
    let is_near = |found: (f64, f64), start_s: f64, fps: f64| {
        assert!(
            (found.0 - start_s).abs() < 1e-6 && (found.1 - fps).abs() < 1e-6,
            "{found:?}, not {start_s} {fps}"
        );
    };
    is_near(starts(), -0.2, 25.0);

    // As editors export.
    for name in ["a", "b"] {
        ffmpeg(&rig, &format!("{} {ENCODED} -timecode 00:00:00:00 {name}.mp4", pictures(1.0)));
    }
    let error = refused(ingest(folder.path(), ""), 3);
    assert!(error.contains("no sound in a, b and no timecodes but those that editors write"), "{error}");

    // Matroska rounds times to milliseconds, and a frame is missing.
    let ntsc = 30000.0 / 1001.0;
    ["a.mp4", "b.mp4"].iter().for_each(|name| fs::remove_file(rig.join(name)).unwrap());
    let frames = "-f lavfi -i testsrc=size=64x48:rate=30000/1001:duration=2";
    let missing = "-vf select=not(eq(n\\,20)) -fps_mode passthrough";
    ffmpeg(&rig, &format!("{frames} {missing} {ENCODED} -timecode 10:00:00:00 a.mkv"));
    ffmpeg(&rig, &format!("{frames} {ENCODED} -timecode 10:00:00:13 b.mkv"));
    is_near(starts(), -13.0 / ntsc, ntsc);

    // 60 frames a second; timecodes count every other frame.
    ["a.mkv", "b.mkv"].iter().for_each(|name| fs::remove_file(rig.join(name)).unwrap());
    for (name, timecode) in [("a", "23:59:59:20"), ("b", "00:00:00:05")] {
        ffmpeg(
            &rig,
            &format!(
                "-f lavfi -i testsrc=size=64x48:rate=30:duration=2 {ENCODED} -timecode {timecode} ../track.mov"
            ),
        );
        ffmpeg(&rig, &format!("-f lavfi -i testsrc=size=64x48:rate=60:duration=2 {ENCODED} ../pictures.mov"));
        ffmpeg(&rig, &format!("-i ../pictures.mov -i ../track.mov -map 0:v -map 1:d -c copy {name}.mov"));
    }
    is_near(starts(), -0.5, 60.0);
}

#[test]
fn high_dynamic_range_is_said() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b", "c"]);
    let rig = folder.path().join("rig");
    for (name, transfer) in [("a", "arib-std-b67"), ("c", "smpte2084")] {
        let colors = format!("-color_trc {transfer} -color_primaries bt2020 -colorspace bt2020nc");
        ffmpeg(&rig, &format!("{} {ENCODED} {colors} {name}.mp4", pictures(1.0)));
    }
    let warnings = ingest(folder.path(), "--offsets none --json").json()["warnings"].to_string();
    assert!(warnings.contains("a (HLG), c (PQ): high dynamic range is shown as it is"), "{warnings}");
    let fit = ["fit", "studio", "-o", "f.ply", "--steps", "1", "--size", "32x24", "--gaussians", "100"];
    let said = aarc_studio(folder.path(), &fit).stderr;
    assert!(said.contains("note: studio: a (HLG), c (PQ): high dynamic range"), "{said}");
}

#[test]
fn what_videos_state_of_their_pictures_and_is_not_followed_is_said() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b", "c"]);
    let rig = folder.path().join("rig");
    ffmpeg(&rig, &format!("{} {ENCODED} -flags +ilme+ildct -x264opts tff=1 a.mp4", pictures(1.0)));
    ffmpeg(&rig, &format!("{} {ENCODED} -color_primaries smpte432 b.mp4", pictures(1.0)));
    ffmpeg(&rig, &format!("{} {ENCODED} -color_primaries smpte170m c.mp4", pictures(1.0)));
    let warnings = ingest(folder.path(), "--offsets none --json").json()["warnings"].to_string();
    assert!(warnings.contains("\"a (tt): interlaced pictures are shown as combs"), "{warnings}");
    assert!(
        warnings.contains("\"b (Display P3): these primaries are taken for those of BT.709"),
        "{warnings}"
    );
}

#[test]
fn videos_of_other_containers_are_read_or_named() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a"]);
    let (folder, rig) = (folder.path(), folder.path().join("rig"));
    let names = ["a", "b", "c", "e"];
    for (name, codec) in [("b.AVI", "mjpeg"), ("c.m4v", "mpeg4"), ("e.webm", "libvpx")] {
        ffmpeg(&rig, &format!("{} -c:v {codec} -pix_fmt yuv420p {name}", pictures(1.0)));
    }
    for name in ["f.MTS", "GX01.LRV", "notes.txt"] {
        fs::write(rig.join(name), "").unwrap();
    }
    fs::write(rig.join("calibration.toml"), calibration(&names)).unwrap();
    let json = ingest(folder, "--offsets none --json").json();
    assert_eq!(json["cameras"].as_array().unwrap().len(), 4);
    assert_eq!((json["frames"].as_u64(), json["fps"].as_f64()), (Some(25), Some(25.0)));
    assert!(
        json["warnings"].to_string().contains("\"GX01.LRV, f.MTS: not read, convert"),
        "{}",
        json["warnings"]
    );
    ["a.mp4", "b.AVI", "c.m4v", "e.webm"].iter().for_each(|name| fs::remove_file(rig.join(name)).unwrap());
    let error = refused(ingest(folder, "--offsets none"), 3);
    assert!(
        error.contains("there is no video in it") && error.contains("f.MTS: not read, convert"),
        "{error}"
    );
}

#[test]
fn a_capture_that_is_too_long_is_refused_before_its_mattes() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b"]);
    for (fps, problem) in
        [("200000", "192001 frames: the range is 1 to 100000"), ("0.0001", "fps 0.0001: the range")]
    {
        let error = refused(ingest(folder.path(), &format!("--offsets none --fps {fps}")), 3);
        assert!(error.contains(problem), "{error}");
        for name in ["capture.json", "masks", "plates"] {
            assert!(!folder.path().join("studio").join(name).exists(), "{name}");
        }
    }
}

#[test]
fn the_field_stands_as_the_options_say() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b", "c"]);
    let folder = folder.path();
    let options =
        "--offsets none --up 0,-3,4 --metres-per-unit 0.25 --origin 0,0,-1 --fps 12.5 --extract jpeg";
    ingest(folder, options).success();
    let manifest = manifest(folder);
    assert_eq!(manifest["up"], serde_json::json!([0.0, -0.6, 0.8]));
    assert_eq!((manifest["fps"].as_f64(), manifest["frames"].as_u64()), (Some(12.5), Some(13)));
    assert_eq!(manifest["cameras"][0]["w2c"][2], serde_json::json!([0.0, 0.0, 1.0, 2.0]), "the origin moved");
    assert!(folder.join("studio/images/c/000012.jpg").is_file());
    let info = studio::fit::clip_info(&CaptureFiles::open(&folder.join("studio")).unwrap(), &[], None);
    assert_eq!((info.up, info.metres_per_unit, info.fps), ([0.0, -0.6, 0.8], 0.25, 12.5));
}

#[test]
fn each_video_has_one_camera_of_its_size() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b"]);
    let (folder, rig) = (folder.path(), folder.path().join("rig"));
    let toml = rig.join("calibration.toml");
    let refused = |problem: &str, advice: &str| {
        let error = self::refused(ingest(folder, "--offsets none"), 3);
        assert!(error.contains(problem) && error.contains(advice), "{error}");
    };
    fs::copy(rig.join("b.mp4"), rig.join("B.mov")).unwrap();
    refused("is of the same camera, b", "leave one of the two");
    fs::remove_file(rig.join("B.mov")).unwrap();
    fs::write(&toml, calibration(&["a", "b", "c"])).unwrap();
    let said = ingest(folder, "--offsets none").success().stdout;
    assert!(said.contains("calibration.toml: no video of c; put it there"), "{said}");
    assert_eq!(manifest(folder)["cameras"].as_array().unwrap().len(), 2);
    fs::write(&toml, calibration(&["a"])).unwrap();
    refused("b.mp4: ", "has no camera of that name; rename it to one of a");
    fs::write(&toml, calibration(&["left_a", "right_b"])).unwrap();
    ingest(folder, "--offsets none").success();
    let sized = |size: &str| fs::write(&toml, calibration(&["a", "b"]).replace("64.0, 48.0", size)).unwrap();
    sized("48.0, 64.0");
    refused("64x48 pixels, but its calibration is of 48x64: it is rotated", "turn the video");
    sized("128.0, 96.0");
    refused("it is scaled by 0.500", "--resize scale");
    ingest(folder, "--offsets none --resize scale").success();
    assert_eq!(manifest(folder)["cameras"][0]["K"][0], serde_json::json!([30.0, 0.0, 16.0]));
    sized("66.0, 48.0");
    refused("other proportions", "--resize crop");
    ingest(folder, "--offsets none --resize crop").success();
    assert_eq!(manifest(folder)["cameras"][0]["K"][0], serde_json::json!([60.0, 0.0, 31.0]));
    // Of several calibrations the fitting one counts.
    let other = |text: &str| fs::write(rig.join("other.toml"), text).unwrap();
    other(&calibration(&["a", "b"]));
    let said = ingest(folder, "--offsets none").success().stdout;
    assert!(
        said.contains(
            "note: calibrations found: calibration.toml, other.toml; other.toml alone fits the videos"
        ),
        "{said}"
    );
    sized("64.0, 48.0");
    assert!(ingest(folder, "--offsets none").success().stdout.contains("calibration.toml is read"));
    other(&calibration(&["a", "b", "c"]).replace("60.0", "61.0"));
    let said = ingest(folder, "--offsets none").success().stdout;
    assert!(said.contains("calibration.toml alone fits") && !said.contains("no video of"), "{said}");
    other(&calibration(&["a", "b"]).replace("60.0", "61.0"));
    let error = self::refused(ingest(folder, "--offsets none"), 2);
    assert!(
        error.contains("calibration.toml, other.toml differ") && error.contains("--calibration"),
        "{error}"
    );
    other("[cam_0]\nmatrix = 1\nrotation = 2\n");
    let said = ingest(folder, "--offsets none").success().stdout;
    assert!(said.contains("not read: ") && said.contains("other.toml: "), "{said}");
    sized("66.0, 48.0");
    other(&calibration(&["c", "d"]));
    let error = self::refused(ingest(folder, "--offsets none"), 2);
    assert!(error.contains("none of the calibrations calibration.toml, other.toml fits"), "{error}");
    for name in ["calibration.toml", "other.toml"] {
        fs::remove_file(rig.join(name)).unwrap();
    }
    refused("there is no calibration in it", "--calibration");
}

#[test]
fn damaged_videos_are_named() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["a", "b"]);
    let (folder, rig) = (folder.path(), folder.path().join("rig"));
    let whole = fs::read(rig.join("b.mp4")).unwrap();
    let refused = |problem: &str| {
        let error = self::refused(ingest(folder, "--offsets none"), 3);
        assert!(
            (error.contains("b.mp4: ") || error.contains("b.mkv: ")) && error.contains(problem),
            "{error}"
        );
        assert!(!folder.join("studio/capture.json").exists() && !folder.join("studio/ingest.html").exists());
    };
    fs::write(rig.join("b.mp4"), &whole[..whole.len() / 2]).unwrap();
    refused("no video that ffmpeg can read: ");
    // With its index in front, a part can still be read.
    ffmpeg(&rig, "-i a.mp4 -c copy -movflags +faststart b.mp4");
    let streamed = fs::read(rig.join("b.mp4")).unwrap();
    fs::write(rig.join("b.mp4"), &streamed[..streamed.len() * 2 / 3]).unwrap();
    refused("the file is cut off after frame ");
    fs::write(rig.join("b.mp4"), b"no video").unwrap();
    refused("no video that ffmpeg can read: ");
    // A part that was cut without recoding hides frames at both ends.
    ffmpeg(&rig, &format!("{} {ENCODED} -g 50 -bf 2 ../long.mp4", pictures(4.0)));
    ffmpeg(&rig, "-ss 2.6 -t 1 -i ../long.mp4 -c copy -movflags +faststart b.mp4");
    let part = fs::read(rig.join("b.mp4")).unwrap();
    fs::write(rig.join("b.mp4"), &part[..part.len() * 2 / 3]).unwrap();
    refused("the file is cut off after frame ");
    // Matroska states its length alone.
    fs::remove_file(rig.join("b.mp4")).unwrap();
    ffmpeg(&rig, "-i a.mp4 -c copy b.mkv");
    let streamed = fs::read(rig.join("b.mkv")).unwrap();
    fs::write(rig.join("b.mkv"), &streamed[..streamed.len() / 3]).unwrap();
    refused("s: the file is cut off; ");
    // A part of a longer recording, whose times go on.
    ffmpeg(&rig, "-i a.mp4 -c copy -output_ts_offset 5 b.mkv");
    ingest(folder, "--offsets none").success();
    fs::remove_file(rig.join("b.mkv")).unwrap();
    fs::write(rig.join("b.mp4"), part).unwrap();
    let probe = ingest(folder, "--offsets none --json").json()["cameras"][1]["probe"].clone();
    assert!((25..30).contains(&probe["frames"].as_u64().unwrap()), "{probe}");
    fs::remove_dir_all(folder.join("studio")).unwrap();
    fs::write(rig.join("b.mp4"), whole).unwrap();
    let ingest = ["ingest", "rig", "-o", "studio", "--offsets", "none"];
    let error = aarc_studio_with(folder, &ingest, &[("PATH", "/nowhere")]).error(2);
    assert!(error.contains("videos need ffprobe, version 5.1 or newer; install ffmpeg"), "{error}");
}

#[test]
fn a_real_rig_becomes_a_capture() {
    let Some(rig) = data("pose2sim-4cam").filter(|_| has_ffmpeg()) else { return };
    let folder = tempdir().unwrap();
    let run = |part: &str, options: &str| {
        let rig = rig.join(part).canonicalize().unwrap();
        let options = options.replace("RIG", rig.to_str().unwrap());
        let line = [
            &["ingest", rig.to_str().unwrap(), "-o", part, "--mattes", "off"],
            &*options.split_whitespace().collect::<Vec<_>>(),
        ]
        .concat();
        aarc_studio(folder.path(), &line)
    };
    assert!(refused(run("Multi", ""), 3).contains("no sound in cam01, cam02, cam03, cam04"));
    let multi = run("Multi", "--offsets none --json").json();
    assert_eq!((multi["layout"].as_str(), multi["frames"].as_u64()), (Some("Qualisys"), Some(100)));
    let single = "--offsets none --calibration RIG/Calib.qca.txt";
    let error = refused(run("Single", single), 3);
    assert!(error.contains("cam01.mp4: 1080x1920 pixels, but its calibration is of 1088x1920"), "{error}");
    let single = run("Single", &format!("{single} --resize crop --json")).json();
    // Two of its cameras look at the same side.
    let near = single["epipolar"]["pairs"][0]["all"]["median_px"].as_f64().unwrap();
    assert!(near < 3.0, "{near}");
    assert_eq!(single["placement"]["up"], serde_json::json!([0.0, 0.0, 1.0]));
    assert_eq!(CaptureFiles::open(&folder.path().join("Multi")).unwrap().capture.cameras.len(), 4);

    // Qualisys and TOML are of the same cameras; the TOML's lenses are wrong.
    let toml =
        run("Single", "--offsets none --calibration RIG/Calib_qualisys.toml --resize crop --json").json();
    for camera in 0..4 {
        for axis in 0..3 {
            let [a, b] =
                [&single, &toml].map(|json| json["cameras"][camera]["position"][axis].as_f64().unwrap());
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }
}

#[test]
fn a_camera_that_moved_is_said() {
    if !has_ffmpeg() {
        return;
    }
    let folder = silent(&["stays", "moved"]);
    let (folder, rig) = (folder.path(), folder.path().join("rig"));
    // Blocks of pseudorandom colours.
    let blocks = image::RgbImage::from_fn(360, 240, |x, y| {
        let hash = (x / 9).wrapping_mul(0x9e37_79b9) ^ (y / 7).wrapping_mul(0x85eb_ca6b);
        let hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
        image::Rgb([(hash >> 8) as u8, (hash >> 16) as u8, (hash >> 24) as u8])
    });
    blocks.save(folder.join("blocks.png")).unwrap();
    for (name, x) in [("stays", "8"), ("moved", "8+6*gt(t\\,0.6)")] {
        let line = format!(
            "-loop 1 -framerate 25 -t 1 -i ../blocks.png -vf crop=320:240:{x}:0 {ENCODED} {name}.mp4"
        );
        ffmpeg(&rig, &line);
    }
    let sized = calibration(&["stays", "moved"]).replace("64.0, 48.0", "320.0, 240.0");
    fs::write(rig.join("calibration.toml"), sized).unwrap();
    let json = ingest(folder, "--offsets none --json").json();
    let warnings = json["warnings"].to_string();
    assert!(warnings.contains("moved: its picture moves by 6 px from the start"), "{warnings}");
    assert!(!warnings.contains("stays: its picture moves"), "{warnings}");
    let moved_px = json["epipolar"]["moved_px"].as_array().unwrap();
    // In the order of the files: moved, stays.
    assert_eq!(moved_px[0][0].as_f64(), Some(0.0), "it moved after the middle");
    assert_eq!([&moved_px[1][0], &moved_px[1][1]].map(Value::as_f64), [Some(0.0); 2]);
}
