//! Gaussians in order of importance become bytes: a quick draft to judge by, and the package itself,
//! which is decoded again and verified.

use anyhow::ensure;
use codec::{Clip, EncodeOptions, Field, Limits, Precision, Source};
use program::Fault;
use refine::code::{CodeError, TRIALS, code};
use refine::prune::Pictures;
use refine::reference::RenderScene;

use super::settings::{Coding, LAYERS, QUALITY_DB};
use super::views::{CODED_SIZE, RANKING_PLACES, compared_views, render_scene, views_of};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// Extra precision of a draft in dB. A draft is coded without sensitivities, and its coding errors must
/// not decide.
const DRAFT_MARGIN_DB: f64 = 10.0;

/// A verified package.
pub(super) struct VerifiedPackage {
    pub(super) bytes: Vec<u8>,
    pub(super) clip: Clip,
    /// PSNR in dB between pictures of the clip and of the field.
    pub(super) self_psnr_db: f64,
}

/// Encodes a field quickly, most important row first, and decodes it again; close enough to the package
/// to choose by.
pub(super) fn draft(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    coding: Coding,
) -> anyhow::Result<Clip> {
    let precision = match coding {
        Coding::Fixed => Precision { psnr: QUALITY_DB, ..Precision::default() },
        Coding::Context { quality_db } => {
            Precision { psnr: quality_db + DRAFT_MARGIN_DB, ..Precision::default() }
        }
    };
    encode_once(scene, field, plate, coding, precision).map(|(_, clip)| clip)
}

/// Encodes a field in layers, most important row first, to the precision of `coding`; decodes the
/// package and verifies that every Gaussian is there.
///
/// # Errors
/// [`Fault::Data`] where the field cannot be coded, or players would not read the package.
pub(super) fn encode(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    coding: Coding,
    progress: &StagedProgress,
) -> anyhow::Result<VerifiedPackage> {
    let compared = compared_views(scene, field);
    progress.stage("pictures to code by", compared.len());
    let judge = Pictures::take(&render_scene(field, plate), compared, || progress.step());
    let (bytes, clip, self_psnr_db) = match coding {
        Coding::Fixed => {
            let precision = Precision { psnr: QUALITY_DB, ..Precision::default() };
            let (bytes, clip) = encode_once(scene, field, plate, coding, precision)?;
            let psnr = judge.psnr(&RenderScene::from(&clip), || ());
            (bytes, clip, psnr)
        }
        Coding::Context { quality_db } => {
            let source = Source { info: &scene.info, field, plate };
            let views = views_of(scene, field, RANKING_PLACES, CODED_SIZE);
            progress.stage("coding", views.len() + TRIALS);
            let coded = code(&source, &LAYERS, quality_db, &views, &judge, || progress.step())
                .map_err(|error| refused(scene, error))?;
            (coded.bytes, coded.clip, coded.psnr_db)
        }
    };
    let decoded_plate = clip.plate.as_ref().map(Field::len);
    ensure!(clip.len() == field.len(), "{} of {} Gaussians were decoded", clip.len(), field.len());
    ensure!(decoded_plate == plate.map(Field::len), "the plate was decoded as {decoded_plate:?}");
    Ok(VerifiedPackage { bytes, clip, self_psnr_db })
}

fn encode_once(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    coding: Coding,
    precision: Precision,
) -> anyhow::Result<(Vec<u8>, Clip)> {
    let source = Source { info: &scene.info, field, plate };
    let options = EncodeOptions { coder: coding.coder(), layers: LAYERS.to_vec(), precision };
    let bytes = codec::encode(&source, &options).map_err(|error| refused(scene, CodeError::Encode(error)))?;
    let clip = codec::decode(&bytes, &Limits::default());
    let clip = clip.map_err(|error| refused(scene, CodeError::Decode(error)))?;
    Ok((bytes, clip))
}

/// The error of a scene that cannot be packaged.
pub(crate) fn refused(scene: &Scene, error: CodeError) -> anyhow::Error {
    match error {
        CodeError::Encode(error) => Fault::Data(format!("{}: {error}", scene.name)).into(),
        CodeError::Decode(error @ codec::Error::Limits { .. }) => {
            let what = format!("{}: more than players read; choose a --budget: {error}", scene.name);
            Fault::Data(what).into()
        }
        CodeError::Decode(error) => error.into(),
    }
}
