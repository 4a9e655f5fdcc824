//! The headset path on a real OpenXR runtime: Monado with a simulated headset, mostly with Khronos's
//! validation layer between.

use std::ffi::OsStr;
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::mpsc::channel;
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::gpu::{self, Passes, device, draw};
use aarc_tests::headset::{Headset, MISSING};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::lossy::lossy;
use aarc_tests::outcome::{DATA, DEVICE, NETWORK, Outcome};
use aarc_tests::programs::{client, example, run};
use aarc_tests::remote::Remote;
use aarc_tests::scene::{Motion, Recipe, decoded, lasting, packaged};
use aarc_tests::server::Server;
use aarc_tests::take_files::{SegmentFile, take_package};
use client::gpu::{
    ChannelDepth, FrameLayout, Gpu, GpuClip, Level, Offscreen, RenderSettings, Renderer, SortOrder,
};
use client::view::View;
use codec::{Camera, Clip, Field, Limits};
use glam::{DVec3, UVec2, Vec2};
use libtest_mimic::{Completion, Failed, Trial};
use program::Fault;
use refine::image::Image;
use serde_json::Value;
use xtask::workspace;

/// The runtime's own Vulkan driver may round blending differently.
const TOLERANCE: Tolerance = Tolerance { max_diff: 12.0, diff_pixels: 100, psnr: 45.0 };

fn main() -> ExitCode {
    let trials = vec![
        trial("the demo plays, each eye from its own position", demo),
        trial("the eyes differ by the parallax", parallax),
        gpu::trial(
            "every quality level costs less and stays close to the exact image",
            Passes::Shared,
            levels,
        ),
        trial("a take plays, and each eye sees the segment of the instant", take),
        trial("no more frames are missed while segments change", changing_segments).with_ignored_flag(true),
        trial("a lower quality draws a smaller image correctly", lower_quality),
        hand_trial("the panel reports a damaged clip and starts the next one", damaged_then_next, false),
        hand_trial("without a clip the panel still exits", no_clip, false),
        hand_trial("a clip by URL plays from its first layer on", by_url, false),
        hand_trial("the panel reports a URL without a clip", no_such_url, false),
        hand_trial("a playlist plays in order, and the panel can skip ahead", playlist, false),
        hand_trial("the next clip loads while frames continue", loading, false),
        hand_trial("the next clip loads while 2000 frames continue", loading_long, true),
        trial("cargo xtask headset prints a table of this machine's runtime", headset_table),
        trial("the validation layer reports a forbidden call", forbidden_call_is_reported),
        hand_trial("a lost device is replaced, and the clip goes on", lost_device, false),
        trial("a device that is lost at once ends the player with one sentence", device_lost_at_once),
        trial("a runtime without two eyes ends the player with one sentence", other_eyes),
        trial("a runtime without times, or with one projection layer, shows the clip", odd_runtimes),
        trial("too little graphics memory ends the player with one sentence", little_memory),
        trial("a skipped clip is a line on the terminal", skipped),
        trial("a killed runtime ends the player with one sentence", killed),
        trial("a runtime that announces its end ends the player with one sentence", runtime_lost),
        hand_trial(
            "a moved stage, a lost head and a lost session leave the clip in its place",
            misfortunes,
            false,
        ),
        hand_trial("the room stays while the head is lost", room_without_head, false),
        trial("a runtime that drops every session ends the player with one sentence", sessions_dropped),
        trial("a missing service is named", no_service),
        trial("a missing runtime is named", no_runtime),
        Trial::test("without OpenXR", || without_openxr().map_err(Failed::from)),
    ];
    gpu::run([("xr", trials)])
}

/// Runs of a test whose runtime crashes before it fails for that.
const ATTEMPTS: u32 = 3;

/// A test that needs the runtime: ignored without one.
fn trial(name: &str, test: fn(&Headset) -> Result<(), String>) -> Trial {
    let attempt = move || Some(attempted(Headset::start()?, test));
    Trial::ignorable_test(name, move || attempts(attempt))
}

/// A test that moves a hand. `on_demand` marks it as ignored by default.
fn hand_trial(name: &str, test: fn(&Headset, Remote) -> Result<(), String>, on_demand: bool) -> Trial {
    let attempt = move || {
        let (headset, remote) = Headset::start_with_hand()?;
        Some(attempted(headset, |headset| test(headset, remote)))
    };
    Trial::ignorable_test(name, move || attempts(attempt)).with_ignored_flag(on_demand)
}

/// Result of one run of a test.
struct Attempt {
    result: Result<(), String>,
    /// End of the runtime's log if it crashed.
    crash: Option<String>,
}

fn attempted(headset: Headset, test: impl FnOnce(&Headset) -> Result<(), String>) -> Attempt {
    let result = test(&headset);
    let crash = if result.is_err() { headset.crash() } else { None };
    Attempt { result, crash }
}

/// Runs a test until its runtime survives it: Monado's service rarely crashes by itself, as its client starts.
/// A player that made it crash would do so every time.
fn attempts(attempt: impl Fn() -> Option<Attempt>) -> Result<Completion, Failed> {
    let mut left = ATTEMPTS;
    loop {
        left -= 1;
        let Some(Attempt { result, crash }) = attempt() else {
            return Ok(Completion::ignored_with(MISSING));
        };
        let Err(error) = result else { return Ok(Completion::Completed) };
        let Some(log) = crash else { return Err(error.into()) };
        let error = format!("{error}\nthe runtime crashed; the end of its log:\n{log}");
        if left == 0 {
            return Err(error.into());
        }
        eprintln!("once more: {error}");
    }
}

/// Output of a run of the player.
struct Played {
    stats: Value,
    /// Camera, clip time in seconds and image of the left and the right eye.
    eyes: [(Camera, f64, Image); 2],
}

