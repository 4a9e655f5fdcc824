//! [`Findings`]: the measurements that a report shows.

use measure::parameter::{Parameter, ParameterValue};
use measure::playing::Playing;

use crate::messages::{count, decimal};
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

    /// The defaults off the Pareto front of their parameter, in a sentence each: which value is better, by how much,
    /// and why the default stands.
    pub fn beaten_defaults(&self) -> Vec<String> {
        let parameters = self.parameters();
        let beaten = |parameter| {
            Parameter::beaten_defaults(parameter).map(move |(default, by)| sentence(parameter, default, &by))
        };
        parameters.iter().flat_map(beaten).collect()
    }
}

/// Says by how much the most exact value of `by` beats `default`, and why `default` stands.
fn sentence(parameter: &Parameter, default: &ParameterValue, by: &[&ParameterValue]) -> String {
    let better = by
        .iter()
        .max_by(|a, b| a.psnr_db().total_cmp(&b.psnr_db()).then(b.cost.median.total_cmp(&a.cost.median)));
    let better = better.expect("a default off the front is beaten");
    let psnr = |point: &ParameterValue| {
        point.errors.psnr_db.map_or_else(|| "no error".into(), |db| format!("{} dB", decimal(db, 2)))
    };
    let exactness = match (better.errors.psnr_db, default.errors.psnr_db) {
        (Some(better), Some(default)) if better >= default => format!("has {:.2} dB more", better - default),
        (Some(better), Some(default)) => format!("has only {:.2} dB less", default - better),
        (None, Some(_)) => "is without error".into(),
        (_, None) => "is as exact".into(),
    };
    let others = match by.len() - 1 {
        0 => String::new(),
        others => format!(" (as {})", count(others, "other value")),
    };
    let cost = match default.cost.median - better.cost.median {
        0.0 => "no more".into(),
        saved => format!("{} {} less", decimal(saved, 3), parameter.cost),
    };
    let Parameter { name, why_default, cost: unit, .. } = parameter;
    let (psnr, median) = (psnr(default), decimal(default.cost.median, 3));
    format!(
        "{name}: {}{others} {exactness} and costs {cost} than the default, {} ({psnr} at {median} {unit}), which \
         stands because {why_default}.",
        better.value, default.value
    )
}
