//! Alignment of depths that have no scale of their own to the cameras' units.

use super::DepthMap;
use crate::median::median;

/// How given depths relate to the units of the capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alignment {
    /// They are in these units already.
    Metric,
    /// Up to one scale, found once: that which makes the median depth of the subject, over all views
    /// of the first frame that has depths, the radius of the rig (the paper's appendix on backbones).
    /// The radius is the median distance of the cameras from the point that their axes pass nearest
    /// to.
    #[default]
    Rig,
    /// Up to a scale and a shift of each map, found by fitting the map to the visual hull's depths.
    Hull,
}

/// What brings depths to other units: `scale * depth + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    pub(super) scale: f64,
    pub(super) shift: f64,
}

impl Affine {
    /// The aligned map; what is unknown, or would be behind the camera, is 0.
    pub(super) fn apply(self, map: &DepthMap) -> DepthMap {
        let aligned = |depth: &f32| match *depth > 0.0 && depth.is_finite() {
            true => ((self.scale * f64::from(*depth) + self.shift) as f32).max(0.0),
            false => 0.0,
        };
        DepthMap { width: map.width, height: map.height, depths: map.depths.iter().map(aligned).collect() }
    }
}

/// Rounds of the two stages of [`robust`]: by absolute deviations, which find the majority wherever
/// they start, then with weights that leave the rest out.
const ROUNDS: [usize; 2] = [10, 5];

/// The scale and shift that take the first of each pair to the second, by iteratively reweighted
/// least squares; up to some 40 % of the pairs may be anything. `None` of fewer than 8 pairs.
///
/// Where the pairs do not tell the two apart (all depths are equal) or the scale is not positive
/// (the depths have nothing to do with the subject), the shift is 0 and the medians agree.
pub(super) fn robust(pairs: &[(f64, f64)]) -> Option<Affine> {
    if pairs.len() < 8 {
        return None;
    }
    let medians = [
        median(pairs.iter().map(|pair| pair.0).collect())?,
        median(pairs.iter().map(|pair| pair.1).collect())?,
    ];
    let by_median = Affine { scale: medians[1] / medians[0], shift: 0.0 };
    let residual = |fit: Affine, (x, y): (f64, f64)| (fit.scale * x + fit.shift - y).abs();
    let mut fit = by_median;
    let mut weights = vec![1.0; pairs.len()];
    for round in 0..ROUNDS[0] + ROUNDS[1] {
        let Some(better) = weighted(pairs, &weights).filter(|fit| fit.scale > 0.0 && fit.scale.is_finite())
        else {
            return Some(by_median);
        };
        fit = better;
        // A thousandth of the depth keeps the weights of exact pairs finite.
        let spread = median(pairs.iter().map(|pair| residual(fit, *pair)).collect())?;
        let spread = (1.4826 * spread).max(1e-3 * medians[1]);
        for (weight, pair) in weights.iter_mut().zip(pairs) {
            let r = residual(fit, *pair) / spread;
            *weight = if round < ROUNDS[0] { 1.0 / r.max(0.01) } else { tukey(r) };
        }
    }
    Some(fit)
}

/// Tukey's biweight with its usual constant.
fn tukey(r: f64) -> f64 {
    let u = r / 4.685;
    if u < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 }
}

/// The weighted least squares fit; `None` where the first numbers of the pairs do not vary.
fn weighted(pairs: &[(f64, f64)], weights: &[f64]) -> Option<Affine> {
    let sum: f64 = weights.iter().sum();
    let each = || pairs.iter().zip(weights);
    let mean_x = each().map(|((x, _), w)| w * x).sum::<f64>() / sum;
    let mean_y = each().map(|((_, y), w)| w * y).sum::<f64>() / sum;
    let xx = each().map(|((x, _), w)| w * (x - mean_x).powi(2)).sum::<f64>();
    let xy = each().map(|((x, y), w)| w * (x - mean_x) * (y - mean_y)).sum::<f64>();
    let scale = xy / xx;
    (xx > 1e-8 * mean_x * mean_x * sum).then_some(Affine { scale, shift: mean_y - scale * mean_x })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depths between 2 and 4, and what an affine map with noise and a share of outliers makes of
    /// them.
    fn pairs(outliers: usize) -> Vec<(f64, f64)> {
        let mut random = fastrand::Rng::with_seed(7);
        let pair = |i: usize| {
            let x = 2.0 + 2.0 * random.f64();
            let noise = 0.01 * (random.f64() - 0.5);
            let y = if i % 100 < outliers { 10.0 * random.f64() } else { 0.7 * x + 0.4 + noise };
            (x, y)
        };
        (0..1000).map(pair).collect()
    }

    #[test]
    fn a_scale_and_a_shift_are_found_among_outliers() {
        for outliers in [0, 20, 40] {
            let fit = robust(&pairs(outliers)).unwrap();
            assert!((fit.scale - 0.7).abs() < 2e-3 && (fit.shift - 0.4).abs() < 5e-3, "{outliers}: {fit:?}");
        }
        // All on one side, as a background is that leaks into masks.
        let far: Vec<_> = pairs(0)
            .into_iter()
            .enumerate()
            .map(|(i, (x, y))| (x, if i % 5 == 0 { 20.0 } else { y }))
            .collect();
        let fit = robust(&far).unwrap();
        assert!((fit.scale - 0.7).abs() < 2e-3 && (fit.shift - 0.4).abs() < 5e-3, "{fit:?}");
    }

    #[test]
    fn depths_that_say_nothing_are_only_scaled() {
        let constant: Vec<_> = pairs(0).into_iter().map(|(_, y)| (3.0, y)).collect();
        let upside_down: Vec<_> = pairs(0).into_iter().map(|(x, y)| (6.0 - x, y)).collect();
        for pairs in [constant, upside_down] {
            let fit = robust(&pairs).unwrap();
            assert_eq!(fit.shift, 0.0);
            assert!((fit.scale * 3.0 - 2.5).abs() < 0.05, "{fit:?}");
        }
        assert_eq!(robust(&pairs(0)[..7]), None);
    }

    #[test]
    fn unknown_depths_stay_unknown() {
        let map = DepthMap { width: 5, height: 1, depths: vec![0.0, -1.0, f32::NAN, 0.5, 2.0] };
        let aligned = Affine { scale: 2.0, shift: -1.5 }.apply(&map);
        assert_eq!(aligned.depths, [0.0, 0.0, 0.0, 0.0, 2.5]);
    }
}
