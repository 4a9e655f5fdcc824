//! [`PackageReport`]: what went into a package, what was omitted and why.

use std::collections::BTreeMap;

use codec::ClipInfo;
use refine::prune::{Candidate, Measure, RESOLUTION_DB, Selection, Topology, WorstPicture};
use serde::Serialize;

use super::layer_order::TriedOrder;
use super::lens_fragments::LensFragments;
use super::snap::Snapped;
use crate::fit::RefinementReport;

/// What went into a package, what was omitted, and how faithful the rest is.
#[derive(Clone, Debug, Serialize)]
pub struct PackageReport {
    /// The field.
    #[serde(flatten)]
    pub subject: Counts,
    /// The background, where there is one.
    pub plate: Option<Counts>,
    /// Part removed to the number of Gaussians that had it.
    pub parts_removed: BTreeMap<&'static str, usize>,
    /// The ranking that retained the Gaussians.
    pub ranking: &'static str,
    /// The ranking that orders them for the layers.
    pub layer_ranking: &'static str,
    /// The orders that competed for the layers.
    pub tried_orders: Vec<TriedOrder>,
    /// What of the topology is preserved.
    pub topology: PreservedTopology,
    /// PSNR in dB between pictures of the decoded package and of the whole field, from views that chose nothing; `None`
    /// where nothing was left out for the budget.
    pub whole_psnr_db: Option<f64>,
    /// The candidates for the budget.
    pub tried: Vec<TriedCandidate>,
    /// Why the chosen candidate won; `None` if all Gaussians fit in the budget.
    pub why: Option<String>,
    /// Gain in dB of the recolouring, if asked for; it is used if above 0.
    #[serde(rename = "refit_gain_db")]
    pub recolor_gain_db: Option<f64>,
    /// Result of the refinement on photographs, if requested.
    pub refined: Option<RefinementReport>,
    /// What was made static before coding.
    pub snapped: Snapped,
    /// Number of Gaussians, of the plate too, that cannot be seen from where people stand; they are kept.
    pub unseen: usize,
    /// Number of Gaussians up to the end of each layer.
    pub layers: Vec<usize>,
    /// Fragments per pixel in a headset, of the whole field and of the package.
    pub lens_fragments: Vec<LensFragments>,
    /// Length of the clip in seconds.
    pub duration_s: f32,
    /// Keys of `scene.json` for which the package has the defaults.
    pub assumed: Vec<&'static str>,
    /// Size of the package.
    pub bytes: usize,
    /// Size of the package without joint rounding; `None` where numbers were not rounded jointly, and for most fields of
    /// more than 16,384 Gaussians, for which that package is not made.
    pub bytes_alone: Option<usize>,
    /// How the Gaussians are coded.
    pub coder: &'static str,
    /// PSNR in dB between renders of the decoded package and of the field that was coded, over all pixels of all judging
    /// views; of views that chose nothing where the source states no viewpoint. Infinite where they are the same.
    pub self_psnr_db: f64,
    /// The same over the pixels that the field covers.
    pub covered_psnr_db: f64,
    /// The view with the lowest PSNR among them.
    pub worst_view: Option<WorstView>,
    /// Number of views that measured the visibility of coding errors; 0 for a coder of one precision.
    pub steering_views: usize,
    /// Number of other views for which numbers were rounded jointly; 0 where they were not.
    pub rounding_views: usize,
    /// Number of further views that judged the result.
    pub judging_views: usize,
    /// Why the package does not have its target PSNR; `None` where it has.
    pub miss: Option<Shortfall>,
}

/// A difference between a package and its target.
#[derive(Clone, Debug, Serialize)]
pub struct Shortfall {
    /// Whether the package is worse than its target; otherwise it is better than needed.
    pub is_below: bool,
    /// One sentence.
    pub text: String,
}

/// The view and instant at which a package reproduces its field worst.
#[derive(Clone, Debug, Serialize)]
pub struct WorstView {
    /// PSNR in dB over all pixels of the view.
    pub psnr_db: f64,
    /// Position of the camera, in source units.
    pub position: [f64; 3],
    /// Seconds from the start of the clip.
    pub time_s: f64,
}

