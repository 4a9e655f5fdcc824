//! [`package`]: a scene becomes the bytes of an `.aarc` package, and an account of what happened.
//!
//! Rows that can never be seen are left out; of the rest, `choose` keeps a budget's worth. These
//! are coded most important first in nested layers, decoded again, counted, rendered, and compared
//! with what was coded: `coding`.

mod choose;
pub(crate) mod coding;
mod ladder;
pub(crate) mod whole;

use std::collections::BTreeMap;

use clap::ValueEnum;
use codec::{ALPHA_MIN, Field};
use indicatif::ProgressBar;
use program::Fault;
use refine::prune::Ranking;
use serde::Serialize;

use crate::fit::{Refinement, RefinementReport};
use crate::import::{Imported, Repairs};
use crate::scene::Scene;
use choose::choose;
pub use choose::{Preserved, Tried};
use coding::Coded;
pub use coding::{Coding, LAYERS, QUALITY_DB};
pub use ladder::{Rung, ladder};

/// What to make of a scene.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Most Gaussians to keep, the plate's not counted; `None` keeps all that can be seen.
    pub budget: Option<usize>,
    /// The ranking that decides what a budget keeps; `None` tries all and takes the best.
    pub rank: Option<Ranking>,
    /// Let the ranking alone decide, whatever the topology loses.
    pub no_floor: bool,
    /// Fit the colours of what a budget keeps to pictures of the whole.
    pub recolor: bool,
    /// How the Gaussians are coded.
    pub coding: Coding,
    /// Parts to remove.
    pub drop: Vec<Part>,
    /// Refuse a scene whose files needed repairs.
    pub strict: bool,
}

/// A part of a field that a package can do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Rotation over time.
    Angular,
    /// View-dependent colour.
    Sh,
    /// The static background.
    Plate,
}

/// A finished package.
#[derive(Debug)]
pub struct Package {
    /// The contents of the file.
    pub bytes: Vec<u8>,
    /// How it came about.
    pub report: Report,
}

/// What went into a package, what was left out, and how faithful the rest is.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The field.
    #[serde(flatten)]
    pub subject: Counts,
    /// The background, where there is one.
    pub plate: Option<Counts>,
    /// Part removed to the number of Gaussians that had it.
    pub parts_removed: BTreeMap<&'static str, usize>,
    /// The order of importance.
    pub ranking: &'static str,
    /// What of the topology is preserved.
    pub topology: Preserved,
    /// PSNR in dB between pictures of the decoded package and of the whole field; `None` where
    /// nothing was left out for the budget.
    pub whole_psnr_db: Option<f64>,
    /// What was tried for the budget.
    pub tried: Vec<Tried>,
    /// Why the package holds what it holds of them; `None` where nothing was left out for the budget.
    pub why: Option<String>,
    /// Gain in dB of the recolouring, if asked for; it is used if above 0.
    #[serde(rename = "refit_gain_db")]
    pub recolor_gain_db: Option<f64>,
    /// What came of moving them towards photographs, if asked for.
    pub refined: Option<RefinementReport>,
    /// Number of Gaussians up to the end of each layer.
    pub layers: Vec<usize>,
    /// Length of the clip in seconds.
    pub duration_s: f32,
    /// Keys of `scene.json` that nobody gave, so that the package has their defaults.
    pub assumed: Vec<&'static str>,
    /// Size of the package.
    pub bytes: usize,
    /// How the Gaussians are coded.
    pub coder: &'static str,
    /// PSNR in dB between renders of the decoded package and of the field that was coded, over
    /// all pixels of all pictures; infinite where they are the same.
    pub self_psnr_db: f64,
}

/// Rows of a file on their way into the package.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Counts {
    /// Rows of the file.
    pub gaussians_in: usize,
    /// Rows packaged.
    pub gaussians_out: usize,
    /// Reason to number of rows left out; together they make up the difference.
    pub dropped: BTreeMap<&'static str, usize>,
    /// Reason to number of rows changed on import.
    pub repaired: BTreeMap<&'static str, usize>,
}

/// Makes a package.
///
/// The same scene and settings give the same bytes, on any number of threads.
///
/// # Errors
/// [`Fault::Data`] where nothing can be seen, numbers cannot be coded, or `strict` refuses.
/// Any other error is a defect of this program.
pub fn package(scene: &Scene, settings: &Settings) -> anyhow::Result<Package> {
    package_showing(scene, settings, None, &ProgressBar::hidden())
}

