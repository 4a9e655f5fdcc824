//! [`Samples`]: one row in all frames of a sequence whose rows correspond.

use codec::{ALPHA_MIN, Field};

/// A row over time, in `f64`.
pub(super) struct Samples<'a> {
    /// Clip times of the frames, ascending.
    pub(super) times: &'a [f64],
    pub(super) positions: Vec<[f64; 3]>,
    /// Quaternions of unit length, each nearer to its predecessor than its negative.
    pub(super) rotations: Vec<[f64; 4]>,
    pub(super) log_scales: Vec<[f64; 3]>,
    /// Constant SH coefficients.
    pub(super) colors: Vec<[f64; 3]>,
    pub(super) opacities: Vec<f64>,
}

/// The frames of all steps: those that are missing lie on lines between their neighbours.
pub(super) struct Filled {
    /// Clip times, ascending.
    pub(super) times: Vec<f64>,
    /// The frame before each time, and the fraction of the way to the next one.
    places: Vec<(usize, f64)>,
}

impl Filled {
    /// Fills frames at `times`, of a clip of `steps` steps.
    pub(super) fn new(times: &[f64], steps: usize) -> Filled {
        let last = (steps - 1).max(1) as f64;
        let mut filled = Filled { times: Vec::new(), places: Vec::new() };
        for (frame, &time) in times.iter().enumerate() {
            filled.times.push(time);
            filled.places.push((frame, 0.0));
            let Some(next) = times.get(frame + 1) else { break };
            let count = ((next - time) * last).round() as usize;
            for k in 1..count {
                let fraction = k as f64 / count as f64;
                filled.times.push(time + fraction * (next - time));
                filled.places.push((frame, fraction));
            }
        }
        filled
    }

    /// The values at all times, from the values of the frames.
    fn values<const N: usize>(&self, of_frames: &[[f64; N]]) -> Vec<[f64; N]> {
        let value = |&(frame, fraction): &(usize, f64)| {
            let (a, b) = (of_frames[frame], of_frames[(frame + 1).min(of_frames.len() - 1)]);
            std::array::from_fn(|i| a[i] + fraction * (b[i] - a[i]))
        };
        self.places.iter().map(value).collect()
    }
}

impl<'a> Samples<'a> {
    /// Row `row` of all frames, `filled` where some are missing.
    pub(super) fn of_row(filled: &'a Filled, frames: &[Field], row: usize) -> Samples<'a> {
        let column = |value: fn(&Field, usize) -> [f32; 3]| -> Vec<[f64; 3]> {
            let of_frames: Vec<[f64; 3]> =
                frames.iter().map(|frame| value(frame, row).map(f64::from)).collect();
            filled.values(&of_frames)
        };
        let mut rotations: Vec<[f64; 4]> =
            frames.iter().map(|frame| frame.rotations[row].map(f64::from)).collect();
        for k in 1..rotations.len() {
            let before = rotations[k - 1];
            if (0..4).map(|i| before[i] * rotations[k][i]).sum::<f64>() < 0.0 {
                rotations[k] = rotations[k].map(|x| -x);
            }
        }
        let unit = |q: [f64; 4]| {
            let length = q.map(|x| x * x).iter().sum::<f64>().sqrt();
            if length > 0.0 { q.map(|x| x / length) } else { q }
        };
        let opacities: Vec<[f64; 1]> = frames.iter().map(|frame| [f64::from(frame.opacities[row])]).collect();
        Samples {
            times: &filled.times,
            positions: column(|frame, row| frame.centers[row]),
            rotations: filled.values(&rotations).into_iter().map(unit).collect(),
            log_scales: column(|frame, row| frame.log_scales[row]),
            colors: column(|frame, row| frame.sh_of(row)[0]),
            opacities: filled.values(&opacities).into_iter().map(|[opacity]| opacity).collect(),
        }
    }

    /// Number of frames.
    pub(super) fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether the row is drawn in frame `k`.
    pub(super) fn is_visible(&self, k: usize) -> bool {
        self.opacities[k] >= ALPHA_MIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_frames_lie_between_their_neighbours() {
        let filled = Filled::new(&[0.0, 0.1, 0.5, 1.0], 11);
        let expected: Vec<f64> = (0..=10).map(|k| f64::from(k) / 10.0).collect();
        assert_eq!(filled.times.len(), 11, "{:?}", filled.times);
        assert!(filled.times.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}", filled.times);
        let values = filled.values(&[[0.0], [1.0], [5.0], [10.0]]);
        assert!(values.iter().zip(&expected).all(|([a], b)| (a - 10.0 * b).abs() < 1e-12), "{values:?}");
        let whole = Filled::new(&[0.0, 0.5, 1.0], 3);
        assert_eq!(whole.values(&[[1.0], [4.0], [2.0]]), [[1.0], [4.0], [2.0]]);
    }
}
