//! Tests of the control of density.

use super::*;
use crate::fit::{Clock, Rates, adam};

const CONTROL: DensityControl =
    DensityControl { rule: DensityRule::Floor, interval: 100, floor: 0, cap: 1000 };

/// At a step at which there is something to do.
const NOW: [usize; 2] = [1000, 10_000];

fn bounds() -> Bounds {
    Bounds::new(10.0, Clock { frames: 9 })
}

/// Gaussians on a circle, where none floats, told apart by their colours.
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

fn names(parameters: &Parameters<f64>) -> Vec<usize> {
    parameters.sh.iter().map(|sh| sh[0] as usize).collect()
}

fn run(control: DensityControl, state: &mut DensityState, parameters: &mut Parameters<f64>) -> DensityChange {
    let mut moments = Moments::new(parameters);
    moments.visits.fill(3);
    assert!(control.is_due(state, parameters.len(), NOW));
    let change = control.control(state, parameters, &mut moments, &bounds());
    assert_eq!(moments.visits.len(), parameters.len());
    assert_eq!(*state, DensityState { seed: state.seed, ..DensityState::new(parameters.len(), 0) });
    change
}

fn pruned(opacities: &[f64], floor: usize) -> (Vec<usize>, DensityChange) {
    let mut all = parameters(opacities);
    let change =
        run(DensityControl { floor, ..CONTROL }, &mut DensityState::new(opacities.len(), 0), &mut all);
    (names(&all), change)
}

#[test]
fn the_floor_keeps_the_most_opaque() {
    let opacities = [0.001, 0.6, 0.003, 0.0049, 0.9, 0.002, 0.0051];
    let (left, change) = pruned(&opacities, 0);
    assert_eq!((left, change.pruned, change.kept), (vec![1, 4, 6], 4, 0));
    assert_eq!(pruned(&opacities, 3).0, [1, 4, 6]);
    let (left, change) = pruned(&opacities, 5);
    assert_eq!((left, change.pruned, change.kept), (vec![1, 2, 3, 4, 6], 2, 2));
    // Fewer than the floor: none may go.
    for floor in [7, 8, 1_000_000] {
        assert_eq!(pruned(&opacities, floor).0, [0, 1, 2, 3, 4, 5, 6]);
    }
}

#[test]
fn of_equals_the_first_stay() {
    assert_eq!(pruned(&[0.001; 9], 4).0, [0, 1, 2, 3]);
    assert_eq!(pruned(&[0.001; 9], 0).0, [0; 0]);
    assert_eq!((pruned(&[], 5).0, pruned(&[0.001], 5).0, pruned(&[0.001], 0).0), (vec![], vec![0], vec![]));
}

