//! `aarc-studio render`: images by the CPU reference renderer, which needs no graphics device.
//!
//! Takes the times, sizes and cameras that the player takes with `--headless`, so that the pictures and the
//! counts of both can be compared.

use std::path::PathBuf;
use std::time::Instant;

use codec::{Camera, ClipInfo};
use image::RgbImage;
use program::images::{ImageOutput, tiled};
use program::{Fault, output, read_camera};
use refine::reference::{self, Order, Radius, RenderScene, coverage};
use serde::Serialize;

use crate::input::{Input, clip_time};
use crate::machine::machine;

use super::options::OutOption;

/// Default size of an image in pixels.
const DEFAULT_SIZE: [u32; 2] = [1280, 720];

/// Maximum number of pixels of an image: 2 GiB in the renderer.
const PIXELS_MAX: u64 = 1 << 26;

/// Half the side of the quads that players commonly draw, in standard deviations.
const COMMON_RADIUS: f64 = 2.0 * std::f64::consts::SQRT_2;

/// Render images with the CPU reference (f64), which needs no graphics device.
#[derive(clap::Args)]
pub struct Args {
    /// Package, fitted field file, or folder holding one
    input: PathBuf,
    /// Seconds from the start of the clip; several times make a folder of images
    #[arg(
        long,
        value_name = "S[,S..]",
        value_delimiter = ',',
        default_value = "0",
        allow_negative_numbers = true
    )]
    time: Vec<f64>,
    /// Size of an image [default: the camera's, else 1280x720]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Viewpoint of the clip, by name or number [default: the first]
    #[arg(long, value_name = "NAME|INDEX", conflicts_with = "camera")]
    view: Option<String>,
    /// Camera file: {"width", "height", "K": 3x3, "world_to_camera": 4x4}, OpenCV axes
    #[arg(long, value_name = "FILE.json")]
    camera: Option<PathBuf>,
    /// Render the left and the right eye side by side
    #[arg(long)]
    stereo: bool,
    #[command(flatten)]
    out: OutOption,
    /// Write counts and timings of the frames to this file; fragments in quads of three radii
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
}

/// Counts and timings of the frames, under the keys of the player's `--stats`.
#[derive(Serialize)]
struct Stats {
    /// The machine.
    adapter: String,
    driver: &'static str,
    /// Of the whole input, plates included; null for a field folder of which only a part was read.
    gaussians: Option<usize>,
    frames: Vec<FrameStats>,
}

/// Counts and timings of one frame, of both eyes where there are two.
#[derive(Serialize)]
struct FrameStats {
    /// Seconds from the start of the clip.
    time: f64,
    /// Gaussians whose opacity reaches 1/255 at this instant.
    alive: usize,
    /// Gaussians whose quad contains a pixel centre of an eye's image.
    drawn: usize,
    /// Fragments in quads that reach to alpha 1/255, over all Gaussians and eyes.
    fragments: u64,
    /// Fragments where quads reach at most sqrt 8 standard deviations.
    fragments_capped: u64,
    /// Fragments where all quads reach sqrt 8 standard deviations.
    fragments_fixed: u64,
    /// Milliseconds of rendering.
    draw_ms: f64,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let output = ImageOutput::check(&args.out.path, args.time.len() > 1)?;
    args.stats.as_deref().map_or(Ok(()), output::check)?;
    let input = Input::load_at(&args.input, &args.time)?;
    let info = input.info();
    let times: Vec<f64> =
        args.time.iter().map(|&time| clip_time("--time", time, info)).collect::<Result<_, _>>()?;
    let eyes = eyes(args, &input)?;
    let scene = input.to_reference();
    let mut frames = Vec::new();
    for (i, (&time, &t)) in args.time.iter().zip(&times).enumerate() {
        let start = Instant::now();
        let images: Vec<RgbImage> = eyes.iter().map(|camera| render(&scene, camera, t)).collect();
        let draw_ms = start.elapsed().as_secs_f64() * 1e3;
        let image = tiled(&images, images.len() as u32);
        let path = output.write(i, &image)?;
        println!("{}: {}x{}, {time} s", path.display(), image.width(), image.height());
        if args.stats.is_some() {
            frames.push(FrameStats { time, draw_ms, ..counts(&scene, &eyes, t) });
        }
    }
    if let Some(path) = &args.stats {
        let stats = Stats {
            adapter: machine(),
            driver: "reference renderer, on the CPU",
            gaussians: input.gaussians(),
            frames,
        };
        output::write(path, format!("{}\n", serde_json::to_string_pretty(&stats)?).as_bytes())?;
    }
    Ok(())
}

/// The cameras to render: one, or the left and the right eye.
///
/// # Errors
/// [`Fault`] where the camera file is damaged, the viewpoint does not exist, or the image is too large.
fn eyes(args: &Args, input: &Input) -> Result<Vec<Camera>, Fault> {
    let ClipInfo { up, metres_per_unit, .. } = *input.info();
    let camera = match (&args.camera, args.size) {
        (Some(path), None) => read_camera(path)?,
        (Some(path), Some([width, height])) => read_camera(path)?.resized(width, height),
        (None, size) => {
            let [width, height] = size.unwrap_or(DEFAULT_SIZE);
            input.viewpoint(args.view.as_deref())?.camera(up, width, height)
        }
    };
    let (width, height) = (camera.width, camera.height);
    if u64::from(width) * u64::from(height) > PIXELS_MAX {
        return Err(Fault::Usage(format!("--size {width}x{height}: choose at most {PIXELS_MAX} pixels")));
    }
    if !args.stereo {
        return Ok(vec![camera]);
    }
    Ok(camera.stereo_pair(Camera::EYE_DISTANCE_M / f64::from(metres_per_unit)).to_vec())
}

fn render(scene: &RenderScene<'_>, camera: &Camera, t: f64) -> RgbImage {
    let image = reference::render(scene, camera, t, Order::Depth);
    RgbImage::from_raw(image.width, image.height, image.to_rgb8()).expect("three bytes per pixel")
}

/// Counts what a player shades at clip time `t`; leaves the timings at zero.
fn counts(scene: &RenderScene<'_>, eyes: &[Camera], t: f64) -> FrameStats {
    let [exact, capped, fixed] = [Radius::Exact, Radius::AtMost(COMMON_RADIUS), Radius::Fixed(COMMON_RADIUS)]
        .map(|radius| coverage(scene, eyes, t, radius));
    FrameStats {
        time: 0.0,
        alive: exact.alive,
        drawn: exact.drawn,
        fragments: exact.fragments,
        fragments_capped: capped.fragments,
        fragments_fixed: fixed.fragments,
        draw_ms: 0.0,
    }
}

/// Parses the size of an image, WxH.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let size = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    size.filter(|[width, height]| *width > 0 && *height > 0)
        .ok_or("not a size WxH of at least 1x1 pixels".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_positive_numbers() {
        assert_eq!(size("64x32"), Ok([64, 32]));
        for text in ["", "64", "0x5", "5x0", "-1x5", "64x32x1", "4294967296x1", "axb"] {
            assert!(size(text).is_err(), "{text}");
        }
    }
}
