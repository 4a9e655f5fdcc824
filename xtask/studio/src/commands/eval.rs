//! `aarc-studio eval`: compares a field, a package or pictures with the photographs of a capture.

use std::path::{Path, PathBuf};

use crate::capture::CaptureFiles;
use crate::eval::{
    self, BlendedPhotographs, Photographs, PrefixEval, SplitMeasures, Strips, Subject, csv, eval_prefixes,
    fastest_interval, free_views, judge, means, over_scenes, quarter_frames, scenes_table, table,
};
use crate::input::Input;
use crate::progress::counting;
use anyhow::bail;
use program::{Fault, output};
use refine::capture::Holdout;
use refine::fit::Lpips;
use refine::image::Image;
use serde_json::{Map, Value, json};

use super::capture::{FrameSelection, LpipsOption, describe};
use super::fit::name_of;
use super::fit_source::FitSource;
use super::options::JsonOption;

/// Compare a field, a package or a folder of pictures with the photographs of a capture.
#[derive(clap::Args)]
pub struct Args {
    /// Package, fitted field, or folder of pictures named as the photographs are; the means of several
    /// SUBJECTs, one per scene, are averaged
    #[arg(required = true, value_name = "SUBJECT")]
    subjects: Vec<PathBuf>,
    /// Folder of the capture: its cameras and photographs (layouts: xtask/CAPTURE.md); once for each
    /// SUBJECT, in their order
    #[arg(long = "capture", required = true, value_name = "CAPTURE")]
    captures: Vec<PathBuf>,
    #[command(flatten)]
    selection: FrameSelection,
    #[command(flatten)]
    lpips: LpipsOption,
    #[command(flatten)]
    json: JsonOption,
    /// Folder to write eval.md, eval.csv, eval.json and pictures to: beside the photographs; of a field or
    /// package also between frames and from other places; of a package also its first layers. Of
    /// several scenes one folder each, named as its capture
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let Args { subjects, captures, .. } = args;
    if subjects.len() != captures.len() {
        let (subjects, captures) = (subjects.len(), captures.len());
        bail!(Fault::Usage(format!(
            "{subjects} SUBJECTs and {captures} --capture: name one --capture for each SUBJECT"
        )));
    }
    let lpips = args.lpips.load()?;
    if let ([subject], [capture]) = (&subjects[..], &captures[..]) {
        let scene = Evaluation { subject, capture, out: args.out.clone(), args, lpips: lpips.as_ref() };
        let evaluated = scene.evaluate()?;
        match args.json.is_given {
            true => println!("{:#}", evaluated.json),
            false => print!("{}\n\n{}", evaluated.about, evaluated.table),
        }
    } else {
        let names: Vec<String> = captures.iter().map(|capture| name_of(capture)).collect();
        if let Some((_, name)) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
            bail!(Fault::Usage(format!(
                "two captures are called {name}, and so would their scenes be: rename one"
            )));
        }
        let (mut scenes, mut means) = (Map::new(), Vec::new());
        for ((subject, capture), name) in subjects.iter().zip(captures).zip(&names) {
            let out = args.out.as_ref().map(|out| out.join(name));
            let evaluated = Evaluation { subject, capture, out, args, lpips: lpips.as_ref() }.evaluate()?;
            if !args.json.is_given {
                print!("{name}: {}\n\n{}\n", evaluated.about, evaluated.table);
            }
            scenes.insert(name.clone(), evaluated.json);
            means.push(evaluated.means);
        }
        let rows = over_scenes(&means);
        let splits = rows.iter().map(|row| Ok((row.split.to_owned(), serde_json::to_value(row)?)));
        let json = json!({"scenes": scenes, "splits": splits.collect::<anyhow::Result<Map<_, _>>>()?});
        let table = format!("Over {} scenes:\n\n{}", names.len(), scenes_table(&rows));
        if let Some(out) = &args.out {
            output::write(&out.join("eval.json"), format!("{json:#}\n").as_bytes())?;
            output::write(&out.join("eval.md"), table.as_bytes())?;
        }
        match args.json.is_given {
            true => println!("{json:#}"),
            false => print!("{table}"),
        }
    }
    if !args.json.is_given {
        println!("\ntrain: fitted to; interp_b: held frames; recon: held cameras; interp_a: both held");
        println!(
            "PSNR; aligned: after one transform of colours per camera; moving: pixels off the camera's median"
        );
        match &lpips {
            Some(lpips) => println!("LPIPS by {}", lpips.network()),
            None => println!("LPIPS is not measured: it takes --lpips-weights."),
        }
    }
    Ok(())
}

/// A scene to evaluate.
struct Evaluation<'a> {
    subject: &'a Path,
    capture: &'a Path,
    /// Folder for tables and pictures.
    out: Option<PathBuf>,
    args: &'a Args,
    lpips: Option<&'a Lpips<f32>>,
}

/// The results of a scene.
struct Evaluated {
    /// Its cameras, frames and photographs.
    about: String,
    means: Vec<SplitMeasures>,
    table: String,
    json: Value,
}

