//! The headset's path on a real runtime: Monado with a simulated headset, Khronos's validation
//! layer in between where nothing else is tested.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::gpu::{self, Passes, device, draw};
use aarc_tests::headset::{Headset, MISSING};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::programs::{Outcome, client, example, run};
use aarc_tests::scene::{decoded, packaged};
use client::gpu::{Depth, Settings, SortOrder};
use codec::{Camera, Clip, Field, Limits};
use libtest_mimic::{Completion, Failed, Trial};
use refine::image::Image;
use serde_json::Value;
use xtask::workspace;

const DEVICE: i32 = 5;

/// The runtime brings its own driver, which may round blending differently.
const TOLERANCE: Tolerance = Tolerance { max_diff: 12.0, diff_pixels: 100, psnr: 45.0 };

fn main() -> ExitCode {
    gpu::run(vec![
        trial("the demo plays, and each eye sees it from its place", demo),
        trial("the eyes differ by the parallax", parallax),
        trial("the validation layer is awake", validation_is_awake),
        trial("a runtime that is killed ends the player with a sentence", killed),
        trial("a service that does not run is named", no_service),
        trial("a runtime that is not there is named", no_runtime),
        Trial::test("without OpenXR", || without_openxr().map_err(Failed::from)),
    ])
}

/// A test that needs the runtime: ignored where there is none.
fn trial(name: &str, test: fn(Headset) -> Result<(), String>) -> Trial {
    Trial::ignorable_test(name, move || match Headset::start() {
        Some(headset) => test(headset).map(|()| Completion::Completed).map_err(Failed::from),
        None => Ok(Completion::ignored_with(MISSING)),
    })
}

/// What a run of the player left behind.
struct Seen {
    stats: Value,
    /// Of the left and the right eye: where it looked from, at which second, and what it saw.
    eyes: [(Camera, f64, Image); 2],
}