impl WorstView {
    pub(super) fn new(worst: &WorstPicture, info: &ClipInfo) -> WorstView {
        WorstView {
            psnr_db: worst.psnr_db,
            position: worst.view.camera.position(),
            time_s: worst.view.t * f64::from(info.duration_s),
        }
    }
}

/// Rows of a file on their way into the package.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Counts {
    /// Rows of the file.
    pub gaussians_in: usize,
    /// Rows packaged.
    pub gaussians_out: usize,
    /// Reason to number of rows left out; together they make up the difference.
    pub dropped: BTreeMap<&'static str, usize>,
    /// Reason to number of rows changed on import.
    pub repaired: BTreeMap<&'static str, usize>,
}

impl Counts {
    pub(super) fn drop(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.dropped.entry(reason).or_default() += rows;
        }
    }

    /// Counts the rows that are left out for a budget of Gaussians, and below it for a budget of fragments, where `rows` stay.
    pub(super) fn keep(&mut self, rows: usize, budget: Option<usize>) {
        let within_budget = budget.map_or(self.gaussians_out, |budget| budget.min(self.gaussians_out));
        self.drop("over budget", self.gaussians_out - within_budget);
        self.drop("over the budget of fragments", within_budget - rows);
        self.gaussians_out = rows;
    }
}

/// A candidate for the budget, and its measures.
#[derive(Clone, Debug, Serialize)]
pub struct TriedCandidate {
    /// The ranking.
    pub ranking: &'static str,
    /// Whether the topology floor changed its selection.
    pub floor: bool,
    /// Whether this is what the package holds.
    pub chosen: bool,
    /// PSNR in dB between pictures of the decoded package and of the whole field.
    pub psnr_db: f64,
    /// What of the topology is preserved.
    #[serde(flatten)]
    pub topology: PreservedTopology,
    /// Gaussians that the topology floor put in the place of others.
    pub restored: usize,
}

/// How much of the topology of the whole field a package preserves, before coding.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PreservedTopology {
    /// Fraction of the persistent features that is preserved.
    pub recall: f64,
    /// Fraction of the retained Gaussians' features that are not cut-off pieces.
    pub precision: f64,
    /// Harmonic mean of both.
    pub f1: f64,
    /// Fraction of the features that are neither lost nor severed; decides between candidates.
    pub preserved: f64,
    /// Mean change of the level at which features merge, in units of the largest density.
    pub saddle_drift: f64,
}

impl From<&Topology> for PreservedTopology {
    fn from(topology: &Topology) -> PreservedTopology {
        PreservedTopology {
            recall: topology.recall(),
            precision: topology.precision(),
            f1: topology.f1(),
            preserved: topology.preserved(Measure::Strict),
            saddle_drift: topology.saddle_drift(),
        }
    }
}

/// The candidates of a selection.
pub(super) fn tried(selection: &Selection) -> Vec<TriedCandidate> {
    let tried = |(i, candidate): (usize, &Candidate)| TriedCandidate {
        ranking: candidate.ranking.name(),
        floor: candidate.retained.restored > 0,
        chosen: i == selection.best,
        psnr_db: candidate.psnr_db,
        topology: PreservedTopology::from(&candidate.retained.topology),
        restored: candidate.retained.restored,
    };
    selection.candidates.iter().enumerate().map(tried).collect()
}

/// Explains the choice of the best candidate, with or without the floor.
// Long: one sentence a case.
pub(super) fn why(Selection { candidates, best, most_faithful }: &Selection) -> String {
    let chosen = &candidates[*best];
    let name = |candidate: &Candidate| match candidate.retained.restored {
        0 => candidate.ranking.name().to_owned(),
        _ => format!("{} with the floor", candidate.ranking.name()),
    };
    let preserved = |candidate: &Candidate| candidate.retained.topology.preserved(Measure::Strict);
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
        Some((_, twin)) if chosen.retained.restored == 0 => {
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
