//! [`choose`]: the Gaussians that a budget keeps, most important first.
//!
//! Each candidate ranking prunes and the topology floor mends. Every candidate is drafted, with and
//! without the floor, and compared with the whole field in pictures; the best one wins. The order of its rows
//! for the layers is chosen after that.

use codec::{Clip, Field};
use refine::prune::{Candidate, Pictures, Ranking, Topology, by_importance, recolor};

use super::analysis::{FieldAnalysis, contributions};
use super::layer_order::TriedOrder;
use super::report::{PreservedTopology, TriedCandidate, tried, why};
use super::settings::PackageSettings;
use super::views::{recolor_views, render_scene};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// The chosen Gaussians, and the reasons.
pub(super) struct Choice<'a> {
    /// Most important first.
    pub(super) field: Field,
    /// The ranking that retains them.
    pub(super) ranking: Ranking,
    /// The ranking that orders them.
    pub(super) layer_ranking: Ranking,
    pub(super) tried_orders: Vec<TriedOrder>,
    pub(super) topology: PreservedTopology,
    pub(super) tried: Vec<TriedCandidate>,
    /// Why this candidate won; `None` where nothing was left out.
    pub(super) why: Option<String>,
    /// Gain of recolouring in dB, if requested; used if above 0.
    pub(super) recolor_gain_db: Option<f64>,
    /// The whole field; `None` where nothing was left out.
    whole: Option<FieldAnalysis<'a>>,
}

impl Choice<'_> {
    /// PSNR in dB of a clip against the whole field; `None` where nothing was left out.
    pub(super) fn whole_psnr_db(&self, clip: &Clip) -> Option<f64> {
        self.whole.as_ref().map(|whole| whole.psnr(clip))
    }
}

/// Chooses `settings.budget` of the rows of `field`, which is not empty.
///
/// # Errors
/// Errors of the draft encoder.
pub(super) fn choose<'a>(
    scene: &'a Scene,
    field: &'a Field,
    plate: Option<&'a Field>,
    settings: &'a PackageSettings,
    progress: &'a StagedProgress,
) -> anyhow::Result<Choice<'a>> {
    let Some(budget) = settings.budget.filter(|&budget| budget < field.len()) else {
        return Ok(keep_all(scene, field, settings, progress));
    };
    let whole = FieldAnalysis::new(scene, field, plate, settings, progress)?;
    let selection = whole.select(budget)?;
    let selected @ Candidate { ranking, retained, psnr_db } = &selection.candidates[selection.best];
    let order = whole.layer_order(selected)?;
    let mut chosen = field.select(&order.rows);
    let mut recolor_gain_db = None;
    if settings.recolor {
        progress.stage("colours", 1);
        let views = recolor_views(scene, field);
        let pictures = Pictures::take(&render_scene(field, plate), views, || ());
        let recolored = recolor(&chosen, plate, &pictures, || ());
        let gain = whole.draft_psnr(&recolored)? - psnr_db;
        recolor_gain_db = Some(gain);
        if gain > 0.0 {
            chosen = recolored;
        }
    }
    Ok(Choice {
        field: chosen,
        ranking: *ranking,
        layer_ranking: order.ranking,
        tried_orders: order.tried,
        topology: PreservedTopology::from(&retained.topology),
        tried: tried(&selection),
        why: Some(why(&selection)),
        recolor_gain_db,
        whole: Some(whole),
    })
}

/// All rows, in the order of one ranking: only the layers depend on it.
fn keep_all<'a>(
    scene: &Scene,
    field: &Field,
    settings: &PackageSettings,
    progress: &StagedProgress,
) -> Choice<'a> {
    let ranking = settings.rank.unwrap_or(Ranking::Mass);
    let contributions = match ranking.looks_at_pictures() {
        true => contributions(scene, field, progress),
        false => Vec::new(),
    };
    let order = by_importance(&ranking.scores(field, &contributions));
    Choice {
        field: field.select(&order),
        ranking,
        layer_ranking: ranking,
        tried_orders: Vec::new(),
        topology: PreservedTopology::from(&Topology::default()),
        tried: Vec::new(),
        why: None,
        recolor_gain_db: None,
        whole: None,
    }
}
