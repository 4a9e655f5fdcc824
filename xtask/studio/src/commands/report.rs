//! `aarc-studio report`: measures cost and error of playing, packaging and fitting a field, cost and error of several
//! segments over time, rate and distortion of packages, the stability of the renderer, and the ablation of a capture's fit.

mod ablation;
#[cfg(feature = "measure")]
mod page;
#[cfg(feature = "measure")]
mod stability;
#[cfg(feature = "measure")]
mod take;

use crate::input::segments_in;
use crate::progress::StagedProgress;
use crate::report::rd::{self, RdSettings};
use crate::report::{ReportPart, ReportSubject};
use ::program::{Fault, output};
use anyhow::bail;
use serde_json::Value;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Instant;

use self::ablation::{Comparison, Request, comparison};
use super::capture::PartSelection;
use super::fit::FitOptions;
use super::options::JsonOption;
use super::package::budget;
use super::render::size;

/// The files of a report.
const PAGE: &str = "report.html";
const NUMBERS: &str = "report.json";

/// Maximum number of pixels of a measured picture: about 60 pictures of 32 bytes per pixel are in memory at
/// once, a gigabyte.
const PIXELS_MAX: u64 = 1 << 19;

/// Measure a clip or a take, and write a page of error against run time and of what it does without.
#[derive(clap::Args)]
pub struct Args {
    /// A package, a fitted field file or a folder holding one, or a field folder; after a package of several segments, the
    /// field folder or the field that it was packaged from, to compare it with; several with --rd or --stability; with --fit the folder of a
    /// capture
    #[arg(value_name = "CLIP|TAKE|FIELD|CAPTURE", required_unless_present = "stability")]
    fields: Vec<PathBuf>,
    /// Instead, rate and distortion: what each budget costs and keeps, by several ways to choose the
    /// Gaussians
    #[arg(long, requires = "fields", group = "budgeted")]
    rd: bool,
    /// Instead, the ablation of CAPTURE's fit: fits without one part each, which hold out every other frame, their
    /// measures on all splits, and their packages. What the folder of the report holds already is not made again
    #[arg(long, requires = "fields", group = "budgeted", conflicts_with = "stability")]
    fit: bool,
    /// With --fit, another method: a folder of its pictures, named as the photographs are, a field or a package;
    /// repeatable
    #[arg(long, value_name = "NAME=FOLDER", requires = "fit", value_parser = comparison)]
    compare: Vec<Comparison>,
    /// Instead, stability: how far the GPU's pictures of stiff and extreme fields, and of these, are
    /// from the reference's
    #[arg(long)]
    stability: bool,
    /// Numbers of Gaussians to keep, for --rd and --fit [default: a half, a quarter and an eighth of a field of at most
    /// 10000 Gaussians; of a larger one those of 80000, 40000, 20000, 10000 and 5000 that are below its number]
    #[arg(long, value_name = "N[,N..]", value_delimiter = ',', requires = "budgeted", value_parser = budget)]
    budgets: Vec<NonZeroUsize>,
    /// Size of the pictures that are measured [default: 512x384; of several segments 320x240; with --rd 320x240, and 640x480 for the rate of
    /// the coder]; with --fit, size to shrink the photographs to [default: their own]
    #[arg(long, value_name = "WxH", value_parser = size, conflicts_with = "stability")]
    size: Option<[u32; 2]>,
    /// Folder of the capture that several segments were fitted to: compare them with all frames of a few cameras, at the
    /// cuts and between
    #[arg(long, value_name = "DIR", conflicts_with_all = ["rd", "stability", "fit"])]
    capture: Option<PathBuf>,
    /// Folder for the files of the report
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    out: PathBuf,
    #[command(flatten)]
    json: JsonOption,
    #[command(flatten, next_help_heading = "Of the photographs of --fit and --capture")]
    part: PartSelection,
    #[command(flatten, next_help_heading = "Of the fits of --fit")]
    options: FitOptions,
}

/// What was measured.
struct Measured {
    parts: Vec<ReportPart>,
    /// Cases of the stability suite that fail, and their number.
    failed: Option<(usize, usize)>,
}

/// What a page is of.
#[cfg_attr(not(feature = "measure"), expect(dead_code, reason = "nothing is measured"))]
struct PageSubject<'a> {
    path: &'a Path,
    /// Number of its segments. A page of one shows what playing, packaging and fitting cost, a page of several the cost and
    /// the error over time.
    segments: usize,
    /// What several segments are compared with.
    reference: Option<&'a Path>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    output::check_folder(&args.out)?;
    args.check_size()?;
    let page_of = args.page_of()?;
    #[cfg(not(feature = "measure"))]
    if args.stability || page_of.is_some() {
        let how = "this build does not measure: run `cargo run --release --package studio --features measure -- report`";
        return Err(Fault::Usage(how.into()).into());
    }
    let Measured { parts, failed } = args.measure(page_of)?;
    let bodies: Vec<(&str, &str)> =
        parts.iter().map(|part| (part.title.as_str(), part.body.as_str())).collect();
    let page = crate::page::page(&bodies);
    let text: Vec<&str> = parts.iter().map(|part| part.text.as_str()).collect();
    let text = text.join("\n");
    let json = format!("{:#}\n", Value::Object(parts.into_iter().flat_map(|part| part.json).collect()));
    write(&args.out, [(PAGE, &page), (NUMBERS, &json)])?;
    if args.json.is_given {
        print!("{json}");
    } else {
        print!("{text}");
        let (out, seconds) = (args.out.display(), start.elapsed().as_secs_f64());
        println!("\n{out}: {PAGE}, {NUMBERS}, written in {seconds:.1} s");
    }
    match failed {
        Some((failed, cases)) if failed > 0 => bail!("{failed} of {cases} cases fail"),
        _ => Ok(()),
    }
}

