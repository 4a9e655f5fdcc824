//! [`layer_order`]: the order in which the layers of a package hold the retained Gaussians.
//!
//! A viewer sees the first layers while the rest arrives, and a player with little memory sees only them. The
//! ranking that retains the best Gaussians need not order them well: the largest blending weight retains every
//! Gaussian that matters in some pixel, and puts small opaque ones before large ones. So all rankings compete
//! again, with the first layers of what was retained. The whole package holds the same Gaussians in
//! any order.

use refine::prune::{RESOLUTION_DB, Ranking};
use serde::Serialize;

use super::settings::LAYERS;

/// The retained rows in the order of layers.
pub(crate) struct LayerOrder {
    /// Most important first.
    pub(crate) rows: Vec<usize>,
    /// The ranking that orders them.
    pub(super) ranking: Ranking,
    /// The orders that competed; empty where there is one layer or one ranking.
    pub(super) tried: Vec<TriedOrder>,
}

/// An order of the retained Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TriedOrder {
    /// The ranking.
    pub ranking: &'static str,
    /// Whether the layers of the package have this order.
    pub chosen: bool,
    /// PSNR in dB between pictures of the first layers before coding and of the whole field, for every layer but
    /// the last.
    pub prefix_psnr_db: Vec<f64>,
}

impl TriedOrder {
    fn mean_psnr_db(&self) -> f64 {
        self.prefix_psnr_db.iter().sum::<f64>() / self.prefix_psnr_db.len() as f64
    }
}

/// Orders the `retained` rows, which are in the order of the ranking `own`, by the ranking in `rankings` whose
/// first layers look most like the whole field: the mean PSNR over all prefixes of layers. `own` keeps its
/// order unless another's mean is better by more than [`RESOLUTION_DB`]. `order` returns the rows of the whole
/// field by a ranking, `judge` the PSNR in dB of rows.
pub(super) fn layer_order(
    rankings: &[Ranking],
    own: Ranking,
    retained: &[usize],
    order: impl Fn(Ranking) -> Vec<usize>,
    mut judge: impl FnMut(&[usize]) -> f64,
) -> LayerOrder {
    let ends: Vec<usize> = LAYERS.into_iter().filter(|&end| end < retained.len()).collect();
    if ends.is_empty() || rankings.len() < 2 {
        return LayerOrder { rows: retained.to_vec(), ranking: own, tried: Vec::new() };
    }
    let reordered = |ranking: Ranking| -> Vec<usize> {
        let mut rows = order(ranking);
        let mut is_retained = vec![false; rows.len()];
        retained.iter().for_each(|&row| is_retained[row] = true);
        rows.retain(|&row| is_retained[row]);
        rows
    };
    let mut tried = Vec::new();
    for &ranking in rankings {
        let rows = reordered(ranking);
        let prefix_psnr_db = ends.iter().map(|&end| judge(&rows[..end])).collect();
        tried.push(TriedOrder { ranking: ranking.name(), chosen: false, prefix_psnr_db });
    }
    let mean = |i: usize| tried[i].mean_psnr_db();
    let of_own = rankings.iter().position(|&ranking| ranking == own);
    let best = (0..tried.len()).fold(0, |best, i| if mean(i) > mean(best) { i } else { best });
    let chosen = of_own.filter(|&i| mean(i) >= mean(best) - RESOLUTION_DB).unwrap_or(best);
    tried[chosen].chosen = true;
    LayerOrder { rows: reordered(rankings[chosen]), ranking: rankings[chosen], tried }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: Ranking = Ranking::BlendMax;

    /// Orders 12,000 of 20,000 rows: [`OWN`] ranks them as numbered, blending by its sum in reverse, mass the
    /// odd ones first. `judge` gives the PSNR of a prefix by its first row and its length.
    fn order(judge: impl Fn(usize, usize) -> f64) -> LayerOrder {
        let by = |ranking| -> Vec<usize> {
            match ranking {
                Ranking::BlendSum => (0..20_000).rev().collect(),
                Ranking::Mass => (1..20_000).step_by(2).chain((0..20_000).step_by(2)).collect(),
                _ => (0..20_000).collect(),
            }
        };
        let retained: Vec<usize> = (0..12_000).collect();
        let rankings = [Ranking::Mass, OWN, Ranking::BlendSum];
        layer_order(&rankings, OWN, &retained, by, |rows| judge(rows[0], rows.len()))
    }

    #[test]
    fn the_mean_over_the_first_layers_decides() {
        // Mass has the best first layer, the sum of blending the best mean.
        let judge = |first: usize, rows: usize| match (first, rows) {
            (1, 5_000) => 24.0,
            (1, 10_000) => 25.0,
            (11_999, 5_000) => 23.0,
            (11_999, 10_000) => 27.0,
            (0, _) => 20.0,
            other => panic!("{other:?} is no prefix of layers of the retained rows"),
        };
        let LayerOrder { rows, ranking, tried } = order(judge);
        assert_eq!((ranking, rows), (Ranking::BlendSum, (0..12_000).rev().collect()));
        assert_eq!(tried.iter().map(|order| order.chosen).collect::<Vec<_>>(), [false, false, true]);
        assert_eq!(tried[0].prefix_psnr_db, [24.0, 25.0]);
    }

    #[test]
    fn the_own_order_stays_within_the_resolution() {
        let by_gain = |gain: f64| order(move |first, _| if first == 0 { 20.0 } else { 20.0 + gain }).ranking;
        assert_eq!((by_gain(0.09), by_gain(0.11)), (OWN, Ranking::Mass));
    }

    #[test]
    fn one_layer_or_one_ranking_leaves_nothing_to_choose() {
        let never = |_: &[usize]| -> f64 { panic!("nothing to judge") };
        for (rankings, len) in [(&Ranking::ALL[..], 5_000), (&[OWN][..], 6_000)] {
            let retained: Vec<usize> = (0..len).rev().collect();
            let order = layer_order(rankings, OWN, &retained, |_| panic!("no order"), never);
            assert_eq!((order.rows, order.ranking, order.tried), (retained, OWN, vec![]));
        }
    }
}
