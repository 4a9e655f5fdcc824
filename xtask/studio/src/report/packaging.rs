//! The parameters of making a package: how exactly it is coded, what chooses the Gaussians that a budget
//! keeps, and whether their colours are fitted anew.
//!
//! Coding is held against what was coded, choosing against the whole field, each in the pictures in
//! which `package` itself compares, in the size of the reports.

use std::collections::BTreeMap;
use std::time::Instant;

use codec::{Clip, Coder, EncodeOptions, Field, Limits, Sensitivity, Source};
use refine::code::{CodeError, TRIALS, code_knowing};
use refine::prune::{Candidate, Pictures, Ranking, Selection, by_importance, recolor};
use refine::reference::{self, sensitivities};

use super::rd::{coded_views, seen_views};
use super::subject::ReportSubject;
use crate::package::{
    FieldAnalysis, LAYERS, PackageSettings, QUALITY_DB, ranking_views, refused, render_scene,
};
use crate::progress::StagedProgress;
use measure::parameter::{FlowStage, ImageErrors, Parameter, ParameterValue, Quartiles};

/// PSNRs to code to, in dB, from the finest to the coarsest.
const TARGETS_DB: [f64; 8] = [55.0, 52.5, QUALITY_DB, 50.0, 47.5, 45.0, 42.5, 40.0];

/// Most Gaussians that are coded.
const CODED: usize = 40_000;

/// How often each package is decoded for its time.
const DECODINGS: usize = 5;

/// Measures the parameters.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) where the field cannot be coded. Any other error is a
/// defect of this program.
pub fn measure(subject: &ReportSubject, progress: &StagedProgress) -> anyhow::Result<Vec<Parameter>> {
    let mut parameters = vec![precision(subject, progress)?];
    if let Some(budget) = budget(&subject.field) {
        parameters.extend(choosing(subject, budget, progress)?);
    }
    Ok(parameters)
}

/// The largest layer of packages that leaves something out.
fn budget(field: &Field) -> Option<usize> {
    LAYERS.into_iter().rev().find(|&budget| budget < field.len())
}

/// What the precision of the coder costs and keeps.
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

    let code = |target_db: f64, visible: &Option<(Vec<Sensitivity>, f32)>| {
        code_knowing(&source, &LAYERS, target_db, visible.clone(), &judge, tried)
            .map_err(|error| refused(scene, error))
    };
    let mut points = Vec::new();
    for target_db in TARGETS_DB {
        let coded = code(target_db, &visible)?;
        let label = format!("{target_db} dB");
        points.push(package(&label, target_db == QUALITY_DB, &coded.bytes, coded.psnr_db)?);
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
            "How exactly the coder `context` keeps the Gaussians, as PSNR of the decoded package against what was \
             coded: {} of the {} Gaussians, those of the greatest mass. `fixed` is the paper's coder, which has one \
             precision. The run time is that of decoding on one thread, the median of {DECODINGS} times.",
            part.len(),
            field.len()
        ),
        cost: "bytes".into(),
        points,
    }
    .mark_front())
}

fn decode(bytes: &[u8]) -> anyhow::Result<Clip> {
    Ok(codec::decode(bytes, &Limits::default())?)
}

/// A package as a point.
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

/// A point of which nothing but its error is known.
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

/// What chooses the Gaussians of a budget, and whether their colours are fitted anew.
fn choosing(subject: &ReportSubject, budget: usize, progress: &StagedProgress) -> anyhow::Result<[Parameter; 2]> {
    let ReportSubject { scene, field, plate } = subject;
    let settings = PackageSettings::default();
    let whole = FieldAnalysis::new(scene, field, plate.as_ref(), &settings, progress)?;
    let Selection { candidates, best, .. } = whole.select(budget)?;
    let chosen = &candidates[best];
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
            "What chooses the {budget} Gaussians of a budget, by itself and with the topology floor where that \
             changes anything: drafts of packages against the whole field. The default tries all and takes the \
             one that is marked."
        ),
        cost: "part of the persistent features that is lost".into(),
        points: candidates.iter().enumerate().map(ranked).collect(),
    };

    progress.stage("colours", 1);
    let start = Instant::now();
    let pictures = Pictures::take(&render_scene(field, plate.as_ref()), ranking_views(scene, field), || ());
    let recolored = recolor(&field.select(&chosen.retained.rows), plate.as_ref(), &pictures, || ());
    let seconds = start.elapsed().as_secs_f64();
    let anew = ParameterValue {
        cost: Quartiles::exactly(seconds),
        ..point("recolored", false, whole.draft_psnr(&recolored)?)
    };
    let colours = Parameter {
        stage: FlowStage::Packaging,
        name: "recolor".into(),
        about: format!(
            "Whether the colours of the {budget} Gaussians are fitted to pictures of the whole field \
             (`--recolor`)."
        ),
        cost: "s of packaging".into(),
        points: vec![point("as they were", true, chosen.psnr_db), anew],
    };
    Ok([ranking, colours].map(Parameter::mark_front))
}
