//! [`Findings`]: the measurements that a report shows.

use measure::parameter::{Parameter, ParameterValue};
use measure::playing::Playing;

use crate::report::fitting::{self, FitLog};

/// What was found out about a clip or field.
#[derive(Debug)]
pub struct Findings {
    /// Its name.
    pub name: String,
    /// Processor and system.
    pub machine: String,
    /// What playing it costs and keeps.
    pub playing: Playing,
    /// The parameters of making a package of it.
    pub packaging: Vec<Parameter>,
    /// Fits of it.
    pub fits: Vec<FitLog>,
}

impl Findings {
    /// All parameters.
    pub(super) fn parameters(&self) -> Vec<Parameter> {
        let mut parameters = self.playing.parameters.clone();
        parameters.extend(self.packaging.clone());
        parameters.extend(fitting::parameter(&self.fits));
        parameters
    }

    /// The defaults that are off the front of their parameter, each in a sentence.
    pub fn beaten_defaults(&self) -> Vec<String> {
        let told = |(parameter, default, by): (&Parameter, &ParameterValue, Vec<&ParameterValue>)| {
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
        parameters.iter().flat_map(beaten).map(told).collect()
    }
}
