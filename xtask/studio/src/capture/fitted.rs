//! The photographs of a capture that a field was fitted to: [`CaptureFiles::fit_record`] records them, and
//! [`CaptureFiles::keep_fitted`] finds them again.

use std::ops::Range;
use std::path::Path;

use program::Fault;
use refine::capture::Holdout;

use super::capture_files::CaptureFiles;
use crate::fields::FitRecord;
use crate::messages::decimal;

/// Tolerance of recorded seconds: relative, and for times near 0 absolute.
const SECONDS_TOLERANCE: f64 = 1e-6;

impl CaptureFiles {
    /// The record of a fit to the selected frames; `holdout` says which are held out.
    pub fn fit_record(&self, holdout: Holdout) -> FitRecord {
        let seconds = self.stated_fps.map(|_| self.seconds());
        let (frames, timing) = (Some(self.selected_frames()), Some(self.timing()));
        let (has_mattes, origin) = (self.has_mattes(), self.moved_origin());
        FitRecord { holdout: Some(holdout), frames, seconds, timing, has_mattes, origin, device: None }
    }

    /// Its origin, if it is another point than the capture's.
    pub(crate) fn moved_origin(&self) -> Option<[f64; 3]> {
        Some(self.origin).filter(|origin| *origin != [0.0; 3])
    }

    /// Keeps the frames that a field was fitted to. `name` is the path of the field, `folder` the capture's,
    /// for messages. Without a record of frames, all are kept.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the capture lacks some of the frames, or has them at other times.
    pub fn keep_fitted(&mut self, record: &FitRecord, name: &Path, folder: &Path) -> Result<(), Fault> {
        let FitRecord { frames: Some(frames), seconds, timing, .. } = record else { return Ok(()) };
        let (name, folder, Range { start, end }) = (name.display(), folder.display(), frames);
        let count = self.capture.frames();
        if *end > count {
            return Err(Fault::Usage(format!(
                "{name} was fitted to frames {start}..{end}, and {folder} has 0..{count}; name the capture of the fit, \
                 with all its frames"
            )));
        }
        self.keep_frames(frames.clone())?;
        let stated = self.stated_fps.map(|_| self.seconds());
        if let (Some(fitted), Some(found)) = (seconds, stated)
            && fitted.iter().zip(found).any(|(a, b)| (a - b).abs() > SECONDS_TOLERANCE * (1.0 + a.abs()))
        {
            let interval =
                |[first, last]: [f64; 2]| format!("{} to {} s", decimal(first, 3), decimal(last, 3));
            return Err(Fault::Usage(format!(
                "{name} was fitted to {}, and frames {start}..{end} of {folder} are at {}; correct the capture's fps, \
                 or fit the field anew",
                interval(*fitted),
                interval(found)
            )));
        }
        if timing.is_some_and(|timing| timing != self.timing()) {
            return Err(Fault::Usage(format!(
                "{name} was fitted to photographs at other times than {folder} states for them; correct its fps and \
                 time_offset_s, or fit the field anew"
            )));
        }
        Ok(())
    }

    /// Times of the first and the last selected frame in the capture, in seconds.
    fn seconds(&self) -> [f64; 2] {
        [self.start_s, self.start_s + self.capture.duration_s()]
    }

    /// CRC-32 of the times of the photographs in the clip, as `xtask/FIELD.md` specifies it. All cameras of the
    /// capture count, selected or not, so that it is the same for any selection.
    fn timing(&self) -> u32 {
        // Equal times can differ in their last bits; no fraction i / n, n up to 100,000, is at the border of two steps.
        let step = |t: f64| (t * 1e6 + 0.3).floor() as i64;
        let duration_s = self.capture.duration_s();
        let mut crc = flate2::Crc::new();
        for frame in 0..self.capture.frames() {
            crc.update(format!("{}\n", step(self.capture.frame_clip_time(frame))).as_bytes());
        }
        for (name, offset_s) in &self.time_offsets_s {
            let offset = if duration_s > 0.0 { offset_s / duration_s } else { 0.0 };
            crc.update(format!("{name} {}\n", step(offset)).as_bytes());
        }
        crc.sum()
    }
}