impl Args {
    /// What the page is of; `None` with `--rd`, `--stability` or `--fit`.
    fn page_of(&self) -> Result<Option<PageSubject<'_>>, Fault> {
        let looks_at_photographs = self.fit || self.capture.is_some();
        if !(self.fit || self.options.is_default()) || !(looks_at_photographs || self.part.is_default()) {
            let what = "--steps and the other options of fits need --fit, --frames and --cameras need --fit or --capture; \
                        add it, or leave them out";
            return Err(Fault::Usage(what.into()));
        }
        if self.rd || self.stability || self.fit {
            return Ok(None);
        }
        let (path, others) = match self.fields.as_slice() {
            [path, others @ ..] => (path, others),
            [] => return Ok(None),
        };
        let (name, segments) = (path.display(), segments_in(path)?);
        if others.len() > usize::from(segments > 1) {
            let what = "a page is of one field, or of several segments and the field that they were packaged from: name \
                        one, or choose --rd or --stability";
            return Err(Fault::Usage(what.into()));
        }
        if segments == 1 && self.capture.is_some() {
            let what = format!("--capture: {name} is one field, without cuts; leave it out");
            return Err(Fault::Usage(what));
        }
        Ok(Some(PageSubject { path, segments, reference: others.first().map(PathBuf::as_path) }))
    }

    fn check_size(&self) -> Result<(), Fault> {
        match self.size {
            Some([width, height]) if !self.fit && u64::from(width) * u64::from(height) > PIXELS_MAX => {
                let what = format!("--size {width}x{height}: choose at most {PIXELS_MAX} pixels");
                Err(Fault::Usage(what))
            }
            _ => Ok(()),
        }
    }

    fn measure(&self, page_of: Option<PageSubject<'_>>) -> anyhow::Result<Measured> {
        let mut parts = Vec::new();
        #[cfg_attr(not(feature = "measure"), expect(unused_mut, reason = "nothing is measured"))]
        let mut failed = None;
        #[cfg(feature = "measure")]
        match page_of {
            Some(PageSubject { path, segments: 1, .. }) => parts.push(self.page_part(path)?),
            Some(PageSubject { path, reference, .. }) => {
                let request = take::TakeRequest {
                    path,
                    reference,
                    size: self.size,
                    capture: self.capture.as_deref(),
                    part: &self.part,
                };
                parts.push(take::measure(&request)?.part()?);
            }
            None => {}
        }
        if self.fit {
            parts.push(self.ablation_part()?);
        } else if page_of.is_none() {
            let subjects = self
                .fields
                .iter()
                .map(|path| ReportSubject::load(path))
                .collect::<anyhow::Result<Vec<_>>>()?;
            if self.rd {
                let settings = self.rd_settings(&subjects)?;
                parts.push(rd_part(&subjects, &settings)?);
            }
            #[cfg(feature = "measure")]
            if self.stability {
                let measured = stability::run(&subjects)?;
                parts.push(measured.part()?);
                failed = Some((measured.failures(), measured.stability.len()));
            }
        }
        Ok(Measured { parts, failed })
    }

    #[cfg(feature = "measure")]
    fn page_part(&self, path: &Path) -> anyhow::Result<ReportPart> {
        page::measure(path, self.size.unwrap_or(page::SIZE))?.part()
    }

    fn ablation_part(&self) -> anyhow::Result<ReportPart> {
        let [capture] = self.fields.as_slice() else {
            bail!(Fault::Usage("--fit is of one capture: name one".into()));
        };
        let request = Request {
            capture,
            size: self.size.map(|[width, height]| (width, height)),
            part: &self.part,
            options: &self.options,
            budgets: self.budgets(),
            others: &self.compare,
            out: &self.out,
        };
        ablation::measure(&request)?.part()
    }

    fn budgets(&self) -> Vec<usize> {
        self.budgets.iter().map(|budget| budget.get()).collect()
    }

    /// What `--rd` measures; refuses budgets that no field is larger than.
    fn rd_settings(&self, subjects: &[ReportSubject]) -> Result<RdSettings, Fault> {
        let budgets = self.budgets();
        let largest = subjects.iter().map(|subject| subject.field.len()).max().unwrap_or(0);
        match budgets.iter().find(|&&budget| budget >= largest) {
            Some(budget) => Err(Fault::Usage(format!(
                "--budgets {budget}: the largest field has {largest} visible Gaussians, choose fewer"
            ))),
            None => Ok(RdSettings { budgets, size: self.size }),
        }
    }
}

/// Measures rate and distortion.
fn rd_part(subjects: &[ReportSubject], settings: &RdSettings) -> anyhow::Result<ReportPart> {
    let progress = StagedProgress::visible();
    let mut measured = Vec::new();
    for subject in subjects {
        progress.set_prefix(format!("{}: ", subject.scene.name));
        measured.push(rd::measure(subject, settings, &progress)?);
    }
    progress.finish();
    rd::part(&measured)
}

/// Writes the files, each whole or not at all, to the folder, which is made if it is missing.
fn write(folder: &Path, files: [(&str, &str); 2]) -> Result<(), Fault> {
    output::make_folder(folder)?;
    files.into_iter().try_for_each(|(name, text)| output::write(&folder.join(name), text.as_bytes()))
}
