//! [`split`]: cuts a field of long time into the segments of a take.
//!
//! On level `l` a segment begins at every multiple of `2^l` units and lasts twice that. A Gaussian goes to the
//! lowest level whose segment, of those the last that begins before it is alive, holds its whole life; the top
//! segment spans the whole take.

use std::collections::BTreeMap;

use crate::{Field, Temporal, take::table::take_order};

/// A segment of a field that was split.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitSegment {
    /// Time of the take in seconds at which clip time is 0, from 0.
    pub start_s: f64,
    /// Seconds from clip time 0 to clip time 1, above 0.
    pub duration_s: f64,
    /// Level on the dyadic grid.
    pub level: u8,
    /// Rows of the field, ascending. Never empty.
    pub rows: Vec<usize>,
    /// These rows, with times in clip time of the segment.
    pub field: Field,
}

/// Splits a field that lasts `duration_s` seconds into the segments of a take, in the order of its file, on a grid
/// of `unit_s` seconds; 1 to 2 seconds suit windows of a few frames.
///
/// Each Gaussian goes to one segment, whose span holds all of its life: at any time the segments that hold it have,
/// together, every Gaussian that is alive. Rows keep their order, the most important first. Times are computed in
/// f64 and rounded to f32 once. Gaussians that are never alive go to a short segment near their window.
///
/// # Panics
/// If the duration or the unit is not between 1e-9 and 1e9 seconds, or the field breaks its invariants.
pub fn split(field: &Field, duration_s: f64, unit_s: f64) -> Vec<SplitSegment> {
    let grid = SegmentGrid::new(duration_s, unit_s);
    let mut places: BTreeMap<(u8, u64), Vec<usize>> = BTreeMap::new();
    for row in 0..field.len() {
        places.entry(grid.place(life(field, row).map(|t| t * duration_s))).or_default().push(row);
    }
    let mut segments: Vec<Option<SplitSegment>> = places
        .into_iter()
        .map(|((level, number), rows)| {
            let (start_s, duration) = grid.span(level, number);
            let mut field = field.select(&rows);
            if let Some(temporal) = &mut field.temporal {
                retime(temporal, duration_s, start_s, duration);
            }
            Some(SplitSegment { start_s, duration_s: duration, level, rows, field })
        })
        .collect();
    let spans: Vec<(f64, f64)> =
        segments.iter().flatten().map(|segment| (segment.start_s, segment.duration_s)).collect();
    take_order(duration_s, &spans).into_iter().filter_map(|number| segments[number].take()).collect()
}

/// Clip times at which the life of a Gaussian begins and ends. One that is never alive lives for an instant.
fn life(field: &Field, row: usize) -> [f64; 2] {
    match (field.alive_interval(row), &field.temporal) {
        (Some((birth, death)), _) => [birth, death],
        (None, Some(temporal)) => [f64::from(temporal.tau[row]).clamp(0.0, 1.0); 2],
        (None, None) => [0.0; 2],
    }
}

/// The segments that a take may have, by level and number: on level `l` one begins at every multiple of `2^l` units
/// and lasts twice that, cut to the take; the top one spans it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentGrid {
    duration_s: f64,
    unit_s: f64,
    /// The level whose first segment spans the take.
    top: u8,
}

impl SegmentGrid {
    /// The grid of a take of `duration_s` seconds, with steps of `unit_s` seconds on level 0.
    ///
    /// # Panics
    /// If one is not between 1e-9 and 1e9.
    pub fn new(duration_s: f64, unit_s: f64) -> SegmentGrid {
        let is_valid = |seconds: f64| (1e-9..=1e9).contains(&seconds);
        assert!(is_valid(duration_s) && is_valid(unit_s), "{duration_s} s and {unit_s} s are 1e-9 to 1e9 s");
        let mut grid = SegmentGrid { duration_s, unit_s, top: 0 };
        while 2.0 * grid.step(grid.top) < duration_s {
            grid.top += 1;
        }
        grid
    }

    /// Seconds between the starts of two segments of a level.
    fn step(&self, level: u8) -> f64 {
        libm::ldexp(self.unit_s, i32::from(level))
    }

    /// Start and duration in seconds of a segment, cut to the take.
    pub fn span(&self, level: u8, number: u64) -> (f64, f64) {
        if level == self.top {
            return (0.0, self.duration_s);
        }
        let start = number as f64 * self.step(level);
        let end = ((number as f64 + 2.0) * self.step(level)).min(self.duration_s);
        let duration = end - start;
        // The sum may be rounded down. A segment that ends with the take must hold its last instant.
        (start, if start + duration < end { duration.next_up() } else { duration })
    }

