//! Rate and distortion: what every budget of the ladder costs and keeps, by several ways to choose
//! the Gaussians (the paper's comparison of streaming packages).
//!
//! All ways rank the same field and share the coder, so they differ in what is kept and in nothing
//! else. A package is held against the field in pictures that neither the rankings nor the
//! selection have seen.

mod rates;
mod text;

use codec::{Field, Sensitivity, Source};
use indicatif::ProgressBar;
use program::Fault;
use refine::code::{CodeError, TRIALS, code_knowing};
use refine::prune::{
    Floor, Measure, Pictures, PosedView, Ranking, Retained, Selection, instants, posed_views,
};
use refine::reference::{self, sensitivities};
use serde::Serialize;

use super::Subject;
use crate::package::Settings;
use crate::package::coding::{LAYERS, QUALITY_DB};
use crate::package::whole::{
    CODE_WORK, CODED_SIZE, JUDGING_PLACES, PICTURE_WORK, Places, RANKING_PLACES, Whole, enforce,
    enforce_work, floor, ranking_shots, scene_of, shots_of, verify_work,
};
use crate::scene::Scene;

pub use rates::{Rate, Simpler};
pub use text::files;

/// Size in pixels of the pictures that are reported on.
const SIZE: (u32, u32) = (320, 240);

/// Where they are taken from: not where pictures rank, and not where they judge.
const PLACES: Places = Places { aside: 8.0, turn: 0.25 };

/// Number of instants at which they are taken. Their middles of equal parts are not those of the
/// pictures that rank and judge.
const INSTANTS: usize = 2;

/// Pictures that tell how exactly a package is coded: one of this many of the places and times that
/// judge, in the size that is reported on.
const CODED_STRIDE: usize = 4;

/// Pictures that tell the coder what is visible: one of this many of those that tell `package`.
const SEEN_STRIDE: usize = 3;

/// Work of one of them, which are larger than those that are reported on.
pub(super) const SEEN_WORK: u64 = 8;

/// A way to choose which Gaussians a package keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Row {
    /// The first by LightGaussian's global significance.
    #[serde(rename = "LightGaussian")]
    LightGaussian,
    /// The first by RadSplat's largest blending contribution.
    #[serde(rename = "RadSplat")]
    RadSplat,
    /// The first by visibility mass.
    #[serde(rename = "mass")]
    Mass,
    /// The same with the topology floor, which restores what is gone (the paper's measure).
    #[serde(rename = "mass + floor")]
    MassFloor,
    /// Of all rankings, with and without the topology floor, which also restores what is cut off, the
    /// one whose package reproduces the field best.
    #[serde(rename = "ours")]
    Ours,
}

impl Row {
    const ALL: [Row; 5] = [Row::LightGaussian, Row::RadSplat, Row::Mass, Row::MassFloor, Row::Ours];

    fn name(self) -> &'static str {
        match self {
            Row::LightGaussian => "LightGaussian",
            Row::RadSplat => "RadSplat",
            Row::Mass => "mass",
            Row::MassFloor => "mass + floor",
            Row::Ours => "ours",
        }
    }
}

/// What was measured of a field.
#[derive(Clone, Debug, Serialize)]
pub struct FieldRd {
    /// The field's name.
    pub field: String,
    /// Number of Gaussians that can be seen, the plate's not counted.
    pub gaussians: usize,
    /// Length of the clip in seconds.
    pub duration_s: f32,
    /// Whether nobody said how long the clip is.
    pub duration_assumed: bool,
    /// How the packages are coded.
    pub coder: &'static str,
    /// Number of persistent features of its density, over all reference instants.
    pub features: usize,
    /// One per budget and row, the largest budget first.
    pub points: Vec<Point>,
    /// What the coder takes for how much precision.
    pub rates: Vec<Rate>,
}

/// A package, measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Gaussians kept.
    pub budget: usize,
    /// The way they were chosen.
    pub row: Row,
    /// The ranking behind it.
    pub ranking: &'static str,
    /// Gaussians that the floor kept in spite of their rank.
    pub restored: usize,
    /// PSNR in dB of pictures of the decoded package against pictures of the field, over all pixels
    /// of all pictures.
    pub psnr_db: f64,
    /// Part of the features that is preserved: the paper's rate.
    pub recall: f64,
    /// Part of what is found that is a feature of the field; the rest are pieces cut off.
    pub precision: f64,
    /// Harmonic mean of both.
    pub f1: f64,
    /// Mean change of the density at which a preserved feature ends, in units of the largest.
    pub saddle_drift: f64,
    /// Rate of a stream that brings the package while the clip plays once.
    pub mbps: f64,
    /// Size of the package.
    pub bytes: usize,
    /// The same per Gaussian, the plate's not counted.
    pub bytes_per_gaussian: f64,
}

