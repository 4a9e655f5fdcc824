//! Captures whose photographs are in videos. Without ffmpeg these tests are skipped.

use std::fs;
use std::path::Path;

use crate::small_stage::stage_of;
use crate::tool::{aarc_studio, aarc_studio_with, ffmpeg, has_ffmpeg};
use refine::capture::PhotoId;
use serde_json::{Value, json};
use studio::capture::CaptureFiles;
use tempfile::TempDir;

/// Frames of the stage, which has 25 a second.
const FRAMES: usize = 12;

/// A change of a manifest.
type Change<'a> = &'a dyn Fn(&mut Value);

/// A stage with its photographs in `images` and, without loss, in videos `NN.mp4` of the folder `rig`, whose manifest names
/// these and is changed by `change`.
fn rig(encode: &str, change: impl Fn(&mut Value)) -> TempDir {
    let folder = stage_of(&FRAMES.to_string());
    let path = folder.path();
    fs::create_dir(path.join("rig")).unwrap();
    let manifest = fs::read(path.join("stage/capture.json")).unwrap();
    let mut manifest: Value = serde_json::from_slice(&manifest).unwrap();
    for camera in 0..8 {
        let pictures = format!("-framerate 25 -i stage/images/{camera:02}/%06d.png");
        ffmpeg(path, &format!("{pictures} -c:v libx264rgb -qp 0 -g 5 -bf 2 {encode} rig/{camera:02}.mp4"));
        manifest["cameras"][camera]["video"] = format!("{camera:02}.mp4").into();
    }
    manifest["fps"] = 25.into();
    manifest["masks"] = "../stage/masks/{camera}/{frame:06}.png".into();
    for key in ["frames", "images"] {
        manifest.as_object_mut().unwrap().remove(key);
    }
    change(&mut manifest);
    fs::write(path.join("rig/capture.json"), manifest.to_string()).unwrap();
    folder
}

fn open(folder: &Path, name: &str) -> CaptureFiles {
    CaptureFiles::open(&folder.join(name)).unwrap()
}

#[test]
fn frames_of_videos_are_the_photographs_in_any_order() {
    if !has_ffmpeg() {
        return;
    }
    let folder = rig("", |_| ());
    let (stage, rig) = (open(folder.path(), "stage"), open(folder.path(), "rig"));
    assert_eq!(rig.capture.photos, stage.capture.photos);
    assert_eq!((rig.capture.frames(), rig.fps()), (FRAMES, 25.0));
    assert!(rig.capture.deviations_s.is_empty(), "all are on time");
    assert_eq!(rig.name(PhotoId { frame: 3, camera: 1 }), "01/000003");
    for frame in [0, 1, 2, 7, 8, 3, 11, 0, 10, 5, 11] {
        for camera in [0, 5] {
            let photo_id = PhotoId { frame, camera };
            let (of_video, of_file) = (rig.photo(photo_id).unwrap(), stage.photo(photo_id).unwrap());
            assert!(of_video == of_file, "camera {camera}, frame {frame}");
        }
    }
    let mut part = rig.clone();
    part.keep_frames(4..9).unwrap();
    part.keep_cameras(&["05".into(), "06".into()]).unwrap();
    let photo = part.photo(PhotoId { frame: 2, camera: 0 }).unwrap();
    assert!(photo == stage.photo(PhotoId { frame: 6, camera: 5 }).unwrap(), "of the selection");
    assert_eq!(part.name(PhotoId { frame: 2, camera: 0 }), "05/000006");
}

