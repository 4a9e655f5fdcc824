//! Tests of capacity control.

use super::densify::halve;
use super::relocate::sigmoid;
use super::*;
use crate::fit::optimizer::{LearningRates, Moments, adam};
use crate::fit::parameters::{Bounds, Parameters, Timeline};

const CONTROL: DensityControl =
    DensityControl { rule: DensityRule::Floor, interval: 100, floor: 0, cap: 1000, ends_early: false };

/// A step at which a control is due, and the number of steps.
const DUE: [usize; 2] = [1000, 10_000];

fn bounds() -> Bounds {
    Bounds::new(10.0, Timeline::even(9))
}

/// Gaussians on a circle, where none floats; their colours number them.
fn parameters(opacities: &[f64]) -> Parameters<f64> {
    let rows = opacities.len();
    let place = |i: usize| [(i as f64).cos(), (i as f64).sin(), 0.0];
    Parameters {
        centers: (0..rows).map(place).collect(),
        rotations: vec![[0.9, 0.1, -0.5, 0.2]; rows],
        log_scales: vec![[-4.0, -3.5, -5.0]; rows],
        logits: opacities.iter().map(|o| (o / (1.0 - o)).ln()).collect(),
        sh: (0..rows).map(|i| [i as f64; 3]).collect(),
        tau: vec![4.25; rows],
        log_widths: vec![0.5; rows],
        motion_order: 1,
        motion: vec![[0.1, 0.2, 0.3]; rows],
        ..Parameters::default()
    }
}

fn numbers(parameters: &Parameters<f64>) -> Vec<usize> {
    parameters.sh.iter().map(|sh| sh[0] as usize).collect()
}

fn run(control: DensityControl, state: &mut DensityState, parameters: &mut Parameters<f64>) -> DensityChange {
    let mut moments = Moments::new(parameters);
    moments.visits.fill(3);
    assert!(control.is_due(state, parameters.len(), DUE));
    let change = control.control(state, DUE[0], parameters, &mut moments, &bounds());
    assert_eq!(moments.visits.len(), parameters.len());
    assert_eq!(*state, DensityState { seed: state.seed, ..DensityState::new(parameters.len(), 0) });
    change
}

fn pruned(opacities: &[f64], floor: usize) -> (Vec<usize>, DensityChange) {
    let mut all = parameters(opacities);
    let change =
        run(DensityControl { floor, ..CONTROL }, &mut DensityState::new(opacities.len(), 0), &mut all);
    (numbers(&all), change)
}

#[test]
fn the_floor_retains_the_most_opaque() {
    let opacities = [0.001, 0.6, 0.003, 0.0049, 0.9, 0.002, 0.0051];
    let (left, change) = pruned(&opacities, 0);
    assert_eq!((left, change.pruned, change.retained), (vec![1, 4, 6], 4, 0));
    assert_eq!(pruned(&opacities, 3).0, [1, 4, 6]);
    let (left, change) = pruned(&opacities, 5);
    assert_eq!((left, change.pruned, change.retained), (vec![1, 2, 3, 4, 6], 2, 2));
    // Fewer than the floor: none is pruned.
    for floor in [7, 8, 1_000_000] {
        assert_eq!(pruned(&opacities, floor).0, [0, 1, 2, 3, 4, 5, 6]);
    }
}

#[test]
fn the_floor_counts_what_is_in_front_of_the_plate() {
    let plate = [0.9, 0.8, 0.7, 0.002];
    let mut all = parameters(&[[0.003, 0.001, 0.6, 0.002].as_slice(), &plate].concat());
    all.behind = [[false; 4], [true; 4]].concat();
    let control = DensityControl { floor: 3, ..CONTROL };
    let change = run(control, &mut DensityState::new(8, 0), &mut all);
    assert_eq!((numbers(&all), change.retained), (vec![0, 2, 3, 4, 5, 6], 2));
}

#[test]
fn among_equals_the_first_stay() {
    assert_eq!(pruned(&[0.001; 9], 4).0, [0, 1, 2, 3]);
    assert_eq!(pruned(&[0.001; 9], 0).0, [0; 0]);
    assert_eq!((pruned(&[], 5).0, pruned(&[0.001], 5).0, pruned(&[0.001], 0).0), (vec![], vec![0], vec![]));
}

