//! Work, time and PSNR of fits, read from the tables that `fit` writes beside fields.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::fit::log::{LogEntry, parse, table_path};
use crate::messages::unreadable;
use measure::parameter::{FlowStage, Parameter, ParameterValue, Quartiles};
use program::Fault;

/// Largest table accepted, in bytes: enough for a line for each of a million steps.
const BYTES_MAX: u64 = 100 << 20;

/// Suffix of table file names.
const ENDING: &str = ".fit.csv";

/// Unit of the work of a fit.
pub const WORK: &str = "millions of Gaussians drawn";

/// The table of one fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FitLog {
    /// Name of the fitted field.
    pub name: String,
    /// Rows of the table.
    pub entries: Vec<LogEntry>,
}

/// Finds the tables beside a field file, or in a folder, in order of their paths.
///
/// # Errors
/// [`Fault::Data`] if the folder cannot be read.
pub fn find(input: &Path) -> Result<Vec<PathBuf>, Fault> {
    if !input.is_dir() {
        return Ok(Some(table_path(input)).filter(|path| path.is_file()).into_iter().collect());
    }
    let fault = |error: std::io::Error| unreadable(input, &error);
    let mut found = Vec::new();
    for entry in input.read_dir().map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        found.extend(Some(path).filter(|path| path.to_string_lossy().ends_with(ENDING)));
    }
    found.sort();
    Ok(found)
}

/// Reads the tables that [`find`] finds beside `input`. Skips files that are not tables of a fit, with a note on stderr.
///
/// # Errors
/// [`Fault::Data`] if the folder cannot be read.
pub fn load_beside(input: &Path) -> Result<Vec<FitLog>, Fault> {
    let usable = |path: PathBuf| load(&path).inspect_err(|fault| eprintln!("note: skipped: {fault}")).ok();
    Ok(find(input)?.into_iter().filter_map(usable).collect())
}

/// Reads a table.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem.
pub fn load(path: &Path) -> Result<FitLog, Fault> {
    let fault = |what: String| Fault::Data(format!("{}: {what}", path.display()));
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| unreadable(path, &error))?;
    file.take(BYTES_MAX + 1).read_to_end(&mut bytes).map_err(|error| unreadable(path, &error))?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(fault(format!("too long for the table of a fit, which has at most {BYTES_MAX} bytes")));
    }
    let text = String::from_utf8(bytes).map_err(|error| fault(error.to_string()))?;
    let entries = parse(&text).map_err(fault)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(FitLog { name: name.strip_suffix(ENDING).unwrap_or(&name).to_owned(), entries })
}

impl FitLog {
    /// The rows that measured held-out photographs, with the work until then, in millions of Gaussians drawn. That is
    /// a count: it does not depend on the machine, and a step costs about as much as the Gaussians that it draws.
    fn measured_rows(&self) -> impl Iterator<Item = (f64, &LogEntry, f64)> {
        let (mut work, mut last_step) = (0.0, 0);
        self.entries.iter().filter_map(move |entry| {
            work += 1e-6 * entry.step.saturating_sub(last_step) as f64 * entry.drawn as f64;
            last_step = entry.step;
            Some((work, entry, entry.held_psnr_db?))
        })
    }
}

/// PSNR over the work of the fits: one point for each row that measured held-out photographs, fit by fit. `None`
/// without such rows.
pub fn parameter(logs: &[FitLog]) -> Option<Parameter> {
    let point = |log: &FitLog, (work, entry, psnr_db): (f64, &LogEntry, f64)| {
        let counts = [
            ("steps", entry.step as f64),
            ("gaussians", entry.gaussians as f64),
            ("gaussians_in_a_picture", entry.drawn as f64),
        ];
        let value = format!("{} at step {}", log.name, entry.step);
        ParameterValue {
            run_time_ms: Some(Quartiles::exactly(1e3 * entry.seconds)),
            ..ParameterValue::new(&value, false, Quartiles::exactly(work), psnr_db, &counts)
        }
    };
    let points: Vec<ParameterValue> =
        logs.iter().flat_map(|log| log.measured_rows().map(move |row| point(log, row))).collect();
    (!points.is_empty()).then(|| {
        Parameter {
            stage: FlowStage::Fitting,
            name: "fit".into(),
            about: "PSNR of the subject in held-out photographs during a fit.".into(),
            why_default: String::new(),
            cost: WORK.into(),
            points,
        }
        .mark_front()
    })
}