/// Plays a clip under validation until it has moved, and returns the last frame. It stands still before the session
/// has the focus, which on a busy machine comes after many frames.
fn play(headset: &Headset, clip: Option<&Path>, quality: Level) -> Result<Played, String> {
    for frames in [16, 64, 256, 1024] {
        let played = play_frames(headset, clip, frames, quality)?;
        if played.eyes.iter().all(|(_, time, _)| *time > 0.0) {
            return Ok(played);
        }
    }
    Err("the clip stands still".into())
}

/// Plays some frames of a clip under validation and returns the last one.
fn play_frames(
    headset: &Headset,
    clip: Option<&Path>,
    frames: u32,
    quality: Level,
) -> Result<Played, String> {
    let (folder, stats) = (headset.path("eyes"), headset.path("stats.json"));
    let mut command = headset.validated(client());
    command.args(clip).args(["--xr", "--frames", &format!("0..{frames}"), "--out"]).arg(&folder);
    command.args(["--quality", &quality.name().to_lowercase()]);
    let outcome = run(command.arg("--stats").arg(&stats).env("RUST_LOG", "client=info"));
    if outcome.code != Some(0) {
        return Err(format!("{outcome:?}"));
    }
    nothing_found(headset)?;
    let stats = json(&stats)?;
    if stats["frames_shown"] != frames {
        return Err(format!("{} of {frames} frames were shown", stats["frames_shown"]));
    }
    Ok(Played { stats, eyes: [eye(&folder, "left")?, eye(&folder, "right")?] })
}

fn nothing_found(headset: &Headset) -> Result<(), String> {
    let findings = headset.findings()?;
    if findings.is_empty() {
        return Ok(());
    }
    Err(format!("the validation layer found\n{}", findings.join("\n")))
}

fn json(path: &Path) -> Result<Value, String> {
    let text = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    serde_json::from_slice(&text).map_err(|error| format!("{}: {error}", path.display()))
}

fn eye(folder: &Path, name: &str) -> Result<(Camera, f64, Image), String> {
    let about = json(&folder.join(format!("{name}.json")))?;
    let time = about["time"].as_f64().ok_or("no time")?;
    let camera: Camera = serde_json::from_value(about).map_err(|error| error.to_string())?;
    let picture =
        image::open(folder.join(format!("{name}.png"))).map_err(|error| error.to_string())?.to_rgb8();
    let (width, height) = picture.dimensions();
    let pixel = |pixel: &image::Rgb<u8>| {
        let [r, g, b] = pixel.0.map(|channel| f64::from(channel) / 255.0);
        [r, g, b, 1.0]
    };
    Ok((camera, time, Image { width, height, pixels: picture.pixels().map(pixel).collect() }))
}

fn demo(headset: &Headset) -> Result<(), String> {
    demo_at(headset, Level::Exact)
}

fn lower_quality(headset: &Headset) -> Result<(), String> {
    demo_at(headset, Level::Least)
}

/// Plays the demo. The eyes must show what the renderer alone draws for the same cameras.
fn demo_at(headset: &Headset, quality: Level) -> Result<(), String> {
    let gpu = device(Passes::Shared).map_err(|fault| fault.to_string())?;
    let played = play(headset, None, quality)?;
    let [(left, time, left_image), (right, right_time, right_image)] = &played.eyes;
    let drawn = quality.size(UVec2::new(number(&played.stats["width"])?, number(&played.stats["height"])?));
    if UVec2::new(left.width, left.height) != drawn || played.stats["quality"]["level"] != quality.name() {
        return Err(format!("{}x{} were drawn and not {drawn}", left.width, left.height));
    }
    if time != right_time {
        return Err(format!("the clip stands at {time} s and at {right_time} s"));
    }
    if !played.stats["runtime"].as_str().is_some_and(|name| name.starts_with("Monado")) {
        return Err(format!("another runtime: {}", played.stats["runtime"]));
    }
    let clip = demo_clip()?;
    let t = time / f64::from(clip.info.duration_s);
    let settings = RenderSettings { sort: SortOrder::Radial, ..RenderSettings::default() };
    let settings = quality.settings(settings, &layer_ends(&clip));
    let cameras = [left.clone(), right.clone()];
    let expected =
        draw(gpu, &clip, &cameras, t, &settings, ChannelDepth::Eight).map_err(|fault| fault.to_string())?;
    let same = [
        check("headset-left", left_image, &expected[0], TOLERANCE),
        check("headset-right", right_image, &expected[1], TOLERANCE),
    ];
    let failures: Vec<String> = same.iter().filter_map(|result| result.clone().err()).collect();
    if !failures.is_empty() {
        return Err(failures.join("\n"));
    }
    // Two equal cameras with equal images would pass the comparison above.
    let apart = difference(left_image, right_image);
    if apart.psnr > 30.0 {
        return Err(format!("the images of both eyes are nearly equal: {apart}"));
    }
    Ok(())
}

/// Seconds of a segment of [`take`].
const SEGMENT_S: f64 = 0.5;