    /// Level and number of the segment of a Gaussian, by the seconds at which its life begins and ends, which are within
    /// the take.
    pub fn place(&self, [birth, death]: [f64; 2]) -> (u8, u64) {
        let lowest = (0..self.top).find_map(|level| {
            let mut number = (birth / self.step(level)) as u64;
            // A segment begins before the take ends.
            if number > 0 && self.span(level, number).0 >= self.duration_s {
                number -= 1;
            }
            let (start, duration) = self.span(level, number);
            let end = start + duration;
            let holds = start <= birth && (death < end || end >= self.duration_s);
            holds.then_some((level, number))
        });
        lowest.unwrap_or((self.top, 0))
    }
}

/// Rewrites times of a clip of `duration_s` seconds in clip time of a span of it, from `start_s` for `span_s`
/// seconds. Times are computed in f64 and rounded to f32 once; beyond the range of f32, centre and width of a window
/// shrink together, so that it stays on.
///
/// With `t = (start + u span) / duration`, where `u` is clip time of the span, `t - tau = (u - tau') span /
/// duration`.
pub fn retime(temporal: &mut Temporal, duration_s: f64, start_s: f64, span_s: f64) {
    let scale = span_s / duration_s;
    for (tau, s) in temporal.tau.iter_mut().zip(&mut temporal.s) {
        let center = (f64::from(*tau) * duration_s - start_s) / span_s;
        let width = f64::from(*s) * duration_s / span_s;
        // Beyond the range of f32 only the quotient of both is seen.
        let excess =
            if width.is_finite() { center.abs().max(width) } else { center.abs() } / f64::from(f32::MAX);
        let shrink = excess.max(1.0);
        (*tau, *s) = ((center / shrink) as f32, (width / shrink) as f32);
    }
    // Of the powers 1 to 3; `powi` may differ between machines.
    let factors = [scale, scale * scale, scale * scale * scale];
    let order = usize::from(temporal.motion_order);
    for (i, v) in temporal.motion.iter_mut().enumerate() {
        *v = v.map(|x| (f64::from(x) * factors[i % order]) as f32);
    }
    for rate in temporal.rotation_rates.iter_mut().flatten() {
        *rate = rate.map(|x| (f64::from(x) * scale) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_a_clip_shows_the_same_at_the_same_second() {
        let field = Field {
            centers: vec![[1.0, 2.0, 3.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-1.0; 3]],
            opacities: vec![0.9],
            sh_degree: 0,
            sh: vec![[0.0; 3]],
            temporal: Some(Temporal {
                tau: vec![0.5],
                s: vec![0.125],
                motion_order: 3,
                motion: vec![[1.0, 0.0, 2.0], [0.0, 4.0, 0.0], [8.0, 0.0, 0.0]],
                rotation_rates: Some(vec![[0.0, 1.0, 0.0, 0.0]]),
            }),
            ..Field::default()
        };
        let mut part = field.clone();
        retime(part.temporal.as_mut().unwrap(), 8.0, 2.0, 4.0);
        for u in [0.0, 0.25, 0.9] {
            let t = 0.25 + 0.5 * u;
            assert!((part.opacity_at(0, u) - field.opacity_at(0, t)).abs() < 1e-12);
            let (a, b) = (part.position_at(0, u), field.position_at(0, t));
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
            let (a, b) = (part.rotation_at(0, u), field.rotation_at(0, t));
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
        }
    }

    #[test]
    fn windows_stay_on_in_a_part_far_shorter_than_they_are() {
        let mut temporal = Temporal {
            tau: vec![0.5, 1e30, 0.5],
            s: vec![f32::MAX, 2e30, f32::INFINITY],
            motion_order: 0,
            ..Temporal::default()
        };
        retime(&mut temporal, 1.0, 0.25, 1e-12);
        for (tau, s) in temporal.tau.iter().zip(&temporal.s) {
            assert!(tau.is_finite() && *s > 0.0, "{tau} {s}");
        }
        let quotient = |i: usize| temporal.tau[i] / temporal.s[i];
        assert!(quotient(0).abs() < 1e-6 && (quotient(1) - 0.5).abs() < 1e-6 && quotient(2) == 0.0);
    }
}
