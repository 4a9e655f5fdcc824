//! [`past`]: what a step knows of the Gaussians that steps before it fitted.

use refine::fit::{Carried, Parameters};

/// Share of a life that counts as all of it: the rest is at opacities that no picture shows.
const ALL: f64 = 0.999;

/// Opacity, of its peak, that a window keeps over the whole take if it is always on.
const ALWAYS_ON: f64 = 0.99;

/// The past of each row of `parameters`, whose times count in intervals from the first photograph of this step up to its
/// last one at `end`; the take lasts from `take[0]` to `take[1]`.
///
/// The share is that of the integral of the window over the photographs of this step, in that from the beginning of the
/// take to the last photograph of this step.
pub(super) fn past(parameters: &Parameters<f32>, take: [f64; 2], end: f64) -> Vec<Carried> {
    (0..parameters.len())
        .map(|row| {
            let tau = f64::from(parameters.tau[row]);
            let width = libm::exp(f64::from(parameters.log_widths[row]));
            // Seen from the later end, so that the difference of two numbers near 1 does not cancel.
            let after = |time: f64| libm::erfc((time - tau) / (width * std::f64::consts::SQRT_2));
            let between = |from: f64, to: f64| after(from) - after(to);
            let (seen, so_far) = (between(0.0, end), between(take[0], end));
            let share = if so_far > 0.0 {
                seen / so_far
            } else if tau < 0.0 {
                0.0
            } else {
                1.0
            };
            let farthest = (tau - take[0]).abs().max((tau - take[1]).abs()) / width;
            let is_static = libm::exp(-0.5 * farthest * farthest) >= ALWAYS_ON;
            let (share, birth) = match share >= ALL {
                // The whole take shows it.
                _ if is_static => ((end / (take[1] - take[0])).min(1.0) as f32, f32::NEG_INFINITY),
                true => (1.0, if take[0] < 0.0 { 0.0 } else { f32::NEG_INFINITY }),
                false => (share as f32, (tau - parameters.support_radius(row) * width) as f32),
            };
            Carried { share, birth, is_static }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
        past(&row(tau, width), [-300.0, 900.0], 45.0)[0].share
    }

    #[test]
    fn a_share_is_that_of_the_life_so_far() {
        assert_eq!(share(20.0, 2.0), 1.0, "all of its life");
        assert_eq!(share(60.0, 2.0), 1.0, "not yet alive");
        assert!((share(0.0, 2.0) - 0.5).abs() < 1e-6, "half of it");
        assert!((0.02..0.03).contains(&share(-4.0, 2.0)));
        assert_eq!(share(-100.0, 2.0), 0.0);
        // On for long: 45 of 345 intervals so far, of a window that has hardly begun to close.
        assert!((share(10.0, 5000.0) - 45.0 / 345.0).abs() < 1e-3);
        // Always on: the whole take shows it.
        assert_eq!(share(10.0, 1e6), 45.0 / 1200.0);
    }

    #[test]
    fn only_a_past_may_begin_before_the_photographs() {
        assert_eq!(past(&row(20.0, 2.0), [-300.0, 900.0], 45.0)[0].birth, 0.0);
        let birth = past(&row(0.0, 2.0), [-300.0, 900.0], 45.0)[0].birth;
        assert!((birth + 2.0 * (2.0f32 * 127.5f32.ln()).sqrt()).abs() < 1e-4, "{birth}");
    }

    #[test]
    fn what_is_always_on_is_still_and_what_begins_with_the_take_has_no_birth() {
        let past = |tau, width, take| past(&row(tau, width), take, 45.0)[0];
        assert!(past(20.0, 1e5, [-300.0, 900.0]).is_static);
        assert!(!past(20.0, 1000.0, [-300.0, 900.0]).is_static);
        assert_eq!(past(3.0, 4.0, [0.0, 1200.0]), Carried::NONE);
    }
}
