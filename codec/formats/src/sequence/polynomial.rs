//! [`Polynomial`]: weighted least squares of one variable, in a basis that is well conditioned.

/// Coefficients at most: a cubic.
const COEFFICIENTS: usize = 4;

/// Pivot, relative to the largest, below which the samples do not determine a coefficient.
const PIVOT_MIN: f64 = 1e-9;

/// A polynomial in `(t - origin) / width`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polynomial {
    origin: f64,
    width: f64,
    coefficients: [f64; COEFFICIENTS],
}

/// Fits a polynomial of degree `degree`, at most 3, to samples `(t, weight, value)` by weighted least squares, or of
/// the largest degree below it that they determine. Without weight anywhere it is zero.
pub(super) fn fit(degree: usize, samples: impl Iterator<Item = (f64, f64, f64)> + Clone) -> Polynomial {
    let ends = samples.clone().filter(|(_, weight, _)| *weight > 0.0).fold(None, |ends, (t, _, _)| {
        let (low, high): (f64, f64) = ends.unwrap_or((t, t));
        Some((low.min(t), high.max(t)))
    });
    let (low, high) = ends.unwrap_or((0.0, 0.0));
    let (origin, width) = (0.5 * (low + high), if high > low { 0.5 * (high - low) } else { 1.0 });
    let mut normal = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    let mut right = [0.0; COEFFICIENTS];
    for (t, weight, value) in samples {
        if weight > 0.0 {
            let powers = powers((t - origin) / width);
            for row in 0..COEFFICIENTS {
                right[row] += weight * powers[row] * value;
                (0..COEFFICIENTS).for_each(|k| normal[row][k] += weight * powers[row] * powers[k]);
            }
        }
    }
    let coefficients =
        (1..=degree + 1).rev().find_map(|count| solve(count, normal, right)).unwrap_or_default();
    Polynomial { origin, width, coefficients }
}

fn powers(u: f64) -> [f64; COEFFICIENTS] {
    [1.0, u, u * u, u * u * u]
}

/// Solves the first `count` normal equations by elimination; `None` if they are singular.
fn solve(
    count: usize,
    mut normal: [[f64; COEFFICIENTS]; COEFFICIENTS],
    mut right: [f64; COEFFICIENTS],
) -> Option<[f64; COEFFICIENTS]> {
    // Positive definite, so the diagonal holds the pivots.
    let least = PIVOT_MIN * normal[0][0];
    for pivot in 0..count {
        if normal[pivot][pivot].is_nan() || normal[pivot][pivot] <= least {
            return None;
        }
        for row in pivot + 1..count {
            let factor = normal[row][pivot] / normal[pivot][pivot];
            (pivot..count).for_each(|k| normal[row][k] -= factor * normal[pivot][k]);
            right[row] -= factor * right[pivot];
        }
    }
    let mut solution = [0.0; COEFFICIENTS];
    for row in (0..count).rev() {
        let known: f64 = (row + 1..count).map(|k| normal[row][k] * solution[k]).sum();
        solution[row] = (right[row] - known) / normal[row][row];
    }
    Some(solution)
}

impl Polynomial {
    /// The value at `t`.
    pub(super) fn at(&self, t: f64) -> f64 {
        let powers = powers((t - self.origin) / self.width);
        (0..COEFFICIENTS).map(|k| self.coefficients[k] * powers[k]).sum()
    }

    /// Coefficients of the powers of `t - tau`.
    pub(super) fn about(&self, tau: f64) -> [f64; COEFFICIENTS] {
        let [a, b, c, d] = self.coefficients;
        let (u, w) = ((tau - self.origin) / self.width, self.width);
        [
            a + u * (b + u * (c + u * d)),
            (b + u * (2.0 * c + 3.0 * u * d)) / w,
            (c + 3.0 * u * d) / (w * w),
            d / (w * w * w),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_found_again_and_few_samples_give_less() {
        let cubic = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t - 4.0 * t * t * t;
        let samples =
            |count: usize| (0..count).map(move |k| 0.2 + 0.1 * k as f64).map(|t| (t, 1.0 + t, cubic(t)));
        let fitted = fit(3, samples(7));
        assert!((fitted.at(0.77) - cubic(0.77)).abs() < 1e-9);
        for (found, expected) in fitted.about(0.0).iter().zip([1.0, -2.0, 3.0, -4.0]) {
            assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
        }
        assert!((fit(3, samples(2)).at(0.3) - cubic(0.3)).abs() < 1e-9, "a line through two");
        assert_eq!(fit(3, samples(1)).at(9.0), cubic(0.2));
        assert_eq!(fit(3, samples(0)).at(9.0), 0.0);
    }
}
