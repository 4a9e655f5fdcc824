//! Writes rate and distortion as Markdown, CSV and plots, per field and as a mean of the fields.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::rates::{CoderRate, SimplerCoders};
use super::result::{FieldRd, RatePoint, Selector};
use super::views::COUNT;
use crate::messages::decimal;
use crate::package::{FLOOR_INSTANTS, QUALITY_DB};
use crate::report::file::ReportFile;
use crate::report::plot::{LineChart, PlotLine, Scale, svg};
use refine::prune::{FloorSettings, RESOLUTION_DB};

/// Name of the mean in the list of fields.
const MEAN: &str = "mean of the fields";

/// The files of the report on `fields`, of which there is at least one: tables, CSV, and a plot of each field
/// and of their mean where it has several budgets.
///
/// # Errors
/// If a plot cannot be drawn.
pub fn files(fields: &[FieldRd]) -> anyhow::Result<Vec<ReportFile>> {
    let mut curves: Vec<Curve> = fields.iter().map(Curve::of).collect();
    if fields.len() > 1 {
        curves.insert(0, Curve::mean(fields));
    }
    let mut plots = Vec::new();
    for (i, curve) in curves.iter().enumerate().filter(|(_, curve)| curve.has_line()) {
        plots.push(ReportFile { name: plot_name(i), text: plot(curve)? });
    }
    let mut files = vec![
        ReportFile { name: "rd.md".into(), text: markdown(fields, &curves) },
        ReportFile { name: "rd.csv".into(), text: csv(&curves) },
    ];
    files.append(&mut plots);
    Ok(files)
}

/// The points of a field, or the means of the points of several.
struct Curve {
    name: String,
    /// Points, each with the number of fields that it is a mean of.
    points: Vec<(RatePoint, usize)>,
}

impl Curve {
    fn of(field: &FieldRd) -> Curve {
        Curve {
            name: field.field.clone(),
            points: field.points.iter().cloned().map(|point| (point, 1)).collect(),
        }
    }

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
                let mean = |of: fn(&RatePoint) -> f64| {
                    same.iter().map(|point| of(point)).sum::<f64>() / same.len() as f64
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
}

/// File name of the plot of the `i`th curve: fields may have equal names, and names may contain any character.
fn plot_name(i: usize) -> String {
    if i == 0 { "rd.svg".into() } else { format!("rd-{i}.svg") }
}

fn plot(curve: &Curve) -> anyhow::Result<String> {
    let line = |row: Selector, y: fn(&RatePoint) -> f64| {
        let points = curve.points.iter().map(|(point, _)| point).filter(|point| point.row == row);
        PlotLine { name: row.name().into(), points: points.map(|point| (point.mbps, y(point))).collect() }
    };
    let panel = |title: &str, y: fn(&RatePoint) -> f64| LineChart {
        title: title.into(),
        lines: Selector::ALL.map(|row| line(row, y)).to_vec(),
        rings: Vec::new(),
        from_zero: false,
        cuts: Vec::new(),
    };
    let title = format!("{}: PSNR after decoding (dB)", curve.name);
    svg(
        Scale::Logarithmic,
        "Mbps",
        &[panel(&title, |p| p.psnr_db), panel("persistent features preserved", |p| p.recall)],
    )
}

/// A column of the tables of points.
struct RateColumn {
    /// Heading in the CSV.
    csv: &'static str,
    /// Heading in Markdown.
    markdown: &'static str,
    value: RateColumnValue,
}

/// The value of a point in a column.
enum RateColumnValue {
    Text(fn(&RatePoint) -> &'static str),
    /// A number, with its digits after the point in the CSV and in Markdown.
    Number(fn(&RatePoint) -> f64, [usize; 2]),
}

const fn text(name: &'static str, value: fn(&RatePoint) -> &'static str) -> RateColumn {
    RateColumn { csv: name, markdown: name, value: RateColumnValue::Text(value) }
}

const fn number(
    csv: &'static str,
    markdown: &'static str,
    digits: [usize; 2],
    value: fn(&RatePoint) -> f64,
) -> RateColumn {
    RateColumn { csv, markdown, value: RateColumnValue::Number(value, digits) }
}

/// The columns of all tables of points, in their order.
const COLUMNS: [RateColumn; 12] = [
    number("budget", "Gaussians", [0, 0], |p| p.budget as f64),
    text("row", |p| p.row.name()),
    text("ranking", |p| p.ranking),
    number("restored", "restored", [0, 0], |p| p.restored as f64),
    number("psnr_db", "PSNR (dB)", [4, 2], |p| p.psnr_db),
    number("recall", "topology", [5, 3], |p| p.recall),
    number("precision", "precision", [5, 3], |p| p.precision),
    number("f1", "F1", [5, 3], |p| p.f1),
    number("saddle_drift", "drift", [6, 4], |p| p.saddle_drift),
    number("mbps", "Mbps", [5, 2], |p| p.mbps),
    number("bytes", "bytes", [0, 0], |p| p.bytes as f64),
    number("bytes_per_gaussian", "B/G", [4, 1], |p| p.bytes_per_gaussian),
];

impl RateColumn {
    /// The cell of a point: in the CSV, and in Markdown.
    fn cells(&self, point: &RatePoint) -> [String; 2] {
        match self.value {
            RateColumnValue::Text(value) => [value(point); 2].map(str::to_owned),
            RateColumnValue::Number(value, digits) => {
                digits.map(|digits| format!("{:.digits$}", value(point)))
            }
        }
    }

