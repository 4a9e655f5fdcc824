//! [`Plan`]: the segments of a take that playing needs at a position, the most urgent first.
//!
//! Pure: it knows the table and the playhead, no files and no device. A reader may rely on the spans of segments alone,
//! so the plan looks at no level: it wants what holds the instant, and then what starts (or, played backwards, ends) at
//! the next two cuts. On a grid of levels these are at most four segments of the lowest one.

use codec::{Segment, Take};
use shaders::SLOTS;

use crate::gpu::Span;

/// Number of cuts ahead whose segments are made ready.
const CUTS_AHEAD: usize = 2;

/// What sums of seconds may be off by: more than the tolerance of [`Span::holds`].
const ROUNDING_S: f64 = 1e-8;

/// Seconds of a take over which the rate that playing needs is averaged.
const RATE_AHEAD_S: f64 = 8.0;

/// Which way the position moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Direction {
    #[default]
    Forward,
    Backward,
}

/// Where a take is played, and how it goes on from there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Playhead {
    /// Seconds from the start of the take.
    pub(crate) t_s: f64,
    pub(crate) direction: Direction,
    /// Whether playing goes on at the other end.
    pub(crate) looping: bool,
    /// Seconds of the take a second.
    pub(crate) speed: f64,
}

/// What playing needs a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Needs {
    pub(crate) bytes: f64,
    pub(crate) segments: f64,
}

/// Layers of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Want {
    pub(crate) segment: usize,
    /// Number of layers that are there, or come before. They are not loaded again.
    pub(crate) from: usize,
    /// Number of layers that are there then.
    pub(crate) layers: usize,
}

/// The wants at a playhead.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Plan {
    /// The most urgent first. A segment with several layers that holds the instant is in it twice: with its first layer
    /// and with all.
    wants: Vec<Want>,
    /// Segments that hold the instant.
    held: Vec<usize>,
    /// The nearest cuts before and after the instant. Between them the plan stays the same.
    from_s: f64,
    until_s: f64,
}

/// The span of a segment.
pub(crate) fn span(segment: &Segment) -> Span {
    Span { start_s: segment.start_s, duration_s: segment.duration_s }
}

impl Plan {
    /// The plan for `head`. Only the first `layers[i]` layers of segment i can be loaded, none if it is 0. Segments
    /// ahead are planned while all together have at most `rows` Gaussians.
    pub(crate) fn new(take: &Take, layers: &[usize], head: Playhead, rows: usize) -> Plan {
        let t_s = if head.t_s > 0.0 { head.t_s.min(take.duration_s) } else { 0.0 };
        let is_loadable = |index: &usize| layers[*index] > 0;
        let holds = |index: &usize| span(&take.segments[*index]).holds(t_s, take.duration_s);
        let held: Vec<usize> = (0..take.segments.len()).filter(is_loadable).filter(holds).collect();
        let mut wants: Vec<Want> = held.iter().map(|&segment| Want { segment, from: 0, layers: 1 }).collect();
        let rest = held.iter().filter(|&&segment| layers[segment] > 1);
        wants.extend(rest.map(|&segment| Want { segment, from: 1, layers: layers[segment] }));

        // A segment has room for all its layers.
        let gaussians = |segment: usize| take.segments[segment].gaussians();
        let mut taken: usize = held.iter().map(|&segment| gaussians(segment)).sum();
        let free = (SLOTS as usize).saturating_sub(held.len());
        for segment in ahead(take, layers, &held, t_s, &head).into_iter().take(free) {
            taken += gaussians(segment);
            if taken > rows {
                break;
            }
            wants.push(Want { segment, from: 0, layers: layers[segment] });
        }
        let (from_s, until_s) = cuts_around(take, t_s);
        Plan { wants, held, from_s, until_s }
    }

    /// Whether the plan is also that for `t_s` seconds, with the same direction and loop.
    pub(crate) fn is_for(&self, t_s: f64) -> bool {
        (self.from_s + ROUNDING_S..self.until_s - ROUNDING_S).contains(&t_s)
    }

    /// The wants that `resident` does not satisfy, the most urgent first. `resident` is the number of layers of a
    /// segment that are there or on their way, 0 for none.
    pub(crate) fn missing(&self, resident: impl Fn(usize) -> usize) -> Vec<Want> {
        let missing = self.wants.iter().filter(|want| resident(want.segment) < want.layers);
        missing.map(|want| Want { from: want.from.max(resident(want.segment)), ..*want }).collect()
    }

    /// The segments that hold the instant and can be loaded.
    pub(crate) fn held(&self) -> &[usize] {
        &self.held
    }

    /// Whether the segment holds the instant and can be loaded.
    pub(crate) fn holds(&self, segment: usize) -> bool {
        self.held.contains(&segment)
    }

    /// Whether the segment is in the plan.
    pub(crate) fn wants(&self, segment: usize) -> bool {
        self.rank(segment).is_some()
    }

    /// Which of the `resident` segments to remove to make room for `segment`: one that is not in the plan, else the
    /// least urgent one behind `segment`. `None` if all are more urgent.
    pub(crate) fn victim(&self, resident: &[usize], segment: usize) -> Option<usize> {
        // What is not in the plan ranks behind all that is.
        let rank = |segment: usize| self.rank(segment).unwrap_or(self.wants.len());
        let least =
            resident.iter().copied().filter(|other| *other != segment).max_by_key(|&other| rank(other))?;
        let may_go = !self.holds(least) && (rank(least) == self.wants.len() || rank(least) > rank(segment));
        may_go.then_some(least)
    }

