//! Time by the display's clock: [`FrameTimer`] for the clip, [`Pacing`] for missed frames.

/// Longest step of the clip's clock in seconds: longer ones are interruptions.
const STEP_MAX_S: f64 = 0.25;

/// Time of the clip from frame to frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameTimer {
    last_ns: Option<i64>,
}

impl FrameTimer {
    /// Seconds from the previous frame to the frame seen at `display_ns`; 0 while the viewer is away, and for
    /// the time away.
    pub(crate) fn elapsed_s(&mut self, display_ns: i64, attended: bool) -> f64 {
        let last_ns = std::mem::replace(&mut self.last_ns, attended.then_some(display_ns));
        match last_ns {
            Some(last_ns) if attended => (seconds(display_ns - last_ns)).clamp(0.0, STEP_MAX_S),
            _ => 0.0,
        }
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// Counts the times at which the display repeated an old frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pacing {
    last_ns: Option<i64>,
    missed: u64,
}

impl Pacing {
    /// Takes in a frame seen at `display_ns`, on a display with one image every `period_ns`.
    pub(crate) fn frame(&mut self, display_ns: i64, period_ns: i64) {
        let last_ns = self.last_ns.replace(display_ns);
        let Some(last_ns) = last_ns.filter(|_| period_ns > 0) else { return };
        // Times are predictions with an error below half a period.
        let periods = ((display_ns - last_ns) as f64 / period_ns as f64).round();
        self.missed += (periods - 1.0).max(0.0) as u64;
    }

    /// Takes in a pause, which misses no frames.
    pub(crate) fn rest(&mut self) {
        self.last_ns = None;
    }

    /// Number of repeated frames.
    pub(crate) fn missed(&self) -> u64 {
        self.missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: i64 = 11_111_111;

    #[test]
    fn the_clip_follows_the_display_while_the_viewer_attends() {
        let mut timer = FrameTimer::default();
        let mut elapsed = |display_ns, attended| timer.elapsed_s(display_ns, attended);
        assert_eq!(elapsed(1_000_000_000, true), 0.0, "the first frame shows the start");
        assert!((elapsed(1_011_111_111, true) - 0.011_111_111).abs() < 1e-12);
        assert!((elapsed(1_033_333_333, true) - 0.022_222_222).abs() < 1e-12, "a frame was missed");
        assert_eq!(elapsed(1_044_444_444, false), 0.0);
        assert_eq!(elapsed(9_000_000_000, true), 0.0, "back: no time went by");
        assert!((elapsed(9_011_111_111, true) - 0.011_111_111).abs() < 1e-12);
        assert_eq!(elapsed(20_000_000_000, true), STEP_MAX_S, "an interruption");
        assert_eq!(elapsed(19_000_000_000, true), 0.0, "never backwards");
    }

    #[test]
    fn missed_frames_are_periods_without_a_new_frame() {
        let mut pacing = Pacing::default();
        for (periods, missed) in [(100.0, 0), (101.1, 0), (101.9, 0), (104.0, 1), (105.0, 1), (109.0, 4)] {
            pacing.frame((periods * PERIOD_NS as f64) as i64, PERIOD_NS);
            assert_eq!(pacing.missed(), missed, "{periods}");
        }
        pacing.rest();
        pacing.frame(1000 * PERIOD_NS, PERIOD_NS);
        assert_eq!(pacing.missed(), 4, "a rest misses nothing");
        pacing.frame(1010 * PERIOD_NS, 0);
        assert_eq!(pacing.missed(), 4, "a runtime without a period");
    }
}
