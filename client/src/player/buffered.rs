//! [`Buffered`]: the parts of a take that play without loading.
//!
//! Between two neighbouring cuts, the starts and ends of segments, the same segments are seen. Such a part is buffered
//! if as many of them are drawn as there are.

use codec::Take;

use crate::content::Direction;

/// The buffered parts of a take.
pub(super) struct Buffered {
    /// The cuts, ascending, from 0 to the end of the take.
    cuts: Vec<f64>,
    /// For each segment the parts that it is seen in, from and up to.
    parts: Vec<(usize, usize)>,
    /// Number of segments that are seen in each part.
    seen: Vec<i32>,
    ranges: Vec<(f64, f64)>,
}

impl Buffered {
    /// Nothing is drawn yet. Segments with 0 `layers` are never drawn and do not count.
    pub(super) fn new(take: &Take, layers: &[usize]) -> Buffered {
        let end_s = take.duration_s;
        let clamped = |segment: &codec::Segment| [segment.start_s.max(0.0), segment.end_s().min(end_s)];
        let mut cuts: Vec<f64> = take.segments.iter().flat_map(clamped).chain([0.0, end_s]).collect();
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
        let at = |cut_s: f64| cuts.partition_point(|other_s| *other_s < cut_s);
        let parts: Vec<(usize, usize)> =
            take.segments.iter().map(|segment| clamped(segment).map(at).into()).collect();
        let loadable = parts.iter().zip(layers).filter(|(_, layers)| **layers > 0).map(|(part, _)| *part);
        let seen = counts(loadable, cuts.len());
        let mut buffered = Buffered { cuts, parts, seen, ranges: Vec::new() };
        buffered.update([].into_iter());
        buffered
    }

    /// Takes in the segments that are drawn.
    pub(super) fn update(&mut self, drawn: impl Iterator<Item = usize>) {
        let drawn = counts(drawn.map(|segment| self.parts[segment]), self.cuts.len());
        self.ranges.clear();
        let is_whole = |(part, _): &(usize, &[f64])| drawn[*part] >= self.seen[*part];
        for (_, ends) in self.cuts.windows(2).enumerate().filter(is_whole) {
            match self.ranges.last_mut() {
                Some((_, to_s)) if *to_s == ends[0] => *to_s = ends[1],
                _ => self.ranges.push((ends[0], ends[1])),
            }
        }
    }

    /// The buffered parts as seconds (from, to), ascending.
    pub(super) fn ranges(&self) -> &[(f64, f64)] {
        &self.ranges
    }

    /// Seconds from `t_s` to the end of its buffered part; 0 if it is in none.
    pub(super) fn from(&self, t_s: f64, direction: Direction) -> f64 {
        let range = self.ranges.iter().find(|(from_s, to_s)| (*from_s..=*to_s).contains(&t_s));
        range.map_or(0.0, |(from_s, to_s)| match direction {
            Direction::Forward => to_s - t_s,
            Direction::Backward => t_s - from_s,
        })
    }
}

/// Number of `spans`, (from, up to), that hold each of `len` places.
fn counts(spans: impl Iterator<Item = (usize, usize)>, len: usize) -> Vec<i32> {
    let mut counts = vec![0; len + 1];
    for (from, up_to) in spans {
        counts[from] += 1;
        counts[up_to] -= 1;
    }
    let mut count = 0;
    counts.iter_mut().for_each(|change| {
        count += *change;
        *change = count;
    });
    counts
}