/// How far the progress advances in [`measure`].
pub fn work(subject: &Subject) -> u64 {
    let Subject { scene, field, .. } = subject;
    let settings = Settings::default();
    let reported = PICTURE_WORK * reported_shots(subject).len() as u64;
    let rows = Row::ALL.len() as u64 * (coded_work(subject) + reported);
    let compared = 3 * verify_work(field) + enforce_work(field);
    let per_budget = Whole::select_work(scene, field, &settings) + compared + rows;
    Whole::look_work(scene, field, &settings)
        + verify_work(field)
        + reported
        + SEEN_WORK * seen_shots(subject).len() as u64
        + per_budget * budgets(field).count() as u64
        + rates::work(subject)
}

/// Measures every row at every budget of the ladder that is smaller than the field. `progress`
/// advances by [`work`].
///
/// # Errors
/// [`Fault::Data`] where the field cannot be coded. Any other error is a defect of this program.
pub fn measure(subject: &Subject, progress: &ProgressBar) -> anyhow::Result<FieldRd> {
    let settings = Settings::default();
    let bench = Bench::new(subject, &settings, progress)?;
    let mut points = Vec::new();
    for budget in budgets(&subject.field) {
        points.extend(bench.rows(budget)?);
    }
    Ok(FieldRd {
        field: subject.scene.name.clone(),
        gaussians: subject.field.len(),
        duration_s: subject.scene.info.duration_s,
        duration_assumed: subject.scene.assumed.contains(&"duration_s"),
        coder: settings.coding.name(),
        features: bench.recall.features(),
        points,
        rates: rates::measure(subject, &bench.whole.order(Ranking::BlendSum), progress)?,
    })
}

/// The budgets that make a difference, the largest first.
fn budgets(field: &Field) -> impl Iterator<Item = usize> {
    LAYERS.into_iter().rev().filter(|&budget| budget < field.len())
}

fn reported_shots(subject: &Subject) -> Vec<PosedView> {
    let Subject { scene, field, .. } = subject;
    let placed = shots_of(scene, field, PLACES, SIZE);
    // The same cameras at other instants.
    let first = placed.first().map(|shot| shot.t);
    let cameras: Vec<_> = placed.into_iter().filter(|shot| Some(shot.t) == first).map(|s| s.camera).collect();
    let known = ranking_shots(scene, field);
    let is_new = |shot: &PosedView| {
        !known.iter().any(|known| known.t == shot.t && known.camera.position() == shot.camera.position())
    };
    posed_views(&cameras, &instants(field, INSTANTS)).into_iter().filter(is_new).collect()
}

/// Pictures that tell how exactly a package is coded.
pub(super) fn coded_shots(subject: &Subject) -> Vec<PosedView> {
    shots_of(&subject.scene, &subject.field, JUDGING_PLACES, SIZE).into_iter().step_by(CODED_STRIDE).collect()
}

/// Work of coding a package.
fn coded_work(subject: &Subject) -> u64 {
    let compared = PICTURE_WORK * coded_shots(subject).len() as u64;
    compared + TRIALS as u64 * (CODE_WORK + compared)
}

/// Pictures that tell the coder what is visible.
pub(super) fn seen_shots(subject: &Subject) -> Vec<PosedView> {
    let shots = shots_of(&subject.scene, &subject.field, RANKING_PLACES, CODED_SIZE);
    shots.into_iter().step_by(SEEN_STRIDE).collect()
}

/// What packages of a field are measured with.
struct Bench<'a> {
    subject: &'a Subject,
    progress: &'a ProgressBar,
    whole: Whole<'a>,
    /// The floor of the paper, which sees what is gone but not what is cut off.
    recall: Floor,
    reported: Pictures,
    /// Of the rows of the field, and the blur they were seen with.
    sensitivities: Option<(Vec<Sensitivity>, f32)>,
}

/// A package of some rows of the field, measured.
struct Coded {
    rows: Vec<usize>,
    bytes: usize,
    psnr_db: f64,
}

/// Rows kept, and why.
struct Choice {
    row: Row,
    ranking: Ranking,
    kept: Retained,
}

