//! [`relocate`]: moves dead Gaussians onto live ones instead of pruning them.
//!
//! The rule of "3D Gaussian splatting as Markov chain Monte Carlo" (Kheradmand et al., 2024), Eq. 9:
//! a Gaussian of opacity `o` is replaced by `n` in the same place that render the same image,
//! `1 - (1 - o')^n = o` at the centre and the same integral along a line through it. The number of
//! Gaussians, and with it the memory, is constant.

use crate::fit::optimizer::Moments;
use crate::fit::parameters::{Bounds, Parameters};
use crate::raster::Real;

/// Largest shift of a relocated Gaussian's window, in intervals along its trajectory.
const TAU_JITTER: f64 = 0.25;

/// Opacity of each of `n` Gaussians that replace one of `opacity`, and the factor of their scales (at
/// most 1).
///
/// The hockey-stick identity turns the nested sums of Eq. 9 into
/// `sum over j from 1 to n of (-1)^(j - 1) C(n, j) o'^j / sqrt(j)`.
fn split_opacity(opacity: f64, n: usize) -> (f64, f64) {
    let each = -libm::expm1(libm::log1p(-opacity) / n as f64);
    let (mut term, mut sum) = (-1.0, 0.0);
    for j in 1..=n {
        term *= -each * (n - j + 1) as f64 / j as f64;
        sum += term / (j as f64).sqrt();
    }
    (each, opacity / sum)
}

/// Moves each of the `dead` rows onto a live one, drawn with a probability proportional to its opacity,
/// and clears the moments of both. Returns how many moved: all, or none if no row is live.
pub(super) fn relocate<T: Real>(
    parameters: &mut Parameters<T>,
    moments: &mut Moments<T>,
    dead: &[bool],
    bounds: &Bounds,
    random: &mut fastrand::Rng,
) -> usize {
    let mut total = 0.0;
    let weight = |row: usize| {
        if !dead[row] && moments.is_own(row) {
            total += sigmoid(parameters.logits[row].to_double());
        }
        total
    };
    let cumulative: Vec<f64> = (0..parameters.len()).map(weight).collect();
    let last = (0..parameters.len()).rfind(|row| !dead[*row] && moments.is_own(*row));
    let (Some(last), true) = (last, dead.contains(&true)) else { return 0 };
    let mut copies = vec![1; parameters.len()];
    let mut sources: Vec<usize> = (0..parameters.len()).collect();
    for row in (0..parameters.len()).filter(|row| dead[*row]) {
        let sample = random.f64() * total;
        sources[row] = cumulative.partition_point(|sum| *sum <= sample).min(last);
        copies[sources[row]] += 1;
    }
    for row in (0..parameters.len()).filter(|row| copies[*row] > 1) {
        let (opacity, growth) = split_opacity(sigmoid(parameters.logits[row].to_double()), copies[row]);
        parameters.logits[row] = T::from_f64(libm::log(opacity / (1.0 - opacity)));
        let growth = T::from_f64(libm::log(growth));
        parameters.log_scales[row] = parameters.log_scales[row].map(|scale| scale + growth);
        bounds.project(parameters.row_mut(row));
        moments.clear(row);
    }
    *parameters = parameters.select(&sources);
    for row in (0..parameters.len()).filter(|row| dead[*row]) {
        if let Some(tau) = parameters.tau.get(row) {
            let jittered = tau.to_double() + TAU_JITTER * (2.0 * random.f64() - 1.0);
            parameters.center_window(row, T::from_f64(jittered.clamp(bounds.tau[0], bounds.tau[1])));
        }
        moments.clear(row);
    }
    dead.iter().filter(|dead| **dead).count()
}

