//! The tables of a page.

use crate::messages::decimal;
use crate::page::{decimals, escape, grouped, row, table};
use crate::report::fitting::{FitLog, WORK};
use measure::parameter::{FlowStage, Parameter, ParameterValue, Quartiles};
use measure::playing::{ClipFeature, ResourceUse};

/// Keys of counts with their column names, in the order of the columns.
const COUNTS: [(&str, &str); 16] = [
    ("covered_fragments", "fragments"),
    ("vertex_invocations", "vertices"),
    ("sorted_keys", "sorted keys"),
    ("bytes_fetched", "bytes fetched"),
    ("rows_tested", "rows tested"),
    ("gpu_bytes", "GPU bytes"),
    ("bytes", "bytes"),
    ("bytes_per_gaussian", "per Gaussian"),
    ("package_bytes", "package bytes"),
    ("gaussians_decoded", "Gaussians decoded"),
    ("package_bytes_fixed", "by <code>fixed</code>"),
    ("features_preserved", "features preserved"),
    ("restored", "restored"),
    ("pipelines", "pipelines"),
    ("passes", "passes"),
    ("sort_passes", "sort passes"),
];

/// Counts of the shader code and bindings of a feature.
const BUILT: [(&str, &str); 2] = [("shader_lines", "shader lines"), ("bindings", "bindings")];

/// Counts with fractions.
const FRACTIONS: [&str; 4] = ["bytes_per_gaussian", "features_preserved", "sort_passes", "passes"];

/// Table of a parameter: cost and quality of each value.
pub(super) fn parameter(parameter: &Parameter) -> String {
    let any = |value: fn(&ParameterValue) -> Option<f64>| {
        parameter.points.iter().any(|point| value(point).is_some())
    };
    let (ssim, tile) = (any(|point| point.errors.ssim), any(|point| point.errors.worst_tile_db));
    let flicker = any(|point| point.errors.flicker);
    let time = match parameter.stage {
        FlowStage::Playing => "frame, ms",
        FlowStage::Packaging => "decoding, ms",
        FlowStage::Fitting => "fit, ms",
    };
    let timed = parameter.points.iter().any(|point| point.run_time_ms.is_some());
    let mut stages: Vec<&String> = parameter.points.iter().flat_map(|point| point.stages_ms.keys()).collect();
    stages.sort();
    stages.dedup();
    let counts: Vec<_> = COUNTS.iter().filter(|(key, _)| is_in_table(parameter, key)).collect();

    let mut head = vec![escape(&parameter.name), "PSNR, dB".into()];
    let mut add = |visible: bool, name: &str| head.extend(visible.then(|| name.to_owned()));
    add(ssim, "SSIM");
    add(tile, "worst tile, dB");
    add(flicker, "flicker, /255");
    add(timed, time);
    stages.iter().for_each(|stage| add(true, stage));
    counts.iter().for_each(|(_, name)| add(true, name));
    if !timed {
        head.push(escape(&parameter.cost));
    }
    let mut text = row("th", &head, "");
    for point in &parameter.points {
        let mut marks = String::new();
        if point.default {
            marks += " <span class=default>default</span>";
        }
        if point.on_front {
            marks += " <span class=front>front</span>";
        }
        let errors = &point.errors;
        let psnr = errors.psnr_db.map_or_else(|| "same".into(), |db| format!("{db:.2}"));
        let mut cells = vec![escape(&point.value) + &marks, psnr];
        let mut add = |visible: bool, value: String| cells.extend(visible.then_some(value));
        add(ssim, decimals(errors.ssim, 5));
        add(tile, decimals(errors.worst_tile_db, 1));
        add(flicker, decimals(errors.flicker, 3));
        add(timed, point.run_time_ms.map_or_else(|| "-".into(), spread));
        for stage in &stages {
            add(true, decimals(point.stages_ms.get(*stage).map(|spread| spread.median), 2));
        }
        for (key, _) in &counts {
            add(true, point.counts.get(*key).map_or_else(|| "-".into(), |&value| count(key, value)));
        }
        add(!timed, decimal(point.cost.median, 3));
        text += &row("td", &cells, if point.default { " class=chosen" } else { "" });
    }
    table(&text)
}

