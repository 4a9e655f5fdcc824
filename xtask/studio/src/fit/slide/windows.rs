//! [`Windows`]: the photographs that the fit of each part of a take has in memory.

/// How far a window reaches beyond its part of the take on either side, in parts: about half the longest life of what a
/// fit makes at 30 frames per second and parts of a second.
const OVERLAP: f64 = 0.25;

/// A take, cut into parts of about `unit_s` seconds; the fit of each sees the part and its surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Windows {
    pub(super) duration_s: f64,
    pub(super) unit_s: f64,
    /// Number of parts, at least 1.
    pub(super) count: usize,
}

impl Windows {
    pub(super) fn new(duration_s: f64, unit_s: f64) -> Windows {
        // The last part is between a half and one and a half of the others.
        Windows { duration_s, unit_s, count: ((duration_s / unit_s).round() as usize).max(1) }
    }

    /// Seconds of the take between which the fit of a part sees photographs.
    pub(super) fn span_s(&self, part: usize) -> [f64; 2] {
        let boundary_s = |number: usize, by: f64| (number as f64 + by) * self.unit_s;
        let from_s = if part == 0 { 0.0 } else { boundary_s(part, -OVERLAP) };
        let to_s = if part + 1 == self.count { self.duration_s } else { boundary_s(part + 1, OVERLAP) };
        [from_s, to_s]
    }

    /// Whether the fit of a part sees a photograph taken at `time_s`. The first and the last part see those that offsets
    /// of cameras place outside the take.
    pub(super) fn sees(&self, part: usize, time_s: f64) -> bool {
        let [from_s, to_s] = self.span_s(part);
        (part == 0 || time_s >= from_s) && (part + 1 == self.count || time_s < to_s)
    }

    /// The parts beside one: before it and after it.
    pub(super) fn beside(&self, part: usize) -> [Option<usize>; 2] {
        [part.checked_sub(1), Some(part + 1).filter(|after| *after < self.count)]
    }

    /// Whether the fit of a part sees a photograph taken at `time_s`, and no finished part beside it does: `is_finished`
    /// says whether the part before and the part after are.
    pub(super) fn is_new(&self, part: usize, is_finished: [bool; 2], time_s: f64) -> bool {
        let seen = |(beside, is_finished): (Option<usize>, bool)| {
            is_finished && beside.is_some_and(|beside| self.sees(beside, time_s))
        };
        self.sees(part, time_s) && !self.beside(part).into_iter().zip(is_finished).any(seen)
    }

    /// Parts of the take that the fit of a part sees.
    pub(super) fn units(&self, part: usize) -> f64 {
        let [from_s, to_s] = self.span_s(part);
        (to_s - from_s) / self.unit_s
    }

    /// Parts of the take that the fit of a part sees, and no finished part beside it saw.
    pub(super) fn new_units(&self, part: usize, is_finished: [bool; 2]) -> f64 {
        let [mut from_s, mut to_s] = self.span_s(part);
        let [before, after] = self.beside(part);
        if let Some(before) = before.filter(|_| is_finished[0]) {
            from_s = self.span_s(before)[1];
        }
        if let Some(after) = after.filter(|_| is_finished[1]) {
            to_s = self.span_s(after)[0];
        }
        (to_s - from_s) / self.unit_s
    }

    /// Second before which the parts after this one finish nothing that was not alive later, too.
    pub(super) fn final_until_s(&self, part: usize) -> f64 {
        if part + 1 < self.count { self.span_s(part + 1)[0] } else { f64::INFINITY }
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
            for part in 0..count {
                let [from_s, to_s] = windows.span_s(part);
                assert!(to_s - from_s <= 1.75 + 1e-9);
            }
            for frame in -1..=(duration_s * 30.0) as i32 + 1 {
                let time_s = f64::from(frame) / 30.0;
                let seen: Vec<usize> = (0..count).filter(|part| windows.sees(*part, time_s)).collect();
                assert!((1..=2).contains(&seen.len()) && seen.windows(2).all(|pair| pair[1] == pair[0] + 1));
            }
        }
    }

    #[test]
    fn in_any_order_each_photograph_is_new_once() {
        let windows = Windows::new(7.3, 1.0);
        let all: Vec<usize> = (0..windows.count).collect();
        let even_first = [0, 2, 4, 6, 1, 3, 5].to_vec();
        for order in [all.clone(), all.into_iter().rev().collect(), even_first] {
            let mut finished = [false; 7];
            let (mut units, mut new) = (0.0, [0; 220]);
            for part in order {
                let is_finished =
                    windows.beside(part).map(|beside| beside.is_some_and(|beside| finished[beside]));
                let new_units = windows.new_units(part, is_finished);
                assert!(new_units > 0.0 && new_units <= windows.units(part));
                units += new_units;
                for (frame, new) in new.iter_mut().enumerate() {
                    *new += u32::from(windows.is_new(part, is_finished, frame as f64 / 30.0));
                }
                finished[part] = true;
            }
            assert!((units - 7.3).abs() < 1e-9, "{units}");
            assert!(new.iter().all(|count| *count == 1), "{new:?}");
        }
    }
}
