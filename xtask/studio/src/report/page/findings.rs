//! [`Findings`]: the measurements that a report shows.

use measure::parameter::{Parameter, ParameterValue};
use measure::playing::Playing;

use crate::report::fitting::{self, FitLog};

/// Measurements of a clip or field.
#[derive(Debug)]
pub struct Findings {
    /// Name of the clip or field.
    pub name: String,
    /// Processor and operating system.
    pub machine: String,
    /// Cost and quality of playing it.
    pub playing: Playing,
    /// Parameters of packaging it.
    pub packaging: Vec<Parameter>,
    /// Progress of fits of it.
    pub fits: Vec<FitLog>,
}

impl Findings {
    /// The parameters of playing, packaging and fitting.
    pub(super) fn parameters(&self) -> Vec<Parameter> {
        let mut parameters = self.playing.parameters.clone();
        parameters.extend(self.packaging.clone());
        parameters.extend(fitting::parameter(&self.fits));
        parameters
    }

    /// The defaults off the Pareto front of their parameter, in a sentence each.
    pub fn beaten_defaults(&self) -> Vec<String> {
        let sentence = |(parameter, default, by): (&Parameter, &ParameterValue, Vec<&ParameterValue>)| {
            let value = |point: &ParameterValue| {
                let psnr = point.errors.psnr_db.map_or_else(|| "no error".into(), |db| format!("{db:.2} dB"));
                format!("{} ({psnr} at {:.2} {})", point.value, point.cost.median, parameter.cost)
            };
            let by: Vec<String> = by.into_iter().map(value).collect();
            format!("{}: {} is beaten by {}", parameter.name, value(default), by.join(", "))
        };
        let parameters = self.parameters();
        let beaten = |parameter| {
            Parameter::beaten_defaults(parameter).map(move |(default, by)| (parameter, default, by))
        };
        parameters.iter().flat_map(beaten).map(sentence).collect()
    }
}
