//! `--list`: runs a command for each take of a list and writes a summary.

use crate::messages::count;
use crate::takes::{List, ListedTake, OutputState, Record, Shard, key};
use anyhow::{anyhow, bail};
use program::{Fault, exit_code, output};
use serde::Serialize;
use serde_json::{Value, json};
use std::any::Any;
use std::fs;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Options of what is written, and for which takes.
#[derive(clap::Args, Clone, Debug, Default)]
pub(super) struct TakeOptions {
    /// File to write [default: the input's name in the current folder, with .ply of a fit and .aarc of a package]
    #[arg(short, long, value_name = "PATH")]
    pub(super) out: Option<PathBuf>,
    /// Run for each take of a list: a text file with a path in each line, relative to its folder. --out is
    /// then the folder for the outputs, a record beside each, and a summary. An output is made again only if
    /// its take or an option changes. A failed take does not stop the others
    #[arg(long, value_name = "FILE", requires = "out", group = "shared")]
    pub(super) list: Option<PathBuf>,
    /// Run only the I-th of N equal shares of the list, from 0/N to N-1/N
    #[arg(long, value_name = "I/N", requires = "shared")]
    pub(super) shard: Option<Shard>,
}

impl TakeOptions {
    /// The list and the folder of its outputs, if there is a list.
    pub(super) fn list_and_folder(&self) -> Option<(&Path, &Path)> {
        self.list.as_deref().zip(self.out.as_deref())
    }
}

/// A command that is run for each take.
pub(super) struct TakeCommand<'a> {
    pub(super) command: &'static str,
    /// Extension of its outputs.
    pub(super) ending: &'static str,
    /// Everything that the output depends on besides the take and `inputs`.
    pub(super) options: String,
    pub(super) inputs: Vec<&'a Path>,
    /// Removes unfinished work on an output that was begun from other inputs.
    pub(super) forget: fn(&Path) -> Result<(), Fault>,
    /// Whether the summary is printed as JSON.
    pub(super) json: bool,
}

/// The outcome of a take.
#[derive(Serialize)]
struct Outcome<'a> {
    scene: &'a Path,
    out: PathBuf,
    outcome: &'static str,
    seconds: f64,
    error: Option<String>,
    exit_code: u8,
}

/// Calls `make` with each unfinished take of a shard and the path of its output, records the returned report,
/// and writes a summary.
///
/// # Errors
/// [`Fault::Usage`] if the folder is unusable; after all takes, a fault of the kind of the first failure.
// Long: the loop over takes and the account of each outcome share all of their state.
pub(super) fn run(
    takes: &List,
    shard: Option<Shard>,
    folder: &Path,
    job: &TakeCommand,
    make: &mut dyn FnMut(&ListedTake, &Path) -> anyhow::Result<Value>,
) -> anyhow::Result<()> {
    output::make_folder(folder)?;
    let shard = shard.unwrap_or(Shard::ALL);
    let mut outcomes = Vec::new();
    for take in takes.in_shard(shard) {
        let out = folder.join(format!("{}.{}", take.name, job.ending));
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| run_take(take, &out, job, make)));
        let result = result.unwrap_or_else(|panic| {
            Err(anyhow!("a defect of this program, to be reported: {}", text(&*panic)))
        });
        let (outcome, error) = match result {
            Ok(outcome) => (outcome, None),
            Err(error) => ("failed", Some(error)),
        };
        let exit_code = error.as_ref().map_or(0, |error| exit_code(error.as_ref()));
        let error = error.map(|error| format!("{error:#}"));
        let outcome = Outcome {
            scene: &take.path,
            out,
            outcome,
            seconds: start.elapsed().as_secs_f64(),
            error,
            exit_code,
        };
        if !job.json {
            print_outcome(&outcome)?;
        }
        outcomes.push(outcome);
    }
    let number_of = |what| outcomes.iter().filter(|outcome| outcome.outcome == what).count();
    let summary = json!({
        "command": job.command, "list": takes.path, "shard": shard.to_string(),
        "done": number_of("done"), "skipped": number_of("skipped"), "failed": number_of("failed"), "takes": outcomes,
    });
    let text = format!("{summary:#}\n");
    let path = folder.join(format!("{}-{}.summary.json", job.command, shard.file_name()));
    output::write(&path, text.as_bytes())?;
    if job.json {
        print!("{text}");
    }
    let mut failed = outcomes.iter().filter(|outcome| outcome.error.is_some());
    let Some(first) = failed.next() else { return Ok(()) };
    let message = format!(
        "{} of {} failed, {} first; see {}",
        1 + failed.count(),
        count(outcomes.len(), "take"),
        first.scene.display(),
        path.display()
    );
    match first.exit_code {
        2 => bail!(Fault::Usage(message)),
        3 => bail!(Fault::Data(message)),
        5 => bail!(Fault::Device(message)),
        _ => bail!(message),
    }
}

