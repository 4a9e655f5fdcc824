//! [`PartTime`]: what the fit of a part knows of the Gaussians that the parts beside it have fitted.

use refine::fit::{Carried, Parameters};

use super::windows::Windows;

/// Share of a life that counts as all of it: the rest is at opacities that no picture shows.
const ALL: f64 = 0.999;

/// Least share of what may still change.
const SHARE_MIN: f64 = 1e-6;

/// The time of a part, in intervals from its first photograph.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartTime {
    /// Where its photographs end.
    pub(super) end: f64,
    /// Where the take begins and ends.
    take: [f64; 2],
    /// Whether the part before and the part after are finished.
    is_finished: [bool; 2],
}

/// The side of a part, in time, on which another lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Before,
    After,
}

impl Side {
    pub(super) const BOTH: [Side; 2] = [Side::Before, Side::After];
}

impl PartTime {
    pub(super) fn new(windows: &Windows, part: usize, interval_s: f64, is_finished: [bool; 2]) -> PartTime {
        let [from_s, to_s] = windows.span_s(part);
        PartTime {
            end: (to_s - from_s) / interval_s,
            take: [-from_s, windows.duration_s - from_s].map(|second| second / interval_s),
            is_finished,
        }
    }

    /// The past of a row that is in the photographs of this part alone.
    pub(super) fn own(&self) -> Carried {
        let [before, after] = self.is_finished;
        let birth = if before { 0.0 } else { f32::NEG_INFINITY };
        let death = if after { self.end as f32 } else { f32::INFINITY };
        Carried { limits: [birth, death], ..Carried::NONE }
    }

    /// The past of each row that the part on one side has fitted.
    ///
    /// The share is the integral of the window over the photographs of this part, divided by the integral from the end
    /// of the take on that side up to the farther end of these photographs.
    pub(super) fn carried(&self, parameters: &Parameters<f32>, side: Side) -> Vec<Carried> {
        (0..parameters.len())
            .map(|row| {
                let tau = f64::from(parameters.tau[row]);
                let width = libm::exp(f64::from(parameters.log_widths[row]));
                let share = match side {
                    Side::Before => share(tau, width, self.take[0], self.end),
                    Side::After => share(self.end - tau, width, self.end - self.take[1], self.end),
                };
                if share >= ALL {
                    return self.own();
                }
                let half_life = parameters.support_radius(row) * width;
                let mut limits = self.own().limits;
                match side {
                    Side::Before => limits[0] = (tau - half_life) as f32,
                    Side::After => limits[1] = (tau + half_life) as f32,
                }
                Carried { share: share.max(SHARE_MIN) as f32, limits, is_static: false }
            })
            .collect()
    }
}

/// Share that the photographs from 0 to `end` have in a window from `begin` of the take up to `end`.
fn share(tau: f64, width: f64, begin: f64, end: f64) -> f64 {
    // Seen from the later end, so that the difference of two numbers near 1 does not cancel.
    let after = |time: f64| libm::erfc((time - tau) / (width * std::f64::consts::SQRT_2));
    let between = |from: f64, to: f64| after(from) - after(to);
    let (seen, so_far) = (between(0.0, end), between(begin, end));
    match so_far > 0.0 {
        true => seen / so_far,
        false if tau < 0.0 => 0.0,
        false => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIME: PartTime = PartTime { end: 45.0, take: [-300.0, 900.0], is_finished: [true, false] };
    const BOTH: PartTime = PartTime { is_finished: [true, true], ..TIME };

    fn row(tau: f32, width: f32) -> Parameters<f32> {
        Parameters {
            centers: vec![[0.0; 3]],
            logits: vec![0.0],
            tau: vec![tau],
            log_widths: vec![width.ln()],
            ..Parameters::default()
        }
    }

    fn share(tau: f32, width: f32) -> f32 {
        TIME.carried(&row(tau, width), Side::Before)[0].share
    }

    #[test]
    fn a_share_is_that_of_the_life_so_far() {
        assert_eq!(share(20.0, 2.0), 1.0, "all of its life");
        assert_eq!(share(60.0, 2.0), 1.0, "not yet alive");
        assert!((share(0.0, 2.0) - 0.5).abs() < 1e-6, "half of it");
        assert!((0.02..0.03).contains(&share(-4.0, 2.0)));
        assert_eq!(share(-100.0, 2.0), SHARE_MIN as f32, "it is not fixed");
        // On for long: 45 of 345 intervals so far, of a window that has hardly begun to close.
        assert!((share(10.0, 5000.0) - 45.0 / 345.0).abs() < 1e-3);
    }

    #[test]
    fn time_has_no_direction() {
        let mirrored = PartTime { take: [-855.0, 345.0], ..TIME };
        for (tau, width) in [(20.0, 2.0), (0.0, 2.0), (-4.0, 2.0), (60.0, 2.0), (10.0, 5000.0)] {
            let after = mirrored.carried(&row(45.0 - tau, width), Side::After)[0].share;
            assert!((after - share(tau, width)).abs() < 1e-6, "{tau} {width}");
        }
    }

    #[test]
    fn only_a_past_may_reach_beyond_the_photographs() {
        let none = f32::INFINITY;
        let limits = |time: PartTime, tau, side| time.carried(&row(tau, 2.0), side)[0].limits;
        let half_life = 2.0 * (2.0f32 * 127.5f32.ln()).sqrt();
        let near = |a: [f32; 2], b: [f32; 2]| {
            assert!(a.iter().zip(b).all(|(a, b)| *a == b || (a - b).abs() < 1e-4), "{a:?} {b:?}");
        };
        near(limits(TIME, 20.0, Side::Before), [0.0, none]);
        near(limits(TIME, 0.0, Side::Before), [-half_life, none]);
        near(limits(BOTH, 0.0, Side::Before), [-half_life, 45.0]);
        near(limits(BOTH, 44.0, Side::After), [0.0, 44.0 + half_life]);
        near(limits(BOTH, 20.0, Side::After), [0.0, 45.0]);
        assert_eq!(PartTime { is_finished: [false; 2], ..TIME }.own(), Carried::NONE);
    }
}