/// Opacity for a logit.
pub(super) fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-logit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::parameters::Timeline;

    /// Integral of the alpha of `n` coincident Gaussians of opacity `o` and standard deviation `s` along a
    /// line through their centre, by the trapezoidal rule.
    fn coverage(o: f64, s: f64, n: usize) -> f64 {
        let step = 1e-3;
        let alpha = |x: f64| 1.0 - (1.0 - o * (-0.5 * (x / s).powi(2)).exp()).powi(n as i32);
        (-12_000..=12_000).map(|i| alpha(f64::from(i) * step) * step).sum()
    }

    #[test]
    fn copies_have_the_coverage_of_the_original() {
        for (opacity, n) in [(0.5, 2), (0.005, 2), (0.9, 3), (0.99, 10), (0.999, 51), (0.3, 400)] {
            let (each, growth) = split_opacity(opacity, n);
            assert!((1.0 - (1.0 - each).powi(n as i32) - opacity).abs() < 1e-12);
            let (found, expected) = (coverage(each, growth, n), coverage(opacity, 1.0, 1));
            assert!((found / expected - 1.0).abs() < 1e-7, "{opacity} {n}: {found} {expected}");
        }
        let (each, growth) = split_opacity(0.7, 1);
        assert!((each - 0.7).abs() < 1e-15 && (growth - 1.0).abs() < 1e-15);
    }

    fn parameters(logits: Vec<f64>) -> Parameters<f64> {
        let rows = logits.len();
        let number = |i: usize| (1.7 * i as f64).sin();
        Parameters {
            centers: (0..rows).map(|i| [i as f64, number(i), 0.0]).collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows],
            log_scales: vec![[-4.0, -3.5, -5.0]; rows],
            logits,
            sh: (0..rows).map(|i| [i as f64; 3]).collect(),
            tau: (0..rows).map(|i| 0.8 * i as f64).collect(),
            log_widths: vec![0.5; rows],
            motion_order: 3,
            motion: (0..3 * rows).map(|i| [number(i), number(i + 7), 0.1]).collect(),
            rotation_rates: vec![[0.0, 0.1, -0.2, 0.05]; rows],
            ..Parameters::default()
        }
    }

    fn bounds() -> Bounds {
        Bounds::new(10.0, Timeline::even(9))
    }

    fn run(parameters: &mut Parameters<f64>, dead: &[bool], seed: u64) -> (usize, Moments<f64>) {
        let mut moments = Moments::new(parameters);
        moments.visits.fill(5);
        let mut random = fastrand::Rng::with_seed(seed);
        (relocate(parameters, &mut moments, dead, &bounds(), &mut random), moments)
    }

    #[test]
    fn dead_rows_join_live_ones_on_their_trajectories() {
        let before = parameters(vec![-7.0, 0.4, -7.0, -6.0, 2.0]);
        let dead = [true, false, true, true, false];
        let mut after = before.clone();
        let (moved, moments) = run(&mut after, &dead, 3);
        assert_eq!((moved, after.len()), (3, 5));
        let timeline = Timeline::even(9);
        let (old, new) = (before.to_field(timeline), after.to_field(timeline));
        for row in 0..5 {
            let source = before.sh.iter().position(|sh| *sh == after.sh[row]).unwrap();
            assert!(!dead[source] && (dead[row] || source == row));
            let n = after.sh.iter().filter(|sh| **sh == after.sh[row]).count();
            let (opacity, growth) = split_opacity(sigmoid(before.logits[source]), n);
            assert!((sigmoid(after.logits[row]) - opacity).abs() < 1e-12);
            let scale = before.log_scales[source][1] + growth.ln();
            assert!((after.log_scales[row][1] - scale).abs() < 1e-12);
            assert!((after.tau[row] - before.tau[source]).abs() <= 0.5);
            assert_eq!(after.tau[row] != before.tau[source], dead[row]);
            for t in [0.0, 0.3, 1.0] {
                let (a, b) = (old.position_at(source, t), new.position_at(row, t));
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3), "{a:?} {b:?}");
                let (a, b) = (old.rotation_at(source, t), new.rotation_at(row, t));
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
            }
            assert_eq!(moments.visits[row], if n > 1 { 0 } else { 5 });
        }
        let mut again = before.clone();
        run(&mut again, &dead, 3);
        assert_eq!(again, after);
        run(&mut again, &dead, 4);
        assert_ne!(again, after);
    }

    /// Opacities 0.5 and 0.25: the first is drawn twice as often.
    #[test]
    fn the_probability_is_proportional_to_the_opacity() {
        let mut logits = vec![0.0, (1.0_f64 / 3.0).ln()];
        logits.resize(3002, -7.0);
        let mut after = parameters(logits);
        let dead: Vec<bool> = (0..3002).map(|row| row > 1).collect();
        run(&mut after, &dead, 1);
        let first = after.sh.iter().filter(|sh| sh[0] == 0.0).count();
        assert!((1900..2100).contains(&first), "{first}");
    }

    #[test]
    fn without_live_or_without_dead_rows_nothing_moves() {
        for dead in [[true; 3], [false; 3]] {
            let mut after = parameters(vec![0.0, 1.0, 2.0]);
            assert_eq!(run(&mut after, &dead, 1).0, 0);
            assert_eq!(after, parameters(vec![0.0, 1.0, 2.0]));
        }
        assert_eq!(run(&mut parameters(Vec::new()), &[], 1).0, 0);
    }

    #[test]
    fn non_finite_rows_are_replaced() {
        let mut after = parameters(vec![f64::NAN, 1.0]);
        after.centers[0] = [f64::INFINITY; 3];
        run(&mut after, &[true, false], 1);
        assert!(after.to_field(Timeline::even(9)).check().is_ok());
    }
}
