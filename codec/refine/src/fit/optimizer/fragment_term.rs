//! [`add_fragment_term`]: a term of the loss that makes Gaussians cover fewer pixels.
//!
//! The player pays for the pixels that a Gaussian covers, seen or not. The images say nothing about the size of one
//! that is nearly hidden or nearly transparent, so without this term, most of the fragments show next to nothing.

use rayon::prelude::*;

use crate::fit::parameters::Parameters;
use crate::raster::Real;

/// Rows per parallel task at least.
const CHUNK: usize = 1024;

/// Adds the gradient of `weight` times the sum, over `rows`, of `ab + bc + ca` for the standard deviations `a, b, c`;
/// row `i` of `gradient` is the gradient of `rows[i]`. `weight` is per squared unit of the capture.
///
/// `ab + bc + ca` is nearly proportional to the area that an ellipsoid covers in the mean over all directions, a
/// quarter of its surface: the views of a player are not the views of the capture.
pub(in crate::fit) fn add_fragment_term<T: Real>(
    gradient: &mut Parameters<T>,
    parameters: &Parameters<T>,
    rows: &[u32],
    weight: f64,
) {
    let weight = T::from_f64(weight);
    gradient.log_scales.par_iter_mut().zip(rows).with_min_len(CHUNK).for_each(|(gradient, row)| {
        let scales = parameters.log_scales[*row as usize].map(T::exp);
        let sum = scales[0] + scales[1] + scales[2];
        for (by, scale) in gradient.iter_mut().zip(scales) {
            *by += weight * scale * (sum - scale);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against a difference of the term itself.
    #[test]
    fn the_gradient_is_that_of_the_area() {
        let parameters = |log_scale: f64| Parameters::<f64> {
            centers: vec![[0.0; 3]; 3],
            log_scales: vec![[-1.0; 3], [-2.0, log_scale, -0.5], [-3.0; 3]],
            ..Parameters::default()
        };
        let term = |log_scale: f64| {
            let area = |scales: &[f64; 3]| {
                let [a, b, c] = scales.map(f64::exp);
                a * b + b * c + c * a
            };
            0.7 * parameters(log_scale).log_scales[1..].iter().map(area).sum::<f64>()
        };
        let mut gradient = Parameters { log_scales: vec![[0.25; 3]; 2], ..Parameters::default() };
        add_fragment_term(&mut gradient, &parameters(-1.5), &[1, 2], 0.7);
        let difference = (term(-1.5 + 1e-5) - term(-1.5 - 1e-5)) / 2e-5;
        assert!((gradient.log_scales[0][1] - 0.25 - difference).abs() < 1e-9);
        assert!((gradient.log_scales[1][0] - 0.25 - 1.4 * (-6.0_f64).exp()).abs() < 1e-12);
    }
}
