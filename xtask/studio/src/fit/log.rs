//! Files beside a field that a fit updates: the table of its progress and a picture.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use refine::fit::{DensityChange, RenderedImage, TrainingView};
use serde::{Deserialize, Serialize};

use crate::scene::beside;

/// A line of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LogEntry {
    /// Steps done.
    pub step: u64,
    /// Seconds of fitting so far, interrupted runs included.
    pub seconds: f64,
    /// Mean loss of the steps since the last line.
    pub loss: f64,
    /// PSNR in a few held-out photographs, of the subject where they have masks, in dB; `None` if none is held out.
    pub held_psnr_db: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Mean number of Gaussians drawn in a picture since the last line.
    pub drawn: usize,
    /// Gaussians added, pruned and relocated since the last line.
    pub density: Density,
    /// Name of the back end and its device.
    pub backend: String,
}

/// Changes by density control over some steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Density {
    /// Gaussians added by cloning and splitting.
    pub added: usize,
    /// Pruned Gaussians.
    pub pruned: usize,
    /// Dead Gaussians relocated to live ones.
    pub relocated: usize,
}

impl Density {
    /// Adds the changes of one step.
    pub(super) fn add(&mut self, change: DensityChange) {
        self.added += change.cloned + change.split;
        self.pruned += change.pruned;
        self.relocated += change.relocated;
    }
}

/// Path of the table of a field's fit, beside the field.
pub fn table_path(field: &Path) -> PathBuf {
    beside(field, "fit.csv")
}

/// Path of the picture of a field's fit, beside the field.
pub fn preview_path(field: &Path) -> PathBuf {
    beside(field, "fit.png")
}

/// The table as CSV.
pub fn csv(entries: &[LogEntry]) -> String {
    let mut text =
        String::from("step,seconds,loss,held_psnr_db,gaussians,drawn,added,pruned,relocated,backend\n");
    for LogEntry { step, seconds, loss, held_psnr_db, gaussians, drawn, density, backend } in entries {
        let held = held_psnr_db.map_or(String::new(), |psnr| format!("{psnr:.3}"));
        let Density { added, pruned, relocated } = density;
        let backend = backend.replace('"', "'");
        writeln!(
            text,
            "{step},{seconds:.1},{loss:.6},{held},{gaussians},{drawn},{added},{pruned},{relocated},\"{backend}\""
        )
        .expect("text grows");
    }
    text
}

/// Parses a table.
///
/// # Errors
/// The problem, with its line number.
pub fn parse(text: &str) -> Result<Vec<LogEntry>, String> {
    let mut lines = (1..).zip(text.lines());
    if lines.next().is_none_or(|(_, head)| head != csv(&[]).trim_end()) {
        return Err("not the table of a fit: its first line is another".into());
    }
    lines.map(|(number, line)| parse_line(line).ok_or(format!("line {number} is not one of a fit"))).collect()
}

fn parse_line(line: &str) -> Option<LogEntry> {
    let mut cells = line.splitn(10, ',');
    let mut cell = || cells.next();
    let number = |cell: Option<&str>| cell?.parse::<f64>().ok().filter(|x| x.is_finite());
    let count = |cell: Option<&str>| cell?.parse::<usize>().ok();
    Some(LogEntry {
        step: cell()?.parse().ok()?,
        seconds: number(cell())?,
        // NaN is valid: the table shows where a fit diverged.
        loss: cell()?.parse().ok()?,
        held_psnr_db: match cell()? {
            "" => None,
            // Infinite if a held-out photograph is matched exactly.
            db => Some(db.parse().ok().filter(|db: &f64| !db.is_nan())?),
        },
        gaussians: count(cell())?,
        drawn: count(cell())?,
        density: Density { added: count(cell())?, pruned: count(cell())?, relocated: count(cell())? },
        backend: cell()?.strip_prefix('"')?.strip_suffix('"')?.to_owned(),
    })
}

/// The photograph and its rendering, side by side.
pub(super) fn preview(view: &TrainingView, picture: &RenderedImage<f32>) -> RgbImage {
    let (width, height) = (picture.width, picture.height);
    let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
    RgbImage::from_fn(2 * width, height, |x, y| {
        let at = |x: u32| (y * width + x) as usize;
        match x < width {
            true => {
                let [r, g, b, _] = view.photograph.pixels[at(x)];
                Rgb([r, g, b])
            }
            false => {
                let [r, g, b, _] = picture.pixels[at(x - width)];
                Rgb([r, g, b].map(byte))
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry() -> LogEntry {
        LogEntry {
            step: 500,
            seconds: 12.5,
            loss: 0.25,
            held_psnr_db: Some(23.125),
            gaussians: 8000,
            drawn: 3200,
            density: Density { added: 3, pruned: 2, relocated: 1 },
            backend: "gpu, a device".into(),
        }
    }

    #[test]
    fn tables_round_trip() {
        let entries = [entry(), LogEntry { held_psnr_db: None, ..entry() }];
        assert_eq!(parse(&csv(&entries)).unwrap(), entries);
        assert_eq!(parse(&csv(&[])).unwrap(), []);
    }

    #[test]
    fn a_loss_may_be_nan() {
        let read = |loss| parse(&csv(&[LogEntry { loss, ..entry() }])).unwrap()[0].loss;
        assert!(read(f64::NAN).is_nan());
        assert_eq!(read(f64::INFINITY), f64::INFINITY);
    }

    #[test]
    fn errors_name_the_line() {
        let table = csv(&[entry()]);
        assert!(parse("a,b\n").unwrap_err().contains("first line"));
        assert!(parse(&format!("{table}500,1")).unwrap_err().contains("line 3"));
        assert!(parse(&table.replace("8000", "many")).unwrap_err().contains("line 2"));
        assert!(parse(&table.replace("12.5", "inf")).is_err());
    }
}
