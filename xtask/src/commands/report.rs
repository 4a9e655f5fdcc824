//! `cargo xtask report`: what the packages of fields cost and keep, and how stable the renderer is,
//! measured.

mod stability;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::bail;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value};
use xtask::fault::Fault;
use xtask::output;
use xtask::report::{ReportFile, Subject, rd};

/// Measure fields and the renderer, and write the tables and plots.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("measures").required(true).multiple(true)))]
pub(crate) struct Args {
    /// Packages, fitted field files or folders holding one
    #[arg(value_name = "CLIP|FIELD")]
    fields: Vec<PathBuf>,
    /// Rate and distortion: what each budget costs and keeps, by several ways to choose the Gaussians
    #[arg(long, group = "measures", requires = "fields")]
    rd: bool,
    /// Stability: how far the GPU's pictures of stiff and extreme fields, and of these, are from the
    /// reference's
    #[arg(long, group = "measures")]
    stability: bool,
    /// Folder for the files of the report
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    out: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// What the report is made of.
#[derive(Default)]
struct Report {
    files: Vec<ReportFile>,
    /// For the terminal.
    text: String,
    json: Map<String, Value>,
    /// Cases of the stability suite that fail, and their number.
    failed: Option<(usize, usize)>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    check_folder(&args.out)?;
    let subjects = args.fields.iter().map(|path| Subject::load(path)).collect::<anyhow::Result<Vec<_>>>()?;
    let mut report = Report::default();
    if args.rd {
        report.add_rd(&subjects)?;
    }
    if args.stability {
        report.add_stability(&args.fields)?;
    }
    write(&args.out, &report.files)?;
    if args.json {
        println!("{:#}", Value::Object(report.json));
    } else {
        print!("{}", report.text);
        let names: Vec<&str> = report.files.iter().map(|file| file.name.as_str()).collect();
        let (out, seconds) = (args.out.display(), start.elapsed().as_secs_f64());
        println!("\n{out}: {}, written in {seconds:.1} s", names.join(", "));
    }
    match report.failed {
        Some((failed, cases)) if failed > 0 => bail!("{failed} of {cases} cases fail"),
        _ => Ok(()),
    }
}

impl Report {
    fn add_rd(&mut self, subjects: &[Subject]) -> anyhow::Result<()> {
        let bar = ProgressBar::new(subjects.iter().map(rd::work).sum());
        // Drawn on a terminal's standard error only.
        let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta} left  {prefix}: {msg}")?;
        bar.set_style(style);
        let mut measured = Vec::new();
        for subject in subjects {
            bar.set_prefix(subject.scene.name.clone());
            measured.push(rd::measure(subject, &bar)?);
        }
        bar.finish_and_clear();
        let files = rd::files(&measured)?;
        self.text += &files[0].text;
        self.files.extend(files);
        self.json.insert("rd".into(), serde_json::to_value(measured)?);
        Ok(())
    }

    fn add_stability(&mut self, fields: &[PathBuf]) -> anyhow::Result<()> {
        let measured = stability::run(fields)?;
        self.text += &measured.table();
        self.files.extend(xtask::report::stability::files(&measured)?);
        self.failed = Some((measured.failures(), measured.stability.len()));
        if let Value::Object(json) = serde_json::to_value(measured)? {
            self.json.extend(json);
        }
        Ok(())
    }
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