#[test]
fn floaters_go_first_and_what_is_broken_always() {
    let mut all = parameters(&[0.5, 0.5, 0.001, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.99, 0.5]);
    all.centers[9] = [500.0, 0.0, 0.0];
    all.motion[1][2] = f64::NAN;
    let mut state = DensityState::new(11, 0);
    let mut with_floor = all.clone();
    let change = run(CONTROL, &mut state, &mut all);
    assert_eq!(names(&all), [0, 3, 4, 5, 6, 7, 8, 10]);
    assert_eq!((change.pruned, change.floaters, change.kept), (3, 1, 0));
    // The transparent one comes back before the floater, and the broken one never.
    let control = DensityControl { floor: 9, ..CONTROL };
    let mut with_larger = with_floor.clone();
    run(control, &mut DensityState::new(11, 0), &mut with_floor);
    assert_eq!(names(&with_floor), [0, 2, 3, 4, 5, 6, 7, 8, 10]);
    run(DensityControl { floor: 99, ..CONTROL }, &mut DensityState::new(11, 0), &mut with_larger);
    assert_eq!(names(&with_larger), [0, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
}

/// State in which each row was seen twice, `rows` with a mean pull of 3e-4 and the others of 1e-4.
fn pulling(count: usize, rows: &[u32]) -> DensityState {
    let mut state = DensityState::new(count, 7);
    let all: Vec<u32> = (0..count as u32).collect();
    let pull = |row: &u32| if rows.contains(row) { 3e-4 } else { 1e-4 };
    let pulls: Vec<f64> = all.iter().map(pull).collect();
    state.pulls.note(&all, &pulls);
    state.pulls.note(&all, &pulls);
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
    let mut state = pulling(4, &[1, 2]);
    let change = CONTROL.control(&mut state, &mut all, &mut moments, &bounds());
    assert_eq!((change.cloned, change.split, change.pruned), (1, 1, 0));
    assert_eq!(names(&all), [0, 1, 3, 1, 2, 2]);
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

/// Mean and covariance of many halves are those of the Gaussian.
#[test]
fn halves_are_drawn_from_the_whole() {
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
fn pulls_are_averaged_over_the_pictures_that_show_a_gaussian() {
    let mut pulls = Pulls::none(3);
    pulls.note(&[0], &[2.5e-4_f32]);
    pulls.note(&[1], &[f32::NAN]);
    for _ in 0..50 {
        pulls.note(&[1], &[5e-6_f32]);
    }
    assert!((pulls.mean(0) - 2.5e-4).abs() < 1e-9);
    assert!(pulls.mean(1) < 1e-5 && pulls.mean(2) == 0.0);
}

#[test]
fn the_cap_admits_those_that_are_pulled_at_most() {
    let mut all = parameters(&[0.5; 6]);
    let mut state = pulling(6, &[1, 2, 4, 5]);
    state.pulls.sums[4] *= 2.0;
    let control = DensityControl { cap: 8, ..CONTROL };
    assert_eq!(run(control, &mut state, &mut all).cloned, 2);
    assert_eq!(names(&all), [0, 1, 2, 3, 4, 5, 1, 4]);
    let mut state = pulling(8, &[0, 1]);
    assert_eq!(run(control, &mut state, &mut all).cloned, 0);
}

#[test]
fn control_comes_at_intervals_while_a_fit_densifies() {
    let due = |step: usize, settled: Option<bool>| {
        let mut state = DensityState { early: Some(8), settled, ..DensityState::new(8, 0) };
        CONTROL.is_due(&mut state, 8, [step, 10_000])
    };
    let at = [400, 500, 550, 3400, 3500, 6900, 7000, 9900];
    assert_eq!(at.map(|step| due(step, None)), [false, true, false, true, true, true, false, false]);
    assert_eq!(at.map(|step| due(step, Some(false))), [false, true, false, true, false, false, false, false]);
}

#[test]
fn growth_from_a_quarter_of_the_steps_on_is_no_settling() {
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
fn relocation_keeps_the_number() {
    let mut all = parameters(&[0.001, 0.6, 0.9, 0.7, 0.6, 0.5, 0.4, 0.002, 0.6, 0.99]);
    all.centers[9] = [900.0, 0.0, 0.0];
    let mut state = pulling(10, &[1, 2, 3]);
    let control = DensityControl { rule: DensityRule::Relocate, floor: 0, cap: 0, ..CONTROL };
    let change = run(control, &mut state, &mut all);
    assert_eq!(change, DensityChange { relocated: 3, floaters: 1, ..DensityChange::default() });
    assert_eq!(names(&all)[1..7], [1, 2, 3, 4, 5, 6]);
    assert!([0, 7, 9].iter().all(|row| (1..9).contains(&names(&all)[*row])));
}

/// A fit in miniature, stopped and resumed from what it has saved.
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
            adam(all, moments, &rows, &gradient, &Rates::new(10.0), &bounds());
            let pulls: Vec<f32> = rows.iter().map(|row| 5e-4 * (*row % 5) as f32).collect();
            state.pulls.note(&rows, &pulls);
            let control = DensityControl { interval: 10, floor: 20, cap: 100, ..CONTROL };
            if control.is_due(state, all.len(), [step + 1, 200]) {
                control.control(state, all, moments, &bounds());
            }
        }
    };
    let start = || {
        let mut all = parameters(&[0.05; 30]);
        all.log_scales[4] = [-1.5; 3];
        let single = Parameters::<f32>::from_field(&all.to_field(Clock { frames: 9 }), Clock { frames: 9 });
        let moments = Moments::new(&single);
        (DensityState::new(30, 42), single, moments)
    };
    let (mut whole, mut first) = (start(), start());
    proceed(&mut whole, 0..200);
    proceed(&mut first, 0..77);
    let mut second = first.clone();
    proceed(&mut second, 77..200);
    assert!(whole.1.len() > 40, "{}", whole.1.len());
    assert_eq!(whole, second);
}

#[test]
fn a_fixed_number_stays_as_it_is() {
    let control = DensityControl { rule: DensityRule::Fixed, floor: 9, ..CONTROL };
    let mut state = DensityState::new(3, 0);
    for step in 1..=1000 {
        assert!(!control.is_due(&mut state, 3, [step, 1000]), "step {step}");
    }
}
