//! Field files with a [`FitRecord`]: how a field was fitted, as the comments of its file record it.

use std::ops::Range;
use std::path::Path;

use codec::{ClipInfo, Field};
use formats::{Hints, ImportError, Imported, MARK, write_commented_field_file};
use program::Fault;
use refine::capture::Holdout;

use crate::parse::{range, three_numbers};

/// Value of the comment on mattes.
const MATTES: &str = "difference";

/// The photographs that a field was fitted to, and by what; `None` where its file does not record it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitRecord {
    /// Held-out frames.
    pub holdout: Option<Holdout>,
    /// Frames of the capture that the clip shows, counted from 0, held-out ones included.
    pub frames: Option<Range<usize>>,
    /// Times of the first and the last of these frames in the capture, in seconds; `None` too if the frame rate was
    /// assumed.
    pub seconds: Option<[f64; 2]>,
    /// Checksum of the times of the photographs in the clip, as [`crate::capture::CaptureFiles::fit_record`]
    /// computes it.
    pub timing: Option<u32>,
    /// Whether photographs without masks had mattes.
    pub has_mattes: bool,
    /// The point of the capture's world that is the origin of the field's; `None` if they are one.
    pub origin: Option<[f64; 3]>,
    /// Name of the graphics device that computed the fit; `None` of the CPU's.
    pub device: Option<String>,
}

impl FitRecord {
    /// The point of the capture's world that is the origin of the field; `None` of a field that no record is of, as packages and
    /// fields of other programs.
    pub(crate) fn recorded_origin(&self) -> Option<[f64; 3]> {
        self.origin.or(self.frames.as_ref().map(|_| [0.0; 3]))
    }

    /// Keys and values of the comments of a field file.
    pub(crate) fn comments(&self) -> Vec<(&'static str, String)> {
        let FitRecord { holdout, frames, seconds, timing, has_mattes, origin, device } = self;
        [
            holdout.map(|holdout| ("holdout", holdout.name().to_owned())),
            frames.as_ref().map(|Range { start, end }| ("frames", format!("{start}..{end}"))),
            seconds.map(|[first, last]| ("seconds", format!("{first} {last}"))),
            timing.map(|timing| ("timing", format!("{timing:08x}"))),
            has_mattes.then(|| ("mattes", MATTES.to_owned())),
            origin.map(|[x, y, z]| ("origin", format!("{x} {y} {z}"))),
            device.as_ref().map(|device| ("device", device.clone())),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// The record in a file's comments.
    ///
    /// # Errors
    /// The comment that cannot be used.
    pub fn from_hints(hints: &Hints) -> Result<FitRecord, String> {
        let mut record = FitRecord::default();
        for (key, value) in &hints.comments {
            record.take(key, value).map_err(|()| format!("comment {MARK} {key}: cannot use `{value}`"))?;
        }
        Ok(record)
    }

    /// Takes the value of a comment with one of these keys; ignores other keys.
    ///
    /// # Errors
    /// If the value cannot be used.
    fn take(&mut self, key: &str, value: &str) -> Result<(), ()> {
        match key {
            "holdout" => self.holdout = Some(Holdout::named(value).ok_or(())?),
            "frames" => self.frames = Some(range(value).ok_or(())?),
            "seconds" => self.seconds = Some(seconds(value).ok_or(())?),
            "timing" => self.timing = Some(u32::from_str_radix(value, 16).map_err(drop)?),
            "origin" => self.origin = Some(point(value).ok_or(())?),
            "device" => self.device = Some(value.to_owned()),
            "mattes" => self.has_mattes = (value == MATTES).then_some(true).ok_or(())?,
            _ => {}
        }
        Ok(())
    }
}

/// Reads a fitted field within the default limits.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem: an error of [`formats::import`], or a record of the fit that
/// cannot be used.
pub fn import(path: &Path) -> anyhow::Result<Imported> {
    let imported = formats::import(path).map_err(fault)?;
    check_record(path, &imported.hints)?;
    Ok(imported)
}

/// Checks the record of the fit in the metadata of the file at `path`.
///
/// # Errors
/// [`Fault::Data`] that names the file and the comment.
pub(crate) fn check_record(path: &Path, hints: &Hints) -> Result<(), Fault> {
    let check = FitRecord::from_hints(hints).map(drop);
    check.map_err(|what| {
        Fault::Data(format!("{}: {what}; get the file again, or export it again", path.display()))
    })
}

/// The fault of a file that cannot be read.
pub(crate) fn fault(error: ImportError) -> Fault {
    Fault::Data(error.to_string())
}

/// A fitted field and the metadata of its clip, without loss, with a record of its fit.
pub fn fitted_field_file(field: &Field, info: &ClipInfo, record: &FitRecord) -> Vec<u8> {
    write_commented_field_file(field, info, &record.comments())
}

/// Two finite numbers in ascending order.
fn seconds(value: &str) -> Option<[f64; 2]> {
    let (first, last) = value.split_once(' ')?;
    let (first, last): (f64, f64) = (first.parse().ok()?, last.parse().ok()?);
    (first <= last && (last - first).is_finite()).then_some([first, last])
}

/// Three finite numbers.
fn point(value: &str) -> Option<[f64; 3]> {
    three_numbers(value, ' ').filter(|point: &[f64; 3]| point.iter().all(|x| x.is_finite()))
}
