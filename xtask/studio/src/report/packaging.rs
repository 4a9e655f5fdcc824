//! Measures the parameters of packaging: coder precision, the ranking that selects the Gaussians of a
//! budget, and recolouring.
//!
//! Coding is compared with the Gaussians before coding, selection with the whole field, each in the images
//! that `package` compares, at the size of the reports.

use std::collections::BTreeMap;
use std::time::Instant;

use codec::{Clip, Coder, EncodeOptions, Field, Limits, Source};
use refine::code::{CodeError, TRIALS, TargetCoder};
use refine::prune::{Candidate, Pictures, PosedView, Ranking, Selection, by_importance, recolor};
use refine::reference::{self, sensitivities};

use super::subject::ReportSubject;
use crate::package::{
    FieldAnalysis, JUDGING_PLACES, LAYERS, PackageSettings, QUALITY_DB, STEERING_PLACES, recolor_views,
    refused, render_scene, views_of,
};
use crate::progress::StagedProgress;
use measure::parameter::{FlowStage, ImageErrors, Parameter, ParameterValue, Quartiles};

/// Target PSNRs in dB, the finest first.
const TARGETS_DB: [f64; 8] = [55.0, 52.5, QUALITY_DB, 50.0, 47.5, 45.0, 42.5, 40.0];

/// Maximum number of Gaussians coded.
const CODED: usize = 40_000;

/// Number of timed decodings per package.
const DECODINGS: usize = 5;

/// Size in pixels of the pictures that measure precision, and their numbers: each is drawn many times.
const SIZE: (u32, u32) = (320, 240);
const CODED_VIEWS: usize = 6;
const SEEN_VIEWS: usize = 8;

/// Why the chosen candidate may have fewer decibels or features than another.
const WHY_BEST: &str = "`package` keeps the candidate of the highest PSNR, or one about as good that severs fewer \
                        features, which the fraction of lost features does not count";

/// Measures coder precision, and ranking and recolouring if a budget is smaller than the field.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) if the field cannot be coded. Any other error is a defect of
/// this program.
pub fn measure(subject: &ReportSubject, progress: &StagedProgress) -> anyhow::Result<Vec<Parameter>> {
    let mut parameters = vec![precision(subject, progress)?];
    if let Some(budget) = budget(&subject.field) {
        parameters.extend(selection(subject, budget, progress)?);
    }
    Ok(parameters)
}

/// The largest layer that is smaller than the field.
fn budget(field: &Field) -> Option<usize> {
    LAYERS.into_iter().rev().find(|&budget| budget < field.len())
}

