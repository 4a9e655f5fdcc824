//! What a fit leaves beside its field as it goes: a table of its progress and a picture.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use refine::fit::{DensityChange, RenderedImage, TrainingView};
use serde::{Deserialize, Serialize};

/// A line of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Steps done.
    pub step: u64,
    /// Seconds since the start, those of an interrupted fit included.
    pub seconds: f64,
    /// Mean loss of the steps since the last line.
    pub loss: f64,
    /// PSNR of the subject in a few held photographs, in dB; `None` where nothing is held.
    pub held_psnr_db: Option<f64>,
    /// Gaussians.
    pub gaussians: usize,
    /// Mean number of them in a picture since the last line.
    pub drawn: usize,
    /// Gaussians that were added, taken and moved to others' places since the last line.
    pub density: Density,
    /// What drew them, and on which device.
    pub backend: String,
}

/// What the control of density did over some steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Density {
    /// Gaussians that were cloned or split: how many more there are for it.
    pub added: usize,
    /// Gaussians that were pruned.
    pub pruned: usize,
    /// Gaussians that moved to where others live.
    pub relocated: usize,
}

impl Density {
    /// Adds what one control did.
    pub(super) fn add(&mut self, change: DensityChange) {
        self.added += change.cloned + change.split;
        self.pruned += change.pruned;
        self.relocated += change.relocated;
    }
}

/// Where the table of a field's fit lies: beside it.
pub fn table_path(field: &Path) -> PathBuf {
    beside(field, "fit.csv")
}

/// Where the picture of a field's fit lies.
pub fn preview_path(field: &Path) -> PathBuf {
    beside(field, "fit.png")
}

/// A file beside a field: its path without `.ply`, and this ending.
pub(super) fn beside(field: &Path, ending: &str) -> PathBuf {
    let mut name = field.file_stem().unwrap_or_default().to_owned();
    name.push(".");
    name.push(ending);
    field.with_file_name(name)
}

/// The table as CSV.
pub fn csv(entries: &[Entry]) -> String {
    let mut text =
        String::from("step,seconds,loss,held_psnr_db,gaussians,drawn,added,pruned,relocated,backend\n");
    for Entry { step, seconds, loss, held_psnr_db, gaussians, drawn, density, backend } in entries {
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

/// The entries of a table.
///
/// # Errors
/// What is wrong, and in which line.
pub fn parse(text: &str) -> Result<Vec<Entry>, String> {
    let mut lines = (1..).zip(text.lines());
    if lines.next().is_none_or(|(_, head)| head != csv(&[]).trim_end()) {
        return Err("not the table of a fit: its first line is another".into());
    }
    lines.map(|(number, line)| parse_line(line).ok_or(format!("line {number} is not one of a fit"))).collect()
}

fn parse_line(line: &str) -> Option<Entry> {
    let mut cells = line.splitn(10, ',');
    let mut cell = || cells.next();
    let number = |cell: Option<&str>| cell?.parse::<f64>().ok().filter(|x| x.is_finite());
    let count = |cell: Option<&str>| cell?.parse::<usize>().ok();
    Some(Entry {
        step: cell()?.parse().ok()?,
        seconds: number(cell())?,
        // It is no number where a fit went astray, which its table is there to show.
        loss: cell()?.parse().ok()?,
        held_psnr_db: match cell()? {
            "" => None,
            // Held photographs can be met exactly.
            db => Some(db.parse().ok().filter(|db: &f64| !db.is_nan())?),
        },
        gaussians: count(cell())?,
        drawn: count(cell())?,
        density: Density { added: count(cell())?, pruned: count(cell())?, relocated: count(cell())? },
        backend: cell()?.strip_prefix('"')?.strip_suffix('"')?.to_owned(),
    })
}

/// The photograph and what is drawn of it, side by side.
pub(super) fn preview(shot: &TrainingView, picture: &RenderedImage<f32>) -> RgbImage {
    let (width, height) = (picture.width, picture.height);
    let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
    RgbImage::from_fn(2 * width, height, |x, y| {
        let at = |x: u32| (y * width + x) as usize;
        match x < width {
            true => {
                let [r, g, b, _] = shot.photograph.pixels[at(x)];
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

    fn entry() -> Entry {
        Entry {
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
    fn tables_are_read_as_they_were_written() {
        let entries = [entry(), Entry { held_psnr_db: None, ..entry() }];
        assert_eq!(parse(&csv(&entries)).unwrap(), entries);
        assert_eq!(parse(&csv(&[])).unwrap(), []);
    }

    #[test]
    fn a_loss_may_be_no_number() {
        let read = |loss| parse(&csv(&[Entry { loss, ..entry() }])).unwrap()[0].loss;
        assert!(read(f64::NAN).is_nan());
        assert_eq!(read(f64::INFINITY), f64::INFINITY);
    }

    #[test]
    fn what_is_no_table_is_refused_by_line() {
        let table = csv(&[entry()]);
        assert!(parse("a,b\n").unwrap_err().contains("first line"));
        assert!(parse(&format!("{table}500,1")).unwrap_err().contains("line 3"));
        assert!(parse(&table.replace("8000", "many")).unwrap_err().contains("line 2"));
        assert!(parse(&table.replace("12.5", "inf")).is_err());
    }
}
