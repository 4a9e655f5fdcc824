//! `aarc-studio export`: writes a clip or field in another format.

use std::path::PathBuf;

use crate::export;
use crate::import::FitRecord;
use crate::input::{Input, clip_time};
use crate::messages::decimal;
use anyhow::bail;
use clap::ArgGroup;
use codec::{ClipInfo, Field};
use program::output::OutputFolder;
use program::{Fault, output};

/// Write a clip or field in another format.
#[derive(clap::Args)]
#[command(group(ArgGroup::new("format").required(true)))]
pub struct Args {
    /// Package, fitted field file, or folder holding one
    input: PathBuf,
    /// For splaTV: moving, colours from all sides alike, 16-bit precision
    #[arg(long, group = "format", conflicts_with = "at")]
    splatv: bool,
    /// For other splat tools; with --at the field at that time, else the lossless field file
    #[arg(long, group = "format")]
    ply: bool,
    /// For tools of the SPZ format: the field at the time given by --at
    #[arg(long, group = "format")]
    spz: bool,
    /// For tools of glTF with KHR_gaussian_splatting: the field at the time given by --at, y up, in metres
    #[arg(long, group = "format")]
    glb: bool,
    /// A folder of static PLYs, one a frame, all with the same rows; each has the Gaussians of all frames
    #[arg(long, group = "format", conflicts_with = "at")]
    sequence: bool,
    /// Frames per second of --sequence [default: the frame rate of the capture]
    #[arg(long, value_name = "F", requires = "sequence", value_parser = rate)]
    fps: Option<f32>,
    /// Seconds from the start of the clip
    #[arg(long, value_name = "SECONDS")]
    at: Option<f64>,
    /// File to write; with --sequence, a new folder
    #[arg(short, long, value_name = "PATH")]
    out: PathBuf,
}

/// Most frames of a sequence.
const FRAMES_MAX: f64 = 100_000.0;

/// A field to be written, and the metadata of its clip.
struct Source {
    field: Field,
    info: ClipInfo,
    has_plate: bool,
    record: FitRecord,
    /// Gaussians that the field shows before or after the span of their segment, where the take does not.
    beyond: usize,
}

fn rate(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("not a positive number of frames per second".into()),
    }
}

