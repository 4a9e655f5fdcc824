//! [`MeasuredVariant`]: the pictures, counts and times of a variant.

use std::collections::BTreeMap;

use refine::image::Image;

use crate::parameter::{ImageErrors, ParameterValue, Quartiles};

/// Measurements of a variant.
pub(super) struct MeasuredVariant {
    pub(super) inspection: Inspection,
    pub(super) timings: Vec<FrameTiming>,
}

/// Pictures and counts of a variant.
pub(super) struct Inspection {
    pub(super) errors: ImageErrors,
    /// Means per picture.
    pub(super) counts: BTreeMap<String, f64>,
    /// The pictures; none of a variant with two eyes.
    pub(super) images: Vec<Image>,
    /// The frames of the turning head.
    pub(super) turn: Vec<Image>,
}

/// Milliseconds per frame, the mean of all pictures.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FrameTiming {
    pub(super) frame_ms: f64,
    pub(super) alive_ms: f64,
    pub(super) sort_ms: f64,
    pub(super) draw_ms: f64,
    /// Whether the GPU timed `draw_ms` of all pictures; else it is the remainder of the frame.
    pub(super) gpu_timed: bool,
}

impl MeasuredVariant {
    /// Milliseconds per frame.
    pub(super) fn frame_ms(&self) -> Quartiles {
        self.quartiles(|timing| timing.frame_ms)
    }

    fn quartiles(&self, value: impl Fn(&FrameTiming) -> f64) -> Quartiles {
        Quartiles::new(self.timings.iter().map(value))
    }

    /// The variant as a value of a parameter.
    pub(super) fn to_value(&self, value: &str, default: bool) -> ParameterValue {
        let stages = [
            ("alive", self.quartiles(|timing| timing.alive_ms)),
            ("sort", self.quartiles(|timing| timing.sort_ms)),
            ("draw", self.quartiles(|timing| timing.draw_ms)),
        ];
        ParameterValue {
            value: value.into(),
            default,
            on_front: false,
            cost: self.frame_ms(),
            errors: self.inspection.errors,
            run_time_ms: Some(self.frame_ms()),
            stages_ms: stages.map(|(name, quartiles)| (name.to_owned(), quartiles)).into(),
            counts: self.inspection.counts.clone(),
        }
    }
}
