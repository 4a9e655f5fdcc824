//! [`DensityControl`]: where Gaussians are added, and which ones go.
//!
//! While a fit densifies, Gaussians that the picture pulls at are doubled: small ones are cloned,
//! large ones split. Transparent ones and floaters are pruned, but never below the capacity floor
//! (the paper's Eq. 8), without which windows of time and a black background strip the scene bare:
//! opacity is judged at its peak and never reset, pulls are averaged over the pictures in whose time
//! a Gaussian lives.

use serde::{Deserialize, Serialize};

use super::columns::is_finite;
use super::floaters::floaters;
use super::relocate::{relocate, sigmoid};
use super::{Bounds, Moments, Parameters, Real};

/// Mean pull, in halves of the picture per unit of loss, from which a Gaussian is doubled; this and
/// what follows is gsplat's.
const PULL_MIN: f64 = 2e-4;

/// Largest standard deviation of a Gaussian that is cloned and not split, as part of the extent.
const CLONE_SCALE: f64 = 0.01;

/// By what the scales of a Gaussian are divided when it is split.
const SPLIT_SHRINK: f64 = 1.6;

/// Peak opacity below which a Gaussian is pruned.
const OPACITY_MIN: f64 = 0.005;

/// Intervals before the first control, or a tenth of the steps, whichever is less.
const WARM_UP: usize = 5;

/// Percent of the steps up to which a fit densifies, and up to which it does where the number of
/// Gaussians does not settle: where it grows by more than `GROWTH` percent from `EARLY` to `SHORT`
/// percent of the steps. The percentages of the steps are the paper's, but not what settling is.
const LONG: usize = 70;
const SHORT: usize = 35;
const EARLY: usize = 25;
const GROWTH: usize = 10;

/// What becomes of Gaussians that have become transparent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DensityRule {
    /// They are pruned down to the capacity floor, and others are cloned and split: the paper's.
    #[default]
    Floor,
    /// They move to where others live; the number of Gaussians never changes.
    Relocate,
    /// They stay, as all do: rows keep their number and their order.
    Fixed,
}

/// How the number of Gaussians is controlled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct DensityControl {
    /// Which rule.
    pub(super) rule: DensityRule,
    /// Steps from one control to the next; 100 in 3D Gaussian Splatting.
    pub(super) interval: usize,
    /// The capacity floor `N_min`: the number of Gaussians that pruning leaves at least.
    pub(super) floor: usize,
    /// The number of Gaussians that doubling makes at most.
    pub(super) cap: usize,
}

/// How the pictures since the last control pull at each Gaussian.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Pulls {
    /// Sums of the pulls at the rows.
    pub(super) sums: Vec<f32>,
    /// Number of pictures that showed each row.
    pub(super) pictures: Vec<u32>,
}

/// What the control remembers from step to step: with it, a fit that was interrupted goes on as if
/// it had not been.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct DensityState {
    /// Pulls since the last control.
    pub(super) pulls: Pulls,
    /// State of the random numbers.
    pub(super) seed: u64,
    /// Number of Gaussians after a quarter of the steps.
    pub(super) early: Option<usize>,
    /// Whether that number settled.
    pub(super) settled: Option<bool>,
}

/// What a control did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensityChange {
    /// Gaussians that were cloned.
    pub cloned: usize,
    /// Gaussians that were split in two.
    pub split: usize,
    /// Gaussians that were pruned: as transparent, floating or broken.
    pub pruned: usize,
    /// Those among all before pruning that float.
    pub floaters: usize,
    /// Gaussians that were to be pruned, but for the floor.
    pub kept: usize,
    /// Gaussians that moved to where others live.
    pub relocated: usize,
}

impl Pulls {
    /// Those of Gaussians that no picture has shown.
    pub(super) fn none(gaussians: usize) -> Pulls {
        Pulls { sums: vec![0.0; gaussians], pictures: vec![0; gaussians] }
    }

