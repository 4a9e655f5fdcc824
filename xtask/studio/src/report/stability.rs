//! Stability of the renderer: for stiff and extreme fields, the deviation of the GPU's images from the f64
//! reference, and its bound.
//!
//! The crate `measure` runs the suite; this module shows it.

use std::fmt::Write;

use measure::stability::CaseResult;
use serde::Serialize;
use serde_json::Value;

use crate::page::{Table, escape, grouped};
use crate::report::ReportPart;

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
    fn table(&self) -> String {
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

    /// The part of a report.
    ///
    /// # Errors
    /// If a number has no JSON form.
    pub fn part(&self) -> anyhow::Result<ReportPart> {
        let Value::Object(json) = serde_json::to_value(self)? else { unreachable!("a struct is an object") };
        Ok(ReportPart { title: "Stability".into(), body: self.html(), text: self.table(), json })
    }

    fn html(&self) -> String {
        let Stability { machine, adapter, driver, stability } = self;
        let mut text = format!(
            "<p>{} of {} cases hold. Machine: {}. Adapter: {}, {}.</p>\n\
             <p>The GPU draws each case into 16-bit floats. The deviation is the largest difference from the f64 reference \
             over all images, for \"/255\" over all channels including alpha. No pixel may be infinite or NaN, no case may \
             take a minute or allocate more than 64 MiB plus 1 KiB per Gaussian. The GPU gets the exact numbers of the \
             case. If a package can hold them, packages by both coders must be within the bound as well; otherwise the \
             encoder must refuse them.</p>\n",
            stability.len() - self.failures(),
            stability.len(),
            escape(machine),
            escape(adapter),
            escape(driver),
        );
        let head =
            ["case", "outcome", "deviation", "bound", "package", "Gaussians", "pictures", "s", "MiB", "how"];
        for group in stability.chunk_by(|a, b| a.group == b.group) {
            let cells = group.iter().map(|row| {
                let CaseResult { case, bound, unit, package, gaussians, pictures, seconds, how, .. } = row;
                vec![
                    case.clone(),
                    row.problem.as_ref().map_or(row.outcome.clone(), |why| format!("{}: {why}", row.outcome)),
                    deviation(row),
                    format!("{bound} {unit}"),
                    package.clone(),
                    grouped(*gaussians as f64),
                    pictures.to_string(),
                    format!("{seconds:.2}"),
                    format!("{:.1}", row.bytes as f64 / f64::from(1 << 20)),
                    how.clone(),
                ]
            });
            let table = Table::new(head).with_rows(cells).html();
            let _ = write!(text, "<h2>{}</h2>\n{table}", escape(&group[0].group));
        }
        text
    }
}

/// The deviation as text for a table.
fn deviation(row: &CaseResult) -> String {
    row.deviation.map_or_else(|| "none".into(), |deviation| format!("{deviation:.3}"))
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
    fn the_page_and_the_json_hold_the_same_numbers() {
        let ReportPart { body, json, .. } = run().part().unwrap();
        let row = "<td>a &quot;window&quot;</td><td>holds</td><td>0.751</td><td>1.5 /255</td><td>taken</td>";
        assert!(body.contains(row) && body.contains("<td>fails: pixel 1,1 is NaN</td>"), "{body}");
        assert_eq!(json["stability"][0]["deviation"], 0.7512);
        assert_eq!(json["stability"][1]["outcome"], "fails");
    }
}