/// Whether a count is worth a column: it exists, and a count of constant resources varies.
fn is_in_table(parameter: &Parameter, key: &str) -> bool {
    let mut values = parameter.points.iter().map(|point| point.counts.get(key));
    let first = values.next().flatten();
    let is_constant = values.all(|value| value == first);
    first.is_some() && !(is_constant && ["gpu_bytes", "pipelines", "passes"].contains(&key))
}

/// Table of the optional features: whether the clip needs each, and the savings of leaving it out.
pub(super) fn features(features: &[ClipFeature]) -> String {
    let columns: Vec<_> = COUNTS
        .iter()
        .chain(&BUILT)
        .filter(|(key, _)| {
            let saves = |feature: &ClipFeature| saved(feature, key).is_some_and(|saved| saved != 0.0);
            features.iter().any(saves)
        })
        .collect();
    let mut head: Vec<String> =
        ["part", "does this scene need it?", "switched on as"].map(String::from).into();
    head.extend(columns.iter().map(|(_, name)| (*name).to_owned()));
    head.push("frame, ms".into());
    let mut text = row("th", &head, "");
    for feature in features {
        let ClipFeature { name, needs, switched_on, left_out, without, with } = feature;
        let mut cells = [name, needs, switched_on].map(|text| escape(text)).to_vec();
        cells.extend(columns.iter().map(|(key, _)| match saved(feature, key) {
            None => String::new(),
            Some(saved) => count(key, saved),
        }));
        cells.push(match (without.frame_ms, with.frame_ms) {
            (Some(without), Some(with)) => format!("{} / {}", spread(without), spread(with)),
            _ => String::new(),
        });
        text += &row("td", &cells, if *left_out { "" } else { " class=needed" });
    }
    table(&text)
}

/// The count with the feature minus the count without it.
fn saved(feature: &ClipFeature, key: &str) -> Option<f64> {
    let count = |resources: &ResourceUse| resources.counts.get(key).copied();
    Some(count(&feature.with)? - count(&feature.without)?)
}

/// Table of the last line of each fit, with the first and the last step at which its points are on the front.
/// `points` are the points of each fit.
pub(super) fn fits(logs: &[FitLog], points: &[&[ParameterValue]]) -> String {
    let head = [
        "field",
        "steps",
        "seconds",
        "ms a step",
        "Gaussians",
        WORK,
        "held photographs, dB",
        "best, dB",
        "steps on the front",
        "by",
    ];
    let mut text = row("th", &head.map(String::from), "");
    for (FitLog { name, entries }, points) in logs.iter().zip(points) {
        let Some(last) = entries.last() else { continue };
        let held = entries.iter().filter_map(|entry| entry.held_psnr_db);
        let front: Vec<String> = points
            .iter()
            .filter(|point| point.on_front)
            .map(|point| grouped(point.counts["steps"]))
            .collect();
        let front = match &front[..] {
            [] => "none".into(),
            [only] => format!("{only} (1 of {})", points.len()),
            [first, .., last] => format!("{first} to {last} ({} of {})", front.len(), points.len()),
        };
        text += &row(
            "td",
            &[
                escape(name),
                grouped(last.step as f64),
                format!("{:.0}", last.seconds),
                format!("{:.1}", 1e3 * last.seconds / last.step.max(1) as f64),
                grouped(last.gaussians as f64),
                decimals(points.last().map(|point| point.cost.median), 2),
                decimals(last.held_psnr_db, 2),
                decimals(held.reduce(f64::max), 2),
                front,
                escape(&last.backend),
            ],
            "",
        );
    }
    table(&text)
}

fn count(key: &str, value: f64) -> String {
    match FRACTIONS.contains(&key) {
        true => format!("{}", (1000.0 * value).round() / 1000.0),
        false => grouped(value),
    }
}

/// Median, with lower and upper quartile if they differ.
fn spread(Quartiles { low, median, high }: Quartiles) -> String {
    match low == high {
        true => format!("{median:.2}"),
        false => format!("{median:.2} <small>{low:.2} to {high:.2}</small>"),
    }
}
