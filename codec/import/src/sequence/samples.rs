//! [`Samples`]: one row in all frames of a sequence whose rows correspond.

use codec::{ALPHA_MIN, Field};

/// A row over time, in `f64`.
pub(super) struct Samples<'a> {
    /// Clip times of the frames, ascending.
    pub(super) times: &'a [f64],
    pub(super) positions: Vec<[f64; 3]>,
    /// Quaternions of unit length, each nearer to the one before than its negative.
    pub(super) rotations: Vec<[f64; 4]>,
    pub(super) log_scales: Vec<[f64; 3]>,
    /// Constant SH coefficients.
    pub(super) colors: Vec<[f64; 3]>,
    pub(super) opacities: Vec<f64>,
}

impl<'a> Samples<'a> {
    /// Row `row` of all frames.
    pub(super) fn of_row(times: &'a [f64], frames: &[Field], row: usize) -> Samples<'a> {
        let column = |of: fn(&Field, usize) -> [f32; 3]| -> Vec<[f64; 3]> {
            frames.iter().map(|frame| of(frame, row).map(f64::from)).collect()
        };
        let mut rotations: Vec<[f64; 4]> =
            frames.iter().map(|frame| frame.rotations[row].map(f64::from)).collect();
        for k in 1..rotations.len() {
            let before = rotations[k - 1];
            if (0..4).map(|i| before[i] * rotations[k][i]).sum::<f64>() < 0.0 {
                rotations[k] = rotations[k].map(|x| -x);
            }
        }
        Samples {
            times,
            positions: column(|frame, row| frame.centers[row]),
            rotations,
            log_scales: column(|frame, row| frame.log_scales[row]),
            colors: column(|frame, row| frame.sh_of(row)[0]),
            opacities: frames.iter().map(|frame| f64::from(frame.opacities[row])).collect(),
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
