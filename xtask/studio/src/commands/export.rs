//! `aarc-studio export`: writes a clip or field in another format.

use std::path::PathBuf;

use crate::export;
use crate::input::{Input, clip_time};
use clap::ArgGroup;
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
    let input = Input::load(&args.input)?;
    if input.has_plate() {
        eprintln!("note: the background plate is left out");
    }
    let (field, info) = input.into_field();
    let t = args.at.map(|seconds| clip_time("--at", seconds, &info)).transpose()?;
    let field = match t {
        Some(t) => export::frozen(&field, t),
        None => field,
    };
    if field.is_empty() {
        let at = args.at.unwrap_or_default();
        return Err(Fault::Data(format!("{}: nothing can be seen at {at} s", args.input.display())).into());
    }
    let bytes = if args.splatv {
        if field.sh_degree > 0 {
            eprintln!("note: .splatv has no view-dependent colour; SH above degree 0 left out");
        }
        export::splatv(&field, &info)
    } else if args.spz {
        if field.temporal.is_some() {
            return Err(Fault::Usage("SPZ holds no motion: give a time with --at SECONDS".into()).into());
        }
        export::spz(&field, info.up)
    } else if t.is_some() {
        export::static_ply(&field)
    } else {
        export::field_file(&field, &info)
    };
    output::write(&args.out, &bytes)?;
    println!("{}: {} Gaussians, {} bytes", args.out.display(), field.len(), bytes.len());
    Ok(())
}
