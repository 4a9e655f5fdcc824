//! [`choose`]: which Gaussians a budget keeps.
//!
//! Each candidate ranking prunes, the topology floor mends; what comes of it, with and without the
//! floor, is coded, decoded and compared with the whole field in pictures; the best package stays.
//! Where there are photographs to refine by, what it holds moves towards them before it is coded.
//! Rankings look at pictures from other places than those that judge them.

use codec::Field;
use indicatif::ProgressBar;
use refine::fit::Cpu;
use refine::prune::{
    Candidate, Measure, PASSES, Pictures, RESOLUTION_DB, Ranking, Selection, Topology, by_importance,
    contributions_to, recolor,
};
use serde::Serialize;

use super::Settings;
use super::coding::{Coded, finish, finishing_steps};
use super::whole::{CODE_WORK, PICTURE_WORK, Whole, judging_shots, ranking_shots, scene_of};
use crate::fit::{Refinement, RefinementReport};
use crate::scene::Scene;

/// Share in the progress of one picture of what is coded, which is larger than those that judge.
const FINISH_WORK: u64 = 8;

/// Steps of refinement that have the share of one in the progress.
const STEPS_PER_WORK: u64 = 16;

/// A way to meet the budget that was tried, and how it did.
#[derive(Clone, Debug, Serialize)]
pub struct Tried {
    /// The ranking.
    pub ranking: &'static str,
    /// Whether the topology floor changed what it keeps.
    pub floor: bool,
    /// Whether this is what the package holds.
    pub chosen: bool,
    /// PSNR in dB between pictures of the decoded package and of the whole field.
    pub psnr_db: f64,
    /// What of the topology is preserved.
    #[serde(flatten)]
    pub topology: Preserved,
    /// Gaussians that the topology floor put in the place of others.
    pub restored: usize,
}

/// How much of the topology of the whole field a package preserves, before coding.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Preserved {
    /// Part of the persistent features that is preserved.
    pub recall: f64,
    /// Part of the features of what is kept that is not merely a piece cut off.
    pub precision: f64,
    /// Harmonic mean of both.
    pub f1: f64,
    /// Mean change of the level at which features merge, in units of the largest density.
    pub saddle_drift: f64,
}

impl From<&Topology> for Preserved {
    fn from(topology: &Topology) -> Preserved {
        Preserved {
            recall: topology.recall(),
            precision: topology.precision(),
            f1: topology.f1(),
            saddle_drift: topology.saddle_drift(),
        }
    }
}

/// What was chosen, and from what.
pub(super) struct Choice {
    pub(super) coded: Coded,
    pub(super) ranking: Ranking,
    pub(super) topology: Preserved,
    /// PSNR in dB against the whole field; `None` where nothing was left out.
    pub(super) psnr_db: Option<f64>,
    pub(super) tried: Vec<Tried>,
    /// Why the package holds what it holds; `None` where nothing was left out.
    pub(super) why: Option<String>,
    /// Gain of the recolouring in dB, where it was asked for; not used unless above 0.
    pub(super) recolor_gain_db: Option<f64>,
    /// What came of refinement, where it was asked for.
    pub(super) refined: Option<RefinementReport>,
}

/// Chooses `settings.budget` of the rows of `field`, which is not empty, and codes them.
pub(super) fn choose(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    settings: &Settings,
    refinement: Option<&Refinement>,
    progress: &ProgressBar,
) -> anyhow::Result<Choice> {
    let budget = settings.budget.unwrap_or(field.len());
    if budget >= field.len() {
        return keep_all(scene, field, plate, settings, refinement, progress);
    }
    let pictured = || progress.inc(PICTURE_WORK);
    let to_judge = PICTURE_WORK * judging_shots(scene, field).len() as u64;
    let to_recolor = match settings.recolor {
        true => {
            let stages = if field.sh_degree > 0 { 2 } else { 1 };
            let pictures = (1 + stages * PASSES) * ranking_shots(scene, field).len();
            PICTURE_WORK * pictures as u64 + CODE_WORK + to_judge
        }
        false => 0,
    };
    progress.set_length(
        Whole::look_work(scene, field, settings)
            + Whole::select_work(scene, field, settings)
            + to_recolor
            + refinement_work(refinement)
            + FINISH_WORK * finishing_steps(scene, field, settings.coding)
            + to_judge,
    );

    let whole = Whole::look(scene, field, plate, settings, progress)?;
    let selection = whole.select(budget)?;
    let Candidate { ranking, kept, psnr_db } = &selection.candidates[selection.best];
    let mut chosen = field.select(&kept.rows);
    let mut recolor_gain_db = None;
    if settings.recolor {
        progress.set_message("colours");
        let pictures = Pictures::take(&scene_of(field, plate), ranking_shots(scene, field), pictured);
        let recolored = recolor(&chosen, plate, &pictures, pictured);
        let gain = whole.draft_psnr(&recolored)? - psnr_db;
        recolor_gain_db = Some(gain);
        if gain > 0.0 {
            chosen = recolored;
        }
    }
    let (chosen, refined) = refined_by(chosen, refinement, progress);
    let coded = finish(scene, chosen, plate, settings.coding, (progress, FINISH_WORK))?;
    let psnr_db = whole.psnr(&coded.clip);
    progress.finish_and_clear();
    Ok(Choice {
        coded,
        ranking: *ranking,
        topology: Preserved::from(&kept.topology),
        psnr_db: Some(psnr_db),
        tried: tried(&selection),
        why: Some(why(&selection)),
        recolor_gain_db,
        refined,
    })
}

