//! `cargo xtask picture`: renders clips with the player and tiles the images into README's picture, one row per clip.
//!
//! Column i of n shows the instant i / n of the clip from viewpoint i.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use image::RgbImage;
use program::images::tiled;
use program::output;
use serde_json::Value;
use xtask::workspace;

/// Images per clip; each clip needs as many viewpoints.
const COLUMNS: u32 = 4;

/// Width and height of an image in pixels.
const SIDE: u32 = 256;

/// The picture, below the root of the repository.
const PICTURE: &str = "assets/picture.png";

/// Render clips into README's picture, assets/picture.png: a row per clip, four instants from four viewpoints
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Packages
    #[arg(required = true, value_name = "CLIP")]
    clips: Vec<PathBuf>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let player = workspace::build("aarc", "dev")?;
    let mut images = Vec::new();
    for clip in &args.clips {
        let duration_s = duration_s(clip)?;
        for column in 0..COLUMNS {
            images.push(render(&player, clip, column, duration_s)?);
        }
    }
    let picture = tiled(&images, COLUMNS);
    Ok(output::write_png(&workspace::root().join(PICTURE), picture.as_raw(), picture.dimensions())?)
}

/// Length of a clip in seconds.
fn duration_s(clip: &Path) -> anyhow::Result<f64> {
    let inspect =
        workspace::studio("dev")?.arg("inspect").arg(clip).arg("--json").stderr(Stdio::inherit()).output()?;
    ensure!(inspect.status.success(), "inspect failed: {}", inspect.status);
    let report: Value = serde_json::from_slice(&inspect.stdout)?;
    report["duration_s"].as_f64().context("inspect prints no duration_s")
}

/// Renders one image of a row.
fn render(player: &Path, clip: &Path, column: u32, duration_s: f64) -> anyhow::Result<RgbImage> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("image.png");
    let time_s = duration_s * f64::from(column) / f64::from(COLUMNS);
    let status = Command::new(player)
        .arg(clip)
        .args(["--headless", "--size", &format!("{SIDE}x{SIDE}"), "--time", &time_s.to_string()])
        .args(["--view", &column.to_string(), "--out"])
        .arg(&path)
        .status()
        .context("cannot run the player")?;
    ensure!(status.success(), "the player failed: {status}");
    Ok(image::open(&path)?.into_rgb8())
}