/// Plays a take of three clips in a loop. The eyes must show what the renderer alone draws of the clip at the instant.
fn take(headset: &Headset) -> Result<(), String> {
    let gpu = device(Passes::Shared).map_err(|fault| fault.to_string())?;
    let field = |seed| {
        let motion = Motion::Dynamic;
        Recipe { count: 300, sh_degree: 1, motion, motion_order: 2, turning: true, seed }.field()
    };
    let fields = [1, 2, 3].map(field);
    let segment = |(field, i): (&Field, u32)| SegmentFile {
        start_s: SEGMENT_S * f64::from(i),
        duration_s: SEGMENT_S,
        package: lasting(field, SEGMENT_S as f32, 30.0),
    };
    let segments: Vec<SegmentFile> = fields.iter().zip(0..).map(segment).collect();
    let path = headset.path("take.aarc");
    let (bytes, _) = take_package(3.0 * SEGMENT_S, 30.0, &segments);
    fs::write(&path, bytes).map_err(|error| error.to_string())?;
    // On a busy machine the segment of the instant may not be decoded in time; the segment before is then shown.
    const TRIES: usize = 3;
    let mut result = Ok(());
    for _ in 0..TRIES {
        result = shows_the_segment(gpu, &play(headset, Some(&path), Level::Exact)?, &segments);
        if result.is_ok() {
            break;
        }
    }
    result
}

/// Whether the eyes show what the renderer alone draws of the segment of their instant.
fn shows_the_segment(gpu: &Gpu, played: &Played, segments: &[SegmentFile]) -> Result<(), String> {
    let counts = &played.stats["take"];
    if counts["segments"] != 3 || counts["uploaded_bytes_max"].as_u64().is_none_or(|bytes| bytes > 256_000) {
        return Err(format!("{counts}"));
    }
    let [(left, time, left_image), (right, _, right_image)] = &played.eyes;
    let segment = &segments[((time / SEGMENT_S) as usize).min(2)];
    let clip = codec::decode(&segment.package, &Limits::default()).map_err(|error| error.to_string())?;
    let settings = RenderSettings { sort: SortOrder::Radial, ..RenderSettings::default() };
    let t = (time - segment.start_s) / SEGMENT_S;
    let cameras = [left.clone(), right.clone()];
    let expected =
        draw(gpu, &clip, &cameras, t, &settings, ChannelDepth::Eight).map_err(|fault| fault.to_string())?;
    check("headset-take-left", left_image, &expected[0], TOLERANCE)?;
    check("headset-take-right", right_image, &expected[1], TOLERANCE).map(drop)
}

/// The share of frames that are missed in a take whose segments change four times a second, over the share in a take of
/// one segment, with as many Gaussians drawn. Run it with `--ignored` on an idle machine.
fn changing_segments(headset: &Headset) -> Result<(), String> {
    const CHANGES: u32 = 120;
    let recipe = Recipe {
        count: 2000,
        sh_degree: 1,
        motion: Motion::Dynamic,
        motion_order: 2,
        turning: true,
        seed: 1,
    };
    let field = recipe.field();
    let duration_s = 0.25 * f64::from(CHANGES);
    let write = |name: &str, count: u32| {
        let segment_s = duration_s / f64::from(count);
        let package = lasting(&field, segment_s as f32, 30.0);
        let segment = |i: u32| SegmentFile {
            start_s: segment_s * f64::from(i),
            duration_s: segment_s,
            package: package.clone(),
        };
        let (bytes, _) = take_package(duration_s, 30.0, &(0..count).map(segment).collect::<Vec<_>>());
        let path = headset.path(name);
        fs::write(&path, bytes).map(|()| path).map_err(|error| error.to_string())
    };
    let takes = [write("one.aarc", 1)?, write("many.aarc", CHANGES)?];
    let stats = headset.path("stats.json");
    let missed = |take: &Path| {
        let mut command = headset.command(client());
        command.arg(take).args(["--xr", "--seconds", "15", "--quality", "least", "--stats"]).arg(&stats);
        // A tenth of the width and height: a software driver is then fast enough for the display's rate.
        let outcome = run(command.env("XRT_COMPOSITOR_SCALE_PERCENTAGE", "10"));
        let stats = json(&stats).map_err(|error| format!("{error} {outcome:?}"))?;
        let (shown, missed) = (number(&stats["frames_shown"])?, number(&stats["frames_missed"])?);
        let loaded = number(&stats["take"]["loaded"])?;
        println!("{shown} frames shown, {missed} missed, {loaded} segments loaded");
        Ok::<_, String>((missed as f64 / (shown + missed) as f64, loaded))
    };
    let mut ratios = Vec::new();
    for _ in 0..5 {
        let [(one, _), (many, loaded)] = [missed(&takes[0])?, missed(&takes[1])?];
        if loaded < 30 {
            return Err(format!("{loaded} segments were loaded"));
        }
        ratios.push(many / one);
    }
    ratios.sort_by(f64::total_cmp);
    println!("missed frames over those of one segment: {ratios:.2?}");
    Ok(())
}

/// Measures the demo with `cargo xtask headset`. A script starts the player, which needs the runtime's libraries.
fn headset_table(headset: &Headset) -> Result<(), String> {
    let player = headset.command(client());
    let quoted = |text: &OsStr| format!("'{}'", text.to_string_lossy());
    let mut script = String::from("#!/bin/sh\n");
    for (name, value) in player.get_envs() {
        let name = name.to_string_lossy();
        script += &match value {
            Some(value) => format!("export {name}={}\n", quoted(value)),
            None => format!("unset {name}\n"),
        };
    }
    let words: Vec<String> =
        [player.get_program()].into_iter().chain(player.get_args()).map(quoted).collect();
    script += &format!("exec {} \"$@\"\n", words.join(" "));
    let (path, out) = (headset.path("player"), headset.path("out"));
    let io = |error: io::Error| error.to_string();
    fs::write(&path, script).map_err(io)?;
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).map_err(io)?;

    let mut xtask = Command::new(workspace::build("xtask", "dev").map_err(|fault| fault.to_string())?);
    xtask.args(["headset", "--seconds", "0.5", "--player"]).arg(&path).arg("-o").arg(&out);
    let outcome = run(xtask.arg(workspace::root().join("assets/demo.aarc")));
    let lines: Vec<&str> = outcome.stdout.lines().collect();
    let is_row =
        |(line, distance): (&&str, &str)| line.starts_with(&format!("| demo | 42978 | {distance} | "));
    let distances = ["near", "standing", "inside"];
    if outcome.code != Some(0) || lines.len() != 7 || !lines[4..].iter().zip(distances).all(is_row) {
        return Err(format!("{outcome:?}"));
    }
    println!("{}", outcome.stdout);
    for (number, distance) in distances.iter().enumerate() {
        let stats = json(&out.join(format!("1-demo-{distance}.json")))?;
        let seconds = stats["measured"]["seconds"].as_f64().unwrap_or_default();
        if seconds < 0.5 || !lines[0].contains("Monado") {
            return Err(format!("row {number} measured {seconds} s: {outcome:?}"));
        }
    }
    Ok(())
}