/// The points of [`parameter`] by fit.
pub fn points_by_fit<'a>(logs: &[FitLog], parameter: &'a Parameter) -> Vec<&'a [ParameterValue]> {
    let mut rest = &parameter.points[..];
    let split = |log: &FitLog| {
        let (points, others) = rest.split_at(log.measured_rows().count());
        rest = others;
        points
    };
    logs.iter().map(split).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::log::{Density, csv};

    fn entry(step: u64, held_psnr_db: Option<f64>) -> LogEntry {
        LogEntry {
            step,
            seconds: 0.01 * step as f64,
            loss: 0.1,
            held_psnr_db,
            gaussians: 800,
            drawn: 300,
            density: Density::default(),
            backend: "cpu".into(),
        }
    }

    #[test]
    fn tables_are_found_beside_fields_and_in_their_folders() {
        let folder = tempfile::tempdir().unwrap();
        let field = folder.path().join("a.ply");
        std::fs::write(&field, "").unwrap();
        assert_eq!(find(&field).unwrap(), Vec::<PathBuf>::new());
        let table = folder.path().join("a.fit.csv");
        std::fs::write(&table, csv(&[entry(100, Some(20.0)), entry(200, Some(22.0))])).unwrap();
        assert_eq!(find(&field).unwrap(), std::slice::from_ref(&table));
        assert_eq!(find(folder.path()).unwrap(), std::slice::from_ref(&table));

        let log = load(&table).unwrap();
        assert_eq!((log.name.as_str(), log.entries.len()), ("a", 2));
        let parameter = parameter(&[log]).unwrap();
        assert_eq!(parameter.points[1].value, "a at step 200");
        assert!(parameter.points.iter().all(|point| point.on_front));
        std::fs::write(&table, "nonsense").unwrap();
        let error = load(&table).unwrap_err();
        assert!(error.exit_code() == 3 && error.to_string().contains("a.fit.csv"), "{error}");
        assert_eq!(load_beside(folder.path()).unwrap(), []);
        // A sparse file takes no disk space.
        File::create(&table).unwrap().set_len(BYTES_MAX + 1).unwrap();
        assert!(load(&table).unwrap_err().to_string().contains("too long"));
    }

    #[test]
    fn the_front_is_of_all_fits_over_their_work() {
        let rows = |held: [f64; 3], drawn: usize| {
            let row = |(step, held)| LogEntry { drawn, ..entry(step, Some(held)) };
            [100, 200, 400].into_iter().zip(held).map(row).collect()
        };
        // The second fit takes twice the work for its steps, and overtakes the first at its second row.
        let logs = [
            FitLog { name: "a".into(), entries: rows([20.0, 22.0, 21.0], 1000) },
            FitLog { name: "b".into(), entries: rows([19.0, 24.0, 26.0], 2000) },
        ];
        let parameter = parameter(&logs).unwrap();
        let by_fit = points_by_fit(&logs, &parameter);
        let work =
            |points: &[ParameterValue]| points.iter().map(|point| point.cost.median).collect::<Vec<_>>();
        let front = |points: &[ParameterValue]| points.iter().map(|point| point.on_front).collect::<Vec<_>>();
        assert_eq!(by_fit.len(), 2);
        for (found, expected) in work(by_fit[0]).into_iter().zip([0.1, 0.2, 0.4]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!((work(by_fit[1])[2] - 0.8).abs() < 1e-12);
        assert_eq!((front(by_fit[0]), front(by_fit[1])), (vec![true, true, false], vec![false, true, true]));
    }

    #[test]
    fn a_fit_without_held_out_photographs_has_no_points() {
        assert_eq!(parameter(&[FitLog { name: "a".into(), entries: vec![entry(100, None)] }]), None);
    }
}