#[test]
fn a_fit_to_videos_is_that_to_their_pictures() {
    if !has_ffmpeg() {
        return;
    }
    let folder = rig("", |_| ());
    let folder = folder.path();
    let mut manifest: Value =
        serde_json::from_slice(&fs::read(folder.join("stage/capture.json")).unwrap()).unwrap();
    manifest["fps"] = 25.into();
    fs::write(folder.join("stage/capture.json"), manifest.to_string()).unwrap();
    let fit = ["--steps", "40", "--gaussians", "300", "--sh-degree", "0", "--holdout", "odd"];
    for (capture, out) in
        [("stage", "stage.ply"), ("rig", "rig.ply"), ("stage", "stage-slid"), ("rig", "rig-slid")]
    {
        let split: &[&str] = if out.ends_with("slid") { &["--split", "0.2"] } else { &[] };
        aarc_studio(folder, &[&["fit", capture, "-o", out], split, &fit].concat()).success();
    }
    let read = |path: &str| fs::read(folder.join(path)).unwrap();
    assert!(read("stage.ply") == read("rig.ply"));
    assert!(read("stage-slid/segment-00-000000.ply") == read("rig-slid/segment-00-000000.ply"));
    let psnr = |field: &str, capture: &str| {
        let json = aarc_studio(folder, &["eval", field, "--capture", capture, "--json"]).json();
        json["splits"]["interp_b"]["psnr_fg"].as_f64().unwrap()
    };
    assert_eq!(psnr("rig.ply", "rig"), psnr("rig.ply", "stage"));
}

#[test]
fn photographs_have_the_times_of_their_frames() {
    if !has_ffmpeg() {
        return;
    }
    // From the seventh frame on 4 ms late; the second camera starts two frames before the capture, the third 3 ms after
    // it; the fourth has half as many frames a second.
    let late = "-vf settb=1/1000,setpts=40*N+4*gte(N\\,6) -fps_mode passthrough -enc_time_base 1/1000 -video_track_timescale 1000";
    let folder = rig(late, |manifest| {
        manifest["frames"] = 9.into();
        manifest["cameras"][1]["start_s"] = json!(-0.08);
        manifest["cameras"][2]["start_s"] = json!(0.003);
        manifest["cameras"][2]["time_offset_s"] = json!(0.01);
        manifest["cameras"][3]["video"] = "slow.mp4".into();
    });
    let path = folder.path();
    ffmpeg(
        path,
        "-framerate 12.5 -i stage/images/03/%06d.png -frames:v 5 -c:v libx264rgb -qp 0 rig/slow.mp4",
    );
    let (stage, rig) = (open(path, "stage"), open(path, "rig"));
    let time_s = |camera: usize, frame: usize| rig.capture.time_s(PhotoId { frame, camera });
    for (camera, frame, expected_s) in [
        (0, 5, 0.2),
        (0, 6, 0.244),
        (0, 8, 0.324),
        (1, 0, 0.0),
        (1, 4, 0.164),
        (2, 1, 0.053),
        (2, 7, 0.297),
        (3, 4, 0.16),
    ] {
        assert!(
            (time_s(camera, frame) - expected_s).abs() < 2e-6,
            "{camera} {frame}: {}",
            time_s(camera, frame)
        );
    }
    let is_same = |camera: usize, frame: usize, stage_frame: usize| {
        let photo = rig.photo(PhotoId { frame, camera }).unwrap().image.pixels;
        let taken = stage.photo(PhotoId { frame: stage_frame, camera }).unwrap().image.pixels;
        // The masks are the frame's.
        let lit = |i: &usize| photo[*i][3] > 0.999 && taken[*i][3] > 0.999;
        (0..photo.len()).filter(lit).all(|i| photo[i][..3] == taken[i][..3])
    };
    assert!(is_same(0, 8, 8) && is_same(1, 4, 6) && !is_same(1, 4, 4));
    let frames: Vec<usize> = rig
        .capture
        .photos
        .iter()
        .filter(|photo_id| photo_id.camera == 3)
        .map(|photo_id| photo_id.frame)
        .collect();
    assert_eq!(frames, [0, 2, 4, 6, 8], "a camera with fewer frames has fewer photographs");
}