    /// Notes a picture: the rows that it shows, and the lengths of the derivatives of the loss by their
    /// places in it, see [`Gradient::screen`](super::Gradient::screen).
    ///
    /// # Panics
    /// If there are not as many lengths as rows.
    pub(super) fn note<T: Real>(&mut self, rows: &[u32], screen: &[T]) {
        assert_eq!(rows.len(), screen.len(), "a derivative for each row");
        for (row, pull) in rows.iter().zip(screen) {
            self.sums[*row as usize] += if pull.is_finite() { pull.to_double() as f32 } else { 0.0 };
            self.pictures[*row as usize] += 1;
        }
    }

    fn mean(&self, row: usize) -> f64 {
        f64::from(self.sums[row]) / f64::from(self.pictures[row].max(1))
    }
}

impl DensityState {
    /// The state at the start of a fit of so many Gaussians. Equal seeds make equal fits.
    pub(super) fn new(gaussians: usize, seed: u64) -> DensityState {
        DensityState { pulls: Pulls::none(gaussians), seed, early: None, settled: None }
    }
}

impl DensityControl {
    /// Whether it is time to add and take Gaussians: there are `count` of them, and `step` of `steps`
    /// are done. To be asked after every step.
    pub(super) fn is_due(&self, state: &mut DensityState, count: usize, [step, steps]: [usize; 2]) -> bool {
        let reached = |percent: usize| step * 100 >= steps * percent;
        if reached(EARLY) {
            state.early.get_or_insert(count);
        }
        if let (true, Some(early)) = (reached(SHORT), state.early) {
            state.settled.get_or_insert(count * 100 <= early * (100 + GROWTH));
        }
        let is_over = reached(if state.settled == Some(false) { SHORT } else { LONG });
        let interval = self.interval.max(1);
        self.rule != DensityRule::Fixed
            && !is_over
            && step >= (WARM_UP * interval).min(steps / 10)
            && step.is_multiple_of(interval)
    }

    /// Adds and takes Gaussians.
    ///
    /// # Panics
    /// If the state or the moments are of another number of Gaussians.
    pub(super) fn control<T: Real>(
        &self,
        state: &mut DensityState,
        parameters: &mut Parameters<T>,
        moments: &mut Moments<T>,
        bounds: &Bounds,
    ) -> DensityChange {
        let count = parameters.len();
        assert!(
            state.pulls.pictures.len() == count && moments.visits.len() == count,
            "a state of {count} Gaussians"
        );
        let mut random = fastrand::Rng::with_seed(state.seed);
        let mut change = DensityChange::default();
        match self.rule {
            DensityRule::Floor => {
                (change.cloned, change.split) = self.densify(state, parameters, moments, bounds, &mut random);
                self.prune(parameters, moments, bounds, &mut change);
            }
            DensityRule::Relocate => {
                let floating = floaters(parameters, bounds);
                change.floaters = floating.iter().filter(|floats| **floats).count();
                let dead: Vec<bool> =
                    (0..count).map(|row| floating[row] || !lives(parameters, row)).collect();
                change.relocated = relocate(parameters, moments, &dead, bounds, &mut random);
            }
            DensityRule::Fixed => {}
        }
        state.seed = random.get_seed();
        state.pulls = Pulls::none(parameters.len());
        change
    }

