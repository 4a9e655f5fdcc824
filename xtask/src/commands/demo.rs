//! `cargo xtask demo`: sets the machine up, packages the demo scene and plays it.
//!
//! Where there is a display, the player opens its window. Elsewhere it renders pictures through the
//! same renderer, and where there is no graphics device either, the reference renderer does.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, bail};
use codec::{Camera, Clip, Limits, Viewpoint};
use image::{RgbImage, imageops};
use program::{Fault, output};
use refine::reference::{self, Order, Radius, coverage};
use serde_json::json;
use studio::package::{self, package};
use studio::scene::Scene;
use studio::synth::juggler;
use xtask::workspace;

use crate::setup::{self, Need};

/// Columns and rows of the contact sheet.
const SHEET: (u32, u32) = (4, 3);

/// Size of a frame of the contact sheet in pixels.
const FRAME_SIZE: (u32, u32) = (360, 360);

/// Size of each eye's picture in pixels.
const EYE_SIZE: (u32, u32) = (720, 720);

/// Distance between the eyes, the mean of adults.
const EYE_DISTANCE_M: f64 = 0.063;

/// Set up, package the demo scene and play it; without a display, render it to pictures.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    let without_vulkan = "the reference renderer draws pictures on the CPU";
    let mut needs = vec![(Need::Vulkan, without_vulkan)];
    if has_display() {
        needs.push((Need::WindowLibraries, "there is no window, but pictures"));
    }
    setup::satisfy(&needs);

    let folder = workspace::target_folder().join("demo");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let path = folder.join("demo.aarc");
    let (field, info) = juggler::clip();
    let package = package(&Scene::made("demo", field, info), &package::Settings::default())?;
    output::write(&path, &package.bytes)?;
    let gaussians = package.report.subject.gaussians_out;
    println!("{}: {gaussians} Gaussians, {} bytes", path.display(), package.bytes.len());
    let clip = codec::decode(&package.bytes, &Limits::default())?;

    println!("building the player");
    let client = workspace::build("client", "dev")?;
    if has_display() {
        println!("playing in a window; H lists the keys, closing the window ends the demo");
        if play(Command::new(&client).arg(&path))? {
            return Ok(());
        }
    }
    let pictures = Pictures::new(&folder, &clip);
    if !pictures.draw(&client, &path)? {
        pictures.draw_with_reference(&clip)?;
    }
    println!("frames over the clip      {}", pictures.sheet.display());
    println!("left and right eye        {}", pictures.stereo.display());
    println!("counts and timings        {}", pictures.stats.display());
    Ok(())
}

fn has_display() -> bool {
    ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some_and(|value| !value.is_empty()))
}

/// Runs the player; whether it could. It says itself what it lacks.
fn play(client: &mut Command) -> anyhow::Result<bool> {
    let no_device = i32::from(Fault::Device(String::new()).exit_code());
    let status = client.status().context("cannot run the player")?;
    match status.code() {
        Some(0) => Ok(true),
        Some(code) if code == no_device => Ok(false),
        _ => bail!("the player failed: {status}"),
    }
}

/// The pictures to make and where they go.
struct Pictures {
    /// Frames over the clip, in rows.
    sheet: PathBuf,
    /// Left and right eye, side by side.
    stereo: PathBuf,
    /// Counts and timings of the frames.
    stats: PathBuf,
    /// Of the frames, in seconds.
    times: Vec<f64>,
    /// Of the stereo pair.
    stereo_time: f64,
}

impl Pictures {
    fn new(folder: &Path, clip: &Clip) -> Pictures {
        let frames = SHEET.0 * SHEET.1;
        let step = f64::from(clip.info.duration_s) / f64::from(frames);
        Pictures {
            sheet: folder.join("contact-sheet.png"),
            stereo: folder.join("stereo.png"),
            stats: folder.join("stats.json"),
            times: (0..frames).map(|i| f64::from(i) * step).collect(),
            stereo_time: 0.5 * f64::from(clip.info.duration_s),
        }
    }

