//! Measures the parameters of packaging: the ranking that selects the Gaussians of a budget, recolouring, and the budget
//! of fragments.
//!
//! Each is compared with the whole field, in the images that `package` compares, at the size of the reports.

use std::time::Instant;

use codec::Field;
use program::{Standpoint, Subject};
use refine::prune::{Candidate, Pictures, Ranking, Selection, recolor};

use super::subject::ReportSubject;
use crate::package::{FieldAnalysis, LAYERS, LensCounter, PackageSettings, recolor_views, render_scene};
use crate::progress::StagedProgress;
use measure::parameter::{FlowStage, Parameter, ParameterValue, Quartiles};

/// Budgets of fragments, as fractions; 1 leaves out none.
const FRACTIONS: [f64; 6] = [1.0, 0.95, 0.9, 0.85, 0.7, 0.5];

/// Why the chosen candidate may have fewer decibels or features than another.
const WHY_BEST: &str = "`package` keeps the candidate of the highest PSNR, or one about as good that severs fewer \
                        features, which the fraction of lost features does not count";

/// Measures the budget of fragments, and ranking and recolouring if a budget is smaller than the field.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) if the field cannot be coded. Any other error is a defect of
/// this program.
pub fn measure(subject: &ReportSubject, progress: &StagedProgress) -> anyhow::Result<Vec<Parameter>> {
    let mut parameters = Vec::new();
    let ReportSubject { scene, field, plate } = subject;
    let settings = PackageSettings::default();
    let analysis = FieldAnalysis::new(scene, field, plate.as_ref(), &settings, progress)?;
    if let Some(budget) = budget(field) {
        parameters.extend(selection(subject, &analysis, budget, progress));
    }
    let rows = analysis.order(Ranking::Mass);
    parameters.push(fragments(subject, &analysis, &rows));
    Ok(parameters)
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
        let counts = [
            ("gaussians", candidate.retained.rows.len() as f64),
            ("features_preserved", recall),
            ("restored", candidate.retained.restored as f64),
        ];
        ParameterValue::new(&label, i == best, Quartiles::exactly(1.0 - recall), candidate.psnr_db, &counts)
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
    let seconds = Quartiles::exactly(start.elapsed().as_secs_f64());
    let kept = ParameterValue::new("as they were", true, Quartiles::exactly(0.0), selected.psnr_db, &[]);
    let refitted = ParameterValue::new("recolored", false, seconds, analysis.psnr(&recolored), &[]);
    let colours = Parameter {
        stage: FlowStage::Packaging,
        name: "recolor".into(),
        about: format!(
            "Whether the colours of the {budget} Gaussians are fitted to images of the whole field \
             (`--recolor`)."
        ),
        why_default: "it takes time, and changes colours that were fitted to photographs".into(),
        cost: "s of packaging".into(),
        points: vec![kept, refitted],
    };
    [ranking, colours].map(Parameter::mark_front)
}

/// PSNR over the fragments that a budget of them keeps of `rows`, the whole field.
fn fragments(subject: &ReportSubject, analysis: &FieldAnalysis, rows: &[usize]) -> Parameter {
    let seen = analysis.fragment_contributions(rows);
    let info = &subject.scene.info;
    let standing = Subject::new(info, subject.scene.surroundings());
    let counter = LensCounter::new(&standing, info.up, &subject.field, Standpoint::Near);
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
        points.push(ParameterValue::new(
            &fraction.to_string(),
            is_whole,
            Quartiles::exactly(per_pixel),
            analysis.psnr(&part),
            &[("gaussians", kept.len() as f64)],
        ));
    }
    Parameter {
        stage: FlowStage::Packaging,
        name: "fragments".into(),
        about: "The fraction of the fragments that a package keeps (`--fragments`), by leaving out the Gaussians that \
                show least for theirs: the others, before coding, against the whole field. A fragment is a pixel of a quad, in \
                both eyes of a Quest 3 at 0.7 m."
            .into(),
        why_default: "what a field shows is not left out unless it is asked for".into(),
        cost: "fragments per pixel, 0.7 m in front".into(),
        points,
    }
    .mark_front()
}

#[cfg(test)]
mod tests {
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
        let parameter = fragments(&subject, &analysis, &rows);
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
}
