//! Measures the parameters of coding: the precision of the coder, and joint rounding. Packages are compared with the
//! Gaussians before coding.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::time::Instant;

use codec::{Clip, Coder, EncodeOptions, Limits, Source};
use refine::code::{CodeError, JOINT_ROUNDS, JointRounding, TRIALS, TargetCoder, code_steps};
use refine::fit::Cpu;
use refine::prune::{Pictures, PosedView, Ranking, by_importance};
use refine::reference::{RenderScene, sensitivities};

use super::subject::ReportSubject;
use crate::package::{
    Coding, JUDGING_PLACES, LAYERS, Places, QUALITY_DB, STEERING_PLACES, refused, render_scene,
    rounding_views, views_of,
};
use crate::progress::StagedProgress;
use measure::parameter::{FlowStage, ImageErrors, Parameter, ParameterValue, Quartiles};

/// Target PSNRs in dB, the finest first.
const TARGETS_DB: [f64; 8] = [55.0, 52.5, QUALITY_DB, 50.0, 47.5, 45.0, 42.5, 40.0];

/// Numbers of rounds of joint rounding beside 0.
const ROUNDS: [usize; 3] = [1, JOINT_ROUNDS, 10];

/// Maximum number of Gaussians coded.
const CODED: usize = 40_000;

/// Number of timed decodings per package.
const DECODINGS: usize = 5;

/// Size in pixels of the pictures that measure precision, and their numbers: each is drawn many times.
const SIZE: (u32, u32) = (320, 240);
const CODED_VIEWS: usize = 6;
const SEEN_VIEWS: usize = 8;

/// Measures coder precision, with other coders beside it, and joint rounding.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) if the field cannot be coded. Any other error is a defect of
/// this program.
pub(super) fn measure(subject: &ReportSubject, progress: &StagedProgress) -> anyhow::Result<[Parameter; 2]> {
    let ReportSubject { scene, field, plate } = subject;
    let mut rows = by_importance(&Ranking::Mass.scores(field, &[]));
    rows.truncate(CODED);
    let part = field.select(&rows);
    let plate = plate.as_ref();
    let source = Source { info: &scene.info, field: &part, plate };
    let seen = views(subject, STEERING_PLACES, SEEN_VIEWS);
    progress.stage("visibility", seen.len());
    let visible = sensitivities(&part, plate, &seen, || progress.step());
    let judge =
        Pictures::take(&render_scene(&part, plate), views(subject, JUDGING_PLACES, CODED_VIEWS), || ());
    let coder = |coder| TargetCoder::new(&source, coder, &LAYERS, visible.clone(), &judge);
    let mut default = coder(Coding::default().coder());
    let about = format!("{} of {}, those of the greatest mass", part.len(), field.len());
    let precision =
        precision(subject, &source, &judge, [&mut default, &mut coder(Coder::Context)], &about, progress)?;
    Ok([precision, joint_rounding(subject, &source, &mut default, &about, progress)?])
}

/// Size and PSNR of packages over the target PSNR of the default coder; and of the other coders, of which the second of
/// `coders` is one.
fn precision(
    subject: &ReportSubject,
    source: &Source,
    judge: &Pictures,
    [default, context]: [&mut TargetCoder; 2],
    about: &str,
    progress: &StagedProgress,
) -> anyhow::Result<Parameter> {
    progress.stage("coding", (1 + TARGETS_DB.len()) * TRIALS + 1);
    let scene = &subject.scene;
    let tried = || progress.step();
    let mut points = Vec::new();
    for target_db in TARGETS_DB {
        let coded = default.code(target_db, tried).map_err(|error| refused(scene, error))?;
        let label = format!("{target_db} dB");
        points.push(package(&label, target_db == QUALITY_DB, &coded.bytes, coded.fidelity.psnr_db)?);
    }
    let coded = context.code(QUALITY_DB, tried).map_err(|error| refused(scene, error))?;
    points.push(package("context", false, &coded.bytes, coded.fidelity.psnr_db)?);
    let options = EncodeOptions { coder: Coder::Fixed, layers: LAYERS.to_vec(), ..EncodeOptions::default() };
    let bytes = codec::encode(source, &options).map_err(|error| refused(scene, CodeError::Encode(error)))?;
    let clip = decode(&bytes)?;
    points.push(package("fixed", false, &bytes, judge.psnr(&RenderScene::from(&clip), || ()))?);
    tried();
    Ok(Parameter {
        stage: FlowStage::Packaging,
        name: "coder precision".into(),
        about: format!(
            "Precision of the coder `rans`: PSNR of the decoded package against the Gaussians before coding, \
             which are {about}. `context` is the older coder at {QUALITY_DB} dB, `fixed` the paper's, which has one \
             precision. Each number is rounded alone. The run time is the median of {DECODINGS} decodings on one thread.",
        ),
        why_default: "it holds for all fields: coding then costs 0.01 dB of a field that fits its photographs to \
                      24.3 dB"
            .into(),
        cost: "bytes".into(),
        points,
    }
    .mark_front())
}