#[test]
fn floaters_go_first_and_non_finite_rows_always() {
    let mut all = parameters(&[0.5, 0.5, 0.001, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.99, 0.5]);
    all.centers[9] = [500.0, 0.0, 0.0];
    all.motion[1][2] = f64::NAN;
    let mut state = DensityState::new(11, 0);
    let mut with_floor = all.clone();
    let change = run(CONTROL, &mut state, &mut all);
    assert_eq!(numbers(&all), [0, 3, 4, 5, 6, 7, 8, 10]);
    assert_eq!((change.pruned, change.floaters, change.retained), (3, 1, 0));
    // The floor restores the transparent one before the floater, and never the non-finite one.
    let control = DensityControl { floor: 9, ..CONTROL };
    let mut with_larger = with_floor.clone();
    run(control, &mut DensityState::new(11, 0), &mut with_floor);
    assert_eq!(numbers(&with_floor), [0, 2, 3, 4, 5, 6, 7, 8, 10]);
    run(DensityControl { floor: 99, ..CONTROL }, &mut DensityState::new(11, 0), &mut with_larger);
    assert_eq!(numbers(&with_larger), [0, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
}

/// A state in which two images showed each row, with a mean gradient of 3e-4 for `rows` and 1e-4 for
/// the others.
fn with_gradients(count: usize, rows: &[u32]) -> DensityState {
    let mut state = DensityState::new(count, 7);
    let all: Vec<u32> = (0..count as u32).collect();
    let gradient = |row: &u32| if rows.contains(row) { 3e-4 } else { 1e-4 };
    let gradients: Vec<f64> = all.iter().map(gradient).collect();
    state.screen_gradients.accumulate(&all, &gradients);
    state.screen_gradients.accumulate(&all, &gradients);
    state
}

#[test]
fn small_ones_are_cloned_and_large_ones_split() {
    let mut all = parameters(&[0.5, 0.6, 0.7, 0.8]);
    // A hundredth of the extent is 0.1.
    all.log_scales[2] = [-4.0, 0.11_f64.ln(), -5.0];
    let before = all.clone();
    let mut moments = Moments::new(&all);
    moments.visits = vec![11, 12, 13, 14];
    moments.first.logits = vec![0.1, 0.2, 0.3, 0.4];
    let mut state = with_gradients(4, &[1, 2]);
    let change = CONTROL.control(&mut state, DUE[0], &mut all, &mut moments, &bounds());
    assert_eq!((change.cloned, change.split, change.pruned), (1, 1, 0));
    assert_eq!(numbers(&all), [0, 1, 3, 1, 2, 2]);
    assert_eq!(all.select(&[0, 1, 2, 3]), before.select(&[0, 1, 3, 1]));
    assert_eq!(
        (moments.visits, moments.first.logits),
        (vec![11, 12, 14, 0, 0, 0], vec![0.1, 0.2, 0.4, 0.0, 0.0, 0.0])
    );
    let halves = all.select(&[4, 5]);
    assert_ne!(halves.centers[0], halves.centers[1]);
    let whole = before.select(&[2, 2]);
    for (half, whole) in halves.log_scales.as_flattened().iter().zip(whole.log_scales.as_flattened()) {
        assert!((whole - half - 1.6_f64.ln()).abs() < 1e-12);
    }
    let (centers, log_scales) = (whole.centers.clone(), whole.log_scales.clone());
    assert_eq!(Parameters { centers, log_scales, ..halves }, whole, "the rest stays");
}

/// The centres of many halves have the mean and covariance of the Gaussian.
#[test]
fn halves_are_sampled_from_the_original() {
    let whole = parameters(&[0.5]);
    let mut random = fastrand::Rng::with_seed(5);
    let count = 20_000;
    let offsets: Vec<glam::DVec3> = (0..count)
        .map(|_| {
            let mut half = whole.clone();
            halve(&mut half, 0, &mut random);
            glam::DVec3::from_array(half.centers[0]) - glam::DVec3::from_array(whole.centers[0])
        })
        .collect();
    let [w, x, y, z] = whole.rotations[0];
    let rotation = glam::DMat3::from_quat(glam::DQuat::from_xyzw(x, y, z, w).normalize());
    for axis in 0..3 {
        let along: Vec<f64> = offsets.iter().map(|offset| offset.dot(rotation.col(axis))).collect();
        let scale = whole.log_scales[0][axis].exp();
        let mean = along.iter().sum::<f64>() / f64::from(count);
        let deviation = (along.iter().map(|x| x * x).sum::<f64>() / f64::from(count)).sqrt();
        assert!(
            mean.abs() < 0.03 * scale && (deviation / scale - 1.0).abs() < 0.02,
            "{mean} {deviation} {scale}"
        );
    }
}

#[test]
fn gradients_are_averaged_over_the_images_that_show_a_gaussian() {
    let mut gradients = ScreenGradients::zeros(3);
    gradients.accumulate(&[0], &[2.5e-4_f32]);
    gradients.accumulate(&[1], &[f32::NAN]);
    for _ in 0..50 {
        gradients.accumulate(&[1], &[5e-6_f32]);
    }
    assert!((gradients.mean(0) - 2.5e-4).abs() < 1e-9);
    assert!(gradients.mean(1) < 1e-5 && gradients.mean(2) == 0.0);
}

#[test]
fn the_cap_admits_the_highest_gradients() {
    let mut all = parameters(&[0.5; 6]);
    let mut state = with_gradients(6, &[1, 2, 4, 5]);
    state.screen_gradients.sums[4] *= 2.0;
    let control = DensityControl { cap: 8, ..CONTROL };
    assert_eq!(run(control, &mut state, &mut all).cloned, 2);
    assert_eq!(numbers(&all), [0, 1, 2, 3, 4, 5, 1, 4]);
    let mut state = with_gradients(8, &[0, 1]);
    assert_eq!(run(control, &mut state, &mut all).cloned, 0);
}

#[test]
fn controls_come_at_intervals_until_densification_ends() {
    let due = |control: DensityControl, settled: Option<bool>| {
        [400, 500, 550, 3400, 3500, 6900, 7000, 9900].map(|step| {
            let mut state = DensityState { early: Some(8), settled, ..DensityState::new(8, 0) };
            control.is_due(&mut state, 8, [step, 10_000])
        })
    };
    let short = [false, true, false, true, false, false, false, false];
    assert_eq!(due(CONTROL, None), [false, true, false, true, true, true, false, false]);
    assert_eq!(due(CONTROL, Some(false)), short);
    assert_eq!(due(DensityControl { ends_early: true, ..CONTROL }, None), short);
}

#[test]
fn densification_ends_once_and_only_by_the_rule_that_thins() {
    let ends = |rule: DensityRule, settled: Option<bool>, steps: usize| -> Vec<usize> {
        let control = DensityControl { rule, ..CONTROL };
        let state = DensityState { settled, ..DensityState::new(8, 0) };
        (1..=steps).filter(|step| control.is_ending(&state, [*step, steps])).collect()
    };
    assert_eq!(ends(DensityRule::Floor, None, 1000), [700]);
    assert_eq!(ends(DensityRule::Floor, Some(false), 1001), [351]);
    let control = DensityControl { ends_early: true, ..CONTROL };
    assert!(control.is_ending(&DensityState::new(8, 0), [350, 1000]));
    assert!(ends(DensityRule::Floor, Some(true), 3).is_empty(), "no step is left after it");
    for rule in [DensityRule::Paper, DensityRule::Relocate, DensityRule::Fixed] {
        assert!(ends(rule, None, 1000).is_empty(), "{rule:?}");
    }
}

#[test]
fn a_count_that_grows_from_a_quarter_of_the_steps_has_not_settled() {
    let settled = |early: usize, late: usize| {
        let mut state = DensityState::new(0, 0);
        for (step, count) in [(2499, 1), (2500, early), (2600, early + 1), (3500, late), (3600, 9)] {
            CONTROL.is_due(&mut state, count, [step, 10_000]);
        }
        state.settled
    };
    assert_eq!((settled(50, 55), settled(50, 56), settled(50, 40)), (Some(true), Some(false), Some(true)));
}

#[test]
fn relocation_preserves_the_count() {
    let mut all = parameters(&[0.001, 0.6, 0.9, 0.7, 0.6, 0.5, 0.4, 0.002, 0.6, 0.99]);
    all.centers[9] = [900.0, 0.0, 0.0];
    let mut state = with_gradients(10, &[1, 2, 3]);
    let control = DensityControl { rule: DensityRule::Relocate, floor: 0, cap: 0, ..CONTROL };
    let change = run(control, &mut state, &mut all);
    assert_eq!(change, DensityChange { relocated: 3, floaters: 1, ..DensityChange::default() });
    assert_eq!(numbers(&all)[1..7], [1, 2, 3, 4, 5, 6]);
    assert!([0, 7, 9].iter().all(|row| (1..9).contains(&numbers(&all)[*row])));
}

/// The rule of the paper resets opacities, and only at its steps.
#[test]
fn the_rule_of_the_paper_resets_opacities() {
    let control = DensityControl { rule: DensityRule::Paper, ..CONTROL };
    let opacities = [0.6, 0.9, 0.007, 0.99];
    let resets = |control: DensityControl, step: usize| {
        let mut all = parameters(&opacities);
        let mut moments = Moments::new(&all);
        moments.first.logits.fill(0.5);
        moments.first.tau.fill(0.5);
        let mut state = DensityState::new(4, 0);
        control.control(&mut state, step, &mut all, &mut moments, &bounds());
        let expected = all.logits.iter().map(|logit| sigmoid(*logit)).zip(opacities);
        let is_reset = expected.clone().all(|(found, before)| (found - before.min(0.01)).abs() < 1e-9);
        let is_same = expected.clone().all(|(found, before)| (found - before).abs() < 1e-9);
        assert!(is_reset || is_same);
        assert_eq!(moments.first.logits, vec![if is_reset { 0.0 } else { 0.5 }; 4]);
        assert_eq!(moments.first.tau, [0.5; 4]);
        is_reset
    };
    assert_eq!([2900, 3000, 3100, 6000].map(|step| resets(control, step)), [false, true, false, true]);
    assert!(!resets(CONTROL, 3000), "the rule with a floor");
}

/// A fit in miniature, interrupted and resumed.
#[test]
fn a_resumed_fit_is_the_same() {
    type Fit = (DensityState, Parameters<f32>, Moments<f32>);
    let proceed = |fit: &mut Fit, steps: std::ops::Range<usize>| {
        let (state, all, moments) = fit;
        for step in steps {
            let rows: Vec<u32> =
                (0..all.len() as u32).filter(|row| !(*row as usize + step).is_multiple_of(3)).collect();
            let mut gradient = all.zeros(rows.len());
            for (i, row) in rows.iter().enumerate() {
                gradient.centers[i] = [1e-6 * ((*row as usize * 7 + step) as f32).sin(); 3];
                gradient.logits[i] = 1e-3 * (*row as f32).cos();
            }
            let rates = LearningRates::new(10.0, Timeline::even(9), all);
            adam(all, moments, &rows, &gradient, &rates, &bounds());
            let gradients: Vec<f32> = rows.iter().map(|row| 5e-4 * (*row % 5) as f32).collect();
            state.screen_gradients.accumulate(&rows, &gradients);
            let control = DensityControl { interval: 10, floor: 20, cap: 100, ..CONTROL };
            if control.is_due(state, all.len(), [step + 1, 200]) {
                control.control(state, step + 1, all, moments, &bounds());
            }
        }
    };
    let start = || {
        let mut all = parameters(&[0.05; 30]);
        all.log_scales[4] = [-1.5; 3];
        let single = Parameters::<f32>::from_field(&all.to_field(Timeline::even(9)), Timeline::even(9));
        let moments = Moments::new(&single);
        (DensityState::new(30, 42), single, moments)
    };
    let (mut uninterrupted, mut first) = (start(), start());
    proceed(&mut uninterrupted, 0..200);
    proceed(&mut first, 0..77);
    let mut second = first.clone();
    proceed(&mut second, 77..200);
    assert!(uninterrupted.1.len() > 40, "{}", uninterrupted.1.len());
    assert_eq!(uninterrupted, second);
}

#[test]
fn the_fixed_rule_never_controls() {
    let control = DensityControl { rule: DensityRule::Fixed, floor: 9, ..CONTROL };
    let mut state = DensityState::new(3, 0);
    for step in 1..=1000 {
        assert!(!control.is_due(&mut state, 3, [step, 1000]), "step {step}");
    }
}

#[test]
fn static_rows_grow_into_static_rows() {
    use crate::fit::parameters::Carried;
    let mut all = parameters(&[0.9, 0.9, 0.001]);
    all.behind = vec![false, true, true];
    let mut moments = Moments::new(&all);
    moments.carried = vec![Carried::NONE, Carried::STATIC, Carried::STATIC];
    let mut state = DensityState::new(3, 0);
    state.screen_gradients.sums = vec![1.0, 1.0, 0.0];
    state.screen_gradients.images = vec![1; 3];
    assert!(CONTROL.is_due(&mut state, 3, DUE));
    let change = CONTROL.control(&mut state, DUE[0], &mut all, &mut moments, &bounds());
    // The transparent one goes, and the others are two each.
    assert_eq!((change.pruned, all.len()), (1, 4));
    for row in 0..4 {
        let is_of_second = numbers(&all)[row] == 1;
        assert_eq!((all.is_behind(row), moments.is_static(row)), (is_of_second, is_of_second), "row {row}");
    }
}
