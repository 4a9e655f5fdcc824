//! [`Timeline`]: conversion between clip time and intervals, the unit of time of a fit.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::capture::{Capture, PhotoId};
use crate::median::median;

/// Number of frames and length of a clip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timeline {
    /// Number of frames, at least 1, held-out ones included; a clip of one frame is static.
    pub frames: usize,
    /// Length of the clip in intervals: a time in intervals is clip time times this. An interval is the time
    /// from one photograph of a camera to its next one that the field is fitted to. 1 for a single frame.
    pub intervals: f64,
}

impl Timeline {
    /// A clip of `frames` evenly spaced frames. The field is fitted to all of them.
    pub const fn even(frames: usize) -> Timeline {
        Timeline { frames, intervals: (if frames > 2 { frames } else { 2 } - 1) as f64 }
    }

    /// The clip of a capture whose photographs `fitted` the field is fitted to. The interval is the median of
    /// all cameras' intervals. Where no camera has two photographs, it is that between photographs of any
    /// camera.
    pub fn from_capture(capture: &Capture, fitted: &[PhotoId]) -> Timeline {
        let duration_s = capture.duration_s();
        let mut times_s: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for photo_id in fitted {
            times_s.entry(photo_id.camera).or_default().push(capture.time_s(*photo_id));
        }
        let any_camera = || gaps(times_s.values().flatten().copied().collect());
        let by_camera: Vec<f64> = times_s.values().cloned().flat_map(gaps).collect();
        let gap_s = median(by_camera).or_else(|| median(any_camera())).unwrap_or(duration_s);
        match duration_s > 0.0 {
            true => Timeline { frames: capture.frames(), intervals: duration_s / gap_s },
            false => Timeline::even(capture.frames()),
        }
    }
}

/// The positive differences between neighbouring times, in ascending order of time.
fn gaps(mut times_s: Vec<f64>) -> Vec<f64> {
    times_s.sort_by(f64::total_cmp);
    times_s.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap_s| *gap_s > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::fixtures::calibrated;
    use crate::capture::{CalibratedCamera, even_times_s};

    /// Cameras with these offsets in seconds, in 9 frames at 10 per second.
    fn capture(offsets_s: &[f64]) -> Capture {
        let camera = |&time_offset_s: &f64| CalibratedCamera { time_offset_s, ..calibrated() };
        let cameras = offsets_s.iter().map(camera).collect();
        Capture { cameras, frame_times_s: even_times_s(9, 10.0), ..Capture::default() }
    }

    fn intervals(capture: &Capture, fitted: &[(usize, usize)]) -> f64 {
        let fitted: Vec<PhotoId> =
            fitted.iter().map(|(camera, frame)| PhotoId { camera: *camera, frame: *frame }).collect();
        Timeline::from_capture(capture, &fitted).intervals
    }

    #[test]
    fn an_interval_is_that_of_the_fitted_photographs_of_a_camera() {
        let together = capture(&[0.0, 0.0]);
        let every = |step: usize| -> Vec<(usize, usize)> {
            (0..9).step_by(step).flat_map(|frame| [(0, frame), (1, frame)]).collect()
        };
        assert!((intervals(&together, &every(1)) - 8.0).abs() < 1e-9);
        assert!((intervals(&together, &every(2)) - 4.0).abs() < 1e-9);
        assert!(
            (intervals(&capture(&[0.0, 0.05]), &every(2)) - 4.0).abs() < 1e-9,
            "an offset changes nothing"
        );
        let gap = [(0, 0), (0, 1), (0, 2), (0, 7), (0, 8)];
        assert!((intervals(&together, &gap) - 8.0).abs() < 1e-9, "missing photographs do not");
    }

    #[test]
    fn photographs_of_a_camera_each_are_taken_together() {
        let scattered = [(0, 0), (1, 2), (2, 4), (3, 6), (4, 8)];
        assert!((intervals(&capture(&[0.0; 5]), &scattered) - 4.0).abs() < 1e-9);
        assert_eq!(intervals(&capture(&[0.0]), &[(0, 3)]), 1.0, "one photograph");
        let one_frame = Capture { frame_times_s: vec![0.0], ..capture(&[0.0; 2]) };
        assert_eq!(Timeline::from_capture(&one_frame, &[]), Timeline::even(1));
    }
}