/// Size and PSNR of packages over the number of rounds of joint rounding, at the default target PSNR.
fn joint_rounding(
    subject: &ReportSubject,
    source: &Source,
    coder: &mut TargetCoder,
    about: &str,
    progress: &StagedProgress,
) -> anyhow::Result<Parameter> {
    let scene = &subject.scene;
    let views = rounding_views(scene, source.field);
    let view_count = views.len();
    let rounds = |count| NonZero::new(count).expect("rounds beside 0");
    let mut backend = Cpu::default();
    let mut joint = JointRounding::new(views, rounds(JOINT_ROUNDS), &mut backend);
    let mut points = Vec::new();
    let alone = coder.code(QUALITY_DB, || ()).map_err(|error| refused(scene, error))?;
    points.push(package("0", false, &alone.bytes, alone.fidelity.psnr_db)?);
    for count in ROUNDS {
        joint = joint.with_rounds(rounds(count));
        progress.stage("joint rounding", code_steps(count));
        let coded = coder.code_jointly(QUALITY_DB, &mut joint, || progress.step());
        let coded = coded.map_err(|error| refused(scene, error))?;
        points.push(package(
            &count.to_string(),
            count == JOINT_ROUNDS,
            &coded.bytes,
            coded.fidelity.psnr_db,
        )?);
    }
    Ok(Parameter {
        stage: FlowStage::Packaging,
        name: "joint rounds".into(),
        about: format!(
            "Rounds in which the numbers of all Gaussians are rounded jointly (`--joint-rounds`), at {QUALITY_DB} dB in \
             images that the rounds do not look at; they look at {view_count} others. The Gaussians are {about}. 0 rounds \
             each number alone."
        ),
        why_default: "more rounds take longer than they save".into(),
        cost: "bytes".into(),
        points,
    }
    .mark_front())
}

fn decode(bytes: &[u8]) -> anyhow::Result<Clip> {
    Ok(codec::decode(bytes, &Limits::default())?)
}

/// The point of a package: its size, decoding time and PSNR.
fn package(value: &str, default: bool, bytes: &[u8], psnr_db: f64) -> anyhow::Result<ParameterValue> {
    let mut times = Vec::new();
    let mut gaussians = 0;
    for _ in 0..DECODINGS {
        let start = Instant::now();
        gaussians = decode(bytes)?.len();
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let size = bytes.len() as f64;
    Ok(ParameterValue {
        cost: Quartiles::exactly(size),
        run_time_ms: Some(Quartiles::of(times)),
        counts: counts([("bytes", size), ("bytes_per_gaussian", size / gaussians as f64)]),
        ..point(value, default, psnr_db)
    })
}

/// A point with a PSNR only.
pub(super) fn point(value: &str, default: bool, psnr_db: f64) -> ParameterValue {
    ParameterValue {
        value: value.into(),
        default,
        on_front: false,
        cost: Quartiles::default(),
        errors: ImageErrors { psnr_db: psnr_db.is_finite().then_some(psnr_db), ..ImageErrors::default() },
        run_time_ms: None,
        stages_ms: BTreeMap::new(),
        counts: BTreeMap::new(),
    }
}

pub(super) fn counts<const N: usize>(counts: [(&str, f64); N]) -> BTreeMap<String, f64> {
    counts.map(|(name, count)| (name.to_owned(), count)).into()
}

/// Views of the subject in small pictures.
fn views(subject: &ReportSubject, places: Places, count: usize) -> Vec<PosedView> {
    views_of(&subject.scene, &subject.field, places, SIZE, count)
}
