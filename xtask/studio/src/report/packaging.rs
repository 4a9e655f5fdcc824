//! Measures the parameters of packaging: the ranking that selects the Gaussians of a budget, recolouring, the budget of
//! fragments, and the fragment term of a refinement.
//!
//! Selection is compared with the whole field, in the images that `package` compares, at the size of the reports. A
//! refinement is compared with photographs.

use std::collections::BTreeMap;
use std::time::Instant;

use codec::Field;
use program::{Standpoint, Subject};
use refine::fit::{Cpu, FRAGMENT_WEIGHT};
use refine::prune::{Candidate, Pictures, Ranking, Selection, recolor};

use super::subject::ReportSubject;
use crate::fit::{Refinement, TrainingViews};
use crate::package::{FieldAnalysis, LAYERS, LensCounter, PackageSettings, recolor_views, render_scene};
use crate::progress::StagedProgress;
use measure::parameter::{FlowStage, ImageErrors, Parameter, ParameterValue, Quartiles};

/// Budgets of fragments, as fractions; 1 leaves out none.
const FRACTIONS: [f64; 6] = [1.0, 0.95, 0.9, 0.85, 0.7, 0.5];

/// Weights of the fragment term of a refinement, in multiples of the default.
const WEIGHTS: [f64; 4] = [0.0, 1.0, 2.0, 4.0];

/// Cost of what a headset draws.
const FRAGMENTS: &str = "fragments per pixel, 0.7 m in front";

/// Why the chosen candidate may have fewer decibels or features than another.
const WHY_BEST: &str = "`package` keeps the candidate of the highest PSNR, or one about as good that severs fewer \
                        features, which the fraction of lost features does not count";

/// Measures the budget of fragments, ranking and recolouring if a budget is smaller than the
/// field, and the fragment term with the photographs and steps of a `refinement`.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) if the field cannot be coded. Any other error is a defect of
/// this program.
pub fn measure(
    subject: &ReportSubject,
    refinement: Option<(&TrainingViews, u64)>,
    progress: &StagedProgress,
) -> anyhow::Result<Vec<Parameter>> {
    let mut parameters = Vec::new();
    let ReportSubject { scene, field, plate } = subject;
    let settings = PackageSettings::default();
    let analysis = FieldAnalysis::new(scene, field, plate.as_ref(), &settings, progress)?;
    if let Some(budget) = budget(field) {
        parameters.extend(selection(subject, &analysis, budget, progress));
    }
    let rows = analysis.order(Ranking::Mass);
    let counter = counter(subject);
    parameters.push(fragments(subject, &analysis, &rows, &counter));
    if let Some((views, steps)) = refinement {
        parameters.push(fragment_term(subject, views, steps, &counter, progress));
    }
    Ok(parameters)
}

/// Counts the fragments of the subject 0.7 m in front.
fn counter(subject: &ReportSubject) -> LensCounter {
    let ReportSubject { scene, field, .. } = subject;
    let info = &scene.info;
    LensCounter::new(&Subject::new(info, scene.surroundings()), info.up, field, Standpoint::Near)
}

/// The largest layer that is smaller than the field.
fn budget(field: &Field) -> Option<usize> {
    LAYERS.into_iter().rev().find(|&budget| budget < field.len())
}

/// PSNR and topology of the rankings at a budget, and the effect of recolouring on the selected Gaussians.
fn selection(
    subject: &ReportSubject,
    analysis: &FieldAnalysis,
    budget: usize,
    progress: &StagedProgress,
) -> [Parameter; 2] {
    let ReportSubject { scene, field, plate } = subject;
    let Selection { candidates, best, .. } = analysis.select(budget);
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
             where it changes the selection: what is selected, before coding, against the whole field. The default tries all and \
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
        ..point("recolored", false, analysis.psnr(&recolored))
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
    [ranking, colours].map(Parameter::mark_front)
}

/// PSNR over the fragments that a budget of them keeps of `rows`, the whole field.
fn fragments(
    subject: &ReportSubject,
    analysis: &FieldAnalysis,
    rows: &[usize],
    counter: &LensCounter,
) -> Parameter {
    let seen = analysis.fragment_contributions(rows);
    let mut points = Vec::new();
    for fraction in FRACTIONS {
        let is_whole = fraction == 1.0;
        let kept = match is_whole {
            true => rows.to_vec(),
            false => analysis.within_fragments(rows, &seen, fraction).0,
        };
        // So few fragments may hold no Gaussian.
        if kept.is_empty() {
            continue;
        }
        let part = subject.field.select(&kept);
        let per_pixel = counter.per_pixel(&render_scene(&part, subject.plate.as_ref()));
        points.push(ParameterValue {
            cost: Quartiles::exactly(per_pixel),
            counts: counts([("gaussians", kept.len() as f64)]),
            ..point(&format!("{fraction}"), is_whole, analysis.psnr(&part))
        });
    }
    Parameter {
        stage: FlowStage::Packaging,
        name: "fragments".into(),
        about: "The fraction of the fragments that a package keeps (`--fragments`), by leaving out the Gaussians that \
                show least for theirs: the others, before coding, against the whole field. A fragment is a pixel of a quad, in \
                both eyes of a Quest 3 at 0.7 m."
            .into(),
        why_default: "what a field shows is not left out unless it is asked for".into(),
        cost: FRAGMENTS.into(),
        points,
    }
    .mark_front()
}

