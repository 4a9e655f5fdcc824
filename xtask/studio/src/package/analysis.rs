//! [`FieldAnalysis`]: the topology of a whole field, its pictures, and the contributions of its rows, with
//! which parts of it are chosen and judged.

use codec::{Clip, Field};
use refine::prune::{
    Candidate, Floor, FloorSettings, Measure, Pictures, ROUNDS, Ranking, Selection, Topology, by_importance,
    contributions_to, instants, select, weight_per_fragment, within_fragments,
};
use refine::reference::{Contribution, RenderScene};

use super::layer_order::{LayerOrder, layer_order};
use super::settings::{LAYERS, PackageSettings};
use super::views::{fragment_views, judging_views, ranking_views, render_scene, whole_views};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// Instants at which the topology is held.
pub(crate) const FLOOR_INSTANTS: usize = 4;

/// A whole field, analysed.
pub(crate) struct FieldAnalysis<'a> {
    scene: &'a Scene,
    field: &'a Field,
    plate: Option<&'a Field>,
    settings: &'a PackageSettings,
    progress: &'a StagedProgress,
    /// Contributions of rows to pictures; empty where no ranking uses them.
    contributions: Vec<Contribution>,
    judge: Pictures,
    floor: Floor,
}

impl<'a> FieldAnalysis<'a> {
    /// Renders a field and finds its topology.
    pub(crate) fn new(
        scene: &'a Scene,
        field: &'a Field,
        plate: Option<&'a Field>,
        settings: &'a PackageSettings,
        progress: &'a StagedProgress,
    ) -> anyhow::Result<FieldAnalysis<'a>> {
        let contributions = match rankings(settings).into_iter().any(Ranking::looks_at_pictures) {
            true => contributions(scene, field, progress),
            false => Vec::new(),
        };
        let views = judging_views(scene, field);
        progress.stage("pictures of the whole", views.len());
        let judge = Pictures::take_before(&RenderScene::from(field), plate, views, || progress.step());
        progress.stage("topology of the whole", 1);
        let floor = floor(field, Measure::default());
        progress.step();
        Ok(FieldAnalysis { scene, field, plate, settings, progress, contributions, judge, floor })
    }

    /// The rows by a ranking, most important first.
    ///
    /// # Panics
    /// If the ranking looks at pictures and the settings name another ranking.
    pub(crate) fn order(&self, ranking: Ranking) -> Vec<usize> {
        by_importance(&ranking.scores(self.field, &self.contributions))
    }

    /// The best `budget` rows: each ranking prunes, alone and with the topology floor, and the candidate
    /// that looks most like the whole field wins.
    pub(crate) fn select(&self, budget: usize) -> Selection {
        let prune = |ranking: Ranking| {
            self.progress.stage(selecting(ranking), 1 + ROUNDS);
            let order = self.order(ranking);
            match self.settings.no_floor {
                true => vec![self.floor.leave(&order, budget)],
                false => self.floor.choices(&order, budget, || self.progress.step()),
            }
        };
        let judge = |rows: &[usize]| self.psnr(&self.field.select(rows));
        select(&rankings(self.settings), prune, judge).expect("there is a ranking")
    }

    /// The rows of a selected candidate in the order of layers.
    pub(crate) fn layer_order(&self, selected: &Candidate) -> LayerOrder {
        let rankings = rankings(self.settings);
        self.progress.stage("layers", rankings.len() * (LAYERS.len() - 1));
        let judge = |rows: &[usize]| {
            self.progress.step();
            self.psnr(&self.field.select(rows))
        };
        layer_order(
            &rankings,
            selected.ranking,
            &selected.retained.rows,
            |ranking| self.order(ranking),
            judge,
        )
    }

    /// The contributions of `rows` to the pictures in which [`within_fragments`](Self::within_fragments) counts
    /// fragments.
    pub(crate) fn fragment_contributions(&self, rows: &[usize]) -> Vec<Contribution> {
        let part = self.field.select(rows);
        let views = fragment_views(self.scene, &part);
        self.progress.stage("fragments", views.len());
        contributions_to(&views, &part, || self.progress.step())
    }

    /// The `rows` that have at most `fraction` of their fragments, in the same order, and the topology that they
    /// preserve: those that show least for their fragments are left out, except where the floor swaps them. `seen` is
    /// [`fragment_contributions`](Self::fragment_contributions) of `rows`.
    pub(crate) fn within_fragments(
        &self,
        rows: &[usize],
        seen: &[Contribution],
        fraction: f64,
    ) -> (Vec<usize>, Topology) {
        let order = by_importance(&weight_per_fragment(seen));
        let count = within_fragments(&order, seen, fraction);
        let order: Vec<usize> = order.into_iter().map(|i| rows[i]).collect();
        let retained = match self.settings.no_floor {
            true => self.floor.leave(&order, count),
            false => self.floor.enforce(&order, count, || ()),
        };
        let mut is_retained = vec![false; self.field.len()];
        retained.rows.iter().for_each(|&row| is_retained[row] = true);
        (rows.iter().copied().filter(|&row| is_retained[row]).collect(), retained.topology)
    }

    /// PSNR in dB of `part` in the judging pictures, before coding: coding errors, which a user chooses to be below what
    /// a budget costs, must not decide.
    pub(crate) fn psnr(&self, part: &Field) -> f64 {
        self.judge.psnr(&RenderScene::from(part), || ())
    }

    /// PSNR in dB of a clip in pictures of the whole field that chose nothing.
    pub(crate) fn reported_psnr(&self, clip: &Clip) -> f64 {
        let views = whole_views(self.scene, self.field);
        let pictures = Pictures::take(&render_scene(self.field, self.plate), views, || ());
        pictures.psnr(&RenderScene::from(clip), || ())
    }
}

/// The stage that selects by a ranking.
pub(super) fn selecting(ranking: Ranking) -> String {
    format!("selecting by {}", ranking.name())
}

/// The rankings to try.
pub(super) fn rankings(settings: &PackageSettings) -> Vec<Ranking> {
    settings.rank.map_or(Ranking::ALL.to_vec(), |ranking| vec![ranking])
}

/// Contributions of the rows of a field to the ranking views.
pub(super) fn contributions(scene: &Scene, field: &Field, progress: &StagedProgress) -> Vec<Contribution> {
    let views = ranking_views(scene, field);
    progress.stage("ranking", views.len());
    contributions_to(&views, field, || progress.step())
}

/// The topology of a field that packages preserve.
pub(crate) fn floor(field: &Field, measure: Measure) -> Floor {
    let instants = instants(field, FLOOR_INSTANTS);
    Floor::new(field, FloorSettings { instants, measure, ..FloorSettings::default() })
}
