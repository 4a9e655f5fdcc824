//! The ablation of a capture: opens the capture and what it is compared with, and goes through the variants.
//!
//! Each result has a record beside it in the folder of the report, so that a second run makes only what is missing:
//!
//! ```text
//! DIR/FIT/field.ply, field.fit.csv   DIR/FIT/eval.csv, pictures   DIR/FIT/BUDGET.aarc, BUDGET.csv
//! DIR/compared-NAME/eval.csv, pictures                             DIR/photographs
//! ```

mod bench;

use std::path::{Path, PathBuf};

use anyhow::bail;
use codec::Camera;
use program::{Fault, output};

use self::bench::{Bench, EVAL, HOLDOUT, is_of_data, pictured};
use crate::capture::CaptureFiles;
use crate::commands::capture::{PartSelection, describe, note_assumed_fps};
use crate::commands::fit::{FitOptions, name_of};
use crate::commands::takes::check_apart;
use crate::eval::Subject;
use crate::fit::FitPlan;
use crate::machine::machine;
use crate::report::ablation::{Ablation, FullFit, VARIANTS};
use crate::report::rd;
use crate::takes::key;

/// What to fit and measure, and where.
pub(super) struct Request<'a> {
    pub(super) capture: &'a Path,
    /// Size to shrink the photographs to.
    pub(super) size: Option<(u32, u32)>,
    pub(super) part: &'a PartSelection,
    pub(super) options: &'a FitOptions,
    /// Budgets of packages; if empty, the budgets of `--rd` for a field of as many Gaussians as the fit is asked for.
    pub(super) budgets: Vec<usize>,
    pub(super) others: &'a [Comparison],
    /// The folder of the report.
    pub(super) out: &'a Path,
}

/// Another method.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    name: String,
    /// What `eval` takes.
    subject: PathBuf,
}

/// Parses `NAME=FOLDER`.
pub(super) fn comparison(text: &str) -> Result<Comparison, String> {
    let parts = text.split_once('=').filter(|(name, subject)| !name.is_empty() && !subject.is_empty());
    let (name, subject) = parts.ok_or("NAME=FOLDER, such as RetimeGS=renders/")?;
    match name.contains(['/', '\\']) || name.starts_with('.') {
        true => Err("the name becomes a folder's: leave slashes and a first dot out".into()),
        false => Ok(Comparison { name: name.into(), subject: subject.into() }),
    }
}

/// Fits and measures what the folder of the report lacks, and collects all of it.
pub(super) fn measure(request: &Request) -> anyhow::Result<Ablation> {
    let Request { capture, size, part, options, others, out, .. } = *request;
    options.check_settings(None, false, false)?;
    let mut capture_files = part.open(capture, size)?;
    check_apart(capture, out)?;
    options.state_fps(&mut capture_files)?;
    for (i, method) in others.iter().enumerate() {
        if others[..i].iter().any(|other| other.name == method.name) {
            bail!(Fault::Usage(format!("--compare: two methods are called {}; rename one", method.name)));
        }
    }
    let subjects = others.iter().map(|method| load_other(&method.subject, &capture_files));
    let subjects = subjects.collect::<anyhow::Result<Vec<_>>>()?;
    let lpips = options.lpips.load()?;
    let plate = options.plate.find(&mut capture_files, HOLDOUT)?;
    let plan = options.plan(&capture_files, HOLDOUT, plate)?;
    let full = FullFit {
        mirrors: plan.mirror.is_possible(capture_files.capture.frames(), !plan.anchor_cameras.is_empty()),
        lpips: plan.lpips.clone(),
        plan: FitPlan { lpips: None, ..plan },
    };
    note_assumed_fps(&capture_files, "--set fps=N states another number");
    output::make_folder(out)?;
    let mut ablation = about(capture, &capture_files, &full.plan)?;
    ablation.lpips = lpips.as_ref().map(|lpips| lpips.network().to_string());
    let mut bench = Bench {
        out,
        options,
        photographs_key: key(EVAL, &full.plan.capture, &[capture])?,
        pictured: pictured(&capture_files)?,
        capture_files,
        lpips,
        views: None,
        ablation,
    };
    bench.photographs()?;
    let budgets = package_budgets(&request.budgets, full.plan.gaussians);
    for (i, variant) in VARIANTS.iter().enumerate() {
        let Some(plan) = (variant.plan)(&full) else {
            bench.leave_out(variant.name, variant.absent);
            continue;
        };
        let budgets = if i == 0 { &budgets[..] } else { &budgets[..budgets.len().min(1)] };
        match bench.variant(variant, &plan, budgets) {
            // What a part is needed for shows in the fit without it: it may have nothing left to draw.
            Err(error) if i > 0 && is_of_data(&error) => bench.leave_out(variant.name, &format!("{error:#}")),
            result => result?,
        }
    }
    for (method, subject) in others.iter().zip(&subjects) {
        bench.other(&method.name, &method.subject, subject)?;
    }
    Ok(bench.ablation)
}

/// An ablation without results.
fn about(capture: &Path, capture_files: &CaptureFiles, plan: &FitPlan) -> Result<Ablation, Fault> {
    let Camera { width, height, .. } = capture_files.capture.cameras[0].camera;
    Ok(Ablation {
        capture: name_of(capture),
        machine: machine(),
        photographs: describe(capture_files, HOLDOUT)?,
        size: [width, height],
        steps: plan.steps,
        gaussians: plan.gaussians,
        lpips: None,
        methods: Vec::new(),
        packages: Vec::new(),
        left_out: Vec::new(),
        views: Vec::new(),
    })
}

/// Loads another method's pictures, field or package, before any fit.
fn load_other(path: &Path, capture_files: &CaptureFiles) -> anyhow::Result<Subject> {
    let subject = Subject::load(path, capture_files).map_err(|error| match path.is_dir() && is_of_data(&error) {
        true => {
            let example = capture_files.capture.photos.first().map_or_else(String::new, |first| capture_files.name(*first));
            let path = path.display();
            anyhow::Error::from(Fault::Data(format!(
                "--compare: {path} holds no picture of a photograph; name the pictures as the photographs, such as \
                 {path}/{example}.png"
            )))
        }
        false => error,
    })?;
    subject.check(capture_files)?;
    Ok(subject)
}

/// Budgets of packages of fits with this many Gaussians, the largest first.
fn package_budgets(requested: &[usize], gaussians: usize) -> Vec<usize> {
    if requested.is_empty() {
        return rd::budgets(gaussians, &[]);
    }
    let mut budgets = requested.to_vec();
    budgets.sort_unstable();
    budgets.dedup();
    budgets.reverse();
    budgets
}
