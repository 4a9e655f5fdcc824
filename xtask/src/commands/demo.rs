//! `cargo xtask demo`: sets the machine up, packages the demo scene and plays it.
//!
//! With a display the player opens its window. Without one it renders images with the same renderer;
//! without a graphics device, the host tool's reference renderer does.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio, exit};

use anyhow::{Context, bail};
use program::images::{frame_name, tiled};
use program::{Fault, output};
use serde::Deserialize;
use xtask::workspace;

use crate::setup::{self, Need, SetupArgs};

/// Columns and rows of the contact sheet.
const SHEET: (u32, u32) = (4, 3);

/// Size of a frame of the contact sheet in pixels.
const FRAME_SIZE: &str = "360x360";

/// Size of each eye's picture in pixels.
const EYE_SIZE: &str = "720x720";

/// Set up, package the demo scene and play it; without a display, render it to images
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    setup: SetupArgs,
}

/// The part of `package --json` that is used.
#[derive(Deserialize)]
struct Report {
    gaussians_out: usize,
    bytes: usize,
    duration_s: f64,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let without_vulkan = "the reference renderer draws images on the CPU";
    let mut needs = vec![(Need::SoundHeaders, "the player cannot be built"), (Need::Vulkan, without_vulkan)];
    if has_display() {
        needs.push((Need::WindowLibraries, "the demo renders pictures instead of opening a window"));
    }
    if !setup::satisfy(&args.setup, &needs) {
        return Ok(());
    }

    let folder = workspace::target_folder().join("demo");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let [field, clip] = ["demo.ply", "demo.aarc"].map(|name| folder.join(name));
    studio(&["synth".as_ref(), "clip".as_ref(), "-o".as_ref(), field.as_ref()])?;
    let report =
        studio(&["package".as_ref(), field.as_ref(), "-o".as_ref(), clip.as_ref(), "--json".as_ref()])?;
    let report: Report = serde_json::from_slice(&report).context("the report of package")?;
    println!("{}: {} Gaussians, {} bytes", clip.display(), report.gaussians_out, report.bytes);

    println!("building the player");
    let player = workspace::build("aarc", "dev")?;
    if has_display() {
        println!("playing in a window; H lists the keys, closing the window ends the demo");
        if succeeds(Command::new(&player).arg(&clip))? {
            return Ok(());
        }
    }
    let pictures = Pictures::new(&folder, report.duration_s);
    let with_player = || {
        let mut command = Command::new(&player);
        command.arg("--headless").arg(&clip);
        command
    };
    if !pictures.draw(with_player)? {
        println!("rendering with the reference renderer, on the CPU");
        let program = workspace::build("aarc-studio", "dev")?;
        let with_reference = || {
            let mut command = Command::new(&program);
            command.arg("render").arg(&clip).stdout(Stdio::null());
            command
        };
        pictures.draw(with_reference)?;
    }
    println!("frames over the clip      {}", pictures.sheet.display());
    println!("left and right eye        {}", pictures.stereo.display());
    println!("counts and timings        {}", pictures.stats.display());
    Ok(())
}

/// Runs a command of the host tool and returns what it prints. Its failure, which it prints itself, ends this
/// program with the same exit code.
fn studio(args: &[&OsStr]) -> anyhow::Result<Vec<u8>> {
    let output = workspace::studio("dev")?.args(args).stderr(Stdio::inherit()).output()?;
    if !output.status.success() {
        exit(output.status.code().unwrap_or(1));
    }
    Ok(output.stdout)
}

fn has_display() -> bool {
    ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some_and(|value| !value.is_empty()))
}

/// Runs a program; `false` where it finds no graphics device or display, which it prints itself.
fn succeeds(command: &mut Command) -> anyhow::Result<bool> {
    let no_device = i32::from(Fault::Device(String::new()).exit_code());
    let status = command.status().with_context(|| format!("cannot run {:?}", command.get_program()))?;
    match status.code() {
        Some(0) => Ok(true),
        Some(code) if code == no_device => Ok(false),
        _ => bail!("{:?} failed: {status}", command.get_program()),
    }
}

/// The pictures of the demo, and their paths.
struct Pictures {
    /// Frames over the clip, in rows.
    sheet: PathBuf,
    /// Left and right eye, side by side.
    stereo: PathBuf,
    /// Counts and timings of the frames.
    stats: PathBuf,
    /// Times of the frames in seconds.
    times: Vec<f64>,
    /// Time of the stereo pair in seconds.
    stereo_time: f64,
}

impl Pictures {
    fn new(folder: &Path, duration_s: f64) -> Pictures {
        let frames = SHEET.0 * SHEET.1;
        Pictures {
            sheet: folder.join("contact-sheet.png"),
            stereo: folder.join("stereo.png"),
            stats: folder.join("stats.json"),
            times: (0..frames).map(|i| f64::from(i) * duration_s / f64::from(frames)).collect(),
            stereo_time: 0.5 * duration_s,
        }
    }

    /// Draws the pictures with `renderer`, which takes the options of `--headless`; `false` where it finds no
    /// graphics device.
    fn draw(&self, renderer: impl Fn() -> Command) -> anyhow::Result<bool> {
        let frames = tempfile::tempdir()?;
        let times: Vec<String> = self.times.iter().map(f64::to_string).collect();
        let mut sheet = renderer();
        sheet.args(["--size", FRAME_SIZE, "--time", &times.join(",")]);
        sheet.arg("--out").arg(frames.path()).arg("--stats").arg(&self.stats);
        let mut stereo = renderer();
        stereo.args(["--size", EYE_SIZE, "--stereo", "--time", &self.stereo_time.to_string()]);
        stereo.arg("--out").arg(&self.stereo);
        if !succeeds(&mut sheet)? || !succeeds(&mut stereo)? {
            return Ok(false);
        }
        let mut pictures = Vec::new();
        for i in 0..self.times.len() {
            let path = frames.path().join(frame_name(i));
            let picture = image::open(&path).with_context(|| format!("cannot read {}", path.display()))?;
            pictures.push(picture.into_rgb8());
        }
        let sheet = tiled(&pictures, SHEET.0);
        output::write_png(&self.sheet, sheet.as_raw(), sheet.dimensions())?;
        Ok(true)
    }
}