    /// Doubles the Gaussians that are pulled at most, as far as the cap allows. Originals stay in
    /// their order, then come clones, then halves of those that were split. New rows have no moments.
    /// Returns how many were cloned and split.
    fn densify<T: Real>(
        &self,
        state: &DensityState,
        parameters: &mut Parameters<T>,
        moments: &mut Moments<T>,
        bounds: &Bounds,
        random: &mut fastrand::Rng,
    ) -> (usize, usize) {
        let count = parameters.len();
        let mut pulled: Vec<usize> = (0..count).filter(|row| state.pulls.mean(*row) > PULL_MIN).collect();
        let by_pull =
            |a: &usize, b: &usize| state.pulls.mean(*b).total_cmp(&state.pulls.mean(*a)).then(a.cmp(b));
        pulled.sort_unstable_by(by_pull);
        pulled.truncate(self.cap.saturating_sub(count));
        pulled.sort_unstable();
        let largest = T::of(libm::log(CLONE_SCALE * bounds.extent));
        let is_small = |row: &usize| parameters.log_scales[*row].iter().all(|scale| *scale <= largest);
        let (cloned, split): (Vec<usize>, Vec<usize>) = pulled.iter().partition(|row| is_small(row));

        let mut sources: Vec<usize> = (0..count).filter(|row| split.binary_search(row).is_err()).collect();
        let first_new = sources.len();
        sources.extend(&cloned);
        let first_half = sources.len();
        sources.extend(split.iter().flat_map(|row| [*row; 2]));
        *parameters = parameters.select(&sources);
        *moments = moments.select(&sources);
        for row in first_new..sources.len() {
            moments.clear(row);
        }
        for row in first_half..sources.len() {
            halve(parameters, row, random);
            bounds.project(parameters, row);
        }
        (cloned.len(), split.len())
    }

    /// Drops the Gaussians that are transparent or float, but where fewer than the floor would be
    /// left keeps that many: the most opaque of those that do not float, then of those that do, the
    /// first of equals. What is not made of numbers always goes.
    fn prune<T: Real>(
        &self,
        parameters: &mut Parameters<T>,
        moments: &mut Moments<T>,
        bounds: &Bounds,
        change: &mut DensityChange,
    ) {
        let count = parameters.len();
        let floating = floaters(parameters, bounds);
        let mut kept: Vec<usize> =
            (0..count).filter(|row| !floating[*row] && lives(parameters, *row)).collect();
        let wanted = kept.len();
        if wanted < self.floor {
            kept = (0..count).filter(|row| is_finite(parameters, *row)).collect();
            let logit = |row: usize| parameters.logits[row].to_double();
            kept.sort_unstable_by(|&a, &b| {
                let by_opacity = logit(b).total_cmp(&logit(a));
                floating[a].cmp(&floating[b]).then(by_opacity).then(a.cmp(&b))
            });
            kept.truncate(self.floor);
            kept.sort_unstable();
        }
        change.floaters = floating.iter().filter(|floats| **floats).count();
        change.kept = kept.len() - wanted;
        change.pruned = count - kept.len();
        if kept.len() < count {
            *parameters = parameters.select(&kept);
            *moments = moments.select(&kept);
        }
    }
}

/// Whether a Gaussian is made of numbers and opaque enough at its peak.
fn lives<T: Real>(parameters: &Parameters<T>, row: usize) -> bool {
    is_finite(parameters, row) && sigmoid(parameters.logits[row].to_double()) >= OPACITY_MIN
}

/// Makes a row one of the two halves of itself: its centre drawn from it, its scales smaller. Window,
/// motion, opacity and colour stay.
fn halve<T: Real>(parameters: &mut Parameters<T>, row: usize, random: &mut fastrand::Rng) {
    let [w, x, y, z] = parameters.rotations[row].map(T::to_double);
    let rotation = glam::DQuat::from_xyzw(x, y, z, w).normalize();
    let scales = parameters.log_scales[row].map(|scale| libm::exp(scale.to_double()));
    let along = glam::DVec3::from_array(scales.map(|scale| scale * normal(random)));
    for (center, offset) in parameters.centers[row].iter_mut().zip((rotation * along).to_array()) {
        *center += T::of(offset);
    }
    let shrink = T::of(libm::log(SPLIT_SHRINK));
    parameters.log_scales[row] = parameters.log_scales[row].map(|scale| scale - shrink);
}

/// A number from the normal distribution (Box and Muller).
fn normal(random: &mut fastrand::Rng) -> f64 {
    let (radius, angle) = (1.0 - random.f64(), std::f64::consts::TAU * random.f64());
    (-2.0 * libm::log(radius)).sqrt() * libm::cos(angle)
}

#[cfg(test)]
mod tests;
