//! `aarc-studio synth`: procedural data.

use std::path::Path;
use std::time::Instant;

use crate::messages::count;
use crate::progress::counting;
use crate::synth::{juggler, limbs, rig, stage};
use clap::Subcommand;
use codec::{ClipInfo, Field};
use program::output;

use super::fit_setting::switch;
use super::options::OutOption;
use super::render::size;

/// Make a procedural scene.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    scene: SyntheticScene,
}

#[derive(Subcommand)]
enum SyntheticScene {
    /// The demo scene: a juggler in a circus ring, 3 seconds that loop, as a field file (.ply)
    Clip(OutOption),
    /// A figure whose thin limbs a ranking cuts off and the topology floor keeps, as a field file (.ply)
    Limbs(OutOption),
    /// A capture by a ray tracer: a figure that strikes, seen from a ring of cameras, with masks and depths
    Stage(StageArgs),
    /// The stage as a rig of real cameras records it: videos with sound, not synchronous, not alike, in a room
    Rig(RigArgs),
}

#[derive(clap::Args)]
struct StageArgs {
    #[command(flatten)]
    out: OutOption,
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
}

#[derive(clap::Args)]
struct RigArgs {
    #[command(flatten)]
    out: OutOption,
    /// Number of cameras
    #[arg(long, value_name = "N", default_value_t = 12)]
    cameras: usize,
    /// Seconds in which all cameras run; each starts before and stops after
    #[arg(long, value_name = "S", default_value_t = 4.0)]
    seconds: f64,
    /// Frames per second
    #[arg(long, value_name = "F", default_value_t = 30.0)]
    fps: f64,
    /// Size of the upright pictures, in even numbers
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = size)]
    size: [u32; 2],
    /// Write the figure's masks, too, masks/CAMERA/FRAME.png for each frame of the videos, and plates without it,
    /// plates/CAMERA.png
    #[arg(long)]
    masks: bool,
    /// How much perturbs the rig: starts, drift, exposure, white-balance, noise, sound-skew and sound-noise are numbers;
    /// offsets, rotated, variable-rate and shadow are on or off; seed, of all that is drawn, and crf, x264's constant rate
    /// factor, are whole numbers. none leaves out what does not follow
    #[arg(long, value_name = "none|PART=X[,PART=X..]", value_delimiter = ',', value_parser = perturbation)]
    perturb: Vec<Perturbation>,
}

/// Quality of the videos where `--perturb` states none: x264's constant rate factor.
const CRF: u8 = 12;

/// How much of a part perturbs.
#[derive(Clone, Copy, Debug)]
enum Perturbation {
    Nothing,
    Number(fn(&mut rig::RigSettings, f64), f64),
    Whole(fn(&mut rig::RigSettings, u64), u64),
    Switch(fn(&mut rig::RigSettings, bool), bool),
}

/// Parses `PART=X`, or `none`.
fn perturbation(text: &str) -> Result<Perturbation, String> {
    if text == "none" {
        return Ok(Perturbation::Nothing);
    }
    let (part, value) = text.split_once('=').ok_or("none or PART=X, such as exposure=0.2")?;
    let number = |set: fn(&mut rig::RigSettings, f64)| match value.parse() {
        Ok(number) => Ok(Perturbation::Number(set, number)),
        Err(_) => Err(format!("{part} is a number, such as {part}=0.1")),
    };
    let whole = |set: fn(&mut rig::RigSettings, u64)| match value.parse() {
        Ok(number) => Ok(Perturbation::Whole(set, number)),
        Err(_) => Err(format!("{part} is a whole number from 0 on")),
    };
    let switch = |set: fn(&mut rig::RigSettings, bool)| {
        switch(part, value).map(|is_on| Perturbation::Switch(set, is_on))
    };
    match part {
        "starts" => number(|rig, x| rig.perturbations.starts_s = x),
        "drift" => number(|rig, x| rig.perturbations.drift_ppm = x),
        "exposure" => number(|rig, x| rig.perturbations.exposure = x),
        "white-balance" => number(|rig, x| rig.perturbations.white_balance = x),
        "noise" => number(|rig, x| rig.perturbations.noise = x),
        "sound-skew" => number(|rig, x| rig.perturbations.sound_skew_s = x),
        "sound-noise" => number(|rig, x| rig.perturbations.sound_noise_db = Some(x)),
        "offsets" => switch(|rig, on| rig.perturbations.offsets = on),
        "rotated" => switch(|rig, on| rig.perturbations.rotated = on),
        "variable-rate" => switch(|rig, on| rig.perturbations.variable_rate = on),
        "shadow" => switch(|rig, on| rig.shadow = on),
        "seed" => whole(|rig, x| rig.seed = x),
        "crf" => whole(|rig, x| rig.crf = u8::try_from(x).unwrap_or(u8::MAX)),
        _ => Err(format!("{part}: nothing of this name perturbs")),
    }
}

impl RigArgs {
    fn settings(&self) -> rig::RigSettings {
        let mut settings = rig::RigSettings {
            cameras: self.cameras,
            seconds: self.seconds,
            fps: self.fps,
            size: self.size,
            seed: 0,
            crf: CRF,
            shadow: false,
            masks: self.masks,
            perturbations: rig::Perturbations::ALL,
        };
        for perturbation in &self.perturb {
            match *perturbation {
                Perturbation::Nothing => settings.perturbations = rig::Perturbations::NONE,
                Perturbation::Number(set, number) => set(&mut settings, number),
                Perturbation::Whole(set, number) => set(&mut settings, number),
                Perturbation::Switch(set, is_on) => set(&mut settings, is_on),
            }
        }
        settings
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match &args.scene {
        SyntheticScene::Clip(OutOption { path }) => write_field(path, juggler::clip),
        SyntheticScene::Limbs(OutOption { path }) => write_field(path, limbs::figure),
        SyntheticScene::Stage(StageArgs { out, cameras, frames, size, props }) => {
            let settings =
                stage::StageSettings { cameras: *cameras, frames: *frames, size: *size, props: *props };
            write_stage(&out.path, &settings)
        }
        SyntheticScene::Rig(args) => write_rig(&args.out.path, &args.settings()),
    }
}

fn write_field(out: &Path, scene: fn() -> (Field, ClipInfo)) -> anyhow::Result<()> {
    output::check(out)?;
    let (field, info) = scene();
    let bytes = formats::write_field_file(&field, &info);
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

fn write_rig(out: &Path, settings: &rig::RigSettings) -> anyhow::Result<()> {
    let rig = rig::Rig::new(settings)?;
    let start = Instant::now();
    let progress = counting(rig.pictures() as u64, "pictures");
    rig::write(out, &rig, || progress.inc(1))?;
    progress.finish_and_clear();
    let [width, height] = settings.size;
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{}: {}, {} of {width}x{height}; in {seconds:.1} s",
        out.display(),
        count(settings.cameras, "video"),
        count(rig.pictures(), "picture")
    );
    Ok(())
}
