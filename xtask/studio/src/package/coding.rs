//! Kept Gaussians become bytes: a quick draft to judge by, and the package itself, just as exact as
//! asked for.

use anyhow::ensure;
use codec::{Clip, Coder, EncodeOptions, Field, Limits, Precision, Source};
use indicatif::ProgressBar;
use program::Fault;
use refine::code::{CodeError, TRIALS, code};
use refine::prune::Pictures;
use refine::reference;

use super::whole::{CODED_SIZE, RANKING_PLACES, compared_shots, scene_of, shots_of};
use crate::scene::Scene;

/// Where layers end, as far as there are Gaussians; the last one ends at the last Gaussian.
pub const LAYERS: [usize; 5] = [5_000, 10_000, 20_000, 40_000, 80_000];

/// How much more exact a draft is to be than the package, in dB: it is made without looking, and
/// its errors must not decide.
const DRAFT_MARGIN_DB: f64 = 10.0;

/// PSNR that a package is to have where nobody says it: coding then costs 0.01 dB of a field that
/// fits its footage to 24.3 dB.
pub const QUALITY_DB: f64 = 50.7;

/// How Gaussians are coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    /// The paper's numbers of bits.
    Fixed,
    /// The coder `context`.
    Context {
        /// PSNR in dB that the package is to have, against the field before coding.
        quality_db: f64,
    },
}

impl Default for Coding {
    fn default() -> Coding {
        Coding::Context { quality_db: QUALITY_DB }
    }
}

impl Coding {
    pub(crate) fn coder(self) -> Coder {
        match self {
            Coding::Fixed => Coder::Fixed,
            Coding::Context { .. } => Coder::Context,
        }
    }

    /// Name of the coder.
    pub(crate) fn name(self) -> &'static str {
        self.coder().name()
    }
}

/// A field after coding.
pub(super) struct Coded {
    pub(super) field: Field,
    pub(super) bytes: Vec<u8>,
    pub(super) clip: Clip,
    /// PSNR in dB of pictures of the clip against pictures of the field.
    pub(super) self_psnr_db: f64,
}

/// Codes a field quickly, most important row first, and decodes it again; the clip is close enough
/// to the package to choose by.
pub(super) fn draft(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    coding: Coding,
) -> anyhow::Result<Clip> {
    let bytes = encode_blindly(scene, field, plate, coding)?;
    codec::decode(&bytes, &Limits::default()).map_err(|error| refused(scene, CodeError::Decode(error)))
}

/// Steps of [`finish`]ing a package, for progress: pictures and trials.
pub(super) fn finishing_steps(scene: &Scene, field: &Field, coding: Coding) -> u64 {
    let compared = compared_shots(scene, field).len();
    let seen = match coding {
        Coding::Fixed => 0,
        Coding::Context { .. } => {
            shots_of(scene, field, RANKING_PLACES, CODED_SIZE).len() + TRIALS * compared
        }
    };
    (compared + seen) as u64
}

/// Codes a field, most important row first, decodes it again and checks that it is all there.
/// `progress` advances by `work` for each of the [`finishing_steps`].
pub(super) fn finish(
    scene: &Scene,
    field: Field,
    plate: Option<&Field>,
    coding: Coding,
    (progress, work): (&ProgressBar, u64),
) -> anyhow::Result<Coded> {
    progress.set_message("coding");
    let compared = compared_shots(scene, &field);
    let pictured = || progress.inc(work);
    let trial_steps = compared.len() as u64;
    let judge = Pictures::take(&scene_of(&field, plate), compared, pictured);
    let (bytes, clip, self_psnr_db) = match coding {
        Coding::Fixed => {
            let bytes = encode_blindly(scene, &field, plate, coding)?;
            let clip = codec::decode(&bytes, &Limits::default());
            let clip = clip.map_err(|error| refused(scene, CodeError::Decode(error)))?;
            let psnr = judge.psnr(&reference::RenderScene::from(&clip), || ());
            (bytes, clip, psnr)
        }
        Coding::Context { quality_db } => {
            let source = Source { info: &scene.info, field: &field, plate };
            let seen = shots_of(scene, &field, RANKING_PLACES, CODED_SIZE);
            let mut left = seen.len();
            let on_step = || {
                progress.inc(if left > 0 { work } else { work * trial_steps });
                left = left.saturating_sub(1);
            };
            let coded = code(&source, &LAYERS, quality_db, &seen, &judge, on_step)
                .map_err(|error| refused(scene, error))?;
            (coded.bytes, coded.clip, coded.psnr_db)
        }
    };
    let decoded_plate = clip.plate.as_ref().map(Field::len);
    ensure!(clip.len() == field.len(), "{} of {} Gaussians came back", clip.len(), field.len());
    ensure!(decoded_plate == plate.map(Field::len), "the plate came back as {decoded_plate:?}");
    Ok(Coded { field, bytes, clip, self_psnr_db })
}

fn encode_blindly(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    coding: Coding,
) -> anyhow::Result<Vec<u8>> {
    let source = Source { info: &scene.info, field, plate };
    let psnr = match coding {
        Coding::Fixed => QUALITY_DB,
        Coding::Context { quality_db } => quality_db + DRAFT_MARGIN_DB,
    };
    let precision = Precision { psnr, ..Precision::default() };
    let options = EncodeOptions { coder: coding.coder(), layers: LAYERS.to_vec(), precision };
    codec::encode(&source, &options).map_err(|error| refused(scene, CodeError::Encode(error)))
}

fn refused(scene: &Scene, error: CodeError) -> anyhow::Error {
    match error {
        CodeError::Encode(error) => Fault::Data(format!("{}: {error}", scene.name)).into(),
        CodeError::Decode(error @ codec::Error::Limits { .. }) => {
            let what = format!("{}: more than players read; choose a --budget: {error}", scene.name);
            Fault::Data(what).into()
        }
        CodeError::Decode(error) => error.into(),
    }
}
