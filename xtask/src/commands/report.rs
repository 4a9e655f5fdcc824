//! `cargo xtask report`: what the packages of fields cost and keep, measured.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use xtask::fault::Fault;
use xtask::output;
use xtask::report::{ReportFile, Subject, rd};

/// Measure fields and write the tables and plots.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Packages, fitted field files or folders holding one
    #[arg(required = true, value_name = "CLIP|FIELD")]
    fields: Vec<PathBuf>,
    /// Rate and distortion: what each budget costs and keeps, by several ways to choose the Gaussians
    #[arg(long, required = true)]
    rd: bool,
    /// Folder for the files of the report
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    out: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    check_folder(&args.out)?;
    let subjects = args.fields.iter().map(|path| Subject::load(path)).collect::<anyhow::Result<Vec<_>>>()?;
    let bar = ProgressBar::new(subjects.iter().map(rd::work).sum());
    // Drawn on a terminal's standard error only.
    let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta} left  {prefix}: {msg}")?;
    bar.set_style(style);
    let mut measured = Vec::new();
    for subject in &subjects {
        bar.set_prefix(subject.scene.name.clone());
        measured.push(rd::measure(subject, &bar)?);
    }
    bar.finish_and_clear();
    let files = rd::files(&measured)?;
    write(&args.out, &files)?;
    if args.json {
        println!("{:#}", json!({ "rd": measured }));
    } else {
        print!("{}", files[0].text);
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        let (out, seconds) = (args.out.display(), start.elapsed().as_secs_f64());
        println!("\n{out}: {}, written in {seconds:.1} s", names.join(", "));
    }
    Ok(())
}

/// Checks, before any work is done, that the folder is there or can be made.
fn check_folder(folder: &Path) -> Result<(), Fault> {
    match folder.metadata() {
        Ok(found) if found.is_dir() => Ok(()),
        Ok(_) => Err(Fault::Usage(format!("{} is a file, name a folder for the report", folder.display()))),
        Err(_) => output::check(folder),
    }
}

/// Writes the files, each whole or not at all, to the folder, which is made if it is missing.
fn write(folder: &Path, files: &[ReportFile]) -> Result<(), Fault> {
    if !folder.is_dir() {
        let fault = |error| Fault::Usage(format!("cannot make the folder {}: {error}", folder.display()));
        fs::create_dir(folder).map_err(fault)?;
    }
    files.iter().try_for_each(|file| output::write(&folder.join(&file.name), file.text.as_bytes()))
}
