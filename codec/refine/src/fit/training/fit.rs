//! [`Fit`]: the state of a fit.
//!
//! It is a value that determines how the fit continues: a fit that was saved and loaded ends with the
//! same bits.

use codec::{Camera, Field};
use serde::{Deserialize, Serialize};

use crate::fit::backend::TrainingState;
use crate::fit::cameras::Rig;
use crate::fit::density::{DensityChange, DensityControl, DensityRule, DensityState, ScreenGradients, thin};
use crate::fit::optimizer::{LearningRates, Moments};
use crate::fit::parameters::{Bounds, Carried, Parameters, Timeline, keep_limits, scene_extent};
use crate::fit::views::TrainingView;

/// Steps between controls of the number of Gaussians, as in 3D Gaussian Splatting.
const INTERVAL: usize = 100;

/// Default of [`FitSettings::cap`], as a multiple of the larger of the floor and the initial number.
const CAP: usize = 2;

/// A value of [`FitSettings::fragment_weight`] that saves most of the fragments and costs next to no quality;
/// `codec/refine/MEASURED.md` has its measurement.
pub const FRAGMENT_WEIGHT: f64 = 1e-3;

/// The settings of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitSettings {
    /// Number of steps, each on one training view.
    pub steps: u64,
    /// Capacity floor, the paper's `N_min` (Eq. 8): pruning leaves at least this many Gaussians in front of a plate;
    /// 0 for no floor.
    pub floor: usize,
    /// Largest number of Gaussians that densification makes; `None` for twice the larger of the floor and the initial
    /// number: the paper's fits end with 1.1 to 1.75 times their floor.
    pub cap: Option<usize>,
    /// Rule of capacity control.
    pub rule: DensityRule,
    /// Stops the gradient of positions and rotations with respect to `tau`: window centres then move by
    /// opacity alone, as in Spacetime Gaussians, and do not compete with the motion.
    pub detach_tau: bool,
    /// Weight in the loss of the area that the Gaussians in an image cover, in squared extents of the scene; 0 for
    /// none. See [`FRAGMENT_WEIGHT`].
    pub fragment_weight: f64,
    /// Whether still Gaussians that show least for the pixels that they cover are left out when densification by
    /// [`DensityRule::Floor`] ends, which it then does early. A room loses next to nothing by it; an object a quarter of a
    /// dB.
    pub thins: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for FitSettings {
    /// The paper's settings.
    fn default() -> FitSettings {
        FitSettings {
            steps: 96_000,
            floor: 200_000,
            cap: None,
            rule: DensityRule::Floor,
            detach_tau: true,
            fragment_weight: 0.0,
            thins: false,
            seed: 0,
        }
    }
}

/// A fit between two steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    pub(super) settings: FitSettings,
    timeline: Timeline,
    pub(super) rates: LearningRates,
    pub(super) bounds: Bounds,
    parameters: Parameters<f32>,
    moments: Moments<f32>,
    control: DensityControl,
    density: DensityState,
    pub(super) steps_done: u64,
    pub(super) non_finite: u64,
    initial_count: usize,
    /// Whether it goes on from earlier fits.
    carries: bool,
    /// The cameras, if they are learned or show other colours than the field.
    pub(super) rig: Option<Rig>,
}

