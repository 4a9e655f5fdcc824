//! [`guided`]: the guided filter, He, Sun and Tang 2010: a mask becomes locally linear in the colours of a picture.

use super::box_mean::box_mean;

/// Pairs of channels, each once.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Filters `mask` (0 to 1) with three channels of a guide as `width` in a row: in squares of `radius` pixels from
/// each pixel, the result is the linear function of the guide that is nearest to the mask, where `smoothness`, in the
/// guide's units squared, keeps its slope small.
pub(super) fn guided(
    mask: &[f32],
    guide: [&[f32]; 3],
    width: usize,
    radius: usize,
    smoothness: f32,
) -> Vec<f32> {
    let mean = |values: &[f32]| box_mean(values, width, radius);
    let product = |a: &[f32], b: &[f32]| -> Vec<f32> {
        mean(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<f32>>())
    };
    let mask_mean = mean(mask);
    let means = guide.map(mean);
    let with_mask = guide.map(|channel| product(channel, mask));
    let pairs = PAIRS.map(|(a, b)| product(guide[a], guide[b]));
    let mut slopes = [vec![0.0; mask.len()], vec![0.0; mask.len()], vec![0.0; mask.len()]];
    let mut offset = vec![0.0; mask.len()];
    for i in 0..mask.len() {
        let m = [means[0][i], means[1][i], means[2][i]];
        let [rr, rg, rb, gg, gb, bb]: [f32; 6] = std::array::from_fn(|k| {
            let (a, b) = PAIRS[k];
            pairs[k][i] - m[a] * m[b] + if a == b { smoothness } else { 0.0 }
        });
        let cov: [f32; 3] = std::array::from_fn(|c| with_mask[c][i] - m[c] * mask_mean[i]);
        // The inverse of the symmetric matrix, by its adjugate.
        let adjugate = [
            [gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg],
            [rb * gb - rg * bb, rr * bb - rb * rb, rg * rb - rr * gb],
            [rg * gb - rb * gg, rg * rb - rr * gb, rr * gg - rg * rg],
        ];
        let determinant = rr * adjugate[0][0] + rg * adjugate[0][1] + rb * adjugate[0][2];
        let mut at_zero = mask_mean[i];
        for c in 0..3 {
            let slope = (0..3).map(|k| adjugate[c][k] * cov[k]).sum::<f32>() / determinant;
            slopes[c][i] = slope;
            at_zero -= slope * m[c];
        }
        offset[i] = at_zero;
    }
    let slopes = slopes.map(|slope| mean(&slope));
    let mut filtered = mean(&offset);
    for (i, value) in filtered.iter_mut().enumerate() {
        *value += (0..3).map(|c| slopes[c][i] * guide[c][i]).sum::<f32>();
    }
    filtered
}
