//! [`add_size_penalty`]: a term of the loss that keeps Gaussians small.
//!
//! The player pays for the pixels that a Gaussian covers, seen or not. The picture says nothing about the size of one
//! that is nearly hidden or nearly transparent, so without this term, half of the fragments show next to nothing.

use crate::fit::parameters::Parameters;
use crate::fit::precision::Real;

/// Weight of the mean over the Gaussians in a picture of the sum of their three standard deviations, in extents of the
/// scene. The term is that of "3D Gaussian splatting as Markov chain Monte Carlo" (Kheradmand et al., 2024), section 4;
/// `codec/refine/README.md` has the measurement of its weight.
pub(in crate::fit) const SIZE_PENALTY: f64 = 0.05;

/// Adds the gradient of `weight` times the mean, over `rows`, of the sum of the standard deviations; row `i` of
/// `gradient` is that of `rows[i]`. `weight` is per unit of the capture.
pub(in crate::fit) fn add_size_penalty<T: Real>(
    gradient: &mut Parameters<T>,
    parameters: &Parameters<T>,
    rows: &[u32],
    weight: f64,
) {
    let each = T::from_f64(weight / rows.len().max(1) as f64);
    for (gradient, row) in gradient.log_scales.iter_mut().zip(rows) {
        for (by, log_scale) in gradient.iter_mut().zip(parameters.log_scales[*row as usize]) {
            *by += each * log_scale.exp();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against a difference of the term itself.
    #[test]
    fn the_gradient_is_that_of_the_mean_size() {
        let parameters = |log_scale: f64| Parameters::<f64> {
            centers: vec![[0.0; 3]; 3],
            log_scales: vec![[-1.0; 3], [-2.0, log_scale, -0.5], [-3.0; 3]],
            ..Parameters::default()
        };
        let term = |log_scale: f64| {
            let shown = &parameters(log_scale).log_scales[1..];
            0.7 * shown.as_flattened().iter().map(|s| s.exp()).sum::<f64>() / 2.0
        };
        let mut gradient = Parameters { log_scales: vec![[0.25; 3]; 2], ..Parameters::default() };
        add_size_penalty(&mut gradient, &parameters(-1.5), &[1, 2], 0.7);
        let difference = (term(-1.5 + 1e-5) - term(-1.5 - 1e-5)) / 2e-5;
        assert!((gradient.log_scales[0][1] - 0.25 - difference).abs() < 1e-9);
        assert!((gradient.log_scales[1][0] - 0.25 - 0.35 * (-3.0_f64).exp()).abs() < 1e-12);
    }
}
