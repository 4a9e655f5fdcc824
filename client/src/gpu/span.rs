//! [`Span`]: the part of a take that a segment lasts.

use codec::span_holds;

/// The seconds of a take that a segment spans. Its clip time runs from 0 to 1 in them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Start in seconds; negative for a segment that a trimmed take does not show from its beginning.
    pub start_s: f64,
    /// Duration in seconds, above 0.
    pub duration_s: f64,
}

impl Span {
    /// The span of the only segment of a clip, in units of the clip.
    pub const WHOLE: Span = Span { start_s: 0.0, duration_s: 1.0 };

    /// Whether the segment is drawn at the instant `t_s` of a take of `take_s` seconds, as [`span_holds`] has it.
    pub fn holds(&self, t_s: f64, take_s: f64) -> bool {
        span_holds(self.start_s, self.start_s + self.duration_s, take_s, t_s)
    }

    /// Clip time of the segment at the instant `t_s` of the take, from 0 to 1.
    pub fn clip_time(&self, t_s: f64) -> f64 {
        ((t_s - self.start_s) / self.duration_s).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_ends_where_the_next_begins() {
        let third = 1.0 / 3.0;
        let spans = [0.0, third, 2.0 * third].map(|start_s| Span { start_s, duration_s: third });
        let holding = |t_s: f64| spans.map(|span| span.holds(t_s, 1.0));
        assert_eq!(holding(0.0), [true, false, false]);
        assert_eq!(holding(1.0), [false, false, true]);
        for (cut, expected) in [(third, [false, true, false]), (2.0 * third, [false, false, true])] {
            // Ends of spans are rounded.
            for t_s in [cut.next_down(), cut, cut.next_up()] {
                assert_eq!(holding(t_s), expected, "{t_s}");
            }
            assert_eq!(holding(cut - 1e-6).iter().filter(|holds| **holds).count(), 1);
            assert_ne!(holding(cut - 1e-6), expected);
        }
    }

    #[test]
    fn clip_time_is_exact_in_an_hour() {
        let span = Span { start_s: 3598.5, duration_s: 1.5 };
        assert_eq!([3598.5, 3599.0, 3600.0].map(|t_s| span.clip_time(t_s)), [0.0, 1.0 / 3.0, 1.0]);
        // As a player gives the instant: a fraction of the take.
        let t_s = 3_599.123_456 / 3600.0 * 3600.0;
        assert!((span.clip_time(t_s) - 0.623_456 / 1.5).abs() < 1e-12);
        let trimmed = Span { start_s: -0.5, duration_s: 1.0 };
        assert!(trimmed.holds(0.0, 2.0) && trimmed.clip_time(0.0) == 0.5 && !trimmed.holds(0.5, 2.0));
        assert_eq!(trimmed.clip_time(-1.0), 0.0);
    }
}
