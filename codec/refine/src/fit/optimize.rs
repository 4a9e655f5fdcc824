//! [`Fit`]: where a fit is.
//!
//! It is a value: what it holds decides what it ends as, so one that was written down and read
//! again ends as it would have.

use codec::{Camera, Field};
use serde::{Deserialize, Serialize};

use super::{
    Bounds, Clock, DensityChange, DensityControl, DensityRule, DensityState, Gaussians, Moments, Parameters,
    Photograph, Picture, Rates, View, extent,
};

/// Steps from one control of the number of Gaussians to the next, as in 3D Gaussian Splatting.
const INTERVAL: usize = 100;

/// Gaussians that doubling makes at most, as a multiple of the floor and of those at the start: the
/// paper's fits end with 1.1 to 1.75 times their floor.
const CAP: usize = 2;

/// What a fit is to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Steps, each on one photograph.
    pub steps: u64,
    /// Fewest Gaussians that pruning leaves, the paper's `N_min`; 0 for none.
    pub floor: usize,
    /// How Gaussians are made and removed.
    pub rule: DensityRule,
    /// Whether windows' centres move by opacity alone, see [`super::cpu::Drawing::backward`].
    pub detached: bool,
    /// Seed of all chance.
    pub seed: u64,
}

impl Default for Settings {
    /// The paper's.
    fn default() -> Settings {
        Settings { steps: 96_000, floor: 200_000, rule: DensityRule::Floor, detached: true, seed: 0 }
    }
}

/// A photograph, and who took it when.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The camera; its image has the size of the photograph.
    pub camera: Camera,
    /// Time in frames.
    pub frame: f64,
    /// The photograph.
    pub photograph: Photograph,
}

impl Shot {
    /// What the camera sees.
    pub fn view(&self) -> View<'_> {
        View { camera: &self.camera, frame: self.frame }
    }
}

/// What a step came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The objective on its photograph, before the step.
    pub loss: f64,
    /// Gaussians that were drawn.
    pub drawn: usize,
    /// Gradients of a Gaussian that held numbers that are not finite, and were left out.
    pub non_finite: usize,
}

/// A fit on its way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    pub(super) settings: Settings,
    clock: Clock,
    pub(super) rates: Rates,
    pub(super) bounds: Bounds,
    parameters: Parameters<f32>,
    moments: Moments<f32>,
    control: DensityControl,
    density: DensityState,
    pub(super) step: u64,
    pub(super) non_finite: u64,
    started_with: usize,
}

impl Fit {
    /// A fit that begins with `parameters`; `cameras` are those that it will see.
    pub fn new<'a>(
        settings: Settings,
        parameters: Parameters<f32>,
        clock: Clock,
        cameras: impl IntoIterator<Item = &'a Camera>,
    ) -> Fit {
        let extent = extent(cameras, &parameters.centers);
        let bounds = Bounds::new(extent, clock).around(&parameters);
        Fit {
            settings,
            clock,
            rates: Rates::new(extent),
            bounds,
            moments: Moments::new(&parameters),
            control: DensityControl {
                rule: settings.rule,
                interval: INTERVAL,
                floor: settings.floor,
                cap: CAP * settings.floor.max(parameters.len()),
            },
            density: DensityState::new(parameters.len(), settings.seed),
            started_with: parameters.len(),
            parameters,
            step: 0,
            non_finite: 0,
        }
    }

    /// Takes the Gaussians out, for a back end to hold.
    pub(super) fn take(&mut self) -> Gaussians {
        Gaussians {
            parameters: std::mem::take(&mut self.parameters),
            moments: std::mem::take(&mut self.moments),
            pulls: std::mem::take(&mut self.density.pulls),
        }
    }

    /// Puts them back.
    pub(super) fn put(&mut self, Gaussians { parameters, moments, pulls }: Gaussians) {
        (self.parameters, self.moments, self.density.pulls) = (parameters, moments, pulls);
    }

    /// Whether it is time to change the number of Gaussians, of which there are `count`.
    pub(super) fn is_control_due(&mut self, count: usize) -> bool {
        let steps = [self.step as usize, self.settings.steps as usize];
        self.control.is_due(&mut self.density, count, steps)
    }

    /// Changes the number of Gaussians.
    pub(super) fn control(&mut self) -> DensityChange {
        self.control.control(&mut self.density, &mut self.parameters, &mut self.moments, &self.bounds)
    }

    /// The field so far.
    pub fn to_field(&self) -> Field {
        self.parameters.to_field(self.clock)
    }

    /// Steps done.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// Whether all steps are done.
    pub fn is_done(&self) -> bool {
        self.step >= self.settings.steps
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.parameters.len()
    }

    /// Whether there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }

    /// Number of Gaussians at the start.
    pub fn started_with(&self) -> usize {
        self.started_with
    }

    /// Gradients of a Gaussian that held numbers that are not finite, so far; they were left out.
    pub fn non_finite(&self) -> u64 {
        self.non_finite
    }

    /// What it was asked to do.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether its columns have the lengths that belong together: not what was written down and
    /// damaged.
    pub fn is_consistent(&self) -> bool {
        let rows = self.parameters.len();
        let Moments { first, second, visits } = &self.moments;
        self.parameters.is_consistent()
            && [first, second].iter().all(|moment| moment.has_shape_of(&self.parameters))
            && visits.len() == rows
            && self.density.pulls.sums.len() == rows
            && self.density.pulls.pictures.len() == rows
    }
}

/// PSNR in dB of the pixels that show the subject, at most 54; `None` where none does.
pub fn psnr_of_subject(picture: &Picture<f32>, photograph: &Photograph) -> Option<f64> {
    let mut squares = 0.0;
    let mut pixels = 0;
    for (i, (drawn, taken)) in picture.pixels.iter().zip(&photograph.pixels).enumerate() {
        if photograph.is_subject(i) {
            let error = |c: usize| f64::from(drawn[c].clamp(0.0, 1.0)) - f64::from(taken[c]) / 255.0;
            squares += (0..3).map(|c| error(c).powi(2)).sum::<f64>();
            pixels += 1;
        }
    }
    // Equal pixels would make any mean infinite; no 8-bit photograph tells less than half a step.
    let least = 0.25 / (255.0 * 255.0) * (3 * pixels) as f64;
    (pixels > 0).then(|| crate::image::psnr(squares.max(least), pixels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_subject_alone_is_measured() {
        let pixels = vec![[0.5, 0.5, 0.5, 1.0], [1.0; 4], [0.0; 4]];
        let picture = Picture { width: 3, height: 1, pixels };
        let pixels = vec![[102, 102, 102, 255], [0, 0, 0, 0], [255, 255, 255, 255]];
        let photograph = Photograph { width: 3, height: 1, pixels, seen: vec![true, true, false] };
        // 0.5 against 0.4: what is masked out or not seen does not count.
        let psnr = psnr_of_subject(&picture, &photograph).unwrap();
        assert!((psnr - 20.0).abs() < 1e-6, "{psnr}");
        let empty = Photograph { pixels: vec![[0; 4]; 3], ..photograph };
        assert_eq!(psnr_of_subject(&picture, &empty), None);
    }
}