/// All rows, in the order of one ranking: only the layers depend on it.
fn keep_all(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    settings: &Settings,
    refinement: Option<&Refinement>,
    progress: &ProgressBar,
) -> anyhow::Result<Choice> {
    let ranking = settings.rank.unwrap_or(Ranking::Mass);
    progress.set_length(finishing_steps(scene, field, settings.coding) + refinement_work(refinement));
    let seen = match ranking.looks_at_pictures() {
        true => contributions_to(&ranking_shots(scene, field), field, || ()),
        false => Vec::new(),
    };
    let order = by_importance(&ranking.scores(field, &seen));
    let (kept, refined) = refined_by(field.select(&order), refinement, progress);
    Ok(Choice {
        coded: finish(scene, kept, plate, settings.coding, (progress, 1))?,
        ranking,
        topology: Preserved::from(&Topology::default()),
        psnr_db: None,
        tried: Vec::new(),
        why: None,
        recolor_gain_db: None,
        refined,
    })
}

/// `kept` where its rows are, moved towards the photographs, where there are any.
fn refined_by(
    kept: Field,
    refinement: Option<&Refinement>,
    progress: &ProgressBar,
) -> (Field, Option<RefinementReport>) {
    let Some(refinement) = refinement else { return (kept, None) };
    progress.set_message("refining");
    let mut steps = 0;
    let tuned = refinement.run(&kept, &mut Cpu::default(), || {
        steps += 1;
        progress.inc(u64::from(steps % STEPS_PER_WORK == 0));
    });
    let (field, report) = tuned.expect("the CPU is always there");
    (field, Some(report))
}

/// How far the progress advances in [`refined_by`].
fn refinement_work(refinement: Option<&Refinement>) -> u64 {
    refinement.map_or(0, |refinement| refinement.steps / STEPS_PER_WORK)
}

fn tried(selection: &Selection) -> Vec<Tried> {
    let tried = |(i, candidate): (usize, &Candidate)| Tried {
        ranking: candidate.ranking.name(),
        floor: candidate.kept.restored > 0,
        chosen: i == selection.best,
        psnr_db: candidate.psnr_db,
        topology: Preserved::from(&candidate.kept.topology),
        restored: candidate.kept.restored,
    };
    selection.candidates.iter().enumerate().map(tried).collect()
}

/// Why the best candidate is the best, and why the floor has a part in it or not.
fn why(Selection { candidates, best, most_faithful }: &Selection) -> String {
    let chosen = &candidates[*best];
    let name = |candidate: &Candidate| match candidate.kept.restored {
        0 => candidate.ranking.name().to_owned(),
        _ => format!("{} with the floor", candidate.ranking.name()),
    };
    let preserved = |candidate: &Candidate| candidate.kept.topology.preserved(Measure::Strict);
    let rival = &candidates[*most_faithful];
    let mut why = if best != most_faithful {
        format!(
            "{} preserves {:.3} of the topology; {} preserves {:.3} and is {:.2} dB more faithful, which is no \
             more than the {RESOLUTION_DB} dB that the pictures can tell",
            name(chosen),
            preserved(chosen),
            name(rival),
            preserved(rival),
            rival.psnr_db - chosen.psnr_db
        )
    } else {
        let others = candidates.iter().filter(|other| other.ranking != chosen.ranking);
        match others.max_by(|a, b| a.psnr_db.total_cmp(&b.psnr_db)) {
            // Nothing to see, or nothing missed.
            _ if chosen.psnr_db == f64::INFINITY => format!("{} looks just like the whole", name(chosen)),
            Some(next) => {
                let gain = chosen.psnr_db - next.psnr_db;
                match gain < 0.005 {
                    true => format!("{} is as faithful as {}", name(chosen), name(next)),
                    false => {
                        format!(
                            "{} is the most faithful, by {gain:.2} dB before {}",
                            name(chosen),
                            name(next)
                        )
                    }
                }
            }
            None => name(chosen),
        }
    };
    let twin = candidates.iter().enumerate().find(|(i, other)| i != best && other.ranking == chosen.ranking);
    match twin {
        Some((_, twin)) if chosen.kept.restored == 0 => {
            why += &format!(
                "; the floor would preserve {:.3} of the topology instead of {:.3} and cost {:.2} dB",
                preserved(twin),
                preserved(chosen),
                chosen.psnr_db - twin.psnr_db
            );
        }
        Some((i, twin)) if i != *most_faithful => {
            why += &format!(
                "; the floor preserves {:.3} of the topology instead of {:.3} and gains {:.2} dB",
                preserved(chosen),
                preserved(twin),
                chosen.psnr_db - twin.psnr_db
            );
        }
        Some(_) => {}
        None if preserved(chosen) == 1.0 => why += "; nothing of the topology is lost",
        None => {}
    }
    why
}
