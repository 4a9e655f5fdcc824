//! [`span_holds`] and [`Resident`]: which segments of a take hold an instant.

use crate::counters::Work;

/// Seconds by which a segment may begin late or end late and still hold an instant: an end is a sum, and where it is
/// rounded below the start of the next segment, the instant between them would show neither. Steps of f64 are 5e-13 s
/// after an hour. FORMAT.md allows it.
pub const SPAN_TOLERANCE_S: f64 = 1e-9;

/// Whether a segment from `start_s` to `end_s` is seen at second `t_s` of a take of `take_s` seconds: from its start up
/// to, but without, its end; at the last instant of the take, if it ends there or later. `t_s` is cut to the take, and
/// is [`SPAN_TOLERANCE_S`] later in all comparisons.
pub fn span_holds(start_s: f64, end_s: f64, take_s: f64, t_s: f64) -> bool {
    let t_s = t_s.max(0.0).min(take_s) + SPAN_TOLERANCE_S;
    start_s <= t_s && (t_s < end_s || take_s <= end_s + SPAN_TOLERANCE_S)
}

/// The segments that hold an instant, while segments enter in the order of their starts. Limits of the format are of
/// spans as they are written, without the tolerance.
#[derive(Clone, Debug, Default)]
pub struct Resident(Vec<(f64, usize)>);

impl Resident {
    /// Moves on to the second `start_s`: removes the segments that have ended, and adds one with this number that begins.
    pub fn enter(&mut self, number: usize, start_s: f64, end_s: f64) {
        Work::Sections.count(1 + self.0.len());
        self.0.retain(|(end_s, _)| *end_s > start_s);
        self.0.push((end_s, number));
    }

    /// Their numbers, in the order in which they entered.
    pub fn numbers(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        self.0.iter().map(|(_, number)| *number)
    }
}
