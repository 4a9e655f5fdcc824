//! [`package`]: the stages of packaging, one after another.

use codec::Field;
use program::Fault;
use refine::code::Miss;
use refine::fit::{Backend, Cpu};

use super::choose::choose;
use super::encode::{VerifiedPackage, encode, explain};
use super::lens_fragments::lens_fragments;
use super::report::{PackageReport, Shortfall, WorstView};
use super::settings::PackageSettings;
use super::visible::{VisibleScene, visible_scene};
use crate::fit::{Refinement, RefinementReport};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// Refinement steps per progress step.
const STEPS_PER_PROGRESS: u64 = 16;

/// A finished package.
#[derive(Debug)]
pub struct Package {
    /// The contents of the file.
    pub bytes: Vec<u8>,
    /// What went into it.
    pub report: PackageReport,
}

/// Makes a package.
///
/// The same scene and settings give the same bytes, on any number of threads.
///
/// # Errors
/// [`program::Fault::Data`] where no Gaussian is visible, numbers cannot be coded, or `strict` refuses a
/// repair. Any other error is a defect of this program.
pub fn package(scene: &Scene, settings: &PackageSettings) -> anyhow::Result<Package> {
    package_with(scene, settings, None, &mut Cpu::default(), &StagedProgress::hidden())
}

/// Makes a package as [`package`] does, refines the retained Gaussians on photographs,
/// and draws `progress`. `backend` computes the gradients of refining and of joint rounding. With a graphics device, the
/// package is marked, for another may give other bytes.
///
/// # Errors
/// As [`package`]; [`program::Fault::Device`] if the device fails.
pub fn package_with(
    scene: &Scene,
    settings: &PackageSettings,
    refinement: Option<&Refinement>,
    backend: &mut dyn Backend,
    progress: &StagedProgress,
) -> anyhow::Result<Package> {
    let VisibleScene { field, mut subject, plate, plate_counts, parts_removed } =
        visible_scene(scene, settings)?;
    let mut choice = choose(scene, &field, plate.as_ref(), settings, progress)?;
    let refine = |refinement| refine_field(&mut choice.field, refinement, backend, progress);
    let refined = refinement.map(refine).transpose()?;
    let VerifiedPackage { coded, snapped, steering_views, rounding_views, judging_views } =
        encode(scene, &choice.field, plate.as_ref(), settings.coding, backend, progress)?;
    let lens_fragments = lens_fragments(&field, plate.as_ref(), &coded.clip);
    let whole_psnr_db = choice.whole_psnr_db(&coded.clip);
    progress.finish();
    let within_budget = settings.budget.map_or(field.len(), |budget| budget.min(field.len()));
    subject.drop("over budget", field.len() - within_budget);
    subject.drop("over the budget of fragments", within_budget - choice.field.len());
    subject.gaussians_out = choice.field.len();
    let report = PackageReport {
        subject,
        plate: plate_counts,
        parts_removed,
        ranking: choice.ranking.name(),
        layer_ranking: choice.layer_ranking.name(),
        tried_orders: choice.tried_orders,
        topology: choice.topology,
        whole_psnr_db,
        tried: choice.tried,
        why: choice.why,
        snapped,
        recolor_gain_db: choice.recolor_gain_db,
        refined,
        layers: coded.clip.layers.iter().map(|end| end.total()).collect(),
        lens_fragments,
        duration_s: scene.info.duration_s,
        assumed: scene.assumed.clone(),
        bytes: coded.bytes.len(),
        coder: settings.coding.name(),
        self_psnr_db: coded.fidelity.psnr_db,
        covered_psnr_db: coded.fidelity.covered_psnr_db,
        worst_view: coded.fidelity.worst.as_ref().map(|worst| WorstView::new(worst, &scene.info)),
        bytes_alone: coded.bytes_alone,
        steering_views,
        rounding_views,
        judging_views,
        miss: settings.coding.quality_db().zip(coded.miss).map(|(quality_db, miss)| Shortfall {
            is_below: miss == Miss::Below,
            text: explain(miss, quality_db, &coded.fidelity),
        }),
    };
    Ok(Package { bytes: coded.bytes, report })
}

/// Refines `field` on the photographs; its rows stay in order.
fn refine_field(
    field: &mut Field,
    refinement: &Refinement,
    backend: &mut dyn Backend,
    progress: &StagedProgress,
) -> Result<RefinementReport, Fault> {
    progress.stage("refining", (refinement.steps / STEPS_PER_PROGRESS) as usize);
    let mut steps = 0;
    let on_step = || {
        steps += 1;
        if steps % STEPS_PER_PROGRESS == 0 {
            progress.step();
        }
    };
    let refined = refinement.run(field, backend, on_step);
    let (refined, report) = refined.map_err(|error| Fault::Device(error.to_string()))?;
    *field = refined;
    Ok(report)
}
