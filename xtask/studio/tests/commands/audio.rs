//! `package --audio`: what sound files become, as one line each. Without ffmpeg these tests are skipped.

use std::fs;

use crate::tool::{aarc_studio, aarc_studio_with, ffmpeg, has_ffmpeg};
use codec::{Limits, Sound};
use serde_json::Value;
use tempfile::tempdir;

/// Packages a small field of 2 s with the options, and returns the report and the sound of the package.
fn packaged(folder: &std::path::Path, options: &[&str]) -> (Value, Option<Sound>) {
    let field = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                 property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n\
                 property float scale_0\nproperty float scale_1\nproperty float scale_2\nproperty float rot_0\n\
                 property float rot_1\nproperty float rot_2\nproperty float rot_3\nend_header\n\
                 0 0 0 1 1 1 2 -2 -2 -2 1 0 0 0\n";
    fs::create_dir_all(folder.join("scene")).unwrap();
    fs::write(folder.join("scene/field.ply"), field).unwrap();
    fs::write(folder.join("scene/scene.json"), r#"{"duration_s": 2}"#).unwrap();
    let mut arguments = vec!["package", "scene", "--joint-rounds", "0", "--json", "-o", "clip.aarc"];
    arguments.extend(options);
    let outcome = aarc_studio(folder, &arguments);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let bytes = fs::read(folder.join("clip.aarc")).unwrap();
    let head = codec::contents(&bytes, &Limits::default()).unwrap();
    (serde_json::from_str(&outcome.stdout).unwrap(), head.sound(&bytes, &Limits::default()).unwrap())
}

#[test]
fn odd_sound_is_repaired_or_refused_in_one_sentence() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempdir().unwrap();
    let at = folder.path();
    ffmpeg(at, "-f lavfi -i sine=f=300:r=8000:d=1 -ac 1 mono.wav");
    ffmpeg(at, "-f lavfi -i sine=f=300:r=44100:d=3 -ac 8 eight.wav");
    ffmpeg(
        at,
        "-f lavfi -i aevalsrc=exprs=if(between(n\\,100\\,199)\\,sqrt(-1)\\,3*sin(n/9)):s=48000:d=2 -c:a pcm_f32le nan.wav",
    );
    ffmpeg(at, "-f lavfi -i testsrc=d=1 -pix_fmt yuv420p silent.mp4");
    fs::write(at.join("text.wav"), "no sound").unwrap();
    for (options, channels, seconds, note) in [
        (&["--audio", "mono.wav"][..], 1, 1.0, "it ends 1 s before the clip"),
        (&["--audio", "eight.wav"], 2, 2.0, "8 channels were mixed to stereo"),
        (&["--audio", "eight.wav"], 2, 2.0, "it goes on behind the end of the clip"),
        (&["--audio", "nan.wav"], 1, 2.0, "100 samples not a finite number: now silence"),
        (&["--audio", "nan.wav"], 1, 2.0, "9.5 dB quieter"),
        (&["--audio", "mono.wav", "--audio-start", "1.5"], 1, 0.5, "it goes on behind the end"),
        (&["--audio", "eight.wav", "--audio-position", "1,-2,0"], 1, 2.0, "mixed to one"),
    ] {
        let (report, sound) = packaged(at, options);
        let audio = &report["audio"];
        let notes = audio["notes"].to_string();
        assert!(notes.contains(note), "{options:?}: {notes}");
        assert_eq!(
            (audio["channels"].as_u64(), audio["duration_s"].as_f64()),
            (Some(channels), Some(seconds))
        );
        let sound = sound.expect("there is sound");
        assert_eq!(f64::from(sound.info().length) / 48_000.0, seconds);
        assert_eq!(sound.info().position.is_some(), options.contains(&"--audio-position"));
    }
    // Segments of a part reach beyond it, and so does their sound.
    aarc_studio(at, &["trim", "clip.aarc", "--from", "0.5", "--to", "1.25", "-o", "part.aarc"]).success();
    let part = aarc_studio(at, &["inspect", "part.aarc", "--json"]).json();
    assert_eq!(part["audio"]["duration_s"], 0.75);
    assert!(packaged(at, &[]).1.is_none() && packaged(at, &["--audio", "none"]).1.is_none());
    for (options, code, sentence) in [
        (&["--audio", "text.wav"][..], 3, "text.wav: it is no sound that ffmpeg reads"),
        (&["--audio", "silent.mp4"], 3, "silent.mp4: there is no sound in it"),
        (&["--audio", "gone.wav"], 3, "gone.wav: there is no such file"),
        (&["--audio", "mono.wav", "--audio-start", "2"], 2, "--audio-start: 2 s is not within the clip"),
        (&["--audio", "mono.wav", "--audio-start", "-3"], 3, "mono.wav: its sound lies outside the clip"),
        // Before the scene is read, which may take a fit.
        (
            &["--audio", "gone.wav", "--capture", "nowhere", "--refine", "9"],
            3,
            "gone.wav: there is no such file",
        ),
        (&["--audio-position", "0,0,0"], 2, "--audio-position: there is no sound to place"),
        (&["--audio", "mono.wav", "--audio-position", "0,0"], 2, "three numbers"),
    ] {
        let mut arguments = vec!["package", "scene", "-o", "other.aarc"];
        arguments.extend(options);
        let outcome = aarc_studio(at, &arguments);
        assert_eq!(outcome.code, Some(code), "{outcome:?}");
        assert!(outcome.stderr.contains(sentence), "{outcome:?}");
        assert!(!at.join("other.aarc").exists());
    }
}

#[test]
fn takes_of_a_list_have_their_own_sound_or_none() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempdir().unwrap();
    let at = folder.path();
    packaged(at, &[]);
    ffmpeg(at, "-f lavfi -i sine=f=300:r=8000:d=1 -ac 1 mono.wav");
    fs::write(at.join("list.txt"), "scene\n").unwrap();
    let listed = |audio: &str| {
        aarc_studio(
            at,
            &["package", "--list", "list.txt", "--joint-rounds", "0", "-o", "out", "--audio", audio],
        )
    };
    let outcome = listed("mono.wav");
    assert_eq!(outcome.code, Some(2), "{outcome:?}");
    assert!(outcome.stderr.contains("--audio: one file cannot be the sound of every take"), "{outcome:?}");
    assert!(!at.join("out").exists());
    listed("none").success();
    assert!(at.join("out/scene.aarc").exists());
}

/// ffmpeg is a script here: it writes a part of the sound, and is killed.
#[cfg(unix)]
#[test]
fn sound_that_was_not_decoded_to_its_end_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempdir().unwrap();
    let at = folder.path();
    packaged(at, &[]);
    fs::create_dir(at.join("bin")).unwrap();
    for (name, script) in [
        ("ffprobe", r#"printf '{"streams": [{"channels": 1}]}'"#),
        ("ffmpeg", r"printf '\0\0\0\0\0\0\0\0'; kill -9 $$"),
    ] {
        let path = at.join("bin").join(name);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }
    fs::write(at.join("a.wav"), "").unwrap();
    let bin = at.join("bin");
    let arguments = ["package", "scene", "--audio", "a.wav", "-o", "other.aarc"];
    let error = aarc_studio_with(at, &arguments, &[("PATH", bin.to_str().unwrap())]).error(3);
    assert!(error.contains("a.wav: ffmpeg did not decode it to its end: signal: 9"), "{error}");
    assert!(!at.join("other.aarc").exists());
}