fn number(value: &Value) -> Result<u32, String> {
    value.as_u64().and_then(|number| number.try_into().ok()).ok_or_else(|| format!("{value} is no number"))
}

fn demo_clip() -> Result<Clip, String> {
    let bytes = fs::read(workspace::root().join("assets/demo.aarc")).map_err(|error| error.to_string())?;
    codec::decode(&bytes, &Limits::default()).map_err(|error| error.to_string())
}

/// Number of Gaussians in the first layer, the first two, and so on.
fn layer_ends(clip: &Clip) -> Vec<usize> {
    clip.layers.iter().map(|end| end.total()).collect()
}

/// Draws the demo for both eyes of a headset at a quarter of its resolution, from two metres. Counts
/// fragments at the size of the level, compares images at full size, and prints both.
fn levels(gpu: &'static Gpu) -> Result<(), String> {
    let fault = |fault: Fault| fault.to_string();
    let (clip, t) = (demo_clip()?, 0.4);
    let (full, ends) = (UVec2::new(420, 440), layer_ends(&clip));
    let cameras = |size: UVec2| {
        let camera = Camera::look_at([0.0, 1.6, 2.0], [0.0, 1.2, 0.0], [0.0, 1.0, 0.0], 1.6, size.x, size.y);
        camera.stereo_pair(Camera::EYE_DISTANCE_M)
    };
    let uploaded = GpuClip::upload(gpu, &clip).map_err(fault)?;
    let layout = FrameLayout { format: ChannelDepth::Eight.format(), eyes: 2, foveated: true };
    let mut renderer = Renderer::new(gpu, uploaded, layout).map_err(fault)?;
    let mut before: Option<u64> = None;
    let mut exact = None;
    for level in Level::ALL {
        let settings =
            level.settings(RenderSettings { sort: SortOrder::Radial, ..RenderSettings::default() }, &ends);
        let size = level.size(full);
        let views = cameras(size).map(|camera| View::from_camera(&camera));
        let target = Offscreen::new(gpu, size, 2, ChannelDepth::Eight)
            .and_then(|target| target.foveated(gpu, Level::INSET_MAX))
            .map_err(fault)?;
        let counts = target.render(gpu, &mut renderer, t, &views, &settings).map_err(fault)?;
        let fragments = renderer.count(gpu).map_err(fault)?.fragments;

        let image =
            draw(gpu, &clip, &cameras(full), t, &settings, ChannelDepth::Sixteen).map_err(fault)?.remove(0);
        let light = |image: &Image| image.pixels.iter().map(|p| p[0] + p[1] + p[2]).sum::<f64>();
        let exact = exact.get_or_insert_with(|| image.clone());
        let (psnr, share) = (difference(&image, exact).psnr, light(&image) / light(exact));
        println!(
            "{:5} {}x{} {fragments} fragments, {} sorted, {psnr:.1} dB, {:.2} % of the light",
            level.name(),
            size.x,
            size.y,
            counts.sorted,
            100.0 * share
        );
        if before.is_some_and(|before| fragments as f64 > 0.9 * before as f64) {
            return Err(format!("{} costs {fragments} fragments, the level above {before:?}", level.name()));
        }
        // Beside the inset resolution falls first.
        let middle = difference(&middle(&image), &middle(exact)).psnr;
        if middle < 30.0 || psnr < 26.0 || !(0.95..1.01).contains(&share) {
            let name = level.name();
            return Err(format!("{name}: {middle:.1} dB in the middle, {psnr:.1}, {share:.3} of the light"));
        }
        before = Some(fragments);
    }
    Ok(())
}

/// The middle third of the sides of an image, which every inset covers.
fn middle(image: &Image) -> Image {
    let (width, height) = (image.width / 3, image.height / 3);
    let pixels = (height..2 * height).flat_map(|y| (width..2 * width).map(move |x| image.pixel(x, y)));
    Image { width, height, pixels: pixels.collect() }
}

