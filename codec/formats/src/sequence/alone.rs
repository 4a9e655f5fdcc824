//! [`FramesAlone`]: frames whose rows do not correspond, each with Gaussians of its own in a window of that frame.

use codec::{Field, Temporal, sh_coefficients};

use crate::columns::padded_sh;
use crate::limits::ImportBudget;

/// Standard deviation of a window, in frames. At the instant of a frame its neighbours have 8 % of their opacity;
/// halfway between two frames both have 54 %.
const S: f64 = 0.45;

/// A moving field that grows frame by frame.
pub(super) struct FramesAlone {
    field: Field,
    steps: usize,
}

impl FramesAlone {
    /// Begins the field of a sequence of `steps` frames, missing ones included.
    pub(super) fn new(steps: usize) -> FramesAlone {
        let field = Field { temporal: Some(Temporal::default()), ..Field::default() };
        FramesAlone { field, steps }
    }

    /// Adds the frame at `step`, which is shown for `frames` frames: more than one if the next ones are missing.
    ///
    /// # Errors
    /// If the field exceeds `budget`.
    pub(super) fn push(
        &mut self,
        frame: &Field,
        step: usize,
        frames: usize,
        budget: &mut ImportBudget,
    ) -> Result<(), String> {
        let field = &mut self.field;
        let degree = field.sh_degree.max(frame.sh_degree);
        budget.spend(frame.len() as u64 * 4 * (11 + 3 * sh_coefficients(degree) as u64 + 2))?;
        if degree > field.sh_degree {
            let added = sh_coefficients(degree) - sh_coefficients(field.sh_degree);
            budget.spend(field.len() as u64 * 12 * added as u64)?;
            field.sh = padded_sh(&field.sh, field.sh_degree, degree);
            field.sh_degree = degree;
        }
        field.filter = frame.filter;
        field.centers.extend(&frame.centers);
        field.rotations.extend(&frame.rotations);
        field.log_scales.extend(&frame.log_scales);
        field.opacities.extend(&frame.opacities);
        field.sh.extend(padded_sh(&frame.sh, frame.sh_degree, degree));
        let interval = 1.0 / (self.steps - 1) as f64;
        let center = (step as f64 + 0.5 * (frames - 1) as f64) * interval;
        let temporal = field.temporal.as_mut().expect("it has windows");
        temporal.tau.resize(temporal.tau.len() + frame.len(), center as f32);
        temporal.s.resize(temporal.s.len() + frame.len(), (S * frames as f64 * interval) as f32);
        Ok(())
    }

    /// The field.
    pub(super) fn into_field(self) -> Field {
        self.field
    }
}