/// Makes the output of a take unless it is done.
fn run_take(
    take: &ListedTake,
    out: &Path,
    job: &TakeCommand,
    make: &mut dyn FnMut(&ListedTake, &Path) -> anyhow::Result<Value>,
) -> anyhow::Result<&'static str> {
    // A meta.json needs the images beside it.
    let is_index = take.path.file_name().is_some_and(|name| name == "meta.json");
    let scene = if is_index { output::folder_of(&take.path) } else { &take.path };
    check_apart(scene, out)?;
    let inputs: Vec<&Path> = [scene].into_iter().chain(job.inputs.iter().copied()).collect();
    let key = key(job.command, &job.options, &inputs)?;
    match Record::state(out, job.command, &key)? {
        OutputState::Done => return Ok("skipped"),
        OutputState::Stale => (job.forget)(out)?,
        OutputState::Begun | OutputState::Unknown => {}
    }
    Record::begin(out, job.command, &key)?;
    let report = make(take, out)?;
    Record::complete(out, job.command, &key, report)?;
    Ok("done")
}

/// Checks that an output, a file or a folder, is neither its take nor inside it: writing it would change the take.
///
/// # Errors
/// [`Fault::Usage`] that names both.
pub(super) fn check_apart(scene: &Path, out: &Path) -> Result<(), Fault> {
    // A take that cannot be found has an error of its own.
    let (Ok(take), Ok(path)) = (fs::canonicalize(scene), std::path::absolute(out)) else { return Ok(()) };
    let existing = fs::canonicalize(&path).ok();
    // A file takes the place of a link with its name, and a folder is made in the first one above it that exists.
    let around = path.ancestors().skip(1).find_map(|folder| fs::canonicalize(folder).ok());
    let (out, scene) = (out.display(), scene.display());
    if existing.as_ref() == Some(&take) {
        return Err(Fault::Usage(format!("{out} is what the output is made from: name another --out")));
    }
    match [existing, around].iter().flatten().any(|place| place.starts_with(&take)) {
        true => Err(Fault::Usage(format!(
            "{out} would lie within {scene}, which it is made from: name another --out"
        ))),
        false => Ok(()),
    }
}

/// Prints a line about a take.
fn print_outcome(outcome: &Outcome) -> anyhow::Result<()> {
    let Outcome { scene, out, outcome, seconds, error, .. } = outcome;
    match error {
        Some(error) => println!("{outcome:8} {}: {error}", scene.display()),
        None => println!("{outcome:8} {}, {seconds:.1} s", out.display()),
    }
    Ok(std::io::stdout().flush()?)
}

/// The message of a panic.
fn text(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or(panic.downcast_ref::<&str>().copied()).unwrap_or("it ended early")
}

/// Parser of the seconds of a part of a take.
pub(super) fn part_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.01..=3600.0).contains(seconds));
    seconds.ok_or_else(|| "a number of seconds from 0.01 to 3600".into())
}
