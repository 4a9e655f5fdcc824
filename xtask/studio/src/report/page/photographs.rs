//! [`TakePhotographs`]: a take beside the photographs of its capture, at the cuts and between.

use refine::metrics::median;
use serde::Serialize;

use crate::eval::FrameErrors;
use crate::messages::decimal;

/// Errors of a take against photographs, over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TakePhotographs {
    /// Names of the cameras.
    pub cameras: Vec<String>,
    /// All frames, in their order.
    pub frames: Vec<FrameErrors>,
    /// Median PSNR in dB of the frames within one of a cut; `None` without such frames.
    pub median_at_cuts_db: Option<f64>,
    /// Median PSNR in dB of the other frames.
    pub median_between_db: Option<f64>,
    /// Median flicker, of 255, over the intervals between frames that hold a cut.
    pub flicker_at_cuts: Option<f64>,
    /// Median flicker over the other intervals.
    pub flicker_between: Option<f64>,
}

impl TakePhotographs {
    /// Errors of `frames` in the order of time, of a take with cuts at these seconds.
    pub fn new(cameras: Vec<String>, frames: Vec<FrameErrors>, cuts_s: &[f64]) -> TakePhotographs {
        let is_cut_within = |from_s: f64, to_s: f64| {
            cuts_s.iter().any(|cut| (from_s - SLACK_S..=to_s + SLACK_S).contains(cut))
        };
        let time = |i: usize| frames[i.min(frames.len() - 1)].t_s;
        let (mut psnr, mut flicker) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        for (i, frame) in frames.iter().enumerate() {
            let before = time(i.saturating_sub(1));
            psnr[usize::from(is_cut_within(before, time(i + 1)))].extend(frame.psnr_db);
            flicker[usize::from(is_cut_within(before, frame.t_s))].extend(frame.flicker);
        }
        let [[between, at_cuts], [flicker_between, flicker_at_cuts]] =
            [psnr, flicker].map(|parts| parts.map(median));
        TakePhotographs {
            cameras,
            frames,
            median_at_cuts_db: at_cuts,
            median_between_db: between,
            flicker_at_cuts,
            flicker_between,
        }
    }

    /// The medians, in a sentence.
    pub(super) fn sentence(&self) -> String {
        let mut parts = Vec::new();
        let both = |name: &str, unit: &str, at_cuts: Option<f64>, between: Option<f64>| {
            let at_cuts = at_cuts.map(|x| format!("{}{unit} at cuts", decimal(x, 2)));
            let between = between.map(|x| format!("{}{unit} between", decimal(x, 2)));
            let numbers: Vec<String> = [at_cuts, between].into_iter().flatten().collect();
            (!numbers.is_empty()).then(|| format!("median {name} {}", numbers.join(", ")))
        };
        parts.extend(both("PSNR", " dB", self.median_at_cuts_db, self.median_between_db));
        parts.extend(both("flicker", "/255", self.flicker_at_cuts, self.flicker_between));
        format!("{}; cameras {}", parts.join("; "), self.cameras.join(", "))
    }
}

/// Seconds by which sums of seconds are rounded.
const SLACK_S: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_within_one_of_a_cut_are_apart() {
        let errors = |i: usize| FrameErrors {
            t_s: i as f64 / 10.0,
            // The cut is between the frames 4 and 5, so these are within a frame of it.
            psnr_db: Some(if (4..=5).contains(&i) { 20.0 } else { 30.0 }),
            flicker: (i > 0).then_some(if i == 5 { 3.0 } else { 2.0 }),
        };
        let frames: Vec<FrameErrors> = (0..10).map(errors).collect();
        let found = TakePhotographs::new(vec!["a".into()], frames.clone(), &[0.45]);
        assert_eq!((found.median_at_cuts_db, found.median_between_db), (Some(20.0), Some(30.0)));
        assert_eq!((found.flicker_at_cuts, found.flicker_between), (Some(3.0), Some(2.0)));
        assert_eq!(
            found.sentence(),
            "median PSNR 20 dB at cuts, 30 dB between; median flicker 3/255 at cuts, 2/255 between; cameras a"
        );
        let none = TakePhotographs::new(Vec::new(), frames, &[]);
        assert_eq!((none.median_at_cuts_db, none.flicker_at_cuts), (None, None));
        // A cut at a frame is within one of three, and in both intervals beside it.
        let at = TakePhotographs::new(Vec::new(), found.frames, &[0.5]);
        assert_eq!(at.median_at_cuts_db, Some(20.0));
    }
}
