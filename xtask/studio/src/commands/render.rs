//! `cargo xtask render`: one image by the CPU reference renderer, which needs no graphics device.

use std::path::{Path, PathBuf};

use crate::input::{Input, clip_time};
use codec::Camera;
use program::{Fault, output};
use refine::reference::{self, Order};

/// Size of the image where nothing says another.
const DEFAULT_SIZE: [u32; 2] = [1280, 720];

/// Most pixels of an image: 2 GiB in the renderer.
const PIXELS_MAX: u64 = 1 << 26;

/// Render an image with the CPU reference (f64), which needs no graphics device.
#[derive(clap::Args)]
pub struct Args {
    /// Package, fitted field file, or folder holding one
    input: PathBuf,
    /// Seconds from the start of the clip
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    time: f64,
    /// Size of the image [default: the camera's, else 1280x720]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Viewpoint of the clip, by name or number [default: the first]
    #[arg(long, value_name = "NAME|INDEX", conflicts_with = "camera")]
    view: Option<String>,
    /// Camera file: {"width", "height", "K": 3x3, "world_to_camera": 4x4}, OpenCV axes
    #[arg(long, value_name = "FILE.json")]
    camera: Option<PathBuf>,
    /// PNG file to write
    #[arg(short, long, value_name = "PATH")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    output::check(&args.out)?;
    let input = Input::load(&args.input)?;
    let info = input.info();
    let t = clip_time("--time", args.time, info)?;
    let camera = match (&args.camera, args.size) {
        (Some(path), None) => read_camera(path)?,
        (Some(path), Some([width, height])) => read_camera(path)?.resized(width, height),
        (None, size) => {
            let [width, height] = size.unwrap_or(DEFAULT_SIZE);
            input.viewpoint(args.view.as_deref())?.camera(info.up, width, height)
        }
    };
    let (width, height) = (camera.width, camera.height);
    if u64::from(width) * u64::from(height) > PIXELS_MAX {
        let most = PIXELS_MAX;
        return Err(Fault::Usage(format!("an image of {width}x{height} has more than {most} pixels")).into());
    }
    let image = reference::render(&input.to_reference(), &camera, t, Order::Depth);
    output::write_png(&args.out, &image.to_rgb8(), (width, height))?;
    println!("{}: {width}x{height}, {} s", args.out.display(), args.time);
    Ok(())
}

fn read_camera(path: &Path) -> Result<Camera, Fault> {
    let fault = |what: String| Fault::Data(format!("camera {}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| fault(error.to_string()))?;
    let camera: Camera = serde_json::from_str(&text).map_err(|error| fault(error.to_string()))?;
    camera.check().map_err(fault)?;
    Ok(camera)
}

/// A size of an image, as WxH.
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