/// Makes a package, as [`package`] does, shows its progress where that takes long, and moves what is
/// kept towards photographs before it is coded, if asked for.
///
/// # Errors
/// Those of [`package`].
pub fn package_showing(
    scene: &Scene,
    settings: &Settings,
    refinement: Option<&Refinement>,
    progress: &ProgressBar,
) -> anyhow::Result<Package> {
    let Prepared { field, mut subject, plate, plate_counts, parts_removed } = prepare(scene, settings)?;
    let choice = choose(scene, &field, plate.as_ref(), settings, refinement, progress)?;
    let Coded { field: kept, bytes, clip, self_psnr_db } = choice.coded;
    subject.drop("over budget", field.len() - kept.len());
    subject.gaussians_out = kept.len();
    let report = Report {
        subject,
        plate: plate_counts,
        parts_removed,
        ranking: choice.ranking.name(),
        topology: choice.topology,
        whole_psnr_db: choice.psnr_db,
        tried: choice.tried,
        why: choice.why,
        recolor_gain_db: choice.recolor_gain_db,
        refined: choice.refined,
        layers: clip.layers.iter().map(|end| end.total()).collect(),
        duration_s: scene.info.duration_s,
        assumed: scene.assumed.clone(),
        bytes: bytes.len(),
        coder: settings.coding.name(),
        self_psnr_db,
    };
    Ok(Package { bytes, report })
}

/// What can be seen of a scene, without the parts to remove.
struct Prepared {
    field: Field,
    subject: Counts,
    plate: Option<Field>,
    plate_counts: Option<Counts>,
    parts_removed: BTreeMap<&'static str, usize>,
}

fn prepare(scene: &Scene, settings: &Settings) -> Result<Prepared, Fault> {
    if settings.strict {
        check_repairs(scene)?;
    }
    let drop = |part| settings.drop.contains(&part);
    let mut parts_removed = BTreeMap::new();

    let (mut field, subject) = visible(&scene.subject);
    let mut background = scene.plate.as_ref().map(visible);
    if drop(Part::Plate)
        && let Some((plate, _)) = background.take()
    {
        parts_removed.insert("plate", plate.len());
    }
    for part in [Part::Angular, Part::Sh] {
        if drop(part) {
            let plate = background.as_mut().map(|(plate, _)| plate);
            let removed = [Some(&mut field), plate].into_iter().flatten().map(|field| remove(part, field));
            parts_removed.insert(if part == Part::Sh { "sh" } else { "angular" }, removed.sum());
        }
    }

    if field.is_empty() {
        return Err(Fault::Data(format!("{}: no Gaussian that can be seen", scene.name)));
    }
    let (plate, plate_counts) = background.unzip();
    // A plate of which nothing can be seen is no plate.
    let plate = plate.filter(|plate| !plate.is_empty());
    Ok(Prepared { field, subject, plate, plate_counts, parts_removed })
}

impl Counts {
    fn drop(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.dropped.entry(reason).or_default() += rows;
        }
    }
}

/// Refuses a scene of which a row was changed or left out on import.
fn check_repairs(scene: &Scene) -> Result<(), Fault> {
    let refused = |what: &str, repairs: &Repairs| match repairs.is_empty() {
        true => Ok(()),
        false => Err(Fault::Data(format!("{what} is not in order and --strict refuses it: {repairs}"))),
    };
    refused(&scene.name, &scene.subject.repairs)?;
    scene.plate.as_ref().map_or(Ok(()), |plate| refused("the background plate", &plate.repairs))
}

/// The rows that can be seen at some instant of the clip, and the account of the others.
pub(crate) fn visible(imported: &Imported) -> (Field, Counts) {
    let Imported { field, repairs, .. } = imported;
    let rows: Vec<usize> = (0..field.len()).filter(|&i| field.alive_interval(i).is_some()).collect();
    let mut counts = Counts {
        gaussians_in: field.len() + repairs.dropped.values().sum::<usize>(),
        gaussians_out: rows.len(),
        dropped: repairs.dropped.clone(),
        repaired: repairs.repaired.clone(),
    };
    let faint = field.opacities.iter().filter(|&&opacity| f64::from(opacity) < ALPHA_MIN).count();
    counts.drop("opacity below 1/255", faint);
    counts.drop("never visible within the clip", field.len() - rows.len() - faint);
    (field.select(&rows), counts)
}

/// Removes a part of every Gaussian; how many of them had it.
fn remove(part: Part, field: &mut Field) -> usize {
    match part {
        Part::Angular => {
            let rates = field.temporal.as_mut().and_then(|temporal| temporal.rotation_rates.take());
            rates.unwrap_or_default().iter().filter(|rate| **rate != [0.0; 4]).count()
        }
        Part::Sh => {
            let has_sh = |i: &usize| field.sh_of(*i)[1..].iter().any(|c| *c != [0.0; 3]);
            let count = (0..field.len()).filter(has_sh).count();
            field.sh = (0..field.len()).map(|i| field.sh_of(i)[0]).collect();
            field.sh_degree = 0;
            count
        }
        Part::Plate => 0,
    }
}