/// Size and PSNR of packages over the coder's target PSNR.
fn precision(subject: &ReportSubject, progress: &StagedProgress) -> anyhow::Result<Parameter> {
    progress.stage("coding", (1 + TARGETS_DB.len() * TRIALS) + seen_views(subject).len());
    let ReportSubject { scene, field, plate } = subject;
    let mut rows = by_importance(&Ranking::Mass.scores(field, &[]));
    rows.truncate(CODED);
    let part = field.select(&rows);
    let plate = plate.as_ref();
    let source = Source { info: &scene.info, field: &part, plate };
    let visible = sensitivities(&part, plate, &seen_views(subject), || progress.step());
    let judge = Pictures::take(&render_scene(&part, plate), coded_views(subject), || ());
    let tried = || progress.step();

    let mut coder = TargetCoder::new(&source, &LAYERS, visible, &judge);
    let mut points = Vec::new();
    for target_db in TARGETS_DB {
        let coded = coder.code(target_db, tried).map_err(|error| refused(scene, error))?;
        let label = format!("{target_db} dB");
        points.push(package(&label, target_db == QUALITY_DB, &coded.bytes, coded.fidelity.psnr_db)?);
    }
    let options = EncodeOptions { coder: Coder::Fixed, layers: LAYERS.to_vec(), ..EncodeOptions::default() };
    let bytes = codec::encode(&source, &options).map_err(|error| refused(scene, CodeError::Encode(error)))?;
    let clip = decode(&bytes)?;
    points.push(package("fixed", false, &bytes, judge.psnr(&reference::RenderScene::from(&clip), || ()))?);
    tried();
    Ok(Parameter {
        stage: FlowStage::Packaging,
        name: "coder precision".into(),
        about: format!(
            "Precision of the coder `context`: PSNR of the decoded package against the Gaussians before coding, \
             which are {} of {}, those of the greatest mass. `fixed` is the paper's coder, which has one \
             precision. The run time is the median of {DECODINGS} decodings on one thread.",
            part.len(),
            field.len()
        ),
        why_default: "it holds for all fields: coding then costs 0.01 dB of a field that fits its photographs to \
                      24.3 dB"
            .into(),
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
fn point(value: &str, default: bool, psnr_db: f64) -> ParameterValue {
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

fn counts<const N: usize>(counts: [(&str, f64); N]) -> BTreeMap<String, f64> {
    counts.map(|(name, count)| (name.to_owned(), count)).into()
}

/// PSNR and topology of the rankings at a budget, and the effect of recolouring on the selected Gaussians.
fn selection(
    subject: &ReportSubject,
    budget: usize,
    progress: &StagedProgress,
) -> anyhow::Result<[Parameter; 2]> {
    let ReportSubject { scene, field, plate } = subject;
    let settings = PackageSettings::default();
    let analysis = FieldAnalysis::new(scene, field, plate.as_ref(), &settings, progress)?;
    let Selection { candidates, best, .. } = analysis.select(budget)?;
    let selected = &candidates[best];
    let ranked = |(i, candidate): (usize, &Candidate)| {
        let floor = if candidate.retained.restored > 0 { " with floor" } else { "" };
        let recall = candidate.retained.topology.recall();
        let label = format!("{}{floor}", candidate.ranking.name());
        ParameterValue {
            cost: Quartiles::exactly(1.0 - recall),
            counts: counts([
                ("gaussians", candidate.retained.rows.len() as f64),
                ("features_preserved", recall),
                ("restored", candidate.retained.restored as f64),
            ]),
            ..point(&label, i == best, candidate.psnr_db)
        }
    };
    let ranking = Parameter {
        stage: FlowStage::Packaging,
        name: "ranking".into(),
        about: format!(
            "The ranking that selects the {budget} Gaussians of a budget, without the topology floor, and with it \
             where it changes the selection: draft packages against the whole field. The default tries all and \
             uses the marked one."
        ),
        why_default: WHY_BEST.into(),
        cost: "fraction of persistent features lost".into(),
        points: candidates.iter().enumerate().map(ranked).collect(),
    };

    progress.stage("colours", 1);
    let start = Instant::now();
    let pictures = Pictures::take(&render_scene(field, plate.as_ref()), recolor_views(scene, field), || ());
    let recolored = recolor(&field.select(&selected.retained.rows), plate.as_ref(), &pictures, || ());
    let seconds = start.elapsed().as_secs_f64();
    let refitted = ParameterValue {
        cost: Quartiles::exactly(seconds),
        ..point("recolored", false, analysis.draft_psnr(&recolored)?)
    };
    let colours = Parameter {
        stage: FlowStage::Packaging,
        name: "recolor".into(),
        about: format!(
            "Whether the colours of the {budget} Gaussians are fitted to images of the whole field \
             (`--recolor`)."
        ),
        why_default: "it takes time, and changes colours that were fitted to photographs".into(),
        cost: "s of packaging".into(),
        points: vec![point("as they were", true, selected.psnr_db), refitted],
    };
    Ok([ranking, colours].map(Parameter::mark_front))
}

/// Views in which the precision of the coder is measured.
fn coded_views(subject: &ReportSubject) -> Vec<PosedView> {
    views_of(&subject.scene, &subject.field, JUDGING_PLACES, SIZE, CODED_VIEWS)
}

/// Views from which visibility is measured for the coder.
fn seen_views(subject: &ReportSubject) -> Vec<PosedView> {
    views_of(&subject.scene, &subject.field, STEERING_PLACES, SIZE, SEEN_VIEWS)
}
