//! [`Span`]: the part of a take during which a segment is shown.

use codec::{RESIDENT_MAX, Resident, SPAN_TOLERANCE_S, Segment, span_holds, take_order};
use refine::reference::SceneSpan;

/// The span of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Second of the take at which clip time of the segment is 0. Negative if the take was trimmed.
    pub start_s: f64,
    /// Seconds from the segment's clip time 0 to 1, above 0.
    pub duration_s: f64,
    /// Level on the dyadic grid.
    pub level: u8,
}

impl Span {
    /// Second of the take at which the segment's clip time is 1.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }

    /// Whether the segment is shown at second `t_s` of a take of `take_s` seconds, as [`span_holds`] has it.
    pub(crate) fn holds(&self, take_s: f64, t_s: f64) -> bool {
        span_holds(self.start_s, self.end_s(), take_s, t_s)
    }

    /// The span for the reference renderer.
    pub(crate) fn in_scene(&self, take_s: f64) -> SceneSpan {
        SceneSpan { take_s, start_s: self.start_s, duration_s: self.duration_s }
    }
}

impl From<&Segment> for Span {
    fn from(segment: &Segment) -> Span {
        Span { start_s: segment.start_s, duration_s: segment.duration_s, level: segment.level }
    }
}

/// The order in which a take of `take_s` seconds holds these segments.
pub(crate) fn order_of(take_s: f64, spans: &[Span]) -> Vec<usize> {
    let pairs: Vec<(f64, f64)> = spans.iter().map(|span| (span.start_s, span.duration_s)).collect();
    take_order(take_s, &pairs)
}

/// Checks the spans of a take of `take_s` seconds, in its order.
///
/// # Errors
/// One sentence that names the first segment that breaks a rule, counted from 0, and says what to do.
pub(super) fn check_spans(take_s: f64, spans: &[Span]) -> Result<(), String> {
    if !(take_s.is_finite() && take_s > 0.0) {
        return Err(format!("duration_s must be a positive number, not {take_s}"));
    }
    for (i, span) in spans.iter().enumerate() {
        let Span { start_s, duration_s, .. } = *span;
        let is_span =
            start_s.is_finite() && duration_s > 0.0 && span.end_s().is_finite() && span.end_s() > start_s;
        if !is_span || start_s >= take_s || span.end_s() <= 0.0 {
            return Err(format!(
                "segments[{i}] lasts {duration_s} s from {start_s} s, which is no part of {take_s} s; correct it"
            ));
        }
    }
    let order = order_of(take_s, spans);
    if let Some(i) = (1..order.len()).find(|&i| order[i] < order[i - 1]) {
        let [late, early] = [order[i - 1], order[i]];
        return Err(format!(
            "segments[{late}], from {} s, belongs before segments[{early}], from {} s; list segments by their start, longer \
             ones first, and before all others those that span the whole",
            spans[late].start_s, spans[early].start_s
        ));
    }
    match held_at_starts(spans).find(|(_, held)| held.len() > RESIDENT_MAX) {
        None => Ok(()),
        Some((start_s, _)) => Err(format!(
            "more than {RESIDENT_MAX} segments hold {start_s} s, and players hold no more; leave some of them out"
        )),
    }
}

/// The numbers of the segments that hold each start, in the order of the starts; segments that begin before the take
/// begin with it. At one of these instants the most segments, and the most Gaussians, are held.
pub(crate) fn held_at_starts(spans: &[Span]) -> impl Iterator<Item = (f64, Vec<usize>)> {
    let start_s = |i: usize| spans[i].start_s.max(0.0);
    let mut by_start: Vec<usize> = (0..spans.len()).collect();
    by_start.sort_by(|&a, &b| start_s(a).total_cmp(&start_s(b)));
    let mut resident = Resident::default();
    let places = 0..by_start.len();
    places.filter_map(move |place| {
        let number = by_start[place];
        resident.enter(number, start_s(number), spans[number].end_s());
        // Those that begin together make one instant.
        let is_last = by_start.get(place + 1).is_none_or(|&next| start_s(next) > start_s(number));
        is_last.then(|| (start_s(number), resident.numbers().collect()))
    })
}

/// The parts of a take of `take_s` seconds that no segment holds, as seconds.
pub(crate) fn gaps(take_s: f64, spans: &[Span]) -> Vec<[f64; 2]> {
    let mut covered: Vec<[f64; 2]> = spans.iter().map(|span| [span.start_s, span.end_s()]).collect();
    covered.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut gaps = Vec::new();
    let mut end_s = 0.0;
    for [start, end] in covered.into_iter().chain([[take_s, take_s]]) {
        // An end is a rounded sum.
        if start > end_s + SPAN_TOLERANCE_S {
            gaps.push([end_s, start]);
        }
        end_s = end.max(end_s);
    }
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spans(list: &[(f64, f64)]) -> Vec<Span> {
        list.iter().map(|&(start_s, duration_s)| Span { start_s, duration_s, level: 0 }).collect()
    }

    #[test]
    fn spans_are_checked_in_the_order_of_the_file() {
        let refused = |list: &[(f64, f64)]| check_spans(4.0, &spans(list)).unwrap_err();
        assert_eq!(
            check_spans(4.0, &spans(&[(0.0, 4.0), (0.0, 2.0), (1.0, 2.0), (1.0, 1.0), (3.9, 9.0)])),
            Ok(())
        );
        assert!(
            refused(&[(0.0, 2.0), (2.0, 1.0), (1.0, 1.0)]).contains("segments[2], from 1 s, belongs before")
        );
        assert!(refused(&[(0.0, 2.0), (0.0, 4.0)]).contains("span the whole"));
        for bad in
            [(4.0, 1.0), (-1.0, 1.0), (0.0, 0.0), (f64::NAN, 1.0), (0.0, f64::NAN), (0.0, f64::INFINITY)]
        {
            assert!(refused(&[bad]).starts_with("segments[0] lasts"), "{bad:?}");
        }
        assert!(refused(&[(0.0, 2.0); 33]).starts_with("more than 32"));
        assert_eq!(check_spans(4.0, &spans(&[(0.0, 2.0); 32])), Ok(()));
        assert!(check_spans(f64::NAN, &[]).unwrap_err().contains("duration_s"));
    }

    #[test]
    fn gaps_are_what_no_segment_holds() {
        assert_eq!(
            gaps(4.0, &spans(&[(0.5, 1.0), (1.0, 1.0), (3.0, 0.5)])),
            [[0.0, 0.5], [2.0, 3.0], [3.5, 4.0]]
        );
        assert_eq!(gaps(4.0, &spans(&[(-1.0, 3.0), (2.0, 3.0)])), [[0.0; 2]; 0]);
    }
}