/// Later versions of ffmpeg crop as the file says, which ffprobe does not.
#[cfg(unix)]
#[test]
fn pictures_of_another_size_are_refused() {
    use std::os::unix::fs::PermissionsExt as _;

    if !has_ffmpeg() {
        return;
    }
    let folder = rig("", |_| ());
    let folder = folder.path();
    let path = std::env::var("PATH").unwrap();
    let cropping = format!(
        "#!/bin/sh\nfor a; do shift; case $a in scale=*) a=crop=32:48:0:0,$a;; esac; set -- \"$@\" \"$a\"; done\n\
         PATH='{path}' exec ffmpeg \"$@\"\n"
    );
    fs::create_dir(folder.join("bin")).unwrap();
    fs::write(folder.join("bin/ffmpeg"), cropping).unwrap();
    fs::set_permissions(folder.join("bin/ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let fit = ["fit", "rig", "-o", "field.ply", "--steps", "5", "--gaussians", "100"];
    let with = format!("{}:{path}", folder.join("bin").display());
    let error = aarc_studio_with(folder, &fit, &[("PATH", &with)]).error(3);
    assert!(
        error.contains("48x48 pixels by ffprobe, and ffmpeg decodes pictures of another size"),
        "{error}"
    );
}

#[test]
fn what_is_wrong_with_a_video_is_said() {
    if !has_ffmpeg() {
        return;
    }
    let folder = rig("-movflags +faststart", |_| ());
    let folder = folder.path();
    let manifest: Value =
        serde_json::from_slice(&fs::read(folder.join("rig/capture.json")).unwrap()).unwrap();
    let whole = fs::read(folder.join("rig/00.mp4")).unwrap();
    ffmpeg(folder, "-f lavfi -i anullsrc -t 1 rig/sound.m4a");
    fs::write(folder.join("rig/cut.mp4"), &whole[..300]).unwrap();
    fs::write(folder.join("rig/short.mp4"), &whole[..whole.len() * 2 / 3]).unwrap();
    let fit = ["fit", "rig", "-o", "field.ply", "--steps", "5", "--gaussians", "100"];
    let refused = |change: Change| {
        let mut manifest = manifest.clone();
        change(&mut manifest);
        fs::write(folder.join("rig/capture.json"), manifest.to_string()).unwrap();
        aarc_studio(folder, &fit).error(3)
    };
    let of_video =
        |name: &'static str| refused(&move |manifest| manifest["cameras"][0]["video"] = name.into());
    for (name, expected) in [
        ("none.mp4", "none.mp4: "),
        ("capture.json", "capture.json: no video that ffmpeg can read: "),
        ("cut.mp4", "cut.mp4: no video that ffmpeg can read: "),
        ("sound.m4a", "sound.m4a: it has no video; name a video file"),
        ("short.mp4", "short.mp4: ffmpeg cannot decode frame "),
    ] {
        let error = of_video(name);
        assert!(error.contains(expected) && error.lines().count() == 1, "{name}: {error}");
    }
    let cases: [(Change, &str); 6] = [
        (
            &|manifest| manifest["cameras"][0]["w"] = 64.into(),
            "00.mp4: 48x48 pixels, but its camera has 64x48",
        ),
        (&|manifest| manifest["fps"] = Value::Null, "camera 00 has a video, so the capture needs its fps"),
        (
            &|manifest| manifest["cameras"][2]["video"] = Value::Null,
            "camera 02 has no video, so the capture needs its images",
        ),
        (
            &|manifest| {
                manifest["images"] = "{camera}/{frame}.png".into();
                manifest["cameras"][2]["video"] = Value::Null;
            },
            "camera 02 has no video, so the capture needs its frames",
        ),
        (
            &|manifest| {
                manifest["images"] = "{camera}/{frame}.png".into();
                manifest["cameras"][2]["video"] = Value::Null;
                manifest["cameras"][2]["start_s"] = json!(0.5);
            },
            "camera 02 has a start_s, which is of videos; name its video",
        ),
        (
            &|manifest| manifest["cameras"][2]["start_s"] = json!(-9.0),
            "a video ends 8.560 s before the capture begins",
        ),
    ];
    for (change, expected) in cases {
        let error = refused(change);
        assert!(error.contains(expected), "{expected}: {error}");
    }
    fs::write(folder.join("rig/capture.json"), manifest.to_string()).unwrap();
    let without = aarc_studio_with(folder, &fit, &[("PATH", "/nowhere")]).error(2);
    assert!(without.contains("videos need ffprobe, version 5.1 or newer; install ffmpeg"), "{without}");
    assert!(!folder.join("field.ply").exists());
}
