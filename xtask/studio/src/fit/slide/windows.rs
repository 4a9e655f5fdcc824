//! [`Windows`]: the photographs that each step of a sliding fit has in memory.

/// How far a window reaches beyond its part of the take on either side, in parts: about half the longest life of what a
/// fit makes at 30 frames per second and parts of a second.
const OVERLAP: f64 = 0.25;

/// A take, cut into parts of about `unit_s` seconds; each step of the fit sees one part and its surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Windows {
    duration_s: f64,
    unit_s: f64,
    /// Number of parts, at least 1.
    pub(super) count: usize,
}

impl Windows {
    pub(super) fn new(duration_s: f64, unit_s: f64) -> Windows {
        // The last part is between a half and one and a half of the others.
        Windows { duration_s, unit_s, count: ((duration_s / unit_s).round() as usize).max(1) }
    }

    /// Seconds of the take between which step `step` sees photographs.
    pub(super) fn span_s(&self, step: usize) -> [f64; 2] {
        let boundary_s = |number: usize, by: f64| (number as f64 + by) * self.unit_s;
        let from_s = if step == 0 { 0.0 } else { boundary_s(step, -OVERLAP) };
        let to_s = if step + 1 == self.count { self.duration_s } else { boundary_s(step + 1, OVERLAP) };
        [from_s, to_s]
    }

    /// Whether step `step` sees a photograph taken at `time_s`. The first and the last step see those that offsets of
    /// cameras place outside the take.
    pub(super) fn sees(&self, step: usize, time_s: f64) -> bool {
        let [from_s, to_s] = self.span_s(step);
        (step == 0 || time_s >= from_s) && (step + 1 == self.count || time_s < to_s)
    }

    /// Whether step `step` sees a photograph taken at `time_s`, and the step before it does not.
    pub(super) fn sees_first(&self, step: usize, time_s: f64) -> bool {
        self.sees(step, time_s) && !(step > 0 && self.sees(step - 1, time_s))
    }

    /// Parts of the take that step `step` sees and no step before it did.
    pub(super) fn new_units(&self, step: usize) -> f64 {
        let [from_s, to_s] = self.span_s(step);
        let seen_s = if step == 0 { from_s } else { self.span_s(step - 1)[1] };
        (to_s - seen_s) / self.unit_s
    }

    /// Parts of the take that step `step` sees.
    pub(super) fn units(&self, step: usize) -> f64 {
        let [from_s, to_s] = self.span_s(step);
        (to_s - from_s) / self.unit_s
    }

    /// Second up to which everything is as it stays after step `step`: where the photographs of the next step begin.
    pub(super) fn final_until_s(&self, step: usize) -> f64 {
        if step + 1 < self.count { self.span_s(step + 1)[0] } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_overlap_and_see_every_photograph() {
        for (duration_s, count) in [(0.3, 1), (1.4, 1), (1.6, 2), (40.0, 40), (39.97, 40), (10.5, 11)] {
            let windows = Windows::new(duration_s, 1.0);
            assert_eq!(windows.count, count, "{duration_s}");
            assert_eq!((windows.span_s(0)[0], windows.span_s(count - 1)[1]), (0.0, duration_s));
            for step in 0..count {
                let [from_s, to_s] = windows.span_s(step);
                assert!(to_s - from_s <= 1.75 + 1e-9 && windows.new_units(step) > 0.0);
                assert!(!(step > 0 && windows.final_until_s(step - 1) != from_s));
            }
            for frame in -1..=(duration_s * 30.0) as i32 + 1 {
                let time_s = f64::from(frame) / 30.0;
                let seen: Vec<usize> = (0..count).filter(|step| windows.sees(*step, time_s)).collect();
                assert!((1..=2).contains(&seen.len()) && seen.windows(2).all(|pair| pair[1] == pair[0] + 1));
            }
            let all: f64 = (0..count).map(|step| windows.new_units(step)).sum();
            assert!((all - duration_s).abs() < 1e-9);
        }
    }
}