/// Plays a clip for a number of frames, validated, and returns what the eyes saw in the last.
fn play(headset: &Headset, clip: Option<&Path>, frames: u32) -> Result<Seen, String> {
    let (folder, stats) = (headset.path("eyes"), headset.path("stats.json"));
    let mut command = headset.validated(client());
    command.args(clip).args(["--xr", "--frames", &format!("0..{frames}"), "--out"]).arg(&folder);
    let outcome = run(command.arg("--stats").arg(&stats).env("RUST_LOG", "client=info"));
    if outcome.code != Some(0) || !outcome.stderr.contains("session Focused") {
        return Err(format!("{outcome:?}"));
    }
    let findings = headset.findings()?;
    if !findings.is_empty() {
        return Err(format!("the validation layer found\n{}", findings.join("\n")));
    }
    let stats = json(&stats)?;
    if stats["frames_shown"] != frames {
        return Err(format!("{} of {frames} frames were shown", stats["frames_shown"]));
    }
    Ok(Seen { stats, eyes: [eye(&folder, "left")?, eye(&folder, "right")?] })
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

fn demo(headset: Headset) -> Result<(), String> {
    let gpu = device(Passes::Shared).map_err(|fault| fault.to_string())?;
    let seen = play(&headset, None, 16)?;
    let [(left, time, left_sees), (right, right_time, right_sees)] = &seen.eyes;
    if *time <= 0.0 || time != right_time {
        return Err(format!("the clip stands at {time} s and {right_time} s"));
    }
    if !seen.stats["runtime"].as_str().is_some_and(|name| name.starts_with("Monado")) {
        return Err(format!("another runtime: {}", seen.stats["runtime"]));
    }
    let bytes = fs::read(workspace::root().join("assets/demo.aarc")).map_err(|error| error.to_string())?;
    let clip: Clip = codec::decode(&bytes, &Limits::default()).map_err(|error| error.to_string())?;
    let t = time / f64::from(clip.info.duration_s);
    let settings = Settings { sort: SortOrder::Radial, ..Settings::default() };
    let cameras = [left.clone(), right.clone()];
    let expected =
        draw(gpu, &clip, &cameras, t, &settings, Depth::Eight).map_err(|fault| fault.to_string())?;
    let same = [
        check("headset-left", left_sees, &expected[0], TOLERANCE),
        check("headset-right", right_sees, &expected[1], TOLERANCE),
    ];
    let failures: Vec<String> = same.iter().filter_map(|result| result.clone().err()).collect();
    if !failures.is_empty() {
        return Err(failures.join("\n"));
    }
    // Two pictures of the same would pass the above with two cameras that are the same.
    let apart = difference(left_sees, right_sees);
    if apart.psnr > 30.0 {
        return Err(format!("the eyes see nearly the same: {apart}"));
    }
    Ok(())
}

/// A red spot at the height of a face, and what it stands on.
fn signpost() -> Field {
    // The constant spherical harmonic is this; colours are 0.5 more than its product.
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

/// Where the spot is seen is compared with where the cameras say that it is, which no renderer
/// takes part in.
fn parallax(headset: Headset) -> Result<(), String> {
    let clip = headset.path("signpost.aarc");
    fs::write(&clip, packaged(&signpost(), None, &[])).map_err(|error| error.to_string())?;
    let seen = play(&headset, Some(&clip), 10)?;
    let field = decoded(&signpost()).still;
    let spot = field.centers.iter().copied().max_by(|a, b| a[1].total_cmp(&b[1])).ok_or("no spot")?;
    let mut places = Vec::new();
    for (camera, _, picture) in &seen.eyes {
        let expected = project(camera, spot.map(f64::from));
        let found = centre_of_red(picture).ok_or("no red spot is seen")?;
        let apart = (found[0] - expected[0]).hypot(found[1] - expected[1]);
        if apart > 0.5 {
            return Err(format!("the spot is seen at {found:?} and not at {expected:?}"));
        }
        places.push((found, expected));
    }
    let [(left, left_expected), (right, right_expected)] = places[..] else { return Err("two eyes".into()) };
    let (disparity, expected) = (left[0] - right[0], left_expected[0] - right_expected[0]);
    // 63 mm between eyes with 175 pixels a radian, at something under 2 m.
    if !(3.0..12.0).contains(&disparity) || (disparity - expected).abs() > 0.2 {
        return Err(format!("disparity {disparity} pixels instead of {expected}"));
    }
    Ok(())
}

/// Where a point falls in a camera's picture, in pixels.
fn project(camera: &Camera, point: [f64; 3]) -> [f64; 2] {
    let m = &camera.camera_from_world;
    let [x, y, z] = [0, 1, 2]
        .map(|row: usize| m[row][3] + (0..3).map(|column| m[row][column] * point[column]).sum::<f64>());
    [camera.k[0][0] * x / z + camera.k[0][2], camera.k[1][1] * y / z + camera.k[1][2]]
}

/// The centre of what is red in a picture, in pixels.
fn centre_of_red(picture: &Image) -> Option<[f64; 2]> {
    let mut sum = [0.0; 3];
    for (i, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (i as u32 % picture.width, i as u32 / picture.width);
        let red = (pixel[0] - pixel[1]).max(0.0);
        sum = [sum[0] + red * (f64::from(x) + 0.5), sum[1] + red * (f64::from(y) + 0.5), sum[2] + red];
    }
    (sum[2] > 1.0).then(|| [sum[0] / sum[2], sum[1] / sum[2]])
}

/// A call that is not allowed is found, so finding nothing means something.
fn validation_is_awake(headset: Headset) -> Result<(), String> {
    let outcome = run(&mut headset.validated(&example("xr_forbidden_call")));
    let findings = headset.findings()?;
    let found = findings.iter().any(|line| line.contains("VUID-XrSystemGetInfo-formFactor-parameter"));
    if outcome.code == Some(0) && found { Ok(()) } else { Err(format!("{findings:?} {outcome:?}")) }
}

/// The last line says what went wrong, and is the only one to do so.
fn one_sentence(outcome: &Outcome, words: &str) -> Result<(), String> {
    let sentences = outcome.stderr.lines().filter(|line| line.starts_with("error: "));
    let last = outcome.stderr.lines().last().unwrap_or_default();
    if outcome.code == Some(DEVICE) && sentences.count() == 1 && last.contains(words) {
        return Ok(());
    }
    Err(format!("{outcome:?}"))
}

/// A running player that ends with the test.
struct Player(Child);

impl Drop for Player {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn killed(mut headset: Headset) -> Result<(), String> {
    let log = headset.path("player.log");
    let said = || String::from_utf8_lossy(&fs::read(&log).unwrap_or_default()).into_owned();
    let mut command = headset.command(client());
    command.arg("--xr").env("RUST_LOG", "client=info").stdin(Stdio::null()).stdout(Stdio::null());
    let stderr = fs::File::create(&log).map_err(|error| error.to_string())?;
    let mut player = Player(command.stderr(stderr).spawn().map_err(|error| error.to_string())?);
    wait_for(|| said().contains("session Focused").then_some(())).ok_or_else(said)?;
    sleep(Duration::from_millis(500));
    if let Some(status) = player.0.try_wait().map_err(|error| error.to_string())? {
        return Err(format!("it ended with {status} while its runtime lived: {}", said()));
    }
    headset.kill();
    let status = wait_for(|| player.0.try_wait().ok().flatten()).ok_or("it goes on without its runtime")?;
    one_sentence(&Outcome { code: status.code(), stdout: String::new(), stderr: said() }, "runtime went away")
}

/// Waits for something to be there, for a minute.
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

fn no_service(mut headset: Headset) -> Result<(), String> {
    headset.kill();
    one_sentence(&run(headset.command(client()).arg("--xr")), "service")
}

fn no_runtime(headset: Headset) -> Result<(), String> {
    let nowhere = headset.path("nothing.json");
    let outcome = run(headset.command(client()).arg("--xr").env("XR_RUNTIME_JSON", nowhere));
    one_sentence(&outcome, "no OpenXR runtime")
}

/// On the machine as it is, whether it has a loader or not.
fn without_openxr() -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let mut command = Command::new(client());
    command.arg("--xr").env("XR_RUNTIME_JSON", folder.path().join("nothing.json"));
    one_sentence(&run(&mut command), "no OpenXR")
}
