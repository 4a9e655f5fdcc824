//! [`Track`]: the Gaussians that follow one row through all frames.
//!
//! One Gaussian with a cubic trajectory follows a simple motion, in the window that its opacities have. Where it is off
//! by more than the tolerance, a row of windows takes its place, each with a cubic of its own: 2, 4, 8 and so on, down to
//! one a frame. A row that jitters is off by more than the tolerance with any number of them: then the number is taken
//! from which on more of them gain little. All fits are weighted least squares; the weight of a frame is the opacity of the
//! window there.

use codec::{ALPHA_MIN, SH_C0};

use super::polynomial::{self, Polynomial};
use super::samples::Samples;
use super::window::{OPACITY_TOLERANCE, Window, union};

/// Tolerances of the logarithms of the standard deviations, of colours, and of angles in radians, these times the
/// anisotropy.
const SCALE_TOLERANCE: f64 = 0.15;
const COLOR_TOLERANCE: f64 = 0.03;
const ANGLE_TOLERANCE: f64 = 0.1;

/// Where no number of windows is within the tolerances, twice as many must lower the error by 2 to this power, to 71 %:
/// windows of a resolved motion lower it to less than 20 %, windows that chase jitter to between 80 and 105 %.
const GAIN_POWER: f64 = 0.5;

/// A Gaussian that follows a row for a while.
pub(super) struct Piece {
    pub(super) window: Window,
    position: [Polynomial; 3],
    rotation: [Polynomial; 4],
    log_scales: [f64; 3],
    color: [f64; 3],
}

/// What one row becomes, and how far off it is in each frame.
pub(super) struct Track {
    pub(super) pieces: Vec<Piece>,
    /// Distance between the row and what is drawn of it, in source units; `None` where the row is invisible.
    pub(super) distances: Vec<Option<f64>>,
    /// Difference of opacity.
    pub(super) opacities: Vec<f64>,
    /// Whether it is off by more than the tolerances.
    pub(super) is_rough: bool,
}

/// A piece as the columns of a field have it.
pub(super) struct PieceRow {
    pub(super) center: [f32; 3],
    pub(super) motion: [[f32; 3]; 3],
    pub(super) rotation: [f32; 4],
    pub(super) rotation_rate: [f32; 4],
    pub(super) log_scales: [f32; 3],
    pub(super) color: [f32; 3],
}

impl Track {
    /// Fits a row, with positions within `tolerance` source units; `steps` is the number of frames, missing ones
    /// included. A row that is never visible has no pieces.
    pub(super) fn fit(samples: &Samples, tolerance: f64, steps: usize) -> Track {
        if (0..samples.len()).all(|k| !samples.is_visible(k)) {
            let distances = vec![None; samples.len()];
            let opacities = samples.opacities.clone();
            return Track { pieces: Vec::new(), distances, opacities, is_rough: false };
        }
        let intervals = steps - 1;
        let doublings = (1..).map(|power| 1 << power).take_while(|count| *count < intervals);
        let rows = doublings.chain([intervals]).map(|count| (count, Window::row(samples, count)));
        let one = Window::of_all(samples).map(|window| (1, vec![window]));
        let mut best: Option<(Track, f64)> = None;
        for (count, windows) in one.into_iter().chain(rows) {
            let (track, misfit) = Track::with_windows(samples, tolerance, &windows);
            if misfit <= 1.0 {
                return Track { is_rough: false, ..track };
            }
            let cost = misfit * (count as f64).powf(GAIN_POWER);
            if best.as_ref().is_none_or(|(_, least)| cost < *least) {
                best = Some((track, cost));
            }
        }
        best.expect("there is a row of windows").0
    }

    /// Fits a piece to each window, as one that is rough; also returns the largest error, in tolerances.
    fn with_windows(samples: &Samples, tolerance: f64, windows: &[Window]) -> (Track, f64) {
        let pieces: Vec<Piece> = windows.iter().filter_map(|window| Piece::fit(samples, *window)).collect();
        let (mut weights, mut squares) = (vec![0.0; samples.len()], vec![0.0; samples.len()]);
        let mut misfit: f64 = 0.0;
        for piece in &pieces {
            for k in piece.window.open_samples(samples.times) {
                let weight = piece.window.at(samples.times[k]);
                weights[k] += weight;
                squares[k] += weight * piece.square_distance(samples, k);
                // What is faint beside the row itself may differ more.
                let share = weight / samples.opacities[k].max(weight);
                misfit = misfit.max(share * piece.misfit(samples, k));
            }
        }
        let distances: Vec<Option<f64>> = (0..samples.len())
            .map(|k| (samples.is_visible(k) && weights[k] > 0.0).then(|| (squares[k] / weights[k]).sqrt()))
            .collect();
        let windows: Vec<Window> = pieces.iter().map(|piece| piece.window).collect();
        let opacities: Vec<f64> = (union(samples.times, &windows).iter().zip(&samples.opacities))
            .map(|(drawn, opacity)| (drawn - opacity).abs())
            .collect();
        let farthest = distances.iter().flatten().copied().fold(0.0, f64::max);
        let fading = opacities.iter().copied().fold(0.0, f64::max);
        misfit = misfit.max(farthest / tolerance).max(fading / (2.0 * OPACITY_TOLERANCE));
        (Track { pieces, distances, opacities, is_rough: true }, misfit)
    }
}

