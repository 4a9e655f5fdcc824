//! Rate of the coder over its precision, and the savings of precision by visibility and of joint rounding: packages of the
//! same Gaussians, coded to several PSNRs against the Gaussians before coding.

use std::num::NonZero;

use codec::Source;
use refine::code::{JOINT_ROUNDS, JointRounding, TRIALS, TargetCoder, code_steps};
use refine::fit::Cpu;
use refine::prune::Pictures;
use refine::reference::{RenderScene, sensitivities};
use serde::Serialize;

use super::views::reported_views;
use crate::package::{
    LAYERS, Shown, compared_views, refused, render_scene, rounding_views, show, visibility_views,
};
use crate::progress::StagedProgress;
use crate::report::subject::ReportSubject;

/// Target PSNRs in dB.
const TARGETS_DB: [f64; 4] = [40.0, 45.0, 50.0, 55.0];

/// Maximum number of Gaussians coded.
const BUDGET: usize = 40_000;

/// A package of the most visible Gaussians, coded to a target PSNR.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoderRate {
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Target PSNR in dB.
    pub target_db: f64,
    /// PSNR in dB of images of the decoded package against images of the Gaussians before coding, in views that chose
    /// nothing.
    pub self_psnr_db: f64,
    /// Bit rate in Mbit/s of streaming the package in the duration of the clip.
    pub mbps: f64,
    /// Size of the package in bytes.
    pub bytes: usize,
    /// Bytes per Gaussian, without counting the plate's Gaussians.
    pub bytes_per_gaussian: f64,
    /// Size in bytes with equal precision for all Gaussians, at the same target.
    pub alike: usize,
    /// Size in bytes with numbers that are rounded jointly, at the same target.
    pub jointly: usize,
}

/// Codes the first rows of `order` to every target PSNR, in images of this `size`.
pub(super) fn measure(
    subject: &ReportSubject,
    order: &[usize],
    size: [u32; 2],
    progress: &StagedProgress,
) -> anyhow::Result<Vec<CoderRate>> {
    let step = |step| show(step, progress);
    let ReportSubject { scene, field, plate } = subject;
    let part = field.select(&order[..BUDGET.min(order.len())]);
    let source = Source { info: &scene.info, field: &part, plate: plate.as_ref() };
    let shown = Shown { field: &part, plate: plate.as_ref() };
    let compared = compared_views(scene, shown, size.into());
    let judge = Pictures::take(&render_scene(&part, plate.as_ref()), compared, || ());
    let reported = Pictures::take(&render_scene(&part, plate.as_ref()), reported_views(subject, size), || ());
    let visible = sensitivities(&part, plate.as_ref(), &visibility_views(scene, shown, size.into()), || ());
    let views = rounding_views(scene, &part);
    let rounds = NonZero::new(JOINT_ROUNDS).expect("a default above 0");
    let mut backend = Cpu::default();
    let mut joint = JointRounding::new(views, rounds, &mut backend);
    let mut coder = TargetCoder::new(&source, &LAYERS, visible, &judge);
    progress.stage("rates", (2 * TRIALS + code_steps(JOINT_ROUNDS)) * TARGETS_DB.len());
    let rate = |target_db: f64| {
        let coded = coder.code(target_db, step).map_err(|error| refused(scene, error))?;
        let alike = coder.code_equally(target_db, step).map_err(|error| refused(scene, error))?;
        let jointly =
            coder.code_jointly(target_db, &mut joint, step).map_err(|error| refused(scene, error))?;
        Ok(CoderRate {
            gaussians: part.len(),
            target_db,
            self_psnr_db: reported.psnr(&RenderScene::from(&coded.clip), || ()),
            mbps: subject.mbps(coded.bytes.len()),
            bytes: coded.bytes.len(),
            bytes_per_gaussian: coded.bytes.len() as f64 / part.len() as f64,
            alike: alike.bytes.len(),
            jointly: jointly.bytes.len(),
        })
    };
    TARGETS_DB.into_iter().map(rate).collect()
}