impl<'a> Bench<'a> {
    fn new(
        subject: &'a Subject,
        settings: &'a Settings,
        progress: &'a ProgressBar,
    ) -> anyhow::Result<Bench<'a>> {
        let Subject { scene, field, plate } = subject;
        let whole = Whole::look(scene, field, plate.as_ref(), settings, progress)?;
        let recall = floor(field, Measure::Recall)?;
        progress.inc(verify_work(field));
        let pictured = || progress.inc(PICTURE_WORK);
        let reported = Pictures::take(&subject.to_reference(), reported_shots(subject), pictured);
        let seen = || progress.inc(SEEN_WORK);
        let sensitivities = sensitivities(field, plate.as_ref(), &seen_shots(subject), seen);
        Ok(Bench { subject, progress, whole, recall, reported, sensitivities })
    }

    /// The points of one budget.
    fn rows(&self, budget: usize) -> anyhow::Result<Vec<Point>> {
        let leave = |row, ranking| {
            let kept = self.recall.leave(&self.whole.order(ranking), budget);
            self.progress.inc(verify_work(&self.subject.field));
            Choice { row, ranking, kept }
        };
        let order = self.whole.order(Ranking::Mass);
        let floored = enforce(&self.recall, &self.subject.field, &order, budget, self.progress);
        let Selection { mut candidates, best, .. } = self.whole.select(budget)?;
        let best = candidates.swap_remove(best);
        let choices = [
            leave(Row::LightGaussian, Ranking::LightGaussian),
            leave(Row::RadSplat, Ranking::BlendMax),
            leave(Row::Mass, Ranking::Mass),
            Choice { row: Row::MassFloor, ranking: Ranking::Mass, kept: floored },
            Choice { row: Row::Ours, ranking: best.ranking, kept: best.retained },
        ];
        let mut packages = Vec::new();
        choices.into_iter().map(|choice| self.point(choice, &mut packages)).collect()
    }

    fn point(&self, choice: Choice, packages: &mut Vec<Coded>) -> anyhow::Result<Point> {
        let Choice { row, ranking, kept: Retained { rows, topology, restored, .. } } = choice;
        let same = packages.iter().position(|package| package.rows == rows);
        let package = match same {
            Some(package) => {
                let pictures = reported_shots(self.subject).len() as u64;
                self.progress.inc(coded_work(self.subject) + PICTURE_WORK * pictures);
                &packages[package]
            }
            None => {
                packages.push(self.code(rows)?);
                packages.last().expect("one was just added")
            }
        };
        let &Coded { bytes, psnr_db, ref rows } = package;
        Ok(Point {
            budget: rows.len(),
            row,
            ranking: ranking.name(),
            restored,
            psnr_db,
            recall: topology.recall(),
            precision: topology.precision(),
            f1: topology.f1(),
            saddle_drift: topology.saddle_drift(),
            mbps: self.subject.mbps(bytes),
            bytes,
            bytes_per_gaussian: bytes as f64 / rows.len() as f64,
        })
    }

    /// Codes the rows, decodes them again and looks at them.
    fn code(&self, rows: Vec<usize>) -> anyhow::Result<Coded> {
        let Subject { scene, field, plate } = self.subject;
        let part = field.select(&rows);
        let source = Source { info: &scene.info, field: &part, plate: plate.as_ref() };
        let visible = self.sensitivities.as_ref().map(|(sensitivities, footprint)| {
            (rows.iter().map(|&row| sensitivities[row]).collect(), *footprint)
        });
        let pictured = || self.progress.inc(PICTURE_WORK);
        let compared = coded_shots(self.subject);
        let trial_work = CODE_WORK + PICTURE_WORK * compared.len() as u64;
        let judge = Pictures::take(&scene_of(&part, plate.as_ref()), compared, pictured);
        let tried = || self.progress.inc(trial_work);
        let coded = code_knowing(&source, &LAYERS, QUALITY_DB, visible, &judge, tried)
            .map_err(|error| refused(scene, error))?;
        let psnr_db = self.reported.psnr(&reference::RenderScene::from(&coded.clip), pictured);
        Ok(Coded { rows, bytes: coded.bytes.len(), psnr_db })
    }
}

/// Why `scene` cannot be packaged.
pub(super) fn refused(scene: &Scene, error: CodeError) -> anyhow::Error {
    match error {
        CodeError::Encode(error) => Fault::Data(format!("{}: {error}", scene.name)).into(),
        CodeError::Decode(error) => error.into(),
    }
}
