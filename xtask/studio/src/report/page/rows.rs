//! The numbers of a report as JSON: a row for each value of each parameter.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Map, Value};

use super::findings::Findings;
use measure::parameter::{FlowStage, ImageErrors, Parameter, ParameterValue, Quartiles};

/// A value of a parameter; the fields are the keys of the JSON.
#[derive(Serialize)]
struct Row<'a> {
    stage: FlowStage,
    name: &'a str,
    value: &'a str,
    /// PSNR in dB; `None` if there is no error.
    error_db: Option<f64>,
    ssim: Option<f64>,
    worst_tile_db: Option<f64>,
    flicker: Option<f64>,
    run_time_ms: Option<f64>,
    /// Lower and upper quartile.
    run_time_low_ms: Option<f64>,
    run_time_high_ms: Option<f64>,
    stages_ms: BTreeMap<&'a str, f64>,
    counts: &'a BTreeMap<String, f64>,
    /// The cost axis of the Pareto front.
    cost: f64,
    cost_unit: &'a str,
    default: bool,
    on_front: bool,
}

fn rows(parameters: &[Parameter]) -> impl Iterator<Item = Row<'_>> {
    let row = |parameter, point| {
        let Parameter { stage, name, cost: cost_unit, .. }: &Parameter = parameter;
        let ParameterValue { value, default, on_front, cost, errors, run_time_ms, stages_ms, counts }: &ParameterValue = point;
        let ImageErrors { psnr_db, ssim, worst_tile_db, flicker } = *errors;
        let time = |quartile: fn(Quartiles) -> f64| run_time_ms.map(quartile);
        Row {
            stage: *stage,
            name,
            value,
            error_db: psnr_db,
            ssim,
            worst_tile_db,
            flicker,
            run_time_ms: time(|spread| spread.median),
            run_time_low_ms: time(|spread| spread.low),
            run_time_high_ms: time(|spread| spread.high),
            stages_ms: stages_ms.iter().map(|(name, spread)| (name.as_str(), spread.median)).collect(),
            counts,
            cost: cost.median,
            cost_unit,
            default: *default,
            on_front: *on_front,
        }
    };
    parameters
        .iter()
        .flat_map(move |parameter| parameter.points.iter().map(move |point| row(parameter, point)))
}

pub(super) fn json(findings: &Findings, parameters: &[Parameter]) -> anyhow::Result<Map<String, Value>> {
    let Findings { name, machine, playing, .. } = findings;
    let values = [
        ("subject", Value::from(name.as_str())),
        ("machine", Value::from(machine.as_str())),
        ("setup", serde_json::to_value(&playing.setup)?),
        ("knobs", values(parameters)?),
        ("parts", serde_json::to_value(&playing.features)?),
        ("beaten_defaults", findings.beaten_defaults().into()),
    ];
    Ok(values.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}

/// The values of all parameters, in a list.
pub(super) fn values(parameters: &[Parameter]) -> anyhow::Result<Value> {
    Ok(serde_json::to_value(rows(parameters).collect::<Vec<_>>())?)
}
