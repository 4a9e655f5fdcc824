//! Aligns depth maps of unknown scale to the units of the cameras.

use super::DepthMap;
use crate::median::median;

/// Relation of given depths to the units of the capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alignment {
    /// The depths are in these units.
    Metric,
    /// One unknown scale for the whole capture. It is found once: in the first frame that has depths,
    /// the median depth of the subject over all views becomes the radius of the rig (the paper's
    /// appendix on backbones). The radius is the median distance of the cameras from the point
    /// nearest to all optical axes.
    #[default]
    Rig,
    /// An unknown scale and shift per map, fitted to the depths of the visual hull.
    Hull,
}

/// A change of units of depths: `scale * depth + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    pub(super) scale: f64,
    pub(super) shift: f64,
}

impl Affine {
    /// Applies the change. Depths that are unknown, or would lie behind the camera, become 0.
    pub(super) fn apply(self, map: &DepthMap) -> DepthMap {
        let aligned = |depth: &f32| match *depth > 0.0 && depth.is_finite() {
            true => ((self.scale * f64::from(*depth) + self.shift) as f32).max(0.0),
            false => 0.0,
        };
        DepthMap { width: map.width, height: map.height, depths: map.depths.iter().map(aligned).collect() }
    }
}

/// Rounds of the two stages of [`robust`]: least absolute deviations find the majority from any start,
/// then Tukey's weights exclude the outliers.
const ROUNDS: [usize; 2] = [10, 5];

/// Fits the scale and shift that take the first of each pair to the second, by iteratively reweighted
/// least squares. Tolerates about 40 % outliers. `None` for fewer than 8 pairs.
///
/// If the first numbers are all equal, or the fitted scale is not positive, the result scales median
/// to median, with shift 0.
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
        // The lower bound keeps the weights of exact pairs finite.
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

/// Weighted least squares fit; `None` if the first numbers of the pairs do not vary.
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

    /// Depths between 2 and 4, paired with their affine image with noise and `outliers` percent of
    /// outliers.
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
    fn fits_scale_and_shift_among_outliers() {
        for outliers in [0, 20, 40] {
            let fit = robust(&pairs(outliers)).unwrap();
            assert!((fit.scale - 0.7).abs() < 2e-3 && (fit.shift - 0.4).abs() < 5e-3, "{outliers}: {fit:?}");
        }
        // Outliers on one side only, as from background that leaks into masks.
        let far: Vec<_> = pairs(0)
            .into_iter()
            .enumerate()
            .map(|(i, (x, y))| (x, if i % 5 == 0 { 20.0 } else { y }))
            .collect();
        let fit = robust(&far).unwrap();
        assert!((fit.scale - 0.7).abs() < 2e-3 && (fit.shift - 0.4).abs() < 5e-3, "{fit:?}");
    }

    #[test]
    fn uninformative_depths_are_only_scaled() {
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
