//! What the coder takes for how much precision, and what its parts save: packages of the same
//! Gaussians, coded to several PSNRs against the field before coding.

use codec::{AttributeSize, Limits, Sensitivity, Source};
use refine::code::{TRIALS, code_knowing};
use refine::prune::Pictures;
use refine::reference::sensitivities;
use serde::Serialize;

use super::views::seen_views;
use crate::package::{LAYERS, compared_views, refused, render_scene};
use crate::progress::StagedProgress;
use crate::report::subject::ReportSubject;

/// PSNRs to code to, in dB.
const TARGETS_DB: [f64; 4] = [40.0, 45.0, 50.0, 55.0];

/// Number of Gaussians coded, or all if there are fewer.
const BUDGET: usize = 40_000;

/// A package of the most visible Gaussians, just as exact as asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoderRate {
    /// Number of Gaussians.
    pub gaussians: usize,
    /// PSNR in dB asked for.
    pub target_db: f64,
    /// PSNR in dB of pictures of the decoded package against pictures of what was coded.
    pub self_psnr_db: f64,
    /// Rate of a stream that brings the package while the clip plays once.
    pub mbps: f64,
    /// Size of the package.
    pub bytes: usize,
    /// The same per Gaussian, the plate's not counted.
    pub bytes_per_gaussian: f64,
    /// What simpler coders would make of it.
    pub simpler: SimplerCoders,
}

/// Sizes in bytes that a package would have without parts of the coder, each but the last without
/// those of the next ones either.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SimplerCoders {
    /// If each number took what its frequency in the package asks for.
    pub order_0: f64,
    /// If then the order of the Gaussians took nothing.
    pub ordered: f64,
    /// If then numbers were predicted; what the package saves beyond is due to contexts.
    pub predicted: f64,
    /// The whole coder, if all Gaussians were as exact as each other, at the same PSNR.
    pub alike: f64,
}

/// Codes the first rows of `order`.
pub(super) fn measure(
    subject: &ReportSubject,
    order: &[usize],
    progress: &StagedProgress,
) -> anyhow::Result<Vec<CoderRate>> {
    progress.stage("rates", 2 * TRIALS * TARGETS_DB.len());
    let step = || progress.step();
    let ReportSubject { scene, field, plate } = subject;
    let part = field.select(&order[..BUDGET.min(order.len())]);
    let source = Source { info: &scene.info, field: &part, plate: plate.as_ref() };
    let judge = Pictures::take(&render_scene(&part, plate.as_ref()), compared_views(scene, &part), || ());
    let visible = sensitivities(&part, plate.as_ref(), &seen_views(subject), || ());
    let unseeing = visible.as_ref().map(|(rows, footprint)| (vec![mean(rows); rows.len()], *footprint));
    let code = |target_db: f64, visible: &Option<(Vec<Sensitivity>, f32)>| {
        code_knowing(&source, &LAYERS, target_db, visible.clone(), &judge, step)
            .map_err(|error| refused(scene, error))
    };
    let rate = |target_db: f64| {
        let coded = code(target_db, &visible)?;
        let alike = code(target_db, &unseeing)?;
        Ok(CoderRate {
            gaussians: part.len(),
            target_db,
            self_psnr_db: coded.psnr_db,
            mbps: subject.mbps(coded.bytes.len()),
            bytes: coded.bytes.len(),
            bytes_per_gaussian: coded.bytes.len() as f64 / part.len() as f64,
            simpler: simpler(&coded.bytes, alike.bytes.len())?,
        })
    };
    TARGETS_DB.into_iter().map(rate).collect()
}

/// The root of the mean square, of which there is one at least.
fn mean(rows: &[Sensitivity]) -> Sensitivity {
    let of = |number: fn(&Sensitivity) -> f32| {
        let squares: f64 = rows.iter().map(|row| f64::from(number(row)).powi(2)).sum();
        (squares / rows.len() as f64).sqrt() as f32
    };
    Sensitivity { color: of(|row| row.color), geometry: of(|row| row.geometry) }
}

/// What simpler coders would make of a package, of which the last was tried.
fn simpler(package: &[u8], alike: usize) -> anyhow::Result<SimplerCoders> {
    let sizes = codec::measure(package, &Limits::default())?;
    let sum = |of: fn(&AttributeSize) -> f64| sizes.iter().map(of).sum::<f64>();
    // Headers and tables.
    let rest = package.len() as f64 - sum(|size| size.coded);
    let position = sizes.iter().filter(|size| size.attribute == "position");
    let order: f64 = position.map(|size| size.order_0 - size.predicted).sum();
    let order_0 = rest + sum(|size| size.order_0);
    let predicted = rest + sum(|size| size.predicted);
    Ok(SimplerCoders { order_0, ordered: order_0 - order, predicted, alike: alike as f64 })
}
