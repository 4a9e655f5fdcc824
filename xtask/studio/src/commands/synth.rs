//! `aarc-studio synth`: procedural data.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::export;
use crate::messages::count;
use crate::progress::counting;
use crate::synth::{juggler, limbs, stage};
use clap::Subcommand;
use codec::{ClipInfo, Field};
use program::output;

use super::render::size;

/// Make a procedural scene.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    scene: SyntheticScene,
}

#[derive(Subcommand)]
enum SyntheticScene {
    /// The demo scene: a juggler in a circus ring, 3 seconds that loop, as a field file
    Clip {
        /// File to write (.ply)
        #[arg(short, long, value_name = "PATH")]
        out: PathBuf,
    },
    /// A figure whose thin limbs a ranking cuts off and the topology floor keeps, as a field file
    Limbs {
        /// File to write (.ply)
        #[arg(short, long, value_name = "PATH")]
        out: PathBuf,
    },
    /// A capture by a ray tracer: a figure that strikes, seen from a ring of cameras, with masks and depths
    Stage {
        /// Folder to make
        #[arg(short, long, value_name = "DIR")]
        out: PathBuf,
        /// Number of cameras; one in eight is held out
        #[arg(long, value_name = "N", default_value_t = 8)]
        cameras: usize,
        /// Number of frames, at most 100,000: up to 33 are one blow, more are a chain of different blows
        #[arg(long, value_name = "N", default_value_t = 9)]
        frames: usize,
        /// Size of the pictures
        #[arg(long, value_name = "WxH", default_value = "64x64", value_parser = size)]
        size: [u32; 2],
        /// Add a floor and a chair, which stand still
        #[arg(long)]
        props: bool,
    },
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match &args.scene {
        SyntheticScene::Clip { out } => write_field(out, juggler::clip),
        SyntheticScene::Limbs { out } => write_field(out, limbs::figure),
        SyntheticScene::Stage { out, cameras, frames, size, props } => {
            let settings =
                stage::StageSettings { cameras: *cameras, frames: *frames, size: *size, props: *props };
            write_stage(out, &settings)
        }
    }
}

fn write_field(out: &Path, scene: fn() -> (Field, ClipInfo)) -> anyhow::Result<()> {
    output::check(out)?;
    let (field, info) = scene();
    let bytes = export::field_file(&field, &info);
    output::write(out, &bytes)?;
    println!("{}: {} Gaussians, {} bytes", out.display(), field.len(), bytes.len());
    Ok(())
}

fn write_stage(out: &Path, settings: &stage::StageSettings) -> anyhow::Result<()> {
    settings.check()?;
    let start = Instant::now();
    let progress = counting(settings.images() as u64, "pictures");
    stage::write(out, settings, || progress.inc(1))?;
    progress.finish_and_clear();
    let stage::StageSettings { cameras, frames, size: [width, height], .. } = settings;
    let held = (0..*cameras).filter(|camera| stage::is_held(*camera)).count();
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{}: {}, {held} of them held; {} of {width}x{height}; in {seconds:.1} s",
        out.display(),
        count(*cameras, "camera"),
        count(*frames, "frame")
    );
    Ok(())
}
