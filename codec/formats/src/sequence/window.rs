//! [`Window`]: the temporal opacity of a Gaussian, and the windows that follow the opacities of a row.
//!
//! One window is found by least squares on the logarithm of the opacity, which is a parabola. A row of equal windows
//! gets its peaks by the multiplicative steps of Richardson and Lucy, which keep them positive.

use codec::ALPHA_MIN;

use super::polynomial;
use super::samples::Samples;

/// Largest difference of opacity that counts as none: five steps of an 8-bit pixel.
pub(super) const OPACITY_TOLERANCE: f64 = 5.0 / 255.0;

/// A centre of a window further from the clip than this, in clip time, is not determined by the frames.
const OUTSIDE_MAX: f64 = 0.5;

/// Standard deviation of the windows in a row of them, in distances between them: opacities then ripple by less than
/// [`OPACITY_TOLERANCE`], and five windows are open at an instant.
const OVERLAP: f64 = 0.75;

/// Steps that the peaks of a row of windows take.
const STEPS: usize = 16;

/// A window that is open everywhere has an infinite `s`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    pub(super) tau: f64,
    pub(super) s: f64,
    pub(super) peak: f64,
}

impl Window {
    /// The opacity at clip time `t`.
    pub(super) fn at(&self, t: f64) -> f64 {
        let z = (t - self.tau) / self.s;
        self.peak * (-0.5 * z * z).exp()
    }

    /// The samples at which it is not closed.
    pub(super) fn open_samples(&self, times: &[f64]) -> std::ops::Range<usize> {
        let radius = self.s * (2.0 * (self.peak / ALPHA_MIN).max(1.0).ln()).sqrt();
        times.partition_point(|&t| t < self.tau - radius)..times.partition_point(|&t| t <= self.tau + radius)
    }

    /// The one window that follows the opacities in all frames; `None` if there is none.
    pub(super) fn of_all(samples: &Samples) -> Option<Window> {
        let opacities = || samples.opacities.iter().copied();
        let (low, high) = (opacities().fold(1.0, f64::min), opacities().fold(0.0, f64::max));
        let window = if high - low <= OPACITY_TOLERANCE {
            Window { tau: 0.5, s: f64::INFINITY, peak: 0.5 * (low + high) }
        } else {
            // An error of the logarithm counts as much as the opacity is large.
            let logarithms = (0..samples.len())
                .filter(|&k| samples.is_visible(k))
                .map(|k| (samples.times[k], samples.opacities[k].powi(2), samples.opacities[k].ln()));
            let [constant, slope, curvature, _] = polynomial::fit(2, logarithms).about(0.5);
            let s = (-0.5 / curvature).sqrt();
            let tau = 0.5 + slope * s * s;
            Window { tau, s, peak: (constant + 0.5 * slope * slope * s * s).exp().min(1.0) }
        };
        let is_determined = window.s > 0.0 && (window.tau - 0.5).abs() <= 0.5 + OUTSIDE_MAX;
        let follows =
            |k: usize| (window.at(samples.times[k]) - samples.opacities[k]).abs() <= OPACITY_TOLERANCE;
        (is_determined && (0..samples.len()).all(follows)).then_some(window)
    }

    /// `count + 1` windows at equal distances, from the first frame to the last, whose union follows the opacities.
    pub(super) fn row(samples: &Samples, count: usize) -> Vec<Window> {
        let distance = 1.0 / count as f64;
        let mut windows: Vec<Window> = (0..=count)
            .map(|j| Window { tau: j as f64 * distance, s: OVERLAP * distance, peak: 1.0 })
            .collect();
        // The sums over the samples that a window sees, of its shape times the given values.
        let seen = |window: &Window, values: &[f64]| -> f64 {
            let open = Window { peak: 1.0, ..*window };
            open.open_samples(samples.times).map(|k| open.at(samples.times[k]) * values[k]).sum()
        };
        for _ in 0..STEPS {
            let union = union(samples.times, &windows);
            for window in &mut windows {
                let (target, present) = (seen(window, &samples.opacities), seen(window, &union));
                window.peak = if present > 0.0 { (window.peak * target / present).min(1.0) } else { 0.0 };
            }
        }
        windows.retain(|window| window.peak >= ALPHA_MIN);
        windows
    }
}

/// Opacity of windows drawn on top of each other.
pub(super) fn union(times: &[f64], windows: &[Window]) -> Vec<f64> {
    let mut transmittance = vec![1.0; times.len()];
    for window in windows {
        window.open_samples(times).for_each(|k| transmittance[k] *= 1.0 - window.at(times[k]));
    }
    transmittance.iter().map(|rest| 1.0 - rest).collect()
}
