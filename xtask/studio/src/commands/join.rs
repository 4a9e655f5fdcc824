//! `aarc-studio join`: fields and packages, one after another, become the field folder of a take.

use std::path::PathBuf;

use program::output;
use serde_json::json;

use crate::messages::{count, decimal};
use crate::segments::{JoinPlan, JoinedTake};

use super::options::{JsonOption, OutOption};

/// Join fields and packages, one after another, into a field folder, which `package` makes a take of. The folder must not
/// exist, or be empty.
#[derive(clap::Args)]
pub struct Args {
    /// Fitted field files, folders holding one, packages or field folders, in the order in which they play
    #[arg(required = true, value_name = "FIELD")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    out: OutOption,
    #[command(flatten)]
    json: JsonOption,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    // Before the inputs are read.
    drop(output::OutputFolder::begin(&args.out.path)?);
    let plan = JoinPlan::new(&args.inputs)?;
    plan.notes.iter().for_each(|note| eprintln!("note: {note}"));
    let out = args.out.path.display();
    eprintln!("note: {out}: {:.1} MB of disk", plan.bytes as f64 * 1e-6);
    let JoinedTake { duration_s, segments, gaussians, bytes } = plan.write(&args.out.path)?;
    if args.json.is_given {
        let joined = json!({
            "out": args.out.path, "duration_s": duration_s, "segments": segments, "gaussians": gaussians, "bytes": bytes,
        });
        println!("{joined:#}");
    } else {
        let (segments, duration) = (count(segments, "segment"), decimal(duration_s, 3));
        println!("{out}: {duration} s in {segments}, {gaussians} Gaussians, {bytes} bytes");
    }
    Ok(())
}