/// PSNR of held photographs over the fragments of fields that are refined with weights of the fragment term.
fn fragment_term(
    subject: &ReportSubject,
    views: &TrainingViews,
    steps: u64,
    counter: &LensCounter,
    progress: &StagedProgress,
) -> Parameter {
    let ReportSubject { field, plate, .. } = subject;
    let measured = |label: &str, weight: Option<f64>, field: &Field, psnr_db: Option<f64>| {
        let per_pixel = counter.per_pixel(&render_scene(field, plate.as_ref()));
        ParameterValue {
            cost: Quartiles::exactly(per_pixel),
            counts: counts([("gaussians", field.len() as f64)]),
            ..point(label, weight == Some(FRAGMENT_WEIGHT), psnr_db.unwrap_or(f64::INFINITY))
        }
    };
    let mut points = Vec::new();
    for fragment_weight in WEIGHTS.map(|factor| factor * FRAGMENT_WEIGHT) {
        let label = format!("{fragment_weight}");
        progress.stage(format!("refining, fragment weight {label}"), steps as usize);
        let plate = plate.as_ref().filter(|_| views.are_whole());
        let refinement = Refinement { views, plate, steps, fragment_weight };
        let refined = refinement.run(field, &mut Cpu::default(), || progress.step());
        let (refined, report) = refined.expect("the CPU is always available");
        if points.is_empty() {
            points.push(measured("not refined", None, field, report.held_before_db));
        }
        points.push(measured(&label, Some(fragment_weight), &refined, report.held_after_db));
    }
    Parameter {
        stage: FlowStage::Packaging,
        name: "fragment term".into(),
        about: format!(
            "The weight of the area that Gaussians cover in the loss of a refinement of {steps} steps \
             (`--fragment-weight`): PSNR of the subject in {} photographs that are held out, before coding.",
            views.held.len()
        ),
        why_default:
            "twice the weight costs 0.1 to 0.2 dB of held photographs, and a window has fragments to spare"
                .into(),
        cost: FRAGMENTS.into(),
        points,
    }
    .mark_front()
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

#[cfg(test)]
mod tests {
    use codec::ClipInfo;
    use refine::capture::{PhotoId, Response};
    use refine::fit::{FrameView, Parameters, Photograph, Timeline, TrainingView, cpu};

    use super::*;
    use crate::scene::Scene;
    use crate::synth::limbs;

    /// A thin figure of a few hundred Gaussians.
    fn subject() -> ReportSubject {
        let (field, info) = limbs::figure();
        let rows: Vec<usize> = (0..field.len()).step_by(16).collect();
        let field = field.select(&rows);
        ReportSubject { scene: Scene::made("limbs", field.clone(), info), field, plate: None }
    }

    fn costs_and_psnr(parameter: &Parameter) -> (Vec<f64>, Vec<f64>) {
        parameter.points.iter().map(|point| (point.cost.median, point.psnr_db())).unzip()
    }

    #[test]
    fn a_smaller_budget_of_fragments_costs_less_and_shows_less() {
        let subject = subject();
        let settings = PackageSettings::default();
        let progress = StagedProgress::hidden();
        let analysis =
            FieldAnalysis::new(&subject.scene, &subject.field, None, &settings, &progress).unwrap();
        let rows = analysis.order(Ranking::Mass);
        let parameter = fragments(&subject, &analysis, &rows, &counter(&subject));
        let (costs, psnr) = costs_and_psnr(&parameter);
        assert_eq!(costs.len(), FRACTIONS.len());
        assert!(costs.is_sorted_by(|a, b| a > b) && psnr.is_sorted_by(|a, b| a > b), "{costs:?} {psnr:?}");
        // The lens shows other views than those that count the fragments of the budget.
        let half = costs[5] / costs[0];
        assert!((0.3..0.7).contains(&half), "{half} of the fragments");
        let defaults: Vec<bool> = parameter.points.iter().map(|point| point.default).collect();
        assert_eq!(defaults, [true, false, false, false, false, false]);
        assert!(parameter.points.iter().all(|point| point.on_front));
    }

    #[test]
    fn a_fragment_term_takes_fragments_from_a_refinement() {
        let mut subject = subject();
        let timeline = Timeline::even(1);
        let parameters = Parameters::<f32>::from_field(&subject.field, timeline);
        let view = |camera_id: usize| {
            let ClipInfo { up, viewpoints, .. } = &subject.scene.info;
            let mut viewpoint = viewpoints[0].clone();
            let turn = glam::Quat::from_axis_angle((*up).into(), camera_id as f32);
            let arm = glam::Vec3::from(viewpoint.position) - glam::Vec3::from(viewpoint.target);
            viewpoint.position = (glam::Vec3::from(viewpoint.target) + turn * arm).to_array();
            let camera = viewpoint.camera(*up, 32, 32);
            let picture = cpu::render(&parameters, &FrameView { camera: &camera, time: 0.0 }).image;
            let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
            let pixels = picture.pixels.iter().map(|pixel| pixel.map(byte)).collect();
            let photograph = Photograph { width: 32, height: 32, pixels, valid: Vec::new() };
            TrainingView { camera_id, camera, time: 0.0, photograph }
        };
        let photo = |camera| (PhotoId { frame: 0, camera }, view(camera));
        let views = TrainingViews {
            train: (0..4).map(photo).collect(),
            held: vec![view(4)],
            timeline,
            responses: vec![Response::NEUTRAL; 5],
        };
        subject.field.log_scales.iter_mut().flatten().for_each(|scale| *scale += 0.3);
        let parameter = fragment_term(&subject, &views, 60, &counter(&subject), &StagedProgress::hidden());
        let (costs, psnr) = costs_and_psnr(&parameter);
        assert_eq!((costs.len(), parameter.points[2].default), (1 + WEIGHTS.len(), true));
        assert!(costs[1..].is_sorted_by(|a, b| a > b), "{costs:?}");
        assert!(psnr[1] > psnr[0] + 1.0, "a refinement takes the blur back: {psnr:?}");
    }
}
