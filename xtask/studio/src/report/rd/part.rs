//! Rate and distortion as a part of a report: tables and a plot of each field, and of the mean of several.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::rates::CoderRate;
use super::result::{FieldRd, RatePoint, Selector};
use super::views::COUNT;
use crate::messages::decimal;
use crate::package::{FLOOR_INSTANTS, QUALITY_DB};
use crate::page::{LineChart, PlotLine, Scale, Table, escape, grouped, prose, svg};
use crate::report::ReportPart;
use refine::prune::{FloorSettings, RESOLUTION_DB};
use serde_json::Map;

/// Name of the mean in the list of fields.
const MEAN: &str = "mean of the fields";

/// The part of a report on `fields`, at least one.
///
/// # Errors
/// If a plot cannot be drawn.
pub fn part(fields: &[FieldRd]) -> anyhow::Result<ReportPart> {
    let mut curves: Vec<Curve> = fields.iter().map(Curve::from).collect();
    if fields.len() > 1 {
        curves.insert(0, Curve::mean(fields));
    }
    let rates = rates(fields);
    let mut text = rates.text();
    let mut body = described(fields).html();
    let _ = write!(
        body,
        "{}<h2>Rate of the coder</h2>\n<p>{}</p>\n{}",
        about(fields),
        about_rates(fields),
        rates.html()
    );
    for curve in &curves {
        let _ = writeln!(body, "<h2>{}</h2>", escape(&curve.name));
        let _ = writeln!(text, "\n{}", curve.name);
        if curve.points.is_empty() {
            let nothing = "No budget is smaller than the field: nothing to select.";
            let _ = writeln!(body, "<p>{nothing}</p>");
            let _ = writeln!(text, "{nothing}");
            continue;
        }
        match curve.has_line() {
            true => body += &curve.plot()?,
            false => body += "<p>One budget makes no curve: the tables hold its numbers.</p>\n",
        }
        for table in curve.tables_of_the_paper() {
            body += &table.html();
            text += &table.text();
        }
        body += &curve.table().html();
    }
    let mut json = Map::from_iter([("rd".to_owned(), serde_json::to_value(fields)?)]);
    if let Some(mean) = curves.first().filter(|_| fields.len() > 1) {
        let points: Vec<&RatePoint> = mean.points.iter().map(|(point, _)| point).collect();
        json.insert("rd_mean".into(), serde_json::to_value(points)?);
    }
    Ok(ReportPart { title: "Rate and distortion".into(), body, text, json })
}

/// The points of a field, or the means of the points of several.
struct Curve {
    name: String,
    /// Points, each with the number of fields that it is a mean of.
    points: Vec<(RatePoint, usize)>,
}

impl From<&FieldRd> for Curve {
    fn from(field: &FieldRd) -> Curve {
        let points = field.points.iter().cloned().map(|point| (point, 1)).collect();
        Curve { name: field.field.clone(), points }
    }
}

impl Curve {
    /// Whether its points make a line: at least two budgets.
    fn has_line(&self) -> bool {
        self.points.iter().any(|(point, _)| point.budget != self.points[0].0.budget)
    }

    /// The mean at each budget, over the fields larger than the budget.
    fn mean(fields: &[FieldRd]) -> Curve {
        let points = || fields.iter().flat_map(|field| &field.points);
        let budgets: BTreeSet<usize> = points().map(|point| point.budget).collect();
        let mut means = Vec::new();
        for budget in budgets.into_iter().rev() {
            for row in Selector::ALL {
                let same: Vec<&RatePoint> =
                    points().filter(|point| point.budget == budget && point.row == row).collect();
                let mean = |value: fn(&RatePoint) -> f64| {
                    same.iter().map(|point| value(point)).sum::<f64>() / same.len() as f64
                };
                let point = RatePoint {
                    budget,
                    row,
                    ranking: if row == Selector::Ours { "best per field" } else { same[0].ranking },
                    restored: mean(|p| p.restored as f64).round() as usize,
                    psnr_db: mean(|p| p.psnr_db),
                    recall: mean(|p| p.recall),
                    precision: mean(|p| p.precision),
                    f1: mean(|p| p.f1),
                    saddle_drift: mean(|p| p.saddle_drift),
                    mbps: mean(|p| p.mbps),
                    bytes: mean(|p| p.bytes as f64).round() as usize,
                    bytes_per_gaussian: mean(|p| p.bytes_per_gaussian),
                };
                means.push((point, same.len()));
            }
        }
        Curve { name: MEAN.into(), points: means }
    }

