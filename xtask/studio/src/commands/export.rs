//! `aarc-studio export`: writes a clip or field in another format.

use std::path::PathBuf;

use crate::export;
use crate::input::{Input, clip_time};
use anyhow::bail;
use clap::ArgGroup;
use codec::{ClipInfo, Field};
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
    /// Seconds from the start of the clip
    #[arg(long, value_name = "SECONDS")]
    at: Option<f64>,
    /// File to write
    #[arg(short, long, value_name = "PATH")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    output::check(&args.out)?;
    let input = match args.at {
        Some(seconds) => Input::load_at(&args.input, &[seconds])?,
        None => Input::load(&args.input)?,
    };
    let (has_plate, record) = (input.has_plate(), input.fit_record());
    let (field, info, beyond) = match input {
        Input::Take(take) => {
            let (field, beyond) = take.merged();
            (field, take.info, beyond)
        }
        input => {
            let (field, info) = input.into_field();
            (field, info, 0)
        }
    };
    let t = args.at.map(|seconds| clip_time("--at", seconds, &info)).transpose()?;
    if args.spz && t.is_none() && field.temporal.is_some() {
        bail!(Fault::Usage("SPZ holds no motion: give a time with --at SECONDS".into()));
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

impl Args {
    /// The parts of a clip that the chosen format cannot hold.
    fn lost(&self, field: &Field, info: &ClipInfo, has_plate: bool) -> Vec<&'static str> {
        let is_up_kept = !self.spz || [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]].contains(&info.up);
        let parts = [
            (has_plate, "the background plate"),
            (self.splatv && field.sh_degree > 0, "view-dependent colour (SH above degree 0)"),
            (self.splatv && field.filter.compensates(), "the mip filter"),
            (self.spz && field.filter.compensates(), "the variance of the mip filter"),
            (self.ply && self.at.is_some() && field.filter.compensates(), "the mip filter for other tools"),
            (!is_up_kept, "the up axis"),
            (self.spz && info.metres_per_unit != 1.0, "metres per unit"),
            (self.spz && !info.viewpoints.is_empty(), "viewpoints"),
            (self.spz, "duration and frame rate"),
        ];
        parts.into_iter().filter(|(is_lost, _)| *is_lost).map(|(_, part)| part).collect()
    }
}
