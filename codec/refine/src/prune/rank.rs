//! Rankings: importance scores of Gaussians.
//!
//! No ranking is best for all fields. [`Mass`](Ranking::Mass), its temporal form and opacity use the
//! field alone; the others use its pictures.

use codec::Field;
use rayon::prelude::*;

use crate::in_order::for_each_in_order;
use crate::reference::PosedView;
use crate::reference::{Contribution, Order, contributions};

/// An importance score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Ranking {
    /// Visibility mass `o mean(scale)` (the paper's `eq:mass`): peak opacity times the arithmetic mean of
    /// the standard deviations.
    Mass,
    /// Mass times the fraction of the clip in which the Gaussian is alive.
    TemporalMass,
    /// Peak opacity.
    Opacity,
    /// LightGaussian's global significance (Fan et al. 2024): `(V / V_ref)^0.1` times the sum of `o T`
    /// over the pixels that the Gaussian covers, `o` being its opacity at the instant.
    ///
    /// As in the published code, `V` is the product of the standard deviations, `V_ref` the volume at
    /// 90 % of the descending order, and the ratio is not clamped to 1. Unlike there, all pixels count:
    /// the published kernel loses concurrent additions.
    LightGaussian,
    /// RadSplat's importance (Niemeyer et al. 2024): the largest blending weight `alpha T` in any pixel.
    BlendMax,
    /// Accumulated blending weight: the sum of `alpha T` over all pixels.
    BlendSum,
}

/// Exponent of the volume ratio in [`Ranking::LightGaussian`].
const VOLUME_POWER: f64 = 0.1;

/// Position of the reference volume in the descending order of volumes, as a fraction of their number.
const VOLUME_REFERENCE: f64 = 0.9;

impl Ranking {
    /// All rankings, in the order in which they are tried; on ties the first wins.
    pub const ALL: [Ranking; 6] = [
        Ranking::Mass,
        Ranking::TemporalMass,
        Ranking::Opacity,
        Ranking::LightGaussian,
        Ranking::BlendMax,
        Ranking::BlendSum,
    ];

    /// Name in commands and reports.
    pub fn name(self) -> &'static str {
        match self {
            Ranking::Mass => "mass",
            Ranking::TemporalMass => "temporal-mass",
            Ranking::Opacity => "opacity",
            Ranking::LightGaussian => "light-gaussian",
            Ranking::BlendMax => "blend-max",
            Ranking::BlendSum => "blend-sum",
        }
    }

    /// Whether [`Ranking::scores`] uses contributions to pictures.
    pub fn looks_at_pictures(self) -> bool {
        matches!(self, Ranking::LightGaussian | Ranking::BlendMax | Ranking::BlendSum)
    }

    /// Scores of the rows of `field`, higher for more important rows. `seen` are the rows' contributions
    /// to pictures, from [`contributions_to`]; rankings without pictures ignore it.
    ///
    /// # Panics
    /// If the ranking uses pictures and `seen` is shorter than the field.
    pub fn scores(self, field: &Field, seen: &[Contribution]) -> Vec<f64> {
        let rows = 0..field.len();
        let opacity = |row: usize| f64::from(field.opacities[row]);
        match self {
            Ranking::Mass => rows.map(|row| mass(field, row)).collect(),
            Ranking::TemporalMass => rows
                .map(|row| {
                    let alive = field.alive_interval(row).map_or(0.0, |(start, end)| end - start);
                    mass(field, row) * alive
                })
                .collect(),
            Ranking::Opacity => rows.map(opacity).collect(),
            Ranking::LightGaussian => {
                // Log-volumes: a product of scales can underflow.
                let volume = |row: usize| field.log_scales[row].iter().map(|&s| f64::from(s)).sum::<f64>();
                let mut falling: Vec<f64> = rows.clone().map(volume).collect();
                falling.sort_by(|a, b| b.total_cmp(a));
                let reference = (VOLUME_REFERENCE * falling.len() as f64) as usize;
                let Some(reference) = falling.get(reference) else { return Vec::new() };
                rows.map(|row| libm::exp(VOLUME_POWER * (volume(row) - reference)) * seen[row].hits).collect()
            }
            Ranking::BlendMax => rows.map(|row| seen[row].weight_max).collect(),
            Ranking::BlendSum => rows.map(|row| seen[row].weight).collect(),
        }
    }
}

fn mass(field: &Field, row: usize) -> f64 {
    let scales = field.log_scales[row].iter().map(|&s| libm::exp(f64::from(s)));
    f64::from(field.opacities[row]) * scales.sum::<f64>() / 3.0
}

/// Contributions of the rows of `field`, summed over `views`. `on_view` is called after each view.
pub fn contributions_to(views: &[PosedView], field: &Field, mut on_view: impl FnMut()) -> Vec<Contribution> {
    let mut total = vec![Contribution::default(); field.len()];
    let in_view = |PosedView { camera, t }: &PosedView| contributions(field, camera, *t, Order::Depth);
    for_each_in_order(views, in_view, |_, one| {
        total.par_iter_mut().zip(&one).for_each(|(total, one)| total.merge(one));
        on_view();
    });
    total
}