    /// PSNR and topology over the rate.
    fn plot(&self) -> anyhow::Result<String> {
        let line = |row: Selector, y: fn(&RatePoint) -> f64| {
            let points = self.points.iter().map(|(point, _)| point).filter(|point| point.row == row);
            PlotLine { name: row.name().into(), points: points.map(|point| (point.mbps, y(point))).collect() }
        };
        let panel = |title: &str, y: fn(&RatePoint) -> f64| LineChart {
            title: title.into(),
            lines: Selector::ALL.map(|row| line(row, y)).to_vec(),
            rings: Vec::new(),
            from_zero: false,
            cuts: Vec::new(),
        };
        let panels = [
            panel("PSNR after decoding (dB)", |p| p.psnr_db),
            panel("persistent features preserved", |p| p.recall),
        ];
        svg(Scale::Logarithmic, "Mbps", &panels)
    }

    /// PSNR and topology in the form of the paper's table.
    fn tables_of_the_paper(&self) -> [Table; 2] {
        let budgets: BTreeSet<usize> = self.points.iter().map(|(point, _)| point.budget).collect();
        let heading = |budget: usize| match self.points.iter().find(|(point, _)| point.budget == budget) {
            Some((_, fields)) if self.name == MEAN => format!("{budget} (of {fields})"),
            _ => budget.to_string(),
        };
        let table = |title: &str, value: fn(&RatePoint) -> String| {
            let head = std::iter::once(title.to_owned()).chain(budgets.iter().rev().copied().map(heading));
            let row = |row: Selector| {
                let points = self.points.iter().filter(|(point, _)| point.row == row);
                std::iter::once(row.name().to_owned()).chain(points.map(|(point, _)| value(point))).collect()
            };
            Table::new(head).with_rows(Selector::ALL.map(row))
        };
        [
            table("PSNR (dB)", |point| format!("{:.2}", point.psnr_db)),
            table("Topology", |point| format!("{:.3}", point.recall)),
        ]
    }

    /// All numbers.
    fn table(&self) -> Table {
        let head = [
            "row",
            "Gaussians",
            "ranking",
            "restored",
            "PSNR (dB)",
            "topology",
            "precision",
            "F1",
            "drift",
            "Mbps",
            "bytes",
            "B/G",
        ];
        let row = |(p, _): &(RatePoint, usize)| {
            vec![
                p.row.name().to_owned(),
                p.budget.to_string(),
                p.ranking.to_owned(),
                p.restored.to_string(),
                format!("{:.2}", p.psnr_db),
                format!("{:.3}", p.recall),
                format!("{:.3}", p.precision),
                format!("{:.3}", p.f1),
                format!("{:.4}", p.saddle_drift),
                format!("{:.2}", p.mbps),
                grouped(p.bytes as f64),
                format!("{:.1}", p.bytes_per_gaussian),
            ]
        };
        Table::new(head).with_rows(self.points.iter().map(row))
    }
}

/// What was measured.
fn described(fields: &[FieldRd]) -> Table {
    let row = |field: &FieldRd| {
        let assumed = if field.duration_assumed { " (assumed)" } else { "" };
        let duration_s = decimal(f64::from(field.duration_s), 3);
        let FieldRd { field, gaussians, features, coder, .. } = field;
        vec![
            field.clone(),
            grouped(*gaussians as f64),
            format!("{duration_s} s{assumed}"),
            features.to_string(),
            (*coder).to_owned(),
        ]
    };
    Table::new(["field", "Gaussians", "duration", "persistent features", "coder"])
        .with_rows(fields.iter().map(row))
}

