//! `aarc-studio trim`: a part of a take as a take of its own, without coding it anew.

use std::path::PathBuf;

use program::{counted, output};
use serde_json::json;

use crate::messages::decimal;
use crate::segments::{TakeFile, TrimmedTake, trim};

use super::options::{JsonOption, OutOption};

/// Cut a part out of a take. Segments that overlap it are kept as they are, so it costs no quality and no time.
#[derive(clap::Args)]
pub struct Args {
    /// Package: a take or an ordinary clip
    take: PathBuf,
    /// Second of the take at which the part begins
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from: f64,
    /// Second of the take at which it ends
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to: f64,
    #[command(flatten)]
    out: OutOption,
    #[command(flatten)]
    json: JsonOption,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    output::check(&args.out.path)?;
    let file = TakeFile::open(&args.take)?;
    let trimmed = trim(&file, args.from, args.to, &args.out.path)?;
    let TrimmedTake { duration_s, source_s, segments, source_segments, bytes, before_s, after_s, .. } =
        trimmed;
    if args.json.is_given {
        let trimmed = json!({
            "out": args.out.path, "duration_s": duration_s, "segments": segments, "bytes": bytes,
            "hidden_before_s": before_s, "hidden_after_s": after_s, "poster_lost": trimmed.is_poster_lost,
        });
        println!("{trimmed:#}");
        return Ok(());
    }
    let [duration, source, before, after] =
        [duration_s, source_s, before_s, after_s].map(|seconds| decimal(seconds, 3));
    println!(
        "{}: {duration} of {source} s, {segments} of {}, {bytes} bytes",
        args.out.path.display(),
        counted(source_segments, "segment")
    );
    if before_s > 0.0 || after_s > 0.0 {
        println!(
            "not shown, but still in the file: up to {before} s before the part and {after} s after it, of segments that overlap it"
        );
    }
    if trimmed.is_poster_lost {
        let out = args.out.path.display();
        println!(
            "the poster was left behind, as it is of another time; aarc-studio poster {out} --time S sets another"
        );
    }
    Ok(())
}