/// Row indices in descending order of `scores`. Equal scores stay in row order; NaN comes last.
pub fn by_importance(scores: &[f64]) -> Vec<usize> {
    // Adding 0 makes -0 equal to 0 for `total_cmp`.
    let key = |row: usize| if scores[row].is_nan() { f64::NEG_INFINITY } else { scores[row] + 0.0 };
    let mut rows: Vec<usize> = (0..scores.len()).collect();
    rows.sort_by(|&a, &b| key(b).total_cmp(&key(a)).then(scores[a].is_nan().cmp(&scores[b].is_nan())));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::posed_views;
    use crate::prune::scenes::around;
    use crate::prune::scenes::{balls, cloud};
    use codec::Temporal;

    /// Two Gaussians whose mean scales are 2 and 1/e.
    fn two() -> Field {
        let mut field = balls(&[[0.0; 3]; 2], 1.0, 0.5);
        field.log_scales = vec![[0.0, 2f32.ln(), 3f32.ln()], [-1.0; 3]];
        field.opacities = vec![0.5, 1.0];
        field
    }

    fn assert_close(actual: &[f64], expected: &[f64]) {
        let close = actual.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6 * b.abs().max(1.0));
        assert!(close && actual.len() == expected.len(), "{actual:?}, {expected:?} expected");
    }

    #[test]
    fn mass_is_opacity_times_mean_scale() {
        assert_close(&Ranking::Mass.scores(&two(), &[]), &[1.0, (-1f64).exp()]);
        assert_close(&Ranking::Opacity.scores(&two(), &[]), &[0.5, 1.0]);
        assert!(![Ranking::Mass, Ranking::Opacity].iter().any(|ranking| ranking.looks_at_pictures()));
    }

    #[test]
    fn temporal_mass_counts_the_time_alive_within_the_clip() {
        let mut field = two();
        let temporal = Temporal { tau: vec![0.0, 0.5], s: vec![0.1, f32::INFINITY], ..Temporal::default() };
        field.temporal = Some(temporal);
        let end = f64::from(0.1f32) * (2.0 * (0.5f64 * 255.0).ln()).sqrt();
        assert_close(&Ranking::TemporalMass.scores(&field, &[]), &[end, (-1f64).exp()]);
    }

    #[test]
    fn light_gaussian_weighs_hits_with_the_volume_ratio() {
        let mut field = balls(&[[0.0; 3]; 10], 1.0, 0.5);
        for row in 0..10 {
            field.log_scales[row] = [row as f32, 0.0, 1.0];
        }
        let seen: Vec<_> =
            (0..10).map(|row| Contribution { hits: 1.0 + row as f64, ..Contribution::default() }).collect();
        // Nine of ten volumes exceed the volume of row 0.
        let expected: Vec<f64> = (0..10).map(|row| (0.1 * row as f64).exp() * (1.0 + row as f64)).collect();
        assert_close(&Ranking::LightGaussian.scores(&field, &seen), &expected);
        assert!(Ranking::LightGaussian.scores(&balls(&[], 1.0, 0.5), &[]).is_empty());
    }

    #[test]
    fn blending_is_summed_and_maximised_over_views() {
        let field = cloud(1, 60);
        let cameras = around(&field, 0.0, (48, 36));
        let views = posed_views(&cameras, &[0.25, 0.75]);
        let mut calls = 0;
        let seen = contributions_to(&views, &field, || calls += 1);
        assert_eq!(calls, 16);
        let single = |view: &PosedView| contributions(&field, &view.camera, view.t, Order::Depth);
        let all: Vec<_> = views.iter().map(single).collect();
        for (ranking, expected) in [
            (Ranking::BlendSum, (0..60).map(|i| all.iter().map(|s| s[i].weight).sum()).collect()),
            (
                Ranking::BlendMax,
                (0..60)
                    .map(|i| all.iter().map(|s| s[i].weight_max).fold(0.0, f64::max))
                    .collect::<Vec<f64>>(),
            ),
        ] {
            assert_close(&ranking.scores(&field, &seen), &expected);
        }
        assert!(seen.iter().filter(|c| c.weight > 0.0).count() > 40);
    }

    #[test]
    fn names_are_distinct() {
        let mut names = Ranking::ALL.map(Ranking::name).to_vec();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Ranking::ALL.len());
    }

    #[test]
    fn order_is_descending_and_stable_with_nan_last() {
        let scores = [0.0, f64::NAN, 2.0, -0.0, f64::INFINITY, 2.0, f64::NEG_INFINITY];
        assert_eq!(by_importance(&scores), [4, 2, 5, 0, 3, 6, 1]);
    }
}
