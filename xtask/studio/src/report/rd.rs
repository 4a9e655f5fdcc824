//! Rate and distortion at every budget, for several ways to select the Gaussians (the paper's comparison of
//! streaming packages).
//!
//! All selectors rank the same field and share the coder, so their packages differ only in the retained rows.
//! Packages are compared with the field in images that neither the rankings nor the selection use.

mod part;
mod rates;
mod result;
mod views;

use refine::fit::Cpu;
use refine::prune::{Floor, Measure, Pictures, ROUNDS, Ranking, Retained, Selection};
use refine::reference;

use super::subject::ReportSubject;
use crate::package::{CODED_SIZE, FieldAnalysis, LAYERS, PackageSettings, encode, floor};
use crate::progress::StagedProgress;

pub use part::part;
pub use rates::CoderRate;
pub use result::{FieldRd, RatePoint, Selector};
use views::{SIZE, reported_views};

/// What to measure.
#[derive(Clone, Debug, Default)]
pub struct RdSettings {
    /// Numbers of Gaussians; if empty, the ends of layers below the size of the field, or parts of a small
    /// field.
    pub budgets: Vec<usize>,
    /// Width and height in pixels of the images compared; by default 320x240, and for the rate of the coder
    /// the width and height of `package`.
    pub size: Option<[u32; 2]>,
}

/// Measures every selector at every budget below the size of the field.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) if the field cannot be coded. Any other error is a defect of this program.
pub fn measure(
    subject: &ReportSubject,
    rd: &RdSettings,
    progress: &StagedProgress,
) -> anyhow::Result<FieldRd> {
    let settings = PackageSettings::default();
    let image_size = rd.size.unwrap_or(SIZE);
    let rate_image_size = rd.size.unwrap_or(CODED_SIZE.into());
    let bench = RateBench::new(subject, &settings, image_size, progress)?;
    let mut points = Vec::new();
    for budget in budgets(subject.field.len(), &rd.budgets) {
        points.extend(bench.points(budget)?);
    }
    Ok(FieldRd {
        field: subject.scene.name.clone(),
        gaussians: subject.field.len(),
        duration_s: subject.scene.info.duration_s,
        duration_assumed: subject.scene.assumed.contains(&"duration_s"),
        coder: settings.coding.name(),
        features: bench.recall.features(),
        image_size,
        points,
        rate_image_size,
        rates: rates::measure(subject, &bench.analysis.order(Ranking::BlendSum), rate_image_size, progress)?,
    })
}

/// The budgets below the size of a field, the largest first: those `requested`, or else the ends of layers. Fewer
/// than two of these make no curve: a half, a quarter and an eighth of the field take their place.
pub(crate) fn budgets(len: usize, requested: &[usize]) -> Vec<usize> {
    let below = |budgets: &[usize]| {
        let mut below: Vec<usize> = budgets.iter().copied().filter(|&budget| budget < len).collect();
        below.sort_unstable();
        below.dedup();
        below.reverse();
        below
    };
    if !requested.is_empty() {
        return below(requested);
    }
    match below(&LAYERS) {
        layers if layers.len() >= 2 => layers,
        _ => [2, 4, 8].map(|part| len / part).into_iter().filter(|&budget| budget > 0).collect(),
    }
}

/// Measures packages of one field.
struct RateBench<'a> {
    subject: &'a ReportSubject,
    progress: &'a StagedProgress,
    analysis: FieldAnalysis<'a>,
    /// The paper's floor, which detects deleted features but not severed ones.
    recall: Floor,
    reported: Pictures,
    settings: &'a PackageSettings,
}

/// Size and PSNR of a package of some rows of the field.
struct CodedRows {
    rows: Vec<usize>,
    bytes: usize,
    psnr_db: f64,
}

/// The rows that a selector retains.
struct SelectedRows {
    row: Selector,
    ranking: Ranking,
    retained: Retained,
}

impl<'a> RateBench<'a> {
    fn new(
        subject: &'a ReportSubject,
        settings: &'a PackageSettings,
        image_size: [u32; 2],
        progress: &'a StagedProgress,
    ) -> anyhow::Result<RateBench<'a>> {
        let ReportSubject { scene, field, plate } = subject;
        let analysis = FieldAnalysis::new(scene, field, plate.as_ref(), settings, progress)?;
        let recall = floor(field, Measure::Recall);
        let reported = reported_views(subject, image_size);
        progress.stage("images", reported.len());
        let reported = Pictures::take(&subject.to_reference(), reported, || progress.step());
        Ok(RateBench { subject, progress, analysis, recall, reported, settings })
    }

    /// The points of all selectors at one budget.
    fn points(&self, budget: usize) -> anyhow::Result<Vec<RatePoint>> {
        let leave = |row, ranking| {
            let retained = self.recall.leave(&self.analysis.order(ranking), budget);
            SelectedRows { row, ranking, retained }
        };
        let order = self.analysis.order(Ranking::Mass);
        self.progress.stage("topology floor", 1 + ROUNDS);
        let floored = self.recall.enforce(&order, budget, || self.progress.step());
        let Selection { mut candidates, best, .. } = self.analysis.select(budget);
        let best = candidates.swap_remove(best);
        // In the order of layers, as `package` codes them.
        let rows = self.analysis.layer_order(&best).rows;
        let choices = [
            leave(Selector::LightGaussian, Ranking::LightGaussian),
            leave(Selector::RadSplat, Ranking::BlendMax),
            leave(Selector::Mass, Ranking::Mass),
            SelectedRows { row: Selector::MassFloor, ranking: Ranking::Mass, retained: floored },
            SelectedRows {
                row: Selector::Ours,
                ranking: best.ranking,
                retained: Retained { rows, ..best.retained },
            },
        ];
        let mut packages = Vec::new();
        choices.into_iter().map(|choice| self.point(choice, &mut packages)).collect()
    }

    fn point(&self, choice: SelectedRows, packages: &mut Vec<CodedRows>) -> anyhow::Result<RatePoint> {
        let SelectedRows { row, ranking, retained: Retained { rows, topology, restored, .. } } = choice;
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

    /// Codes the rows as `package` does, and compares the images of the package with the field's.
    fn code(&self, rows: Vec<usize>) -> anyhow::Result<CodedRows> {
        let ReportSubject { scene, field, plate } = self.subject;
        let part = field.select(&rows);
        let coded =
            encode(scene, &part, plate.as_ref(), self.settings.coding, &mut Cpu::default(), self.progress)?
                .coded;
        let psnr_db = self.reported.psnr(&reference::RenderScene::from(&coded.clip), || ());
        Ok(CodedRows { rows, bytes: coded.bytes.len(), psnr_db })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_are_below_the_size_of_the_field() {
        assert_eq!(budgets(62_040, &[]), [40_000, 20_000, 10_000, 5_000]);
        assert_eq!(budgets(10_001, &[]), [10_000, 5_000]);
        assert_eq!(budgets(9_418, &[]), [4_709, 2_354, 1_177], "one layer's end makes no curve");
        assert_eq!((budgets(3, &[]), budgets(1, &[])), (vec![1], vec![]));
        assert_eq!(budgets(9_418, &[500, 5_000, 500, 20_000]), [5_000, 500]);
    }
}
