//! `aarc-studio ingest`: from the videos of a rig to a capture.

use std::path::{Path, PathBuf};

use crate::ingest::{self, ExtractFormat, IngestOptions, MattePolicy, Offsets, ResizePolicy, UpSource};
use crate::parse::three_numbers;

use super::options::{JsonOption, OutOption};

/// Make a capture of a rig's videos and calibration, and a page that shows whether it is any good.
///
/// The capture refers to the videos. xtask/CAPTURE.md says which calibrations are read, and how starts are found.
#[derive(clap::Args)]
pub struct Args {
    /// Folder of videos, one for each camera, with their calibration
    rig: PathBuf,
    #[command(flatten)]
    out: OutOption,
    /// The calibration; by default the calibration in the folder of videos that fits them
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// When the videos start: a file with lines of a name and seconds, or none if they start together; by default their
    /// timecodes or sound say it
    #[arg(long, value_name = "FILE|none")]
    offsets: Option<PathBuf>,
    /// Frames per second of the capture; by default the commonest of the videos
    #[arg(long, value_name = "N", value_parser = positive)]
    fps: Option<f64>,
    /// Which way is up in the calibration's world; by default as its layout says, or else the mean of the cameras
    #[arg(long, value_name = "X,Y,Z|calibration|cameras", value_parser = up, allow_hyphen_values = true)]
    up: Option<UpSource>,
    /// Point of the calibration's world that becomes the origin
    #[arg(long, value_name = "X,Y,Z", value_parser = origin, allow_hyphen_values = true)]
    origin: Option<Origin>,
    /// Metres per unit of the calibration's world: 0.001 for millimetres
    #[arg(long, value_name = "M", value_parser = positive)]
    metres_per_unit: Option<f64>,
    /// Height in metres of the subject, who stands upright at the start: instead of --metres-per-unit
    #[arg(long, value_name = "M", value_parser = positive, conflicts_with = "metres_per_unit")]
    height: Option<f64>,
    /// What happened to videos of another size than their calibration: they are refused without it
    #[arg(long, value_name = "HOW")]
    resize: Option<ResizePolicy>,
    /// Write the frames as pictures instead of references to the videos
    #[arg(long, value_name = "FORMAT")]
    extract: Option<ExtractFormat>,
    /// Folder of pictures or videos without the subject, named as the videos; by default the median of each video serves
    #[arg(long, value_name = "DIR")]
    plates: Option<PathBuf>,
    /// Whether masks of the subject are made, by the difference from the plates
    #[arg(long, value_name = "on|off", default_value = "on")]
    mattes: MattePolicy,
    #[command(flatten)]
    json: JsonOption,
}

/// A point; clap would take an array for several values.
#[derive(Clone, Copy, Debug)]
struct Origin([f64; 3]);

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let options = IngestOptions {
        calibration: args.calibration.clone(),
        offsets: match &args.offsets {
            None => Offsets::Found,
            Some(path) if path == Path::new("none") => Offsets::Together,
            Some(path) => Offsets::File(path.clone()),
        },
        fps: args.fps,
        up: args.up,
        origin: args.origin.map(|Origin(origin)| origin),
        metres_per_unit: args.metres_per_unit,
        height_m: args.height,
        resize: args.resize,
        extract: args.extract,
        plates: args.plates.clone(),
        mattes: args.mattes,
    };
    // JSON alone belongs on standard output.
    let mut say = |line: &str| if args.json.is_given { eprintln!("{line}") } else { println!("{line}") };
    let findings = ingest::ingest(&args.rig, &args.out.path, &options, &mut say)?;
    match args.json.is_given {
        true => println!("{}", serde_json::to_string_pretty(&findings)?),
        false => println!("next        look at the page, then: fit {} -o field.ply", args.out.path.display()),
    }
    Ok(())
}

/// Three finite numbers.
fn vector(text: &str) -> Option<[f64; 3]> {
    three_numbers(text, ',').filter(|vector: &[f64; 3]| vector.iter().all(|x| x.is_finite()))
}

fn up(text: &str) -> Result<UpSource, String> {
    match text {
        "calibration" => Ok(UpSource::Calibration),
        "cameras" => Ok(UpSource::Cameras),
        _ => {
            let vector = vector(text).ok_or("a direction as 0,0,1, or calibration, or cameras")?;
            let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
            let up = vector.map(|x| x / length);
            up.iter()
                .all(|x| x.is_finite())
                .then_some(UpSource::Stated(up))
                .ok_or_else(|| "it is no direction".into())
        }
    }
}

fn origin(text: &str) -> Result<Origin, String> {
    vector(text).map(Origin).ok_or_else(|| "a point as 0,1.5,0".into())
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| (1e-9..=1e6).contains(x));
    number.ok_or_else(|| "a number above 0".into())
}
