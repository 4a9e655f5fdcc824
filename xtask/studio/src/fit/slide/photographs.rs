//! [`Photographs`]: the photographs of a window in memory, and of the next window, read ahead of use.

use std::collections::BTreeSet;

use program::Fault;
use refine::capture::{Holdout, PhotoId, Split};
use refine::fit::{Timeline, TrainingView};

use super::windows::Windows;
use crate::capture::CaptureFiles;
use crate::fit::training_views::{CHECKED_MAX, TrainingViews, evenly, load_views, responses, splits};

/// Number of frames that stand for the whole take.
const SPREAD_FRAMES: usize = 8;

/// The photographs of a capture, by window.
pub(super) struct Photographs<'a> {
    pub(super) capture_files: &'a CaptureFiles,
    pub(super) windows: Windows,
    /// Photographs to fit to, and held-out ones.
    fitted: Vec<PhotoId>,
    held: Vec<PhotoId>,
    /// Seconds between two photographs of a camera.
    pub(super) interval_s: f64,
}

/// Photographs in memory.
pub(super) type Loaded = Vec<(PhotoId, TrainingView)>;

impl<'a> Photographs<'a> {
    pub(super) fn new(
        capture_files: &'a CaptureFiles,
        windows: Windows,
        holdout: Holdout,
    ) -> Result<Photographs<'a>, Fault> {
        let splits = splits(capture_files, holdout)?;
        let ids = |is_wanted: &dyn Fn(Split) -> bool| -> Vec<PhotoId> {
            splits.iter().filter(|(_, split)| is_wanted(*split)).map(|(photo_id, _)| *photo_id).collect()
        };
        let fitted = ids(&|split| split == Split::Train);
        let held = ids(&|split| split != Split::Train);
        let intervals = Timeline::from_capture(&capture_files.capture, &fitted).intervals;
        let interval_s = capture_files.capture.duration_s() / intervals;
        Ok(Photographs { capture_files, windows, fitted, held, interval_s })
    }

    pub(super) fn time_s(&self, photo_id: PhotoId) -> f64 {
        self.capture_files.capture.time_s(photo_id)
    }

    fn sees(&self, part: usize, photo_id: PhotoId) -> bool {
        self.windows.sees(part, self.time_s(photo_id))
    }

    /// Reads the files of `part` that `current` does not see, one after another, and drops them: the system keeps what
    /// was read in memory that it has no other use for, and decoding need not wait for a slow disk.
    pub(super) fn read_ahead(&self, part: usize, current: usize) {
        let is_new = |photo_id: &&PhotoId| self.sees(part, **photo_id) && !self.sees(current, **photo_id);
        self.fitted.iter().filter(is_new).for_each(|photo_id| self.capture_files.read_ahead(*photo_id));
    }

    /// The photographs of a few frames that are spread evenly over the take; their times count from its beginning.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn spread(&self) -> Result<TrainingViews, Fault> {
        let frames: BTreeSet<usize> = self.fitted.iter().map(|photo_id| photo_id.frame).collect();
        let frames: Vec<usize> = frames.into_iter().collect();
        // No more than a window has.
        let count = SPREAD_FRAMES.min(frames.len() / self.windows.count).max(2);
        let frames = evenly(&frames, count);
        let is_one = |photo_id: &&PhotoId| frames.contains(&photo_id.frame);
        let ids: Vec<PhotoId> = self.fitted.iter().filter(is_one).copied().collect();
        let mut train = load_views(self.capture_files, &ids, &|| {})?;
        for (photo_id, view) in &mut train {
            view.time = self.time_s(*photo_id) / self.interval_s;
        }
        let intervals = self.windows.duration_s / self.interval_s;
        Ok(TrainingViews {
            train,
            held: Vec::new(),
            timeline: Timeline { frames: frames.len().max(2), intervals },
            responses: responses(&self.capture_files.capture),
        })
    }

    /// The views of a part, and a few held-out ones; `in_memory` are photographs that need not be read again.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn views(&self, part: usize, in_memory: Loaded) -> Result<TrainingViews, Fault> {
        let mut train = in_memory;
        train.retain(|(photo_id, _)| self.sees(part, *photo_id));
        let there: BTreeSet<PhotoId> = train.iter().map(|(photo_id, _)| *photo_id).collect();
        let seen = |ids: &[PhotoId]| -> Vec<PhotoId> {
            ids.iter().copied().filter(|photo_id| self.sees(part, *photo_id)).collect()
        };
        let mut missing = seen(&self.fitted);
        missing.retain(|photo_id| !there.contains(photo_id));
        train.extend(load_views(self.capture_files, &missing, &|| {})?);
        let held = evenly(&seen(&self.held), CHECKED_MAX);
        let mut held = load_views(self.capture_files, &held, &|| {})?;
        let [from_s, to_s] = self.windows.span_s(part);
        for (photo_id, view) in train.iter_mut().chain(&mut held) {
            view.time = (self.time_s(*photo_id) - from_s) / self.interval_s;
        }
        // A resumed fit has the same order.
        train.sort_by_key(|(photo_id, _)| *photo_id);
        let frames: BTreeSet<usize> = train.iter().map(|(photo_id, _)| photo_id.frame).collect();
        let timeline = Timeline { frames: frames.len().max(2), intervals: (to_s - from_s) / self.interval_s };
        let responses = responses(&self.capture_files.capture);
        let held = held.into_iter().map(|(_, view)| view).collect();
        Ok(TrainingViews { train, held, timeline, responses })
    }
}