/// A red spot at the height of a face, and two green ones on the floor.
fn signpost() -> Field {
    // The constant spherical harmonic: colour = 0.5 + Y0 * coefficient.
    const Y0: f32 = 0.282_094_8;
    let color = |rgb: [f32; 3]| rgb.map(|channel| (channel - 0.5) / Y0);
    Field {
        centers: vec![[0.0, 1.4, 0.0], [-0.2, 0.0, -0.1], [0.2, 0.0, 0.1]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
        log_scales: vec![[(0.04f32).ln(); 3]; 3],
        opacities: vec![0.9; 3],
        sh: vec![color([1.0, 0.0, 0.0]), color([0.0, 1.0, 0.0]), color([0.0, 1.0, 0.0])],
        ..Field::default()
    }
}

/// Compares the spot's place in the images with its projection by the cameras, without any renderer.
fn parallax(headset: &Headset) -> Result<(), String> {
    let clip = headset.path("signpost.aarc");
    fs::write(&clip, packaged(&signpost(), None, &[])).map_err(|error| error.to_string())?;
    let played = play(headset, Some(&clip), Level::Exact)?;
    let field = decoded(&signpost()).static_field;
    let spot = field.centers.iter().copied().max_by(|a, b| a[1].total_cmp(&b[1])).ok_or("no spot")?;
    let mut places = Vec::new();
    for (camera, _, picture) in &played.eyes {
        let expected = project(camera, spot.map(f64::from));
        let found = centre_of_red(picture).ok_or("there is no red spot")?;
        let apart = (found[0] - expected[0]).hypot(found[1] - expected[1]);
        if apart > 0.5 {
            return Err(format!("the spot is at {found:?} and not at {expected:?}"));
        }
        places.push((found, expected));
    }
    let [(left, left_expected), (right, right_expected)] = places[..] else { return Err("two eyes".into()) };
    let (disparity, expected) = (left[0] - right[0], left_expected[0] - right_expected[0]);
    // Eyes 63 mm apart, 175 pixels per radian, a distance just below 2 m.
    if !(3.0..12.0).contains(&disparity) || (disparity - expected).abs() > 0.2 {
        return Err(format!("disparity {disparity} pixels instead of {expected}"));
    }
    Ok(())
}

/// Projection of a point into a camera's image, in pixels.
fn project(camera: &Camera, point: [f64; 3]) -> [f64; 2] {
    let m = &camera.camera_from_world;
    let [x, y, z] = [0, 1, 2]
        .map(|row: usize| m[row][3] + (0..3).map(|column| m[row][column] * point[column]).sum::<f64>());
    [camera.k[0][0] * x / z + camera.k[0][2], camera.k[1][1] * y / z + camera.k[1][2]]
}

/// Centroid of an image's red, in pixels.
fn centre_of_red(picture: &Image) -> Option<[f64; 2]> {
    let mut sum = [0.0; 3];
    for (i, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (i as u32 % picture.width, i as u32 / picture.width);
        let red = (pixel[0] - pixel[1]).max(0.0);
        sum = [sum[0] + red * (f64::from(x) + 0.5), sum[1] + red * (f64::from(y) + 0.5), sum[2] + red];
    }
    (sum[2] > 1.0).then(|| [sum[0] / sum[2], sum[1] / sum[2]])
}

/// The layer finds a forbidden call, so an empty list of findings is evidence.
fn forbidden_call_is_reported(headset: &Headset) -> Result<(), String> {
    let outcome = run(&mut headset.validated(&example("xr_forbidden_call")));
    let findings = headset.findings()?;
    let found = findings.iter().any(|line| line.contains("VUID-XrSystemGetInfo-formFactor-parameter"));
    if outcome.code == Some(0) && found { Ok(()) } else { Err(format!("{findings:?} {outcome:?}")) }
}

/// Checks for exactly one error, on the last line, that contains `words`.
fn one_sentence(outcome: &Outcome, code: i32, words: &str) -> Result<(), String> {
    let sentences = outcome.stderr.lines().filter(|line| line.starts_with("error: "));
    let last = outcome.stderr.lines().last().unwrap_or_default();
    if outcome.code == Some(code) && sentences.count() == 1 && last.contains(words) {
        return Ok(());
    }
    Err(format!("{outcome:?}"))
}

/// A running player that ends with the test.
struct Player {
    process: Child,
    log: PathBuf,
}

impl Player {
    /// Starts it with `arguments`.
    fn start(headset: &Headset, mut command: Command, arguments: &[&Path]) -> Result<Player, String> {
        let log = headset.path("player.log");
        let stderr = fs::File::create(&log).map_err(|error| error.to_string())?;
        command.arg("--xr").args(arguments).env("RUST_LOG", "client=info");
        let command = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(stderr);
        Ok(Player { process: command.spawn().map_err(|error| error.to_string())?, log })
    }

    /// Its stderr so far.
    fn log(&self) -> String {
        String::from_utf8_lossy(&fs::read(&self.log).unwrap_or_default()).into_owned()
    }

    fn wait_for_log(&self, words: &str) -> Result<(), String> {
        wait_for(|| self.log().contains(words).then_some(())).ok_or_else(|| self.log())
    }

    /// Its outcome, if it has ended.
    fn ended(&mut self) -> Option<Outcome> {
        let status = self.process.try_wait().ok().flatten()?;
        Some(Outcome { code: status.code(), stdout: String::new(), stderr: self.log() })
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn killed(headset: &Headset) -> Result<(), String> {
    let command = headset.command(client());
    let mut player = Player::start(headset, command, &[])?;
    player.wait_for_log("session Focused")?;
    sleep(Duration::from_millis(500));
    if let Some(outcome) = player.ended() {
        return Err(format!("it ended although its runtime runs: {outcome:?}"));
    }
    headset.kill();
    let outcome = wait_for(|| player.ended()).ok_or("it runs without its runtime")?;
    one_sentence(&outcome, DEVICE, "runtime went away")
}

fn runtime_lost(headset: &Headset) -> Result<(), String> {
    let mut command = headset.odd(client(), "runtime-lost:5");
    one_sentence(&run(command.args(["--xr", "--frames", "0..30"])), DEVICE, "runtime went away")
}

fn sessions_dropped(headset: &Headset) -> Result<(), String> {
    let mut command = headset.odd(client(), "session-lost:5");
    one_sentence(&run(command.args(["--xr", "--frames", "0..60"])), DEVICE, "drops its session")
}

/// The head of the remote driver rests, so that only the moved stage changes what the eyes see.
fn misfortunes(headset: &Headset, _: Remote) -> Result<(), String> {
    // Where the left eye is in the clip after `frames` frames of it, and the statistics.
    let seen = |oddities: &str, frames: u64| {
        let mut command = headset.odd(client(), oddities);
        let (folder, stats) = (headset.path("eyes"), headset.path("stats.json"));
        command.args(["--xr", "--quality", "least", "--frames", &format!("0..{frames}"), "--out"]);
        command.arg(&folder).arg("--stats").arg(&stats).env("XRT_COMPOSITOR_SCALE_PERCENTAGE", "10");
        let outcome = run(&mut command);
        let stats = json(&stats).map_err(|error| format!("{oddities}: {error} {outcome:?}"))?;
        match outcome.code {
            Some(0) => Ok((DVec3::from(eye(&folder, "left")?.0.position()), stats)),
            _ => Err(format!("{oddities}: {outcome:?} {stats}")),
        }
    };
    let (before, _) = seen("", 3)?;
    // The first frames have no clip yet, and on a busy machine many of them.
    for from in [50, 200, 800] {
        // The stage moves while the head is lost, and the session is lost after the head is back.
        let (moves, lost) = (from + 10, from + 40);
        let oddities = format!("head-lost:{from} stage-moves:{moves} session-lost:{lost}");
        let (after, stats) = seen(&oddities, from + 50)?;
        let [empty, unseen] = ["frames_empty", "frames_unseen"].map(|key| number(&stats[key]));
        let (empty, unseen) = (u64::from(empty?), u64::from(unseen?));
        if unseen < 20 {
            return Err(format!("the head was never lost: {stats}"));
        }
        if empty + unseen - 20 >= from {
            continue;
        }
        let moved_m = before.distance(after);
        if (moved_m - 1.0).abs() > 1e-3 || stats["sessions_lost"] != 1 {
            return Err(format!("the eye moves by {moved_m} m in the clip, and the stage by 1: {stats}"));
        }
        return Ok(());
    }
    Err("the clip came too late".into())
}

/// A button of the panel shows the room; without the head, frames have no layers.
fn room_without_head(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    let mut command = headset.odd(client(), "room");
    command.env("XRT_COMPOSITOR_SCALE_PERCENTAGE", "10");
    let player = Player::start(headset, command, &["--quality", "least"].map(Path::new))?;
    player.wait_for_log("session Focused")?;
    let mode = press(&mut remote, ROOM, || {
        let log = player.log();
        log.lines().find_map(|line| line.strip_prefix("no layers over ").map(String::from))
    });
    match mode.as_deref() {
        Some("ALPHA_BLEND") => Ok(()),
        _ => Err(format!("{mode:?}: {}", player.log())),
    }
}

/// Submissions of the player and of the runtime to the player's device before it is lost, in which more than 50
/// frames are shown: fewer would not be worth another device.
const SUBMISSIONS: u32 = 500;

/// Only the player's device is lost: the service has one of its own.
fn lost_device(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    for when in ["submit", "wait"] {
        let stats = headset.path("stats.json");
        let mut command = headset.command(client());
        lossy(&mut command, &headset.path(""), &format!("{when}:{SUBMISSIONS}:1"));
        let arguments = ["--quality", "least", "--stats"].map(Path::new);
        let mut player = Player::start(headset, command, &[&arguments[..], &[&stats]].concat())?;
        // A line on the terminal, which no log filter hides.
        player.wait_for_log("\nthe graphics device stopped working: the clip goes on with another one")?;
        // The viewer did nothing, and sees the clip again.
        player.wait_for_log(": now ")?;
        let outcome = exit(&mut player, &mut remote)?;
        let stats = json(&stats).map_err(|error| format!("{when}: {error} {outcome:?}"))?;
        let (frames, lost) = (number(&stats["frames_shown"])?, number(&stats["sessions_lost"])?);
        if outcome.code != Some(0) || frames < 50 || lost != 1 {
            return Err(format!("{when}: {outcome:?} {stats}"));
        }
    }
    Ok(())
}

fn device_lost_at_once(headset: &Headset) -> Result<(), String> {
    for when in ["submit:20", "wait:20"] {
        let mut command = headset.command(client());
        lossy(&mut command, &headset.path(""), when);
        one_sentence(&run(command.arg("--xr")), DEVICE, "stopped working")
            .map_err(|error| format!("{when}: {error}"))?;
    }
    Ok(())
}

/// Runtimes with one view or four report as many for two eyes, or refuse two.
fn other_eyes(headset: &Headset) -> Result<(), String> {
    for (oddity, words) in [
        ("views:1", "the headset has 1 view, "),
        ("views:4", "the headset has 4 views, "),
        ("one-eye", "each of two eyes"),
    ] {
        let outcome = run(headset.odd(client(), oddity).arg("--xr"));
        one_sentence(&outcome, DEVICE, words).map_err(|error| format!("{oddity}: {error}"))?;
    }
    Ok(())
}

/// The clip goes on, and with a period the display's rate is known. `Good` has an inset, which the player composes.
fn odd_runtimes(headset: &Headset) -> Result<(), String> {
    let stats = headset.path("stats.json");
    for oddity in ["no-time", "no-period", "one-layer"] {
        let mut command = headset.odd(client(), oddity);
        command.args(["--xr", "--quality", "good", "--seconds", "0.2", "--stats"]).arg(&stats);
        let outcome = run(&mut command);
        let stats = json(&stats).map_err(|error| format!("{oddity}: {error} {outcome:?}"))?;
        let knows_rate = stats["display_hz"].as_f64().is_some_and(|hz| hz > 0.0);
        let seconds = stats["measured"]["seconds"].as_f64().unwrap_or_default();
        if outcome.code != Some(0) || seconds < 0.2 || knows_rate == (oddity == "no-period") {
            return Err(format!("{oddity}: {outcome:?} {stats}"));
        }
    }
    Ok(())
}

/// All allocations on the player's device fail from one on, the runtime's allocations too. Opening the session then
/// fails before or after its first drawing.
fn little_memory(headset: &Headset) -> Result<(), String> {
    for call in [1, 2, 4, 6, 8, 10] {
        let mut command = headset.command(client());
        lossy(&mut command, &headset.path(""), &format!("memory:{call}"));
        let outcome = run(command.args(["--xr", "--frames", "0..9", "--out"]).arg(headset.path("eyes")));
        one_sentence(&outcome, DEVICE, "").map_err(|error| format!("memory:{call}: {error}"))?;
    }
    Ok(())
}

fn skipped(headset: &Headset) -> Result<(), String> {
    let clips = [("a.aarc", &b"no clip"[..]), ("b.aarc", &packaged(&signpost(), None, &[]))];
    let clips = write_clips(headset, &clips)?;
    let list = clips.join("list.json");
    fs::write(&list, r#"{"version": 1, "clips": ["a.aarc", "b.aarc"]}"#)
        .map_err(|error| error.to_string())?;
    let outcome = run(headset.command(client()).arg(&list).args(["--xr", "--frames", "0..3"]));
    match outcome.code == Some(0) && outcome.stderr.lines().any(|line| line.ends_with("skipped")) {
        true => Ok(()),
        false => Err(format!("{outcome:?}")),
    }
}

/// Buttons of the panel, in its points.
const NEXT_CLIP: Vec2 = Vec2::new(744.0, 564.0);
const ROOM: Vec2 = Vec2::new(564.0, 656.0);
const EXIT: Vec2 = Vec2::new(752.0, 656.0);

/// Presses a button of the panel repeatedly until `look` returns something.
fn press<T>(remote: &mut Remote, button: Vec2, mut look: impl FnMut() -> Option<T>) -> Option<T> {
    // A few frames of the simulated display, even on a busy machine.
    const FRAMES: Duration = Duration::from_millis(300);
    remote.point(button);
    wait_for(|| {
        sleep(FRAMES);
        remote.trigger(true);
        sleep(FRAMES);
        remote.trigger(false);
        look()
    })
}

/// Exits by the panel.
fn exit(player: &mut Player, remote: &mut Remote) -> Result<Outcome, String> {
    press(remote, EXIT, || player.ended()).ok_or_else(|| format!("no way out: {}", player.log()))
}

/// Writes a folder of clips, which play in turn.
fn write_clips(headset: &Headset, clips: &[(&str, &[u8])]) -> Result<PathBuf, String> {
    let folder = headset.path("clips");
    fs::create_dir(&folder).map_err(|error| error.to_string())?;
    for (name, bytes) in clips {
        fs::write(folder.join(name), bytes).map_err(|error| error.to_string())?;
    }
    Ok(folder)
}

fn damaged_then_next(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    let good = packaged(&signpost(), None, &[]);
    let damaged = &good[..good.len() / 2];
    let clips = write_clips(headset, &[("a.aarc", damaged), ("b.aarc", &good)])?;
    let stats = headset.path("stats.json");
    let arguments = [&clips.join("a.aarc"), Path::new("--stats"), &stats];
    let mut player = Player::start(headset, headset.validated(client()), &arguments)?;
    player.wait_for_log("a.aarc: ")?;
    let plays = press(&mut remote, NEXT_CLIP, || player.log().contains("playing b.aarc").then_some(()));
    plays.ok_or_else(|| format!("no next clip: {}", player.log()))?;
    let outcome = exit(&mut player, &mut remote)?;
    nothing_found(headset)?;
    let stats = json(&stats)?;
    if outcome.code != Some(0) || number(&stats["frames_empty"])? == 0 || number(&stats["frames_shown"])? == 0
    {
        return Err(format!("{outcome:?} {stats}"));
    }
    Ok(())
}

fn no_clip(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    let missing = headset.path("missing.aarc");
    let mut player = Player::start(headset, headset.command(client()), &[&missing])?;
    player.wait_for_log("missing.aarc: ")?;
    let outcome = exit(&mut player, &mut remote)?;
    one_sentence(&outcome, DATA, "missing.aarc")?;
    // The menu button exits without the panel.
    let mut player = Player::start(headset, headset.command(client()), &[&missing])?;
    player.wait_for_log("session Focused")?;
    sleep(Duration::from_secs(1));
    remote.menu(true);
    let outcome = wait_for(|| player.ended()).ok_or_else(|| format!("no way out: {}", player.log()))?;
    one_sentence(&outcome, DATA, "missing.aarc")
}

fn by_url(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    let file = packaged(&signpost(), None, &[1]);
    let first =
        codec::contents(&file, &Limits::default()).map_err(|error| error.to_string())?.layer_bytes()[0];
    let (permit, permits) = channel::<()>();
    let gate = Mutex::new(permits);
    let server = Server::start(move |_, request, answer| {
        let part = answer.file_head(request, &file, "\"one\"");
        let middle = first.max(part.start);
        answer.bytes(&file, part.start..middle);
        // Until the first layer plays, or the test has ended.
        if gate.lock().is_ok_and(|gate| gate.recv().is_ok()) {
            answer.bytes(&file, middle..part.end);
        }
    });
    let url = server.url("clip.aarc");
    let mut player = Player::start(headset, headset.validated(client()), &[Path::new(&url)])?;
    player.wait_for_log("playing clip.aarc")?;
    if server.sent().iter().any(|sent| sent.end > first) {
        return Err("the rest was sent before".into());
    }
    // Where starting takes longer than a network may be silent, the rest was asked for again.
    for _ in 0..=server.requests().len() {
        permit.send(()).map_err(|error| error.to_string())?;
    }
    player.wait_for_log("clip.aarc: now 2 layers")?;
    let outcome = exit(&mut player, &mut remote)?;
    nothing_found(headset)?;
    if outcome.code == Some(0) { Ok(()) } else { Err(format!("{outcome:?}")) }
}

fn playlist(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    let (short, long) = (lasting(&signpost(), 0.25, 8.0), lasting(&signpost(), 600.0, 8.0));
    let clips = [("a.aarc", &*short), ("b.aarc", b"no clip"), ("c.aarc", &short), ("d.aarc", &long)];
    let clips = write_clips(headset, &clips)?;
    let list = clips.join("list.json");
    let write = |names: &str| {
        fs::write(&list, format!(r#"{{"version": 1, "clips": [{names}]}}"#))
            .map_err(|error| error.to_string())
    };
    write(r#""a.aarc", "b.aarc", "c.aarc""#)?;
    let mut player = Player::start(headset, headset.validated(client()), &[&list])?;
    let order = |log: &str| -> Vec<String> {
        log.lines().filter_map(|line| line.split("playing ").nth(1)).map(String::from).collect()
    };
    wait_for(|| (order(&player.log()).len() >= 4).then_some(())).ok_or_else(|| player.log())?;
    let log = player.log();
    if order(&log)[..4] != ["a.aarc", "c.aarc", "a.aarc", "c.aarc"] || !log.contains("b.aarc: ") {
        return Err(log);
    }
    let outcome = exit(&mut player, &mut remote)?;
    nothing_found(headset)?;
    if outcome.code != Some(0) {
        return Err(format!("{outcome:?}"));
    }
    // The panel skips the rest of a long clip.
    write(r#""d.aarc", "c.aarc", "d.aarc""#)?;
    let mut player = Player::start(headset, headset.command(client()), &[&list])?;
    player.wait_for_log("playing d.aarc")?;
    let next = press(&mut remote, NEXT_CLIP, || player.log().contains("playing c.aarc").then_some(()));
    next.ok_or_else(|| format!("no next clip: {}", player.log()))?;
    let outcome = exit(&mut player, &mut remote)?;
    if outcome.code == Some(0) { Ok(()) } else { Err(format!("{outcome:?}")) }
}

fn no_such_url(headset: &Headset, mut remote: Remote) -> Result<(), String> {
    let server = Server::start(|_, _, answer| answer.head(404, &[("Content-Length", "0")]));
    let url = server.url("clip.aarc");
    let mut player = Player::start(headset, headset.command(client()), &[Path::new(&url)])?;
    player.wait_for_log("no such file (404 Not Found)")?;
    let outcome = exit(&mut player, &mut remote)?;
    one_sentence(&outcome, NETWORK, "no such file")
}

fn loading(headset: &Headset, remote: Remote) -> Result<(), String> {
    load_while_playing(headset, remote, 60)
}

/// The required number of frames: run it with `--ignored` on an idle machine.
fn loading_long(headset: &Headset, remote: Remote) -> Result<(), String> {
    load_while_playing(headset, remote, 2000)
}

/// Skips from clip to clip and prints the missed frames. At the lowest quality, because a software
/// driver shows only five frames a second even of that.
fn load_while_playing(headset: &Headset, mut remote: Remote, frames: u32) -> Result<(), String> {
    let demo = fs::read(workspace::root().join("assets/demo.aarc")).map_err(|error| error.to_string())?;
    let clips = write_clips(headset, &[("a.aarc", &demo), ("b.aarc", &demo)])?;
    let (stats, range) = (headset.path("stats.json"), format!("0..{frames}"));
    let (first, options) =
        (clips.join("a.aarc"), ["--quality", "least", "--frames", &range, "--stats"].map(Path::new));
    let arguments = [&[&*first], &options[..], &[&stats]].concat();
    let mut player = Player::start(headset, headset.command(client()), &arguments)?;
    player.wait_for_log("playing a.aarc")?;
    let start = Instant::now();
    let outcome = loop {
        if let Some(outcome) = press(&mut remote, NEXT_CLIP, || player.ended()) {
            break outcome;
        }
        if start.elapsed() > Duration::from_secs(600) {
            return Err(format!("it does not end: {}", player.log()));
        }
    };
    let stats = json(&stats).map_err(|error| format!("{error} {outcome:?}"))?;
    let (missed, loading) = (number(&stats["frames_missed"])?, &stats["while_loading"]);
    let during = number(&loading["frames"])?;
    println!(
        "{frames} frames were shown and {missed} missed; while clips were loaded {during} and {}",
        number(&loading["missed"])?
    );
    if outcome.code != Some(0) || during == 0 || !outcome.stderr.contains("playing b.aarc") {
        return Err(format!("{outcome:?} {stats}"));
    }
    Ok(())
}

/// Polls for up to a minute.
fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(60) {
        if let Some(found) = look() {
            return Some(found);
        }
        sleep(Duration::from_millis(20));
    }
    None
}

fn no_service(headset: &Headset) -> Result<(), String> {
    headset.kill();
    one_sentence(&run(headset.command(client()).arg("--xr")), DEVICE, "service")
}

fn no_runtime(headset: &Headset) -> Result<(), String> {
    let nowhere = headset.path("nothing.json");
    let outcome = run(headset.command(client()).arg("--xr").env("XR_RUNTIME_JSON", nowhere));
    one_sentence(&outcome, DEVICE, "no OpenXR runtime")
}

/// On this machine as it is, with or without an OpenXR loader.
fn without_openxr() -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let mut command = Command::new(client());
    command.arg("--xr").env("XR_RUNTIME_JSON", folder.path().join("nothing.json"));
    one_sentence(&run(&mut command), DEVICE, "no OpenXR")
}
