//! `cargo xtask eval`: a field, a package or pictures against the photographs of a capture.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use image::RgbImage;
use indicatif::{ProgressBar, ProgressStyle};
use refine::capture::{self, Split};
use serde_json::{Map, Value, json};
use xtask::capture::Footage;
use xtask::eval::{Judged, Subject, csv, judge, means, strip, table, telling};
use xtask::fault::Fault;
use xtask::output;

/// Compare a field, a package or a folder of pictures with the photographs of a capture.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Package, fitted field, or folder of pictures named as the photographs are
    subject: PathBuf,
    /// Folder of the capture: its cameras and photographs (layouts: xtask/CAPTURE.md)
    #[arg(long, value_name = "CAPTURE")]
    capture: PathBuf,
    /// Frames that are held out from fitting
    #[arg(long, value_enum, default_value = "odd")]
    holdout: Holdout,
    /// Cameras that are held out from fitting, by name, besides those that the capture says
    #[arg(long, value_name = "NAME[,NAME..]", value_delimiter = ',')]
    held_cameras: Vec<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Folder to write eval.md, eval.csv, eval.json and pictures side by side to
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Holdout {
    /// Every other frame, from the second
    Odd,
    /// None
    None,
}

impl From<Holdout> for capture::Holdout {
    fn from(holdout: Holdout) -> capture::Holdout {
        match holdout {
            Holdout::Odd => capture::Holdout::Odd,
            Holdout::None => capture::Holdout::None,
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let mut footage = Footage::open(&args.capture)?;
    hold_cameras(&mut footage, &args.held_cameras)?;
    let subject = Subject::load(&args.subject, &footage)?;
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out)
            .map_err(|error| Fault::Usage(format!("cannot make {}: {error}", out.display())))?;
    }
    let style =
        ProgressStyle::with_template("{bar:30} {pos}/{len} photographs, {eta} left").expect("a template");
    let progress = ProgressBar::new(footage.capture.shots.len() as u64).with_style(style);
    let judged = judge(&subject, &footage, args.holdout.into(), || progress.inc(1))?;
    progress.finish_and_clear();

    let missing = footage.capture.shots.len() - judged.len();
    if missing > 0 {
        eprintln!("note: {missing} of {} photographs have no picture", footage.capture.shots.len());
    }
    let means = means(&judged);
    let splits: Map<String, Value> = means
        .iter()
        .map(|row| Ok((row.split.to_owned(), serde_json::to_value(row)?)))
        .collect::<anyhow::Result<_>>()?;
    let held: Vec<&str> = footage
        .capture
        .cameras
        .iter()
        .filter(|camera| camera.held)
        .map(|camera| camera.name.as_str())
        .collect();
    let json = serde_json::to_string_pretty(&json!({
        "subject": args.subject, "capture": args.capture, "held_cameras": held,
        "holdout": args.holdout.to_possible_value().map(|value| value.get_name().to_owned()),
        "splits": splits,
    }))?;
    let table = table(&means);
    if let Some(out) = &args.out {
        output::write(&out.join("eval.json"), format!("{json}\n").as_bytes())?;
        output::write(&out.join("eval.md"), table.as_bytes())?;
        output::write(&out.join("eval.csv"), csv(&judged, &footage).as_bytes())?;
        for one in telling(&judged) {
            write_strip(out, &subject, &footage, one)?;
        }
    }
    match args.json {
        true => println!("{json}"),
        false => print(&footage, &judged, &table),
    }
    Ok(())
}

fn hold_cameras(footage: &mut Footage, names: &[String]) -> Result<(), Fault> {
    for name in names {
        let found = footage.capture.cameras.iter_mut().find(|camera| camera.name == *name);
        match found {
            Some(camera) => camera.held = true,
            None => {
                return Err(Fault::Usage(format!("--held-cameras: the capture has no camera \"{name}\"")));
            }
        }
    }
    Ok(())
}

fn print(footage: &Footage, judged: &[Judged], table: &str) {
    let cameras = &footage.capture.cameras;
    let held = cameras.iter().filter(|camera| camera.held).count();
    let is_train = |one: &&Judged| one.split == Split::Train;
    println!(
        "{} cameras, {held} of them held; {} frames; {} of {} photographs to fit to",
        cameras.len(),
        footage.capture.times.len(),
        judged.iter().filter(is_train).count(),
        judged.len()
    );
    println!("train: fitted to; interp_b: held frames; recon: held cameras; interp_a: both held\n");
    print!("{table}");
    println!("\nLPIPS is not measured.");
}

fn write_strip(out: &Path, subject: &Subject, footage: &Footage, one: &Judged) -> anyhow::Result<()> {
    let strip = strip(subject, footage, one.shot)?;
    let rgb = RgbImage::from_raw(strip.width, strip.height, strip.to_rgb8()).expect("three bytes per pixel");
    let name = footage.name(one.shot).replace(['/', '\\'], "_");
    output::write_png(&out.join(format!("{}_{name}.png", one.split.name())), &rgb)
}