    /// Has the player render; whether it could.
    fn draw(&self, client: &Path, clip: &Path) -> anyhow::Result<bool> {
        let headless = |time: &str, (width, height): (u32, u32), out: &Path| {
            let mut command = Command::new(client);
            command.arg(clip).args(["--headless", "--time", time, "--size", &format!("{width}x{height}")]);
            command.arg("--out").arg(out);
            command
        };
        let frames = tempfile::tempdir()?;
        let times: Vec<String> = self.times.iter().map(f64::to_string).collect();
        let mut sheet = headless(&times.join(","), FRAME_SIZE, frames.path());
        let mut stereo = headless(&self.stereo_time.to_string(), EYE_SIZE, &self.stereo);
        if !play(sheet.arg("--stats").arg(&self.stats))? || !play(stereo.arg("--stereo"))? {
            return Ok(false);
        }
        let mut pictures = Vec::new();
        for i in 0..self.times.len() {
            let path = frames.path().join(format!("frame_{i:04}.png"));
            let picture = image::open(&path).with_context(|| format!("cannot read {}", path.display()))?;
            pictures.push(picture.into_rgb8());
        }
        write_picture(&self.sheet, &tiled(&pictures, SHEET.0))?;
        Ok(true)
    }

    /// The same on the CPU.
    fn draw_with_reference(&self, clip: &Clip) -> anyhow::Result<()> {
        println!("rendering with the reference renderer, on the CPU");
        let duration = f64::from(clip.info.duration_s);
        let viewpoints = &clip.info.viewpoints;
        let viewpoint =
            viewpoints.first().cloned().unwrap_or_else(|| Viewpoint::framing(clip.bounds, clip.info.up));
        let camera = |(width, height)| viewpoint.camera(clip.info.up, width, height);
        let scene = reference::RenderScene::from(clip);
        let draw = |camera: &Camera, time: f64| {
            let image = reference::render(&scene, camera, time / duration, Order::Depth);
            RgbImage::from_raw(image.width, image.height, image.to_rgb8()).expect("three bytes per pixel")
        };
        let mut pictures = Vec::new();
        let mut frames = Vec::new();
        for &time in &self.times {
            let camera = camera(FRAME_SIZE);
            let start = Instant::now();
            pictures.push(draw(&camera, time));
            let draw_ms = start.elapsed().as_secs_f64() * 1e3;
            let counts = coverage(&scene, &camera, time / duration, Radius::Exact);
            frames.push(json!({
                "time": time,
                "alive": counts.alive,
                "drawn": counts.drawn,
                "fragments": counts.fragments,
                "draw_ms": draw_ms,
            }));
        }
        write_picture(&self.sheet, &tiled(&pictures, SHEET.0))?;
        let distance = EYE_DISTANCE_M / f64::from(clip.info.metres_per_unit);
        // What lies ahead of the middle is to the right of the left eye.
        let eyes = [0.5, -0.5].map(|side| {
            let mut camera = camera(EYE_SIZE);
            camera.camera_from_world[0][3] += side * distance;
            draw(&camera, self.stereo_time)
        });
        write_picture(&self.stereo, &tiled(&eyes, 2))?;
        let stats = json!({ "adapter": null, "driver": "reference renderer, on the CPU", "frames": frames });
        output::write(&self.stats, format!("{stats:#}\n").as_bytes())?;
        Ok(())
    }
}

/// Pictures of one size in rows of `columns`.
fn tiled(pictures: &[RgbImage], columns: u32) -> RgbImage {
    let (width, height) = pictures[0].dimensions();
    let rows = (pictures.len() as u32).div_ceil(columns);
    let mut sheet = RgbImage::new(width * columns, height * rows);
    for (i, picture) in pictures.iter().enumerate() {
        let (column, row) = (i as u32 % columns, i as u32 / columns);
        imageops::replace(&mut sheet, picture, (column * width).into(), (row * height).into());
    }
    sheet
}

fn write_picture(path: &Path, picture: &RgbImage) -> Result<(), Fault> {
    output::write_png(path, picture, picture.dimensions())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn pictures_are_laid_out_in_rows() {
        let picture = |value: u8| RgbImage::from_pixel(3, 2, Rgb([value; 3]));
        let sheet = tiled(&[picture(1), picture(2), picture(3)], 2);
        assert_eq!(sheet.dimensions(), (6, 4));
        let at = |x, y| sheet.get_pixel(x, y).0[0];
        assert_eq!([at(0, 0), at(5, 1), at(2, 3), at(3, 2)], [1, 2, 3, 0]);
    }
}
