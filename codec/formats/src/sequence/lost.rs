//! [`LostRows`]: rows of frames that cannot be used, such as rows with a centre that is no number, and how they are
//! filled.
//!
//! One bad number in one frame would otherwise move all rows behind it, and nothing would correspond.

use std::collections::BTreeMap;

use codec::Field;

/// The rows that cannot be used in some frames.
#[derive(Debug, Default)]
pub(super) struct LostRows {
    /// For each such row the numbers of the frames, ascending.
    frames: BTreeMap<usize, Vec<usize>>,
}

impl LostRows {
    /// Adds rows of a frame that follows all frames added before.
    pub(super) fn add(&mut self, frame: usize, rows: &[usize]) {
        rows.iter().for_each(|row| self.frames.entry(*row).or_default().push(frame));
    }

    /// Number of frames in which a row cannot be used.
    pub(super) fn of_row(&self, row: usize) -> usize {
        self.frames.get(&row).map_or(0, Vec::len)
    }

    /// Gives the rows, which are constant in colour, values between the values of the frames beside, at `times`. Before
    /// the first frame that has a row, and after the last, it stands still and is invisible. Rows that no frame has
    /// stay as they are. Returns how many rows were filled, one in each frame counted.
    pub(super) fn fill(&self, times: &[f64], frames: &mut [Field]) -> usize {
        let (mut filled, count) = (0, frames.len());
        for (&row, lost) in self.frames.iter().filter(|(_, lost)| lost.len() < count) {
            filled += lost.len();
            for run in lost.chunk_by(|a, b| a + 1 == *b) {
                let (first, last) = (run[0], run[run.len() - 1]);
                let before = first.checked_sub(1);
                let after = Some(last + 1).filter(|after| *after < count);
                for &frame in run {
                    match before.zip(after) {
                        Some((a, b)) => {
                            let fraction = (times[frame] - times[a]) / (times[b] - times[a]);
                            fill(frames, row, frame, [a, b], fraction as f32);
                        }
                        None => {
                            let nearest = before.or(after).expect("a frame has the row");
                            fill(frames, row, frame, [nearest; 2], 0.0);
                            frames[frame].opacities[row] = 0.0;
                        }
                    }
                }
            }
        }
        filled
    }
}

/// Fills a row of a frame from two others.
fn fill(frames: &mut [Field], row: usize, frame: usize, [a, b]: [usize; 2], fraction: f32) {
    let between = |x: f32, y: f32| x + fraction * (y - x);
    let vector = |x: [f32; 3], y: [f32; 3]| [0, 1, 2].map(|i| between(x[i], y[i]));
    let [from, to] = [&frames[a], &frames[b]];
    let center = vector(from.centers[row], to.centers[row]);
    let log_scales = vector(from.log_scales[row], to.log_scales[row]);
    let color = vector(from.sh[row], to.sh[row]);
    let opacity = between(from.opacities[row], to.opacities[row]);
    // Half a turn apart they are the same as the nearer of both.
    let (p, q) = (from.rotations[row], to.rotations[row]);
    let sign = if (0..4).map(|i| p[i] * q[i]).sum::<f32>() < 0.0 { -1.0 } else { 1.0 };
    let sum = [0, 1, 2, 3].map(|i| between(p[i], sign * q[i]));
    let norm = sum.iter().map(|x| x * x).sum::<f32>().sqrt();
    let rotation = if norm > 0.0 { sum.map(|x| x / norm) } else { p };
    let field = &mut frames[frame];
    field.centers[row] = center;
    field.log_scales[row] = log_scales;
    field.sh[row] = color;
    field.opacities[row] = opacity;
    field.rotations[row] = rotation;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(x: f32) -> Field {
        Field {
            centers: vec![[x, 0.0, -x]; 2],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[x; 3]; 2],
            opacities: vec![x / 10.0; 2],
            sh: vec![[2.0 * x; 3]; 2],
            ..Field::default()
        }
    }

    #[test]
    fn rows_lie_between_the_frames_that_have_them() {
        let mut frames = [0.0, 1.0, 9.0, 9.0, 4.0].map(frame);
        frames[4].rotations[1] = [-1.0, 0.0, 0.0, 0.0];
        let mut lost = LostRows::default();
        lost.add(2, &[1]);
        lost.add(3, &[1]);
        assert_eq!((lost.of_row(0), lost.of_row(1)), (0, 2));
        assert_eq!(lost.fill(&[0.0, 0.25, 0.5, 0.75, 1.0], &mut frames), 2);
        assert_eq!((frames[2].centers[0], frames[2].centers[1]), ([9.0, 0.0, -9.0], [2.0, 0.0, -2.0]));
        assert_eq!((frames[3].centers[1], frames[3].sh[1]), ([3.0, 0.0, -3.0], [6.0; 3]));
        assert_eq!(frames[3].rotations[1], [1.0, 0.0, 0.0, 0.0]);
        assert!(
            (frames[2].opacities[1] - 0.2).abs() < 1e-6 && (frames[2].log_scales[1][0] - 2.0).abs() < 1e-6
        );
    }

    #[test]
    fn beyond_the_frames_that_have_them_they_are_invisible_and_one_that_is_nowhere_stays() {
        let mut frames = [1.0, 2.0, 3.0, 4.0].map(frame);
        let mut lost = LostRows::default();
        lost.add(0, &[0, 1]);
        lost.add(1, &[1]);
        lost.add(2, &[1]);
        lost.add(3, &[0, 1]);
        assert_eq!(lost.fill(&[0.0, 0.3, 0.6, 1.0], &mut frames), 2);
        assert_eq!(frames.each_ref().map(|frame| frame.centers[0][0]), [2.0, 2.0, 3.0, 3.0]);
        assert_eq!(frames.each_ref().map(|frame| frame.opacities[0]), [0.0, 0.2, 0.3, 0.0]);
        assert_eq!(frames.each_ref().map(|frame| frame.centers[1][0]), [1.0, 2.0, 3.0, 4.0]);
    }
}
