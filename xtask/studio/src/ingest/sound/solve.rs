//! Least squares over the graph of pairs: a number for each camera, whose differences are the pairs' differences.

use refine::metrics::median;

use super::pair::{CONFIDENCE_MIN, SoundPair};

/// Deviation in seconds that is always kept.
const KEPT_S: f64 = 5e-4;

/// The same for drifts, in parts per million.
const KEPT_PPM: f64 = 5.0;

/// Numbers of the cameras, the first 0, and what they leave of the pairs' differences; `None` of pairs that were dropped.
#[derive(Debug)]
pub(super) struct Solution {
    pub(super) values: Vec<f64>,
    pub(super) residuals: Vec<Option<f64>>,
}

/// Starts in seconds.
pub(super) fn starts(cameras: usize, pairs: &[SoundPair]) -> Solution {
    solve(cameras, pairs, |pair| pair.later_s, KEPT_S)
}

/// Drifts in parts per million against the median one.
pub(super) fn drifts(cameras: usize, pairs: &[SoundPair]) -> Vec<f64> {
    let mut values = solve(cameras, pairs, |pair| pair.drift_ppm, KEPT_PPM).values;
    let middle = median(values.clone()).unwrap_or(0.0);
    values.iter_mut().for_each(|value| *value -= middle);
    values
}

/// The number of the group of each camera: the smallest camera that pairs join it with.
pub(super) fn groups<'p>(cameras: usize, pairs: impl Iterator<Item = &'p SoundPair>) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..cameras).collect();
    for pair in pairs {
        let [a, b] = pair.cameras.map(|camera| groups[camera]);
        groups.iter_mut().filter(|group| **group == a.max(b)).for_each(|group| *group = a.min(b));
    }
    groups
}

fn solve(cameras: usize, pairs: &[SoundPair], difference: fn(&SoundPair) -> f64, kept: f64) -> Solution {
    let mut used: Vec<bool> = pairs.iter().map(|pair| pair.confidence >= CONFIDENCE_MIN).collect();
    loop {
        let values = least_squares(cameras, pairs, &used, difference);
        let residual = |values: &[f64], i: usize| {
            let [a, b] = pairs[i].cameras;
            difference(&pairs[i]) - (values[b] - values[a])
        };
        // The worst goes first: it bends the others. A pair that alone joins its cameras leaves no residual, so that few are
        // asked whether others join them, which takes a walk over all pairs.
        let mut off: Vec<(f64, usize)> = (0..pairs.len())
            .filter(|i| used[*i])
            .map(|i| (residual(&values, i).abs(), i))
            .filter(|(size, _)| *size > 0.25 * kept)
            .collect();
        off.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        let worst = off.into_iter().map(|(_, i)| i).find(|i| is_joined_without(cameras, pairs, &used, *i));
        let is_outlier = worst.is_some_and(|worst| {
            used[worst] = false;
            let others = least_squares(cameras, pairs, &used, difference);
            let sizes = (0..pairs.len()).filter(|i| used[*i]).map(|i| residual(&others, i).abs()).collect();
            let usual = median(sizes).unwrap_or(0.0);
            let is_outlier = residual(&others, worst).abs() > kept.max(4.0 * usual);
            used[worst] = !is_outlier;
            is_outlier
        });
        if !is_outlier {
            let residuals = (0..pairs.len()).map(|i| used[i].then(|| residual(&values, i))).collect();
            return Solution { values, residuals };
        }
    }
}

/// Whether the cameras of a pair are joined by others.
fn is_joined_without(cameras: usize, pairs: &[SoundPair], used: &[bool], without: usize) -> bool {
    let others = pairs.iter().enumerate().filter(|(i, _)| used[*i] && *i != without).map(|(_, pair)| pair);
    let groups = groups(cameras, others);
    let [a, b] = pairs[without].cameras;
    groups[a] == groups[b]
}