    /// The alignment of the column in Markdown.
    fn alignment(&self) -> &'static str {
        match self.value {
            RateColumnValue::Text(_) => "---",
            RateColumnValue::Number(..) => "--:",
        }
    }
}

fn csv(curves: &[Curve]) -> String {
    let mut text = format!("field,fields,{}\n", COLUMNS.map(|column| column.csv).join(","));
    for Curve { name, points } in curves {
        let name = name.replace('"', "\"\"");
        for (point, fields) in points {
            let cells = COLUMNS.map(|column| column.cells(point)[0].clone());
            let _ = writeln!(text, "\"{name}\",{fields},{}", cells.join(","));
        }
    }
    text
}

fn markdown(fields: &[FieldRd], curves: &[Curve]) -> String {
    let mut text = format!("# Rate and distortion\n\n{}\n", caption(fields));
    rates(&mut text, fields);
    for (i, curve) in curves.iter().enumerate() {
        let _ = write!(text, "\n## {}\n\n", curve.name);
        if curve.points.is_empty() {
            text.push_str("No budget is smaller than the field: nothing to select.\n");
            continue;
        }
        match curve.has_line() {
            true => {
                let _ = write!(text, "![PSNR and topology over the rate]({})\n\n", plot_name(i));
            }
            false => text.push_str("One budget makes no curve: the tables hold its numbers.\n\n"),
        }
        compact(&mut text, curve);
        full(&mut text, curve);
    }
    text
}

/// The table of fields and the explanation of the numbers.
fn caption(fields: &[FieldRd]) -> String {
    let settings = FloorSettings::default();
    let mut text = String::from(
        "| field | Gaussians | duration | persistent features | coder |\n|---|---|---|---|---|\n",
    );
    for field in fields {
        let assumed = if field.duration_assumed { " (assumed)" } else { "" };
        let duration_s = decimal(f64::from(field.duration_s), 3);
        let FieldRd { field, gaussians, features, coder, .. } = field;
        let _ = writeln!(text, "| {field} | {gaussians} | {duration_s} s{assumed} | {features} | {coder} |");
    }
    let [width, height] = fields[0].image_size;
    let _ = write!(
        text,
        "
All rows rank the same field and share the coder. *LightGaussian*, *RadSplat* (largest blending contribution) and
*mass* keep the first Gaussians of their ranking. *mass + floor* restores features that are gone, by the paper's
measure alone. *ours* is the selection of `package --budget`: it tries every ranking, alone and with the floor, which
then also restores severed features, and uses the one with the highest PSNR. Among those within {RESOLUTION_DB} dB of
the highest it uses the one that preserves more features.

PSNR compares images of the decoded package with images of the unpruned field over black, because there is no ground
truth here: {width}x{height}, {COUNT} views at most, from camera positions and at instants that neither the rankings nor the
selection use. As in `package`, the coder's precision is chosen so that images of the decoded package
reach {QUALITY_DB} dB against images of the Gaussians before coding. Topology is the fraction of the field's persistent
features that the selected Gaussians preserve (the paper's rate, a recall): components of the density's superlevel sets
on a grid of {} voxels along the longest axis, 26 neighbours, persistence above {} of the largest density, at
{FLOOR_INSTANTS} instants (one if static). Precision is the fraction of the package's features that are features of the
field; severed pieces lower it. Drift is the mean change of the density at which a preserved feature ends, as a fraction
of the largest density. Mbps is the size of the package over the duration of the clip.
",
        settings.voxels, settings.epsilon,
    );
    text
}

/// Rate of the coder, per field.
fn rates(text: &mut String, fields: &[FieldRd]) {
    let [width, height] = fields[0].rate_image_size;
    let _ = write!(
        text,
        "\n## Rate of the coder\n\nThe most visible Gaussians, coded to a target PSNR of images of the decoded package \
         against images of the Gaussians before coding, of {width}x{height} pixels. B/G is the size of the file in bytes per Gaussian. The columns \
         before it are sizes by simpler coders: *order 0* is the entropy of the numbers, *+ order* the same with a free \
         order, *+ prediction* the entropy of the residuals; contexts save the rest. *all alike* is the complete coder \
         at the same PSNR, with equal precision for visible and invisible Gaussians; *context* is that coder instead of \
         `rans`; *jointly* has numbers that are rounded jointly, as `package` rounds them.\n\n\
         | field | Gaussians | target PSNR (dB) | PSNR (dB) | Mbps | bytes | order 0 | + order | + prediction | B/G | all alike | context | jointly |\n\
         |---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    for field in fields {
        for CoderRate {
            gaussians,
            target_db,
            self_psnr_db,
            mbps,
            bytes,
            bytes_per_gaussian,
            simpler,
            jointly,
        } in &field.rates
        {
            let SimplerCoders { order_0, ordered, predicted, alike, context } = *simpler;
            let [order_0, ordered, predicted, alike, context, jointly] =
                [order_0, ordered, predicted, alike, context, *jointly as f64]
                    .map(|bytes| format!("{:.2}", bytes / *gaussians as f64));
            let _ = writeln!(
                text,
                "| {} | {gaussians} | {target_db} | {self_psnr_db:.1} | {mbps:.2} | {bytes} | {order_0} | {ordered} | \
                 {predicted} | {bytes_per_gaussian:.2} | {alike} | {context} | {jointly} |",
                field.field
            );
        }
    }
}

/// PSNR and topology in the form of the paper's table.
fn compact(text: &mut String, curve: &Curve) {
    let budgets: BTreeSet<usize> = curve.points.iter().map(|(point, _)| point.budget).collect();
    let of_fields = |budget: usize| match curve.points.iter().find(|(point, _)| point.budget == budget) {
        Some((_, fields)) if curve.name == MEAN => format!(" (of {fields})"),
        _ => String::new(),
    };
    for (title, value) in [
        ("PSNR (dB)", (|p: &RatePoint| format!("{:.2}", p.psnr_db)) as fn(&RatePoint) -> String),
        ("Topology", |p: &RatePoint| format!("{:.3}", p.recall)),
    ] {
        let _ = write!(text, "| {title} |");
        budgets.iter().rev().for_each(|&budget| {
            let _ = write!(text, " {budget}{} |", of_fields(budget));
        });
        let _ = writeln!(text, "\n|---|{}", "---|".repeat(budgets.len()));
        for row in Selector::ALL {
            let _ = write!(text, "| {} |", row.name());
            for (point, _) in curve.points.iter().filter(|(point, _)| point.row == row) {
                let _ = write!(text, " {} |", value(point));
            }
            text.push('\n');
        }
        text.push('\n');
    }
}

/// All numbers of a curve.
fn full(text: &mut String, curve: &Curve) {
    let _ = writeln!(text, "| {} |", COLUMNS.map(|column| column.markdown).join(" | "));
    let _ = writeln!(text, "|{}|", COLUMNS.map(|column| column.alignment()).join("|"));
    for (point, _) in &curve.points {
        let cells = COLUMNS.map(|column| column.cells(point)[1].clone());
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
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
                simpler: SimplerCoders {
                    order_0: 5e4,
                    ordered: 45e3,
                    predicted: 4e4,
                    alike: 42e3,
                    context: 41e3,
                },
                jointly: 30_000,
            }],
        }
    }

    fn file<'a>(files: &'a [ReportFile], name: &str) -> &'a str {
        &files.iter().find(|file| file.name == name).unwrap_or_else(|| panic!("no {name}")).text
    }

    #[test]
    fn one_field_has_its_tables_and_its_plot() {
        let files = files(&[field("a", &[10_000, 5_000])]).unwrap();
        assert_eq!(files.len(), 3);
        let csv = file(&files, "rd.csv");
        assert_eq!(csv.lines().count(), 1 + 10);
        let columns = |line: &str| line.split(',').count();
        assert!(csv.lines().all(|line| columns(line) == columns(csv.lines().next().unwrap())), "{csv}");
        assert!(csv.contains("\"a\",1,5000,ours,mass,4,29.0000,0.90000"), "{csv}");
        let text = file(&files, "rd.md");
        assert!(text.contains("| ours | 34.00 | 29.00 |"), "{text}");
        let full =
            "| 5000 | ours | mass | 4 | 29.00 | 0.900 | 1.000 | 0.750 | 0.0100 | 0.50 | 100000 | 20.0 |";
        assert!(text.contains(full), "{text}");
        assert!(
            text.contains(
                "| a | 5000 | 45 | 45.1 | 0.25 | 31250 | 10.00 | 9.00 | 8.00 | 6.25 | 8.40 | 8.20 | 6.00 |"
            ),
            "{text}"
        );
        assert!(!text.contains(MEAN) && text.contains("1 s (assumed)"), "{text}");
        assert_eq!(file(&files, "rd.svg").matches("<circle").count(), 2 * 10);
    }

    #[test]
    fn a_mean_counts_only_fields_that_have_the_budget() {
        let mut other = field("b", &[5_000]);
        other.points.iter_mut().for_each(|point| point.psnr_db += 2.0);
        let files = files(&[field("a", &[10_000, 5_000]), other]).unwrap();
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names, ["rd.md", "rd.csv", "rd.svg", "rd-1.svg"], "one budget of b makes no curve");
        let text = file(&files, "rd.md");
        assert!(text.contains("| PSNR (dB) | 10000 (of 1) | 5000 (of 2) |"), "{text}");
        assert!(text.contains("| ours | 34.00 | 30.00 |"), "{text}");
    }

    #[test]
    fn a_field_below_the_smallest_budget_is_reported() {
        let files = files(&[field("tiny", &[])]).unwrap();
        assert_eq!(files.len(), 2, "no plot");
        assert!(file(&files, "rd.md").contains("No budget is smaller than the field"));
        assert_eq!(file(&files, "rd.csv").lines().count(), 1);
    }

    #[test]
    fn one_budget_has_a_table_and_no_plot() {
        let files = files(&[field("small", &[5_000])]).unwrap();
        assert_eq!(files.len(), 2, "no plot");
        let text = file(&files, "rd.md");
        assert!(text.contains("One budget makes no curve") && text.contains("| ours | 29.00 |"), "{text}");
        assert!(!text.contains("rd.svg") && text.contains("of 640x480 pixels"), "{text}");
    }
}