impl Fit {
    /// A fit that starts from `parameters`. The positions of `cameras`, the cameras of all training views,
    /// scale its learning rates and bounds.
    pub fn new<'a>(
        settings: FitSettings,
        parameters: Parameters<f32>,
        timeline: Timeline,
        cameras: impl IntoIterator<Item = &'a Camera>,
    ) -> Fit {
        let extent = scene_extent(cameras, &parameters.centers);
        let bounds = Bounds::new(extent, timeline).around(&parameters);
        Fit {
            settings,
            timeline,
            rates: LearningRates::new(extent, timeline, &parameters),
            bounds,
            moments: Moments::new(&parameters),
            control: DensityControl {
                rule: settings.rule,
                interval: INTERVAL,
                floor: settings.floor,
                cap: settings.cap.unwrap_or(CAP * settings.floor.max(parameters.len())),
                ends_early: settings.thins,
            },
            density: DensityState::new(parameters.len(), settings.seed),
            initial_count: parameters.len(),
            parameters,
            steps_done: 0,
            non_finite: 0,
            carries: false,
            rig: None,
        }
    }

    /// The fit goes on from earlier ones: `carried` is the past of each row.
    ///
    /// # Panics
    /// If there is not one for each Gaussian.
    pub fn carrying(mut self, carried: Vec<Carried>) -> Fit {
        assert_eq!(carried.len(), self.len(), "a past for each Gaussian");
        self.moments.carried = carried;
        self.carries = true;
        self.keep_limits();
        self
    }

    /// The photographs are taken by the cameras of `rig`, which has the cameras of all training views.
    pub fn seen_by(self, rig: Rig) -> Fit {
        Fit { rig: (!rig.is_neutral()).then_some(rig), ..self }
    }

    /// The cameras, if they are learned or show other colours than the field.
    pub fn rig(&self) -> Option<&Rig> {
        self.rig.as_ref()
    }

    /// Whether windows have to be kept within [`Carried::limits`] after this step.
    pub(super) fn is_keeping_due(&self) -> bool {
        self.carries && (self.is_done() || self.steps_done.is_multiple_of(INTERVAL as u64))
    }

    /// Keeps windows within [`Carried::limits`].
    pub(super) fn keep_limits(&mut self) {
        keep_limits(&mut self.parameters, &self.moments.carried, &self.bounds);
    }

    /// Moves the training state out, for a back end.
    pub(super) fn take(&mut self) -> TrainingState {
        TrainingState {
            parameters: std::mem::take(&mut self.parameters),
            moments: std::mem::take(&mut self.moments),
            screen_gradients: std::mem::take(&mut self.density.screen_gradients),
        }
    }

    /// Moves it back in.
    pub(super) fn put(&mut self, state: TrainingState) {
        let TrainingState { parameters, moments, screen_gradients } = state;
        (self.parameters, self.moments) = (parameters, moments);
        self.density.screen_gradients = screen_gradients;
    }

    /// Whether capacity control is due, with `count` Gaussians.
    pub(super) fn is_control_due(&mut self, count: usize) -> bool {
        let steps = [self.steps_done as usize, self.settings.steps as usize];
        self.control.is_due(&mut self.density, count, steps)
    }

    /// Applies capacity control.
    pub(super) fn control(&mut self) -> DensityChange {
        self.control.control(
            &mut self.density,
            self.steps_done as usize,
            &mut self.parameters,
            &mut self.moments,
            &self.bounds,
        )
    }

    /// Whether still Gaussians are thinned after this step. Call it after [`is_control_due`](Self::is_control_due).
    pub(super) fn is_thinning_due(&self) -> bool {
        self.settings.thins
            && self.control.is_ending(&self.density, [self.steps_done as usize, self.settings.steps as usize])
    }

    /// Leaves out the still Gaussians that show least in `views` for the pixels that they cover. Returns how many.
    pub(super) fn thin(&mut self, views: &[&TrainingView]) -> usize {
        let thinned =
            thin(self.settings.floor, &mut self.parameters, &mut self.moments, self.timeline, views);
        self.density.screen_gradients = ScreenGradients::zeros(self.len());
        thinned
    }

    /// The fitted field.
    pub fn to_field(&self) -> Field {
        self.parameters.to_field(self.timeline)
    }

    /// The fitted field in two: what moves, and the plate, which is [behind](Parameters::behind) it and has no temporal
    /// columns.
    pub fn to_field_and_plate(&self) -> [Field; 2] {
        let (still, moving): (Vec<usize>, Vec<usize>) =
            (0..self.len()).partition(|row| self.parameters.is_behind(*row));
        let [moving, still] =
            [moving, still].map(|rows| self.parameters.select(&rows).to_field(self.timeline));
        [moving, Field { temporal: None, ..still }]
    }

    /// Number of Gaussians of the plate.
    pub fn plate_len(&self) -> usize {
        self.parameters.behind.iter().filter(|behind| **behind).count()
    }

    /// The parameters of the rows that are not [fixed](Carried::is_fixed).
    pub fn into_fitted(self) -> Parameters<f32> {
        let Fit { parameters, moments: Moments { carried, .. }, .. } = self;
        let is_fixed = |row: usize| carried.get(row).is_some_and(|carried| carried.is_fixed());
        let rows: Vec<usize> = (0..parameters.len()).filter(|row| !is_fixed(*row)).collect();
        parameters.select(&rows)
    }

    /// Number of steps done.
    pub fn steps_done(&self) -> u64 {
        self.steps_done
    }

    /// Whether all steps are done.
    pub fn is_done(&self) -> bool {
        self.steps_done >= self.settings.steps
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
    pub fn initial_count(&self) -> usize {
        self.initial_count
    }

    /// Total of [`StepReport::non_finite`](crate::fit::StepReport::non_finite) over the steps done.
    pub fn non_finite(&self) -> u64 {
        self.non_finite
    }

    /// The settings.
    pub fn settings(&self) -> &FitSettings {
        &self.settings
    }

    /// Whether the lengths of all columns agree; a damaged file may deserialise into a fit in which they
    /// do not.
    pub fn is_consistent(&self) -> bool {
        let rows = self.parameters.len();
        let Moments { first, second, visits, carried } = &self.moments;
        self.parameters.is_consistent()
            && [first, second].iter().all(|moment| moment.has_shape_of(&self.parameters))
            && visits.len() == rows
            && carried.len() == if self.carries { rows } else { 0 }
            && self.rig.as_ref().is_none_or(Rig::is_consistent)
            && self.density.screen_gradients.sums.len() == rows
            && self.density.screen_gradients.images.len() == rows
    }
}
