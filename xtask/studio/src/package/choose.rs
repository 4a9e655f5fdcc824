//! [`choose`]: the Gaussians that a budget keeps, most important first.
//!
//! Each candidate ranking prunes and the topology floor mends. Every candidate, with and without the floor, is
//! compared with the whole field in pictures, before coding; the best one wins. The order of its rows
//! for the layers is chosen after that, and a budget of fragments leaves out some of them.

use codec::{Clip, Field};
use program::Fault;
use refine::prune::{Pictures, Ranking, Topology, by_importance, recolor};

use super::analysis::{FieldAnalysis, contributions};
use super::layer_order::{LayerOrder, TriedOrder};
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
    /// PSNR in dB of a clip against the whole field, in pictures that chose nothing; `None` where nothing was left out.
    pub(super) fn whole_psnr_db(&self, clip: &Clip) -> Option<f64> {
        self.whole.as_ref().map(|whole| whole.reported_psnr(clip))
    }
}

/// Chooses `settings.budget` of the rows of `field`, which is not empty, and of these `settings.fragments`.
///
/// # Errors
/// [`Fault::Usage`] where so few fragments hold no Gaussian.
pub(super) fn choose<'a>(
    scene: &'a Scene,
    field: &'a Field,
    plate: Option<&'a Field>,
    settings: &'a PackageSettings,
    progress: &'a StagedProgress,
) -> anyhow::Result<Choice<'a>> {
    let budget = settings.budget.filter(|&budget| budget < field.len());
    if budget.is_none() && settings.fragments.is_none() {
        return Ok(keep_all(scene, field, settings, progress));
    }
    let whole = FieldAnalysis::new(scene, field, plate, settings, progress)?;
    let selection = budget.map(|budget| whole.select(budget));
    let selected = selection.as_ref().map(|selection| &selection.candidates[selection.best]);
    let ranking = selected.map_or(settings.rank.unwrap_or(Ranking::Mass), |selected| selected.ranking);
    let mut order = match selected {
        Some(selected) => whole.layer_order(selected),
        None => LayerOrder { rows: whole.order(ranking), ranking, tried: Vec::new() },
    };
    let mut topology = selected.map_or(Topology::default(), |selected| selected.retained.topology);
    if let Some(fraction) = settings.fragments {
        let seen = whole.fragment_contributions(&order.rows);
        (order.rows, topology) = whole.within_fragments(&order.rows, &seen, fraction);
    }
    if order.rows.is_empty() {
        return Err(nothing_left(scene));
    }
    let mut chosen = field.select(&order.rows);
    let mut recolor_gain_db = None;
    if settings.recolor {
        let psnr_db = match (selected, settings.fragments) {
            (Some(selected), None) => selected.psnr_db,
            _ => whole.psnr(&chosen),
        };
        progress.stage("colours", 1);
        let views = recolor_views(scene, field);
        let pictures = Pictures::take(&render_scene(field, plate), views, || ());
        let recolored = recolor(&chosen, plate, &pictures, || ());
        let gain = whole.psnr(&recolored) - psnr_db;
        recolor_gain_db = Some(gain);
        if gain > 0.0 {
            chosen = recolored;
        }
    }
    Ok(Choice {
        field: chosen,
        ranking,
        layer_ranking: order.ranking,
        tried_orders: order.tried,
        topology: PreservedTopology::from(&topology),
        tried: selection.as_ref().map(tried).unwrap_or_default(),
        why: selection.as_ref().map(why),
        recolor_gain_db,
        whole: Some(whole),
    })
}

/// The error where a budget of fragments is less than the first Gaussian's.
fn nothing_left(scene: &Scene) -> anyhow::Error {
    let name = &scene.name;
    Fault::Usage(format!("{name}: so few fragments hold no Gaussian; give a larger --fragments")).into()
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