/// Solves the normal equations, the Laplacian of the graph, with the first camera at 0.
fn least_squares(
    cameras: usize,
    pairs: &[SoundPair],
    used: &[bool],
    difference: fn(&SoundPair) -> f64,
) -> Vec<f64> {
    let mut rows = vec![vec![0.0; cameras + 1]; cameras];
    for (pair, _) in pairs.iter().zip(used).filter(|(_, used)| **used) {
        let [a, b] = pair.cameras;
        // A confident pair counts more, but many weak ones still outweigh it.
        let weight = pair.confidence.sqrt();
        for (i, j, sign) in [(a, b, -1.0), (b, a, 1.0)] {
            rows[i][i] += weight;
            rows[i][j] -= weight;
            rows[i][cameras] += sign * weight * difference(pair);
        }
    }
    // The first, and any that nothing joins, is at 0.
    for (i, row) in rows.iter_mut().enumerate() {
        if i == 0 || row[i] == 0.0 {
            row.fill(0.0);
            row[i] = 1.0;
        }
    }
    for pivot in 0..cameras {
        let by = rows[pivot].clone();
        for row in rows.iter_mut().skip(pivot + 1).filter(|row| row[pivot] != 0.0) {
            let factor = row[pivot] / by[pivot];
            row.iter_mut().zip(&by).for_each(|(x, by)| *x -= factor * by);
        }
    }
    let mut values = vec![0.0; cameras];
    for i in (0..cameras).rev() {
        let known: f64 = (i + 1..cameras).map(|j| rows[i][j] * values[j]).sum();
        values[i] = (rows[i][cameras] - known) / rows[i][i];
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(cameras: [usize; 2], later_s: f64) -> SoundPair {
        SoundPair { cameras, later_s, drift_ppm: 0.0, confidence: 50.0, residual_s: None, curve: Vec::new() }
    }

    #[test]
    fn a_pair_that_contradicts_the_others_is_dropped() {
        let truth = [0.0, 0.5, -0.25, 1.0];
        let mut pairs: Vec<SoundPair> = super::super::correlate::pairs(4)
            .into_iter()
            .map(|[a, b]| pair([a, b], truth[b] - truth[a]))
            .collect();
        pairs[2].later_s += 0.3;
        let Solution { values, residuals } = starts(4, &pairs);
        assert!(values.iter().zip(truth).all(|(x, y)| (x - y).abs() < 1e-9), "{values:?}");
        assert_eq!(residuals.iter().filter(|x| x.is_none()).count(), 1);
        assert!(residuals[2].is_none());
    }

    /// Of 48 cameras, in the time of a solution for each.
    #[test]
    fn many_pairs_that_contradict_the_others_are_dropped() {
        let truth = |camera: usize| (camera as f64 * 0.7).sin();
        let mut pairs: Vec<SoundPair> = super::super::correlate::pairs(48)
            .into_iter()
            .map(|[a, b]| pair([a, b], truth(b) - truth(a)))
            .collect();
        pairs.iter_mut().step_by(11).zip(1..).for_each(|(pair, i)| pair.later_s += 0.01 * f64::from(i));
        let Solution { values, residuals } = starts(48, &pairs);
        assert!((0..48).all(|camera| (values[camera] - truth(camera)).abs() < 1e-9), "{values:?}");
        assert_eq!(residuals.iter().filter(|x| x.is_none()).count(), pairs.len().div_ceil(11));
    }

    #[test]
    fn the_only_pair_of_a_camera_stays() {
        let pairs = [pair([0, 1], 0.1), pair([1, 2], 0.2), pair([0, 2], 0.9), pair([2, 3], 5.0)];
        let Solution { values, .. } = starts(4, &pairs);
        assert!((values[3] - values[2] - 5.0).abs() < 1e-9, "{values:?}");
        assert_eq!(groups(5, pairs.iter()), [0, 0, 0, 0, 4]);
    }
}