impl Piece {
    /// Fits trajectory, rotation, size and colour; `None` if the row is invisible while the window is open.
    fn fit(samples: &Samples, window: Window) -> Option<Piece> {
        let open = window.open_samples(samples.times).filter(|&k| samples.is_visible(k));
        let weighted: Vec<(usize, f64)> = open.map(|k| (k, window.at(samples.times[k]))).collect();
        let total: f64 = weighted.iter().map(|(_, weight)| weight).sum();
        if total.is_nan() || total < ALPHA_MIN {
            return None;
        }
        let curve = |degree: usize, value: &dyn Fn(usize) -> f64| {
            let samples = weighted.iter().map(|&(k, weight)| (samples.times[k], weight, value(k)));
            polynomial::fit(degree, samples)
        };
        let mean = |values: &[[f64; 3]]| {
            [0, 1, 2].map(|i| weighted.iter().map(|&(k, weight)| weight * values[k][i]).sum::<f64>() / total)
        };
        // A cubic through few frames swings between them.
        let degree = (weighted.len() - 1).div_ceil(2).min(3);
        Some(Piece {
            window,
            position: [0, 1, 2].map(|axis| curve(degree, &|k| samples.positions[k][axis])),
            rotation: [0, 1, 2, 3].map(|i| curve(1.min(degree), &|k| samples.rotations[k][i])),
            log_scales: mean(&samples.log_scales),
            color: mean(&samples.colors),
        })
    }

    fn square_distance(&self, samples: &Samples, k: usize) -> f64 {
        let t = samples.times[k];
        (0..3).map(|axis| (self.position[axis].at(t) - samples.positions[k][axis]).powi(2)).sum()
    }

    /// Largest error of size, colour and angle in frame `k`, in tolerances; none where the row is invisible.
    fn misfit(&self, samples: &Samples, k: usize) -> f64 {
        if !samples.is_visible(k) {
            return 0.0;
        }
        let largest = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max);
        let scale = largest(self.log_scales, samples.log_scales[k]) / SCALE_TOLERANCE;
        let color = SH_C0 * largest(self.color, samples.colors[k]) / COLOR_TOLERANCE;
        let q = self.rotation.map(|curve| curve.at(samples.times[k]));
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        let cos = (0..4).map(|i| q[i] * samples.rotations[k][i]).sum::<f64>() / norm;
        let sizes = self.log_scales;
        let anisotropy = 1.0
            - (sizes.iter().copied().fold(f64::INFINITY, f64::min)
                - sizes.iter().copied().fold(f64::NEG_INFINITY, f64::max))
            .exp();
        let angle = if norm > 0.0 { 2.0 * cos.abs().min(1.0).acos() } else { 1.0 };
        scale.max(color).max(anisotropy * angle / ANGLE_TOLERANCE)
    }

    /// The piece as a row of a field.
    pub(super) fn to_row(&self) -> PieceRow {
        // A window that is always open has its centre at the middle of the clip.
        let about = |curve: Polynomial| curve.about(self.window.tau);
        let axes = self.position.map(about);
        let rotation = self.rotation.map(about);
        let norm = rotation.iter().map(|curve| curve[0] * curve[0]).sum::<f64>().sqrt();
        let normalized = |k: usize| rotation.map(|curve| (curve[k] / norm) as f32);
        PieceRow {
            center: axes.map(|curve| curve[0] as f32),
            motion: [1, 2, 3].map(|power| axes.map(|curve| curve[power] as f32)),
            rotation: normalized(0),
            rotation_rate: normalized(1),
            log_scales: self.log_scales.map(|x| x as f32),
            color: self.color.map(|x| x as f32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 300;

    /// A visible row at `x` of frame and clip time.
    fn fitted(x: impl Fn(usize, f64) -> f64) -> Track {
        let times: Vec<f64> = (0..FRAMES).map(|k| k as f64 / (FRAMES - 1) as f64).collect();
        let samples = Samples {
            times: &times,
            positions: times.iter().enumerate().map(|(k, &t)| [x(k, t), 0.0, 0.0]).collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; FRAMES],
            log_scales: vec![[0.0; 3]; FRAMES],
            colors: vec![[0.0; 3]; FRAMES],
            opacities: vec![0.9; FRAMES],
        };
        Track::fit(&samples, 1e-3, FRAMES)
    }

    /// Noise from -1 to 1 that differs from frame to frame.
    fn jitter(k: usize) -> f64 {
        2.0 * ((k as f64 * 12.9898 + 1.0).sin() * 43_758.545_3).rem_euclid(1.0) - 1.0
    }

    fn largest(track: &Track) -> f64 {
        track.distances.iter().flatten().fold(0.0, |a: f64, b| a.max(*b))
    }

    #[test]
    fn jitter_does_not_multiply_gaussians_and_motion_does() {
        let resting = fitted(|_, _| 0.0);
        assert_eq!((resting.pieces.len(), resting.is_rough), (1, false));
        let shaken = fitted(|k, _| 0.01 * jitter(k));
        assert_eq!((shaken.pieces.len(), shaken.is_rough), (1, true));
        assert!(largest(&shaken) < 0.0125, "{}", largest(&shaken));
        let swung = fitted(|_, t| 0.05 * (t * 20.0).sin());
        assert!((17..=33).contains(&swung.pieces.len()) && !swung.is_rough, "{}", swung.pieces.len());
        // The motion is followed, the jitter on it is not.
        let both = fitted(|k, t| 0.05 * (t * 20.0).sin() + 0.003 * jitter(k));
        assert!((17..=33).contains(&both.pieces.len()) && both.is_rough, "{}", both.pieces.len());
        assert!(largest(&both) < 0.006, "{}", largest(&both));
    }
}
