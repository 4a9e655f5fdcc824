//! `cargo xtask eval`: a field, a package or pictures against the photographs of a capture.

use std::path::{Path, PathBuf};

use image::RgbImage;
use indicatif::{ProgressBar, ProgressStyle};
use refine::capture::Holdout;
use refine::fit::Lpips;
use refine::image::Image;
use serde_json::{Map, Value, json};
use xtask::capture::Footage;
use xtask::eval::{
    Ladder, Strips, Subject, csv, free_views, judge, ladder, means, quarter_frames, swiftest, table,
};
use xtask::fault::Fault;
use xtask::input::Input;
use xtask::output;

use super::capture::{Cut, describe, load_lpips};

/// Compare a field, a package or a folder of pictures with the photographs of a capture.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Package, fitted field, or folder of pictures named as the photographs are
    subject: PathBuf,
    /// Folder of the capture: its cameras and photographs (layouts: xtask/CAPTURE.md)
    #[arg(long, value_name = "CAPTURE")]
    capture: PathBuf,
    #[command(flatten)]
    cut: Cut,
    /// Weights of LPIPS (AlexNet or VGG16) as safetensors; without them it is not measured
    #[arg(long, value_name = "FILE")]
    lpips_weights: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Folder to write eval.md, eval.csv, eval.json and pictures to: beside the photographs; of a field or
    /// package also between frames and from other places; of a package also its first layers
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let footage = args.cut.open(&args.capture)?;
    let subject = Subject::load(&args.subject, &footage)?;
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out)
            .map_err(|error| Fault::Usage(format!("cannot make {}: {error}", out.display())))?;
    }
    if footage.missing() > 0 {
        eprintln!("note: {} photographs are missing that others have the like of", footage.missing());
    }
    let holdout = args.cut.holdout();
    let style =
        ProgressStyle::with_template("{bar:30} {pos}/{len} photographs, {eta} left").expect("a template");
    let progress = ProgressBar::new(footage.capture.shots.len() as u64).with_style(style);
    let lpips = load_lpips(args.lpips_weights.as_deref())?;
    let mut strips = Strips::new(&subject, &footage, holdout)?;
    let judged = judge(&subject, &footage, holdout, lpips.as_ref(), |look| {
        if let (Some(look), Some(_)) = (look, &args.out) {
            strips.look(look);
        }
        progress.inc(1);
    })?;
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
    let mut json = json!({
        "subject": args.subject, "capture": args.capture, "held_cameras": held,
        "holdout": args.cut.holdout_name(),
        "splits": splits,
    });
    let mut table = table(&means);
    if let (Some(out), Subject::Drawn(input)) = (&args.out, &subject)
        && let Some(ladder) = more_pictures(out, input, args, &footage)?
    {
        table += &ladder.table();
        json["ladder"] = serde_json::to_value(&ladder)?;
    }
    let json = format!("{json:#}");
    if let Some(out) = &args.out {
        output::write(&out.join("eval.json"), format!("{json}\n").as_bytes())?;
        output::write(&out.join("eval.md"), table.as_bytes())?;
        output::write(&out.join("eval.csv"), csv(&judged, &footage).as_bytes())?;
        for strip in strips.into_strips() {
            let name = footage.name(strip.shot).replace(['/', '\\'], "_");
            write_picture(&out.join(format!("{}_{name}.png", strip.split.name())), &strip.image)?;
        }
    }
    match args.json {
        true => println!("{json}"),
        false => print(&footage, holdout, lpips.as_ref(), &table)?,
    }
    Ok(())
}

fn print(footage: &Footage, holdout: Holdout, lpips: Option<&Lpips<f32>>, table: &str) -> Result<(), Fault> {
    println!("{}", describe(footage, holdout)?);
    println!("train: fitted to; interp_b: held frames; recon: held cameras; interp_a: both held\n");
    print!("{table}");
    match lpips {
        Some(lpips) => println!("\nLPIPS by {}", lpips.net()),
        None => println!("\nLPIPS is not measured: it takes --lpips-weights."),
    }
    Ok(())
}

/// What only a field or a package can show: other times, other places, other budgets.
fn more_pictures(
    out: &Path,
    input: &Input,
    args: &Args,
    footage: &Footage,
) -> anyhow::Result<Option<Ladder>> {
    let holdout = args.cut.holdout();
    let interval = swiftest(footage, holdout)?;
    if let Some(interval) = &interval {
        write_picture(&out.join("quarter_frames.png"), &quarter_frames(input, footage, interval)?)?;
    }
    let t = interval.map_or(0.0, |interval| interval.middle(footage));
    if let Some(views) = free_views(input, footage, t) {
        write_picture(&out.join("free_views.png"), &views)?;
    }
    let Input::Package(clip) = input else { return Ok(None) };
    let ladder = ladder(clip, &args.subject, footage, holdout)?;
    if let Some(ladder) = &ladder {
        write_picture(&out.join("ladder.png"), &ladder.picture)?;
    }
    Ok(ladder)
}

fn write_picture(path: &Path, image: &Image) -> anyhow::Result<()> {
    let rgb = RgbImage::from_raw(image.width, image.height, image.to_rgb8()).expect("three bytes per pixel");
    output::write_png(path, &rgb)
}
