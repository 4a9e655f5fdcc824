//! Rate and distortion: what every budget of the ladder costs and keeps, by several ways to choose
//! the Gaussians (the paper's comparison of streaming packages).
//!
//! All ways rank the same field and share the coder, so they differ in what is kept and in nothing
//! else. A package is held against the field in pictures that neither the rankings nor the
//! selection have seen.

mod rates;
mod result;
mod text;
mod views;

use codec::{Field, Sensitivity, Source};
use refine::code::{TRIALS, code_knowing};
use refine::prune::{Floor, Measure, Pictures, ROUNDS, Ranking, Retained, Selection};
use refine::reference::{self, sensitivities};

use super::subject::ReportSubject;
use crate::package::{FieldAnalysis, LAYERS, PackageSettings, QUALITY_DB, floor, refused, render_scene};
use crate::progress::StagedProgress;

pub use rates::{CoderRate, SimplerCoders};
pub use result::{FieldRd, RatePoint, Selector};
pub use text::files;
use views::reported_views;
pub(super) use views::{coded_views, seen_views};

/// Measures every row at every layer end that is smaller than the field.
///
/// # Errors
/// [`Fault::Data`] where the field cannot be coded. Any other error is a defect of this program.
pub fn measure(subject: &ReportSubject, progress: &StagedProgress) -> anyhow::Result<FieldRd> {
    let settings = PackageSettings::default();
    let bench = RateBench::new(subject, &settings, progress)?;
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

/// What packages of a field are measured with.
struct RateBench<'a> {
    subject: &'a ReportSubject,
    progress: &'a StagedProgress,
    whole: FieldAnalysis<'a>,
    /// The floor of the paper, which sees what is gone but not what is cut off.
    recall: Floor,
    reported: Pictures,
    /// Of the rows of the field, and the blur they were seen with.
    sensitivities: Option<(Vec<Sensitivity>, f32)>,
}

/// A package of some rows of the field, measured.
struct CodedRows {
    rows: Vec<usize>,
    bytes: usize,
    psnr_db: f64,
}

/// Rows kept, and why.
struct SelectedRows {
    row: Selector,
    ranking: Ranking,
    kept: Retained,
}

impl<'a> RateBench<'a> {
    fn new(
        subject: &'a ReportSubject,
        settings: &'a PackageSettings,
        progress: &'a StagedProgress,
    ) -> anyhow::Result<RateBench<'a>> {
        let ReportSubject { scene, field, plate } = subject;
        let whole = FieldAnalysis::new(scene, field, plate.as_ref(), settings, progress)?;
        let recall = floor(field, Measure::Recall)?;
        let (reported, seen) = (reported_views(subject), seen_views(subject));
        progress.stage("pictures", reported.len() + seen.len());
        let reported = Pictures::take(&subject.to_reference(), reported, || progress.step());
        let sensitivities = sensitivities(field, plate.as_ref(), &seen, || progress.step());
        Ok(RateBench { subject, progress, whole, recall, reported, sensitivities })
    }

    /// The points of one budget.
    fn rows(&self, budget: usize) -> anyhow::Result<Vec<RatePoint>> {
        let leave = |row, ranking| {
            let kept = self.recall.leave(&self.whole.order(ranking), budget);
            SelectedRows { row, ranking, kept }
        };
        let order = self.whole.order(Ranking::Mass);
        self.progress.stage("topology floor", 1 + ROUNDS);
        let floored = self.recall.enforce(&order, budget, || self.progress.step());
        let Selection { mut candidates, best, .. } = self.whole.select(budget)?;
        let best = candidates.swap_remove(best);
        let choices = [
            leave(Selector::LightGaussian, Ranking::LightGaussian),
            leave(Selector::RadSplat, Ranking::BlendMax),
            leave(Selector::Mass, Ranking::Mass),
            SelectedRows { row: Selector::MassFloor, ranking: Ranking::Mass, kept: floored },
            SelectedRows { row: Selector::Ours, ranking: best.ranking, kept: best.retained },
        ];
        let mut packages = Vec::new();
        choices.into_iter().map(|choice| self.point(choice, &mut packages)).collect()
    }

    fn point(&self, choice: SelectedRows, packages: &mut Vec<CodedRows>) -> anyhow::Result<RatePoint> {
        let SelectedRows { row, ranking, kept: Retained { rows, topology, restored, .. } } = choice;
        let same = packages.iter().position(|package| package.rows == rows);
        let package = match same {
            Some(package) => &packages[package],
            None => {
                packages.push(self.code(rows)?);
                packages.last().expect("one was just added")
            }
        };
        let &CodedRows { bytes, psnr_db, ref rows } = package;
        Ok(RatePoint {
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
    fn code(&self, rows: Vec<usize>) -> anyhow::Result<CodedRows> {
        let ReportSubject { scene, field, plate } = self.subject;
        let part = field.select(&rows);
        let source = Source { info: &scene.info, field: &part, plate: plate.as_ref() };
        let visible = self.sensitivities.as_ref().map(|(sensitivities, footprint)| {
            (rows.iter().map(|&row| sensitivities[row]).collect(), *footprint)
        });
        self.progress.stage("coding", TRIALS);
        let judge = Pictures::take(&render_scene(&part, plate.as_ref()), coded_views(self.subject), || ());
        let coded = code_knowing(&source, &LAYERS, QUALITY_DB, visible, &judge, || self.progress.step())
            .map_err(|error| refused(scene, error))?;
        let psnr_db = self.reported.psnr(&reference::RenderScene::from(&coded.clip), || ());
        Ok(CodedRows { rows, bytes: coded.bytes.len(), psnr_db })
    }
}