impl Source {
    fn load(args: &Args) -> anyhow::Result<Source> {
        let input = match args.at {
            Some(seconds) => Input::load_at(&args.input, &[seconds])?,
            None => Input::load(&args.input)?,
        };
        let (has_plate, record, info) = (input.has_plate(), input.fit_record(), input.info().clone());
        let (field, beyond) = input.into_field();
        Ok(Source { field, info, has_plate, record, beyond })
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if args.sequence {
        return write_sequence(args);
    }
    output::check(&args.out)?;
    let Source { field, info, has_plate, record, beyond } = Source::load(args)?;
    let t = args.at.map(|seconds| clip_time("--at", seconds, &info)).transpose()?;
    if (args.spz || args.glb) && t.is_none() && field.temporal.is_some() {
        let format = if args.spz { "SPZ" } else { "GLB" };
        bail!(Fault::Usage(format!("{format} holds no motion: give a time with --at SECONDS")));
    }
    let field = match t {
        Some(t) => export::frozen(&field, t),
        None => field,
    };
    if field.is_empty() {
        let (input, at) = (args.input.display(), args.at.unwrap_or_default());
        bail!(Fault::Data(format!(
            "{input}: no Gaussian is visible at {at} s: choose another time with --at"
        )));
    }
    let bytes = if args.splatv {
        export::splatv(&field, &info)
    } else if args.spz {
        export::spz(&field, info.up)
    } else if args.glb {
        let bytes = export::glb(&field, &info);
        bytes.ok_or_else(|| {
            Fault::Usage("a GLB holds at most 4 GiB: package it with a --budget before".into())
        })?
    } else if t.is_some() {
        export::static_ply(&field, Some(&info))
    } else {
        export::fitted_field_file(&field, &info, &record)
    };
    output::write(&args.out, &bytes)?;
    let lost = args.lost(&field, &info, has_plate);
    if !lost.is_empty() {
        eprintln!("note: {} does not hold {}", args.out.display(), lost.join(", "));
    }
    if beyond > 0 && t.is_none() {
        eprintln!(
            "note: {} shows {beyond} Gaussians before or after the span of their segment, where the take does not",
            args.out.display()
        );
    }
    println!("{}: {} Gaussians, {} bytes", args.out.display(), field.len(), bytes.len());
    Ok(())
}

/// Writes a folder of frames.
fn write_sequence(args: &Args) -> anyhow::Result<()> {
    let folder = OutputFolder::begin(&args.out)?;
    let Source { field, info, has_plate, beyond, .. } = Source::load(args)?;
    let fps = args.fps.unwrap_or(info.fps);
    // A frame at the very end counts in spite of rounding.
    let duration = f64::from(info.duration_s);
    let intervals = (duration * f64::from(fps) + 1e-3).floor();
    if !(2.0..FRAMES_MAX).contains(&intervals) {
        let (frames, fps) = (intervals + 1.0, decimal(fps.into(), 3));
        bail!(Fault::Usage(format!(
            "--fps {fps}: {frames} frames; choose a rate for 3 to {FRAMES_MAX} frames"
        )));
    }
    let info = ClipInfo { fps, duration_s: (intervals / f64::from(fps)) as f32, ..info };
    let frames = intervals as usize + 1;
    let times: Vec<f64> = (0..frames).map(|k| (k as f64 / f64::from(fps) / duration).min(1.0)).collect();
    let rows = export::rows_of_sequence(&field, &times);
    let input = args.input.display();
    if rows.is_empty() {
        bail!(Fault::Data(format!("{input}: no Gaussian is visible in any frame")));
    }
    let digits = (frames - 1).to_string().len().max(4);
    let mut bytes = 0;
    for (k, &t) in times.iter().enumerate() {
        let ply = export::static_ply(&export::frame_of_sequence(&field, &rows, t), Some(&info));
        bytes += ply.len();
        folder.write(&format!("frame_{k:0digits$}.ply"), &ply)?;
    }
    folder.finish()?;
    let out = args.out.display();
    let lost = args.lost(&field, &info, has_plate);
    if !lost.is_empty() {
        eprintln!("note: {out} does not hold {}", lost.join(", "));
    }
    if beyond > 0 {
        eprintln!(
            "note: {out} shows {beyond} Gaussians before or after the span of their segment, where the take does not"
        );
    }
    println!("{out}: {frames} frames of {} Gaussians, {bytes} bytes", rows.len());
    Ok(())
}

impl Args {
    /// The parts of a clip that the chosen format cannot hold.
    fn lost(&self, field: &Field, info: &ClipInfo, has_plate: bool) -> Vec<&'static str> {
        let is_frozen = self.sequence || self.at.is_some();
        let is_up_kept = !self.spz || [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]].contains(&info.up);
        let parts = [
            (has_plate, "the background plate"),
            (self.splatv && field.sh_degree > 0, "view-dependent colour (SH above degree 0)"),
            (self.splatv && field.filter.compensates(), "the mip filter"),
            (self.spz && field.filter.compensates(), "the variance of the mip filter"),
            (
                (self.ply || self.sequence) && is_frozen && field.filter.compensates(),
                "the mip filter for other tools",
            ),
            (self.glb && field.filter.compensates(), "the mip filter"),
            ((self.splatv || self.spz || self.glb) && field.near > 0.0, "the near distance"),
            (!is_up_kept, "the up axis"),
            (self.spz && info.metres_per_unit != 1.0, "metres per unit"),
            ((self.spz || self.glb) && !info.viewpoints.is_empty(), "viewpoints"),
            (self.spz || self.glb, "duration and frame rate"),
        ];
        parts.into_iter().filter(|(is_lost, _)| *is_lost).map(|(_, part)| part).collect()
    }
}
