//! What the coder takes for how much precision: packages of the same Gaussians, coded to several
//! PSNRs against the field before coding.

use codec::Source;
use indicatif::ProgressBar;
use refine::code::{CodeError, TRIALS, code};
use refine::prune::Pictures;
use serde::Serialize;

use super::{SEEN_WORK, seen_shots};
use crate::fault::Fault;
use crate::package::coding::LAYERS;
use crate::package::whole::{compared_shots, scene_of};
use crate::report::Subject;

/// PSNRs to code to, in dB.
const TARGETS_DB: [f64; 4] = [40.0, 45.0, 50.0, 55.0];

/// Number of Gaussians coded, or all if there are fewer.
const BUDGET: usize = 40_000;

/// A package of the most visible Gaussians, just as exact as asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rate {
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
}

/// How far the progress advances in [`measure`].
pub(super) fn work(subject: &Subject) -> u64 {
    let compared = compared_shots(&subject.scene, &subject.field).len();
    let steps = seen_shots(subject).len() + TRIALS;
    SEEN_WORK * (compared + steps * TARGETS_DB.len()) as u64
}

/// Codes the first rows of `order`.
pub(super) fn measure(
    subject: &Subject,
    order: &[usize],
    progress: &ProgressBar,
) -> anyhow::Result<Vec<Rate>> {
    progress.set_message("rates");
    let step = || progress.inc(SEEN_WORK);
    let Subject { scene, field, plate } = subject;
    let part = field.select(&order[..BUDGET.min(order.len())]);
    let source = Source { info: &scene.info, field: &part, plate: plate.as_ref() };
    let judge = Pictures::take(&scene_of(&part, plate.as_ref()), compared_shots(scene, &part), step);
    let rate = |target_db: f64| {
        let coded = code(&source, &LAYERS, target_db, &seen_shots(subject), &judge, step).map_err(
            |error| match error {
                CodeError::Encode(error) => Fault::Data(format!("{}: {error}", scene.name)).into(),
                CodeError::Decode(error) => anyhow::Error::from(error),
            },
        )?;
        Ok(Rate {
            gaussians: part.len(),
            target_db,
            self_psnr_db: coded.psnr_db,
            mbps: subject.mbps(coded.bytes.len()),
            bytes: coded.bytes.len(),
            bytes_per_gaussian: coded.bytes.len() as f64 / part.len() as f64,
        })
    };
    TARGETS_DB.into_iter().map(rate).collect()
}