/// What the numbers of the points mean, as HTML.
fn about(fields: &[FieldRd]) -> String {
    let FloorSettings { voxels, epsilon, .. } = FloorSettings::default();
    let [width, height] = fields[0].image_size;
    format!(
        "<p>All rows rank the same field and share the coder. <i>LightGaussian</i>, <i>RadSplat</i> (largest blending \
         contribution) and <i>mass</i> keep the first Gaussians of their ranking. <i>mass + floor</i> restores features \
         that are gone, by the paper's measure alone. <i>ours</i> is the selection of <code>package --budget</code>: it \
         tries every ranking, alone and with the floor, which then also restores severed features, and uses the one \
         with the highest PSNR. Among those within {RESOLUTION_DB} dB of the highest it uses the one that preserves more \
         features.</p>\n\
         <p>PSNR compares images of the decoded package with images of the unpruned field over black, because there is no \
         ground truth here: {width}x{height}, {COUNT} views at most, from camera positions and at instants that neither \
         the rankings nor the selection use. As in <code>package</code>, the coder's precision is chosen so that images \
         of the decoded package reach {QUALITY_DB} dB against images of the Gaussians before coding. Topology is the \
         fraction of the field's persistent features that the selected Gaussians preserve (the paper's rate, a recall): \
         components of the density's superlevel sets on a grid of {voxels} voxels along the longest axis, 26 neighbours, \
         persistence above {epsilon} of the largest density, at {FLOOR_INSTANTS} instants (one if static). Precision is \
         the fraction of the package's features that are features of the field; severed pieces lower it. Drift is the \
         mean change of the density at which a preserved feature ends, as a fraction of the largest density. Mbps is the \
         size of the package over the duration of the clip.</p>\n"
    )
}

/// What the rates mean, as HTML.
fn about_rates(fields: &[FieldRd]) -> String {
    let [width, height] = fields[0].rate_image_size;
    prose(&format!(
        "The most visible Gaussians, coded to a target PSNR of images of the decoded package against images of the \
         Gaussians before coding, of {width}x{height} pixels. B/G is the size of the file in bytes per Gaussian: with \
         equal precision for visible and invisible Gaussians, with each number rounded alone, and with numbers that \
         are rounded jointly, as `package` rounds them, all at the same target PSNR. PSNR is measured in views that chose \
         nothing, so it differs from the target."
    ))
}

