//! `--list`: a command for each of many takes, and what came of them.

use crate::takes::{List, Record, Shard, Standing, Take, key};
use anyhow::{anyhow, bail};
use program::{Fault, output};
use serde::Serialize;
use serde_json::{Value, json};
use std::any::Any;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Which takes.
#[derive(clap::Args, Clone, Debug, Default)]
pub(super) struct Many {
    /// Do it for many: a text file with a path in each line, relative to its folder. --out is then the
    /// folder for NAME's output, a record beside each, by which it is not made again until the take or
    /// an option changes, and the summary. A take that fails holds no other up
    #[arg(long, value_name = "FILE", requires = "out")]
    pub(super) list: Option<PathBuf>,
    /// Do only the I-th of N equal parts of the list, from 0/N to N-1/N
    #[arg(long, value_name = "I/N", requires = "list")]
    pub(super) shard: Option<Shard>,
}

/// What is done with each take.
pub(super) struct Job<'a> {
    pub(super) command: &'static str,
    /// Ending of its output.
    pub(super) ending: &'static str,
    /// All that the output depends on besides the take.
    pub(super) options: String,
    pub(super) inputs: Vec<&'a Path>,
    /// Forgets half a work on an output, of something else.
    pub(super) forget: fn(&Path) -> Result<(), Fault>,
    /// Whether the summary is printed as JSON.
    pub(super) json: bool,
}

/// What came of a take.
#[derive(Serialize)]
struct Outcome<'a> {
    scene: &'a Path,
    out: PathBuf,
    outcome: &'static str,
    seconds: f64,
    error: Option<String>,
    exit_code: u8,
}

/// Has `make` make the output, at the path that comes second, of each take of a list that is not done yet,
/// and writes a summary. What `make` returns is kept in the record.
///
/// # Errors
/// [`Fault::Usage`] where the folder is unusable; the kind of the first failure, after all takes,
/// where any failed.
pub(super) fn run(
    takes: &List,
    shard: Option<Shard>,
    folder: &Path,
    job: &Job,
    make: &mut dyn FnMut(&Take, &Path) -> anyhow::Result<Value>,
) -> anyhow::Result<()> {
    make_folder(folder)?;
    let shard = shard.unwrap_or(Shard::ALL);
    let mut outcomes = Vec::new();
    for take in takes.of(shard) {
        let out = folder.join(format!("{}.{}", take.name, job.ending));
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| one(take, &out, job, make)));
        let result =
            result.unwrap_or_else(|panic| Err(anyhow!("a defect of this program: {}", text(&*panic))));
        let (outcome, error) = match result {
            Ok(outcome) => (outcome, None),
            Err(error) => ("failed", Some(error)),
        };
        let exit_code = error.as_ref().map_or(0, exit_code);
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
            tell(&outcome)?;
        }
        outcomes.push(outcome);
    }
    let count = |what| outcomes.iter().filter(|outcome| outcome.outcome == what).count();
    let summary = json!({
        "command": job.command, "list": takes.path, "shard": shard.to_string(),
        "done": count("done"), "skipped": count("skipped"), "failed": count("failed"), "takes": outcomes,
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
        "{} of {} takes failed, {} first; {} says why",
        1 + failed.count(),
        outcomes.len(),
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

/// Makes the folder of the outputs, if it is not there.
pub(super) fn make_folder(folder: &Path) -> Result<(), Fault> {
    std::fs::create_dir_all(folder)
        .map_err(|error| Fault::Usage(format!("cannot make the folder {}: {error}", folder.display())))
}

/// Makes the output of a take, unless it is done.
fn one(
    take: &Take,
    out: &Path,
    job: &Job,
    make: &mut dyn FnMut(&Take, &Path) -> anyhow::Result<Value>,
) -> anyhow::Result<&'static str> {
    // The images of such a file are beside it.
    let is_index = take.path.file_name().is_some_and(|name| name == "meta.json");
    let scene = match take.path.parent().filter(|_| is_index) {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => &take.path,
    };
    check_apart(scene, out)?;
    let inputs: Vec<&Path> = [scene].into_iter().chain(job.inputs.iter().copied()).collect();
    let key = key(job.command, &job.options, &inputs)?;
    match Record::standing(out, job.command, &key) {
        Standing::Done => return Ok("skipped"),
        Standing::Stale => (job.forget)(out)?,
        Standing::Begun | Standing::Unknown => {}
    }
    Record::begin(out, job.command, &key)?;
    let report = make(take, out)?;
    Record::complete(out, job.command, &key, report)?;
    Ok("done")
}

/// Checks that an output is not within its take, which it would change.
fn check_apart(scene: &Path, out: &Path) -> Result<(), Fault> {
    let within = || {
        let folder = std::fs::canonicalize(out.parent()?).ok()?;
        Some(folder.starts_with(std::fs::canonicalize(scene).ok()?))
    };
    match within() {
        Some(true) => Err(Fault::Usage(format!(
            "{} would lie within {}, which it is made from: name another --out",
            out.display(),
            scene.display()
        ))),
        _ => Ok(()),
    }
}

/// A line for people, as soon as there is something to say.
fn tell(outcome: &Outcome) -> anyhow::Result<()> {
    let Outcome { scene, out, outcome, seconds, error, .. } = outcome;
    match error {
        Some(error) => println!("{outcome:8} {}: {error}", scene.display()),
        None => println!("{outcome:8} {}, {seconds:.1} s", out.display()),
    }
    Ok(std::io::stdout().flush()?)
}

fn exit_code(error: &anyhow::Error) -> u8 {
    error.downcast_ref::<Fault>().map_or(1, Fault::exit_code)
}

/// What a panic says.
fn text(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or(panic.downcast_ref::<&str>().copied()).unwrap_or("it ended early")
}
