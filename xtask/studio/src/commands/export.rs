//! `aarc-studio export`: writes a clip or field in another format.

use std::path::PathBuf;

use anyhow::bail;
use clap::ArgGroup;
use codec::{ClipInfo, Field};
use formats::{SequenceFrames, Target, frozen};
use program::output::OutputFolder;
use program::{Fault, output};

use crate::fields::FitRecord;
use crate::input::{Input, clip_time};
use crate::messages::decimal;

use super::options::OutOption;

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
    /// A new folder of static PLYs, one a frame, all with the same rows; each has the Gaussians of all frames
    #[arg(long, group = "format", conflicts_with = "at")]
    sequence: bool,
    /// Frames per second of --sequence [default: the frame rate of the capture]
    #[arg(long, value_name = "F", requires = "sequence", value_parser = rate)]
    fps: Option<f32>,
    /// Seconds from the start of the clip
    #[arg(long, value_name = "SECONDS")]
    at: Option<f64>,
    #[command(flatten)]
    out: OutOption,
}

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

    /// Says which parts of the clip the output does not hold, and what it shows too much of.
    fn print_loss(&self, args: &Args, mut lost: Vec<&str>) {
        let (out, beyond) = (args.out.path.display(), self.beyond);
        if self.has_plate {
            lost.insert(0, "the background plate");
        }
        if !lost.is_empty() {
            eprintln!("note: {out} does not hold {}", lost.join(", "));
        }
        if beyond > 0 && args.at.is_none() {
            eprintln!(
                "note: {out} shows {beyond} Gaussians before or after the span of their segment, where the take does not"
            );
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if args.sequence {
        return write_sequence(args);
    }
    output::check(&args.out.path)?;
    let source = Source::load(args)?;
    let t = args.at.map(|seconds| clip_time("--at", seconds, &source.info)).transpose()?;
    let target = args.target();
    if !target.holds_motion() && t.is_none() && source.field.temporal.is_some() {
        let format = if args.spz { "SPZ" } else { "GLB" };
        bail!(Fault::Usage(format!("{format} holds no motion: give a time with --at SECONDS")));
    }
    let field = match t {
        Some(t) => &frozen(&source.field, t),
        None => &source.field,
    };
    if field.is_empty() {
        let (input, at) = (args.input.display(), args.at.unwrap_or_default());
        bail!(Fault::Data(format!(
            "{input}: no Gaussian is visible at {at} s: choose another time with --at"
        )));
    }
    let bytes = target.write(field, &source.info, &source.record.comments()).map_err(Fault::Usage)?;
    output::write(&args.out.path, &bytes)?;
    source.print_loss(args, target.lost(field, &source.info));
    println!("{}: {} Gaussians, {} bytes", args.out.path.display(), field.len(), bytes.len());
    Ok(())
}

/// Writes a folder of frames.
fn write_sequence(args: &Args) -> anyhow::Result<()> {
    let folder = OutputFolder::begin(&args.out.path)?;
    let source = Source::load(args)?;
    let fps = args.fps.unwrap_or(source.info.fps);
    let frames = SequenceFrames::new(&source.field, &source.info, fps)
        .map_err(|what| Fault::Usage(format!("--fps {}: {what}", decimal(fps.into(), 3))))?;
    if frames.rows() == 0 {
        let input = args.input.display();
        bail!(Fault::Data(format!("{input}: no Gaussian is visible in any frame")));
    }
    let mut bytes = 0;
    for (name, ply) in frames.files() {
        bytes += ply.len();
        folder.write(&name, &ply)?;
    }
    folder.finish()?;
    source.print_loss(args, Target::StaticPly.lost(&source.field, &source.info));
    let (out, count, rows) = (args.out.path.display(), frames.count(), frames.rows());
    println!("{out}: {count} frames of {rows} Gaussians, {bytes} bytes");
    Ok(())
}

impl Args {
    /// As what one file is written.
    fn target(&self) -> Target {
        match self {
            Args { splatv: true, .. } => Target::Splatv,
            Args { spz: true, .. } => Target::Spz,
            Args { glb: true, .. } => Target::Glb,
            Args { at: Some(_), .. } => Target::StaticPly,
            _ => Target::FieldFile,
        }
    }
}