/// Rate of the coder, for each field.
fn rates(fields: &[FieldRd]) -> Table {
    let head = [
        "field",
        "Gaussians",
        "target PSNR (dB)",
        "PSNR (dB)",
        "Mbps",
        "bytes",
        "all alike B/G",
        "alone B/G",
        "jointly B/G",
    ];
    let row = |field: &FieldRd, rate: &CoderRate| {
        let CoderRate { gaussians, target_db, self_psnr_db, mbps, bytes, alike, jointly, .. } = *rate;
        let each = |bytes: usize| format!("{:.2}", bytes as f64 / gaussians as f64);
        vec![
            field.field.clone(),
            grouped(gaussians as f64),
            target_db.to_string(),
            format!("{self_psnr_db:.1}"),
            format!("{mbps:.2}"),
            grouped(bytes as f64),
            each(alike),
            each(bytes),
            each(jointly),
        ]
    };
    let rows = fields.iter().flat_map(|field| field.rates.iter().map(move |rate| row(field, rate)));
    Table::new(head).with_rows(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, budgets: &[usize]) -> FieldRd {
        let point = |budget: usize, (i, row): (usize, Selector)| RatePoint {
            budget,
            row,
            ranking: "mass",
            restored: i,
            psnr_db: 20.0 + i as f64 + budget as f64 / 1000.0,
            recall: 0.5 + 0.1 * i as f64,
            precision: 1.0,
            f1: 0.75,
            saddle_drift: 0.01,
            mbps: budget as f64 * 1e-4,
            bytes: budget * 20,
            bytes_per_gaussian: 20.0,
        };
        let points = budgets
            .iter()
            .flat_map(|&budget| Selector::ALL.into_iter().enumerate().map(move |r| point(budget, r)));
        FieldRd {
            field: name.into(),
            gaussians: 1 + budgets.first().copied().unwrap_or(0),
            duration_s: 1.0,
            duration_assumed: true,
            coder: "fixed",
            features: 7,
            image_size: [320, 240],
            points: points.collect(),
            rate_image_size: [640, 480],
            rates: vec![CoderRate {
                gaussians: 5_000,
                target_db: 45.0,
                self_psnr_db: 45.06,
                mbps: 0.25,
                bytes: 31_250,
                bytes_per_gaussian: 6.25,
                alike: 42_000,
                jointly: 30_000,
            }],
        }
    }

    fn part_of(fields: &[FieldRd]) -> ReportPart {
        part(fields).unwrap()
    }

    #[test]
    fn one_field_has_its_tables_and_its_plot() {
        let ReportPart { body, text, json, .. } = part_of(&[field("a<b", &[10_000, 5_000])]);
        let cells = |cells: &[&str]| format!("<td>{}</td>", cells.join("</td><td>"));
        let full = [
            "ours", "5000", "mass", "4", "29.00", "0.900", "1.000", "0.750", "0.0100", "0.50", "100,000",
            "20.0",
        ];
        let rate = ["a&lt;b", "5,000", "45", "45.1", "0.25", "31,250", "8.40", "6.25", "6.00"];
        for row in [&["ours", "34.00", "29.00"][..], &full, &rate] {
            assert!(body.contains(&cells(row)), "{row:?}: {body}");
        }
        assert!(
            !body.contains(MEAN) && body.contains("1 s (assumed)") && body.contains("of 640x480 pixels"),
            "{body}"
        );
        assert_eq!(body.matches("<circle").count(), 2 * 10, "PSNR and topology of every point");
        assert!(text.contains("ours           34.00  29.00") && text.contains("a<b"), "{text}");
        assert_eq!(json["rd"][0]["points"][9]["psnr_db"], 29.0);
    }

    #[test]
    fn a_mean_counts_only_fields_that_have_the_budget() {
        let mut other = field("b", &[5_000]);
        other.points.iter_mut().for_each(|point| point.psnr_db += 2.0);
        let ReportPart { body, text, json, .. } = part_of(&[field("a", &[10_000, 5_000]), other]);
        assert_eq!(
            (json["rd_mean"].as_array().unwrap().len(), &json["rd_mean"][9]["psnr_db"]),
            (10, &30.0.into())
        );
        assert_eq!(body.matches("<svg").count(), 2, "one budget of b makes no curve");
        assert!(text.contains("PSNR (dB)      10000 (of 1)  5000 (of 2)"), "{text}");
        assert!(text.contains("ours                  34.00        30.00"), "{text}");
    }

    #[test]
    fn a_field_below_the_smallest_budget_is_reported() {
        let ReportPart { body, text, .. } = part_of(&[field("tiny", &[])]);
        assert!(!body.contains("<svg") && body.contains("No budget is smaller than the field"), "{body}");
        assert!(text.contains("No budget is smaller than the field"), "{text}");
    }

    #[test]
    fn one_budget_has_a_table_and_no_plot() {
        let ReportPart { body, .. } = part_of(&[field("small", &[5_000])]);
        assert!(!body.contains("<svg") && body.contains("One budget makes no curve"), "{body}");
        assert!(body.contains("<td>ours</td><td>29.00</td>"), "{body}");
    }
}
