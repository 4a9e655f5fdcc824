//! Stability of the renderer: for stiff and extreme fields, the deviation of the GPU's images from the f64
//! reference, and its bound.
//!
//! The crate `measure` runs the suite; this module writes its tables.

use std::fmt::Write;

use measure::stability::CaseResult;
use serde::Serialize;

use super::file::ReportFile;

/// A run of the suite.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stability {
    /// Processor and system.
    pub machine: String,
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Name and version of its driver.
    pub driver: String,
    /// The cases.
    pub stability: Vec<CaseResult>,
}

impl Stability {
    /// Number of failed cases.
    pub fn failures(&self) -> usize {
        self.stability.iter().filter(|row| row.problem.is_some()).count()
    }

    /// The table for a terminal.
    pub fn table(&self) -> String {
        let Stability { machine, adapter, driver, stability } = self;
        let mut text = format!("machine  {machine}\nadapter  {adapter}, {driver}\n");
        let mut group = "";
        for row in stability {
            if row.group != group {
                group = &row.group;
                let _ = writeln!(text, "\n{group:<68}{:>10}{:>8}", "deviation", "bound");
            }
            let (deviation, CaseResult { case, bound, unit, outcome, .. }) = (deviation(row), row);
            let _ = writeln!(text, "  {outcome:<7}{case:<59}{deviation:>10}{bound:>8} {unit}");
            if let Some(problem) = &row.problem {
                let _ = writeln!(text, "         {problem}");
            }
        }
        let _ = writeln!(text, "\n{} of {} cases hold", stability.len() - self.failures(), stability.len());
        text
    }
}

/// The files of the report: Markdown, CSV and JSON.
///
/// # Errors
/// If the JSON cannot be made.
pub fn files(run: &Stability) -> anyhow::Result<Vec<ReportFile>> {
    Ok(vec![
        ReportFile { name: "stability.md".into(), text: markdown(run) },
        ReportFile { name: "stability.csv".into(), text: csv(&run.stability) },
        ReportFile {
            name: "stability.json".into(),
            text: format!("{}\n", serde_json::to_string_pretty(run)?),
        },
    ])
}

fn markdown(run: &Stability) -> String {
    let Stability { machine, adapter, driver, stability } = run;
    let mut text = format!(
        "# Stability

{} of {} cases hold. Machine: {machine}. Adapter: {adapter}, {driver}.

The GPU draws each case into 16-bit floats. The deviation is the largest difference from the f64 reference over all
images, for \"/255\" over all channels including alpha. No pixel may be infinite or NaN, no case may take a minute or
allocate more than 64 MiB plus 1 KiB per Gaussian. The GPU gets the exact numbers of the case. If a package can hold
them, packages by both coders must be within the bound as well; otherwise the encoder must refuse them.
",
        stability.len() - run.failures(),
        stability.len()
    );
    let mut group = "";
    for row in stability {
        if row.group != group {
            group = &row.group;
            let _ = write!(
                text,
                "\n## {group}\n\n| case | outcome | deviation | bound | how | package | Gaussians | pictures | s | MiB |\n\
                 |---|---|--:|--:|---|---|--:|--:|--:|--:|\n"
            );
        }
        let (deviation, CaseResult { case, bound, unit, package, gaussians, pictures, seconds, how, .. }) =
            (deviation(row), row);
        let outcome = match &row.problem {
            None => row.outcome.clone(),
            Some(problem) => format!("**{}**: {}", row.outcome, cell(problem)),
        };
        let mib = row.bytes as f64 / f64::from(1 << 20);
        let _ = writeln!(
            text,
            "| {} | {outcome} | {deviation} | {bound} {unit} | {} | {} | {gaussians} | {pictures} | {seconds:.2} | {mib:.1} |",
            cell(case),
            cell(how),
            cell(package),
        );
    }
    text
}

/// The deviation as text for a table.
fn deviation(row: &CaseResult) -> String {
    row.deviation.map_or_else(|| "none".into(), |deviation| format!("{deviation:.3}"))
}

/// Escapes text for a cell of a Markdown table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

fn csv(rows: &[CaseResult]) -> String {
    let mut text = String::from(
        "group,case,outcome,deviation,bound,unit,package,gaussians,pictures,seconds,bytes,how,problem\n",
    );
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "));
    for row in rows {
        let deviation = row.deviation.map_or_else(String::new, |deviation| deviation.to_string());
        let _ = writeln!(
            text,
            "{},{},{},{deviation},{},{},{},{},{},{:.4},{},{},{}",
            quoted(&row.group),
            quoted(&row.case),
            row.outcome,
            row.bound,
            row.unit,
            quoted(&row.package),
            row.gaussians,
            row.pictures,
            row.seconds,
            row.bytes,
            quoted(&row.how),
            quoted(row.problem.as_deref().unwrap_or_default()),
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run() -> Stability {
        let good = CaseResult {
            group: "stiff in time".into(),
            case: "a \"window\"".into(),
            outcome: "holds".into(),
            deviation: Some(0.7512),
            bound: 1.5,
            unit: "/255".into(),
            package: "taken".into(),
            gaussians: 3,
            pictures: 2,
            seconds: 0.25,
            bytes: 3 << 20,
            how: "|v3 d^3| is small".into(),
            problem: None,
        };
        let bad = CaseResult {
            case: "other".into(),
            outcome: "fails".into(),
            deviation: None,
            problem: Some("pixel 1,1 is NaN".into()),
            ..good.clone()
        };
        let (machine, adapter, driver) = ("two cores".into(), "llvmpipe".into(), "Mesa".into());
        Stability { machine, adapter, driver, stability: vec![good, bad] }
    }

    #[test]
    fn the_table_has_a_line_per_case_with_its_problem() {
        let run = run();
        assert_eq!(run.failures(), 1);
        let table = run.table();
        assert_eq!(table.matches("stiff in time").count(), 1, "{table}");
        assert!(table.contains("0.751     1.5 /255") && table.contains("pixel 1,1 is NaN"), "{table}");
        assert!(table.ends_with("1 of 2 cases hold\n"), "{table}");
    }

    #[test]
    fn files_hold_the_same_numbers() {
        let run = run();
        let [markdown, csv, json] = files(&run).unwrap().try_into().unwrap();
        assert!(
            markdown
                .text
                .contains("| a \"window\" | holds | 0.751 | 1.5 /255 | \\|v3 d^3\\| is small | taken |")
        );
        assert!(markdown.text.contains("**fails**: pixel 1,1 is NaN"), "{}", markdown.text);
        assert!(csv.text.contains("\"a \"\"window\"\"\",holds,0.7512,1.5,/255"), "{}", csv.text);
        assert_eq!(csv.text.lines().count(), 3);
        let value: serde_json::Value = serde_json::from_str(&json.text).unwrap();
        assert_eq!(value["stability"][0]["deviation"], 0.7512);
        assert_eq!(value["stability"][1]["outcome"], "fails");
    }
}
