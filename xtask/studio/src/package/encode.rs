//! Gaussians in order of importance become bytes, which are decoded again and verified.

use std::num::NonZero;

use anyhow::{anyhow, ensure};
use codec::{Clip, Coder, EncodeError, EncodeOptions, Field, Limits, Source};
use program::Fault;
use refine::code::{
    CodeError, CodeStep, Coded, JointRounding, Miss, PackageTarget, WORST_BELOW_DB, code, code_steps,
};
use refine::fit::Backend;
use refine::prune::{Fidelity, Pictures};
use refine::reference::RenderScene;

use super::settings::{Coding, LAYERS};
use super::snap::{Snapped, snap};
use super::views::{
    CODED_SIZE, Shown, compared_views, render_scene, reported_views, rounding_views, visibility_views,
};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// What to do about a package that a defect of this program spoilt.
const DEFECT: &str = "report this defect of the program with the field";

/// A verified package.
pub(crate) struct VerifiedPackage {
    pub(crate) coded: Coded,
    /// What was made static before coding.
    pub(super) snapped: Snapped,
    /// Number of views that measured the visibility of coding errors.
    pub(super) steering_views: usize,
    /// Number of other views for which numbers were rounded jointly.
    pub(super) rounding_views: usize,
    /// Number of further views that judged the result.
    pub(super) judging_views: usize,
    /// What is reported of the package: from views that chose nothing, where no viewpoint is stated.
    pub(super) reported: Fidelity,
}

/// Makes static what only seems to change, and encodes a field in layers, most important row first, to the precision
/// of `coding`; decodes the package, compares it with the field as given, and verifies that every Gaussian is there.
/// `backend` computes the gradients of joint rounding.
///
/// # Errors
/// [`Fault::Data`] where the field cannot be coded, or players would not read the package.
pub(crate) fn encode(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    coding: Coding,
    backend: &mut dyn Backend,
    progress: &StagedProgress,
) -> anyhow::Result<VerifiedPackage> {
    let compared = compared_views(scene, Shown { field, plate }, CODED_SIZE);
    progress.stage("pictures to code by", compared.len());
    let judging_views = compared.len();
    let judge = Pictures::take(&render_scene(field, plate), compared, || progress.step());
    progress.stage("snapping", 1);
    let views = visibility_views(scene, Shown { field, plate }, CODED_SIZE);
    let whole = field;
    let (field, snapped) = &snap(field, &views, coding);
    let info = scene.head_info();
    let source = Source { info: &info, field, plate };
    let by_device = backend.device().is_some();
    let (coded, steering_views, rounding_views) = match coding {
        Coding::Fixed => {
            let (bytes, clip) = encode_fixed(scene, &source, by_device)?;
            let fidelity = judge.compare(&RenderScene::from(&clip), || ());
            (Coded { bytes, clip, fidelity, miss: None, bytes_alone: None }, 0, 0)
        }
        Coding::ToQuality { quality_db, joint_rounds } => {
            let rounding = NonZero::new(joint_rounds).map(|rounds| (rounds, rounding_views(scene, field)));
            let rounding_count = rounding.as_ref().map_or(0, |(_, views)| views.len());
            let mut joint = rounding.map(|(rounds, views)| JointRounding::new(views, rounds, backend));
            progress.stage("coding", views.len() + code_steps(joint_rounds));
            let target = PackageTarget { layers: &LAYERS, psnr_db: quality_db, by_device };
            let coded = code(&source, target, &views, &judge, joint.as_mut(), |step| show(step, progress))
                .map_err(|error| refused(scene, error))?;
            (coded, views.len(), rounding_count)
        }
    };
    let clip = &coded.clip;
    let decoded_plate = clip.plate.as_ref().map(Field::len);
    let is_whole = (clip.len(), decoded_plate) == (field.len(), plate.map(Field::len));
    ensure!(is_whole, "{}: the package does not decode to all of the field; {DEFECT}", scene.name);
    progress.stage("reporting", 1);
    let reported = match reported_views(scene, Shown { field: whole, plate }, CODED_SIZE) {
        Some(views) => {
            let pictures = Pictures::take(&render_scene(whole, plate), views, || ());
            pictures.compare(&RenderScene::from(clip), || ())
        }
        None => coded.fidelity.clone(),
    };
    Ok(VerifiedPackage { coded, snapped: *snapped, steering_views, rounding_views, judging_views, reported })
}

/// Shows what coding does.
pub(crate) fn show(step: CodeStep, progress: &StagedProgress) {
    match step {
        CodeStep::Done => progress.step(),
        CodeStep::Trial { what, number, most } => {
            progress.say(&format!("coding, {what}, trial {number} of at most {most}"));
        }
    }
}

/// Encodes a field by the coder `fixed`, and decodes it again.
fn encode_fixed(scene: &Scene, source: &Source, by_device: bool) -> anyhow::Result<(Vec<u8>, Clip)> {
    let options =
        EncodeOptions { coder: Coder::Fixed, layers: LAYERS.to_vec(), by_device, ..EncodeOptions::default() };
    let bytes = codec::encode(source, &options).map_err(|error| refused(scene, CodeError::Encode(error)))?;
    let clip = codec::decode(&bytes, &Limits::default());
    let clip = clip.map_err(|error| refused(scene, CodeError::Decode(error)))?;
    Ok((bytes, clip))
}

/// One sentence on why a package does not have its target PSNR.
pub(super) fn explain(miss: Miss, quality_db: f64, fidelity: &Fidelity) -> String {
    let reached_db = fidelity.psnr_db;
    let worst_db = fidelity.worst.as_ref().map_or(reached_db, |worst| worst.psnr_db);
    match miss {
        Miss::Below => format!(
            "{quality_db} dB, and {WORST_BELOW_DB} dB less in the worst view, are out of reach: the closest \
             package has {reached_db:.1} dB and {worst_db:.1} dB"
        ),
        Miss::Above => format!(
            "{reached_db:.1} dB, above the target of {quality_db} dB: the next coarser precision is below it"
        ),
        Miss::AboveForWorst => format!(
            "{reached_db:.1} dB, above the target of {quality_db} dB, so that no view is more than \
             {WORST_BELOW_DB} dB below the target"
        ),
    }
}

/// The error of a scene that cannot be packaged.
pub(crate) fn refused(scene: &Scene, error: CodeError) -> anyhow::Error {
    match error {
        CodeError::Encode(error) => {
            let step = match error {
                EncodeError::Info { .. } => "set another in scene.json",
                EncodeError::TooLarge => "choose a --budget",
                _ => "export the field again",
            };
            Fault::Data(format!("{}: {error}; {step}", scene.name)).into()
        }
        CodeError::Device(error) => Fault::Device(error.to_string()).into(),
        CodeError::Decode(error @ codec::Error::Limits { .. }) => {
            let what = format!("{}: {error}, which is more than players read; choose a --budget", scene.name);
            Fault::Data(what).into()
        }
        CodeError::Decode(error) => {
            anyhow!("{}: the package cannot be decoded ({error}); {DEFECT}", scene.name)
        }
    }
}