    fn rank(&self, segment: usize) -> Option<usize> {
        self.wants.iter().position(|want| want.segment == segment)
    }
}

/// The segments at the next cuts, in the order in which they are reached.
fn ahead(take: &Take, layers: &[usize], held: &[usize], t_s: f64, head: &Playhead) -> Vec<usize> {
    let end_s = take.duration_s;
    // Seconds from the playhead until the segment is seen; `None` for never.
    let until = |index: usize| {
        let segment = &take.segments[index];
        let ahead_s = match head.direction {
            Direction::Forward => segment.start_s.max(0.0) - t_s,
            Direction::Backward => t_s - segment.end_s().min(end_s),
        };
        let is_ahead = match head.direction {
            Direction::Forward => ahead_s > 0.0,
            // A span does not hold its end, nor the instant that rounding may put before it.
            Direction::Backward => ahead_s > -ROUNDING_S,
        };
        match is_ahead {
            true => Some(ahead_s),
            false => head.looping.then_some(ahead_s + end_s),
        }
    };
    let mut coming: Vec<(f64, usize)> = (0..take.segments.len())
        .filter(|index| layers[*index] > 0 && !held.contains(index))
        .filter_map(|index| Some((until(index)?, index)))
        .collect();
    let last_s = nth_cut(&coming, CUTS_AHEAD);
    coming.retain(|(ahead_s, _)| *ahead_s <= last_s);
    coming.sort_by(|a, b| a.0.total_cmp(&b.0));
    coming.into_iter().map(|(_, index)| index).collect()
}

/// What playing on from `head` needs a second of the first `layers` layers of segments.
pub(crate) fn needs(take: &Take, layers: usize, head: &Playhead) -> Needs {
    let ahead_s = RATE_AHEAD_S.min(take.duration_s);
    let is_ahead = |segment: &&Segment| {
        let from_s = match head.direction {
            Direction::Forward => segment.start_s - head.t_s,
            Direction::Backward => head.t_s - segment.end_s(),
        };
        let from_s = if head.looping { from_s.rem_euclid(take.duration_s) } else { from_s };
        (0.0..ahead_s).contains(&from_s)
    };
    let mut needs = Needs::default();
    for segment in take.segments.iter().filter(is_ahead) {
        let layers = &segment.layers[..layers.min(segment.layers.len())];
        needs.bytes += head.speed / ahead_s * layers.last().map_or(0, |layer| layer.bytes) as f64;
        needs.segments += head.speed / ahead_s;
    }
    needs
}

/// The last start or end of a segment up to `t_s`, and the first one behind it.
fn cuts_around(take: &Take, t_s: f64) -> (f64, f64) {
    let cuts = take.segments.iter().flat_map(|segment| [segment.start_s, segment.end_s()]);
    cuts.fold((f64::NEG_INFINITY, f64::INFINITY), |(from_s, until_s), cut_s| match cut_s <= t_s {
        true => (cut_s.max(from_s), until_s),
        false => (from_s, cut_s.min(until_s)),
    })
}

/// The `count`th of the different times in `coming`, or the last one.
fn nth_cut(coming: &[(f64, usize)], count: usize) -> f64 {
    let mut cut_s = f64::NEG_INFINITY;
    for _ in 0..count {
        let next_s = coming.iter().map(|(ahead_s, _)| *ahead_s).filter(|ahead_s| *ahead_s > cut_s);
        match next_s.reduce(f64::min) {
            Some(next_s) => cut_s = next_s,
            None => break,
        }
    }
    cut_s
}

/// The largest number of Gaussians that a plan wants at any playhead of the take.
pub(crate) fn rows_wanted(take: &Take) -> usize {
    let end_s = take.duration_s;
    let seen =
        |segment: &Segment| (segment.start_s.max(0.0), segment.end_s().min(end_s), segment.gaussians());
    let forward: Vec<_> = take.segments.iter().map(seen).collect();
    let backward = forward.iter().map(|&(start_s, end_s, rows)| (-end_s, -start_s, rows)).collect();
    rows_ahead(forward).max(rows_ahead(backward))
}

/// The largest number of Gaussians of the `spans`, (start, end, Gaussians), that hold a start or are at one of the
/// [`CUTS_AHEAD`] next starts, the first following the last.
fn rows_ahead(mut spans: Vec<(f64, f64, usize)>) -> usize {
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut ends: Vec<(f64, usize)> = spans.iter().map(|&(_, end_s, rows)| (end_s, rows)).collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let cuts: Vec<(f64, usize)> = spans
        .chunk_by(|a, b| a.0 == b.0)
        .map(|cut| (cut[0].0, cut.iter().map(|(_, _, rows)| rows).sum()))
        .collect();
    let (mut held, mut ended, mut largest) = (0, ends.into_iter().peekable(), 0);
    for (i, &(start_s, rows)) in cuts.iter().enumerate() {
        while let Some((_, gone)) = ended.next_if(|(end_s, _)| *end_s <= start_s) {
            held -= gone;
        }
        held += rows;
        let next = (1..cuts.len().min(CUTS_AHEAD + 1)).map(|n| cuts[(i + n) % cuts.len()].1);
        largest = largest.max(held + next.sum::<usize>());
    }
    largest
}

#[cfg(test)]
mod tests;