impl Evaluation<'_> {
    // Long: one optional comparison after the other, each a few lines.
    fn evaluate(self) -> anyhow::Result<Evaluated> {
        let Evaluation { subject: path, capture, out, args, lpips } = self;
        let subject = Subject::load(path, &args.selection.open(capture)?)?;
        let source = match &subject {
            Subject::Drawn(input) => FitSource::new(path, input),
            Subject::Pictures(_) => FitSource::of_pictures(path),
        };
        let (holdout, note) = source.held_frames(args.selection.holdout());
        let mut capture_files = args.selection.open_for(capture, &source, holdout)?;
        if source.has_plate {
            capture_files.keep_background();
        }
        let about = describe(&capture_files, holdout)?;
        if let Some(out) = &out {
            output::make_folder(out)?;
        }
        if capture_files.missing_count() > 0 {
            let missing = match capture_files.missing_count() {
                1 => "1 photograph is".to_owned(),
                number => format!("{number} photographs are"),
            };
            eprintln!(
                "note: {}: {missing} missing, since not every camera has every frame",
                capture.display()
            );
        }
        let progress = counting(capture_files.capture.photos.len() as u64, "photographs");
        let mut strips = Strips::new(&subject, &capture_files, holdout)?;
        let splits = eval::splits(&capture_files, holdout)?;
        let mut blended = BlendedPhotographs::new(&capture_files, splits, lpips);
        let photographs = Photographs::new(&capture_files, source.has_plate);
        let judged = judge(&subject, &photographs, holdout, lpips, |look| {
            progress.inc(1);
            let Some(look) = look else { return Ok(()) };
            if out.is_some() {
                strips.add(look);
            }
            blended.add(&look)
        })?;
        let blended = means(&blended.judged()?);
        progress.finish_and_clear();
        if let Some(note) = note {
            eprintln!("note: {note}");
        }

        let missing = capture_files.capture.photos.len() - judged.len();
        if missing > 0 {
            eprintln!(
                "note: {missing} of {} photographs have no picture",
                capture_files.capture.photos.len()
            );
        }
        let means = means(&judged);
        let exact: usize = means.iter().filter(|row| row.exact < row.images).map(|row| row.exact).sum();
        if exact > 0 {
            eprintln!(
                "note: {} equal to their photographs, such as empty ones; the means of PSNR leave them out",
                if exact == 1 { "1 image is".to_owned() } else { format!("{exact} images are") }
            );
        }
        let held = capture_files.capture.cameras.iter().filter(|camera| camera.held);
        let held: Vec<&str> = held.map(|camera| camera.name.as_str()).collect();
        let mut json = json!({
            "subject": path, "capture": capture, "held_cameras": held,
            "holdout": holdout.name(),
            "frames": [capture_files.selected_frames().start, capture_files.selected_frames().end],
            "splits": by_split(&means)?,
        });
        if !blended.is_empty() {
            json["baselines"] = json!({"blended_photographs": by_split(&blended)?});
        }
        let mut table = table(&means, &blended);
        if let (Some(out), Subject::Drawn(input)) = (&out, &subject)
            && let Some(prefixes) = more_pictures(out, input, holdout, &capture_files, &photographs)?
        {
            table += &prefixes.table();
            json["ladder"] = serde_json::to_value(&prefixes)?;
        }
        if let Some(out) = &out {
            output::write(&out.join("eval.json"), format!("{json:#}\n").as_bytes())?;
            output::write(&out.join("eval.md"), table.as_bytes())?;
            output::write(&out.join("eval.csv"), csv(&judged, &capture_files).as_bytes())?;
            for strip in strips.into_strips() {
                let name = capture_files.name(strip.photo_id).replace(['/', '\\'], "_");
                write_picture(&out.join(format!("{}_{name}.png", strip.split.name())), &strip.image)?;
            }
        }
        Ok(Evaluated { about, means, table, json })
    }
}

/// The rows by the names of their splits.
fn by_split(means: &[SplitMeasures]) -> anyhow::Result<Map<String, Value>> {
    means.iter().map(|row| Ok((row.split.to_owned(), serde_json::to_value(row)?))).collect()
}

/// What only a field or a package can show: other times, other places, other budgets.
fn more_pictures(
    out: &Path,
    input: &Input,
    holdout: Holdout,
    capture_files: &CaptureFiles,
    photographs: &Photographs,
) -> anyhow::Result<Option<PrefixEval>> {
    let interval = fastest_interval(capture_files, holdout)?;
    if let Some(interval) = &interval {
        write_picture(&out.join("quarter_frames.png"), &quarter_frames(input, capture_files, interval)?)?;
    }
    let t = interval.map_or(0.0, |interval| interval.center(capture_files));
    if let Some(views) = free_views(input, capture_files, t) {
        write_picture(&out.join("free_views.png"), &views)?;
    }
    let Input::Take(take) = input else { return Ok(None) };
    let prefixes = eval_prefixes(take, photographs, holdout)?;
    if let Some(prefixes) = &prefixes {
        write_picture(&out.join("ladder.png"), &prefixes.picture)?;
    }
    Ok(prefixes)
}

/// Writes a PNG.
pub(super) fn write_picture(path: &Path, image: &Image) -> Result<(), Fault> {
    output::write_png(path, &image.to_rgb8(), (image.width, image.height))
}
