//! [`Photographs`]: those of a window, and those of the next one read ahead.

use std::collections::BTreeSet;

use program::Fault;
use refine::capture::{Holdout, PhotoId, Split};
use refine::fit::{Timeline, TrainingView};

use super::windows::Windows;
use crate::capture::CaptureFiles;
use crate::fit::training_views::{CHECKED_MAX, TrainingViews, evenly, load_views, splits};

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
        let (fitted, held): (Vec<_>, Vec<_>) =
            splits.into_iter().partition(|(_, split)| *split == Split::Train);
        let ids = |list: Vec<(PhotoId, Split)>| list.into_iter().map(|(photo_id, _)| photo_id).collect();
        let (fitted, held): (Vec<PhotoId>, Vec<PhotoId>) = (ids(fitted), ids(held));
        let intervals = Timeline::of(&capture_files.capture, &fitted).intervals;
        let interval_s = capture_files.capture.duration_s() / intervals;
        Ok(Photographs { capture_files, windows, fitted, held, interval_s })
    }

    fn time_s(&self, photo_id: PhotoId) -> f64 {
        self.capture_files.capture.time_s(photo_id)
    }

    /// Reads the photographs that step `step` sees and the step before it does not.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn load_new(&self, step: usize) -> Result<Loaded, Fault> {
        self.load(|time_s| self.windows.sees_first(step, time_s))
    }

    /// Reads the photographs that step `step` and the step before it see.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn load_seen_before(&self, step: usize) -> Result<Loaded, Fault> {
        self.load(|time_s| self.windows.sees(step, time_s) && self.windows.sees(step - 1, time_s))
    }

    /// Reads the photographs to fit to that were taken when they are wanted.
    fn load(&self, is_wanted: impl Fn(f64) -> bool) -> Result<Loaded, Fault> {
        let is_wanted = |photo_id: &&PhotoId| is_wanted(self.time_s(**photo_id));
        let ids: Vec<PhotoId> = self.fitted.iter().filter(is_wanted).copied().collect();
        load_views(self.capture_files, &ids, &|| {})
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
        let intervals = self.capture_files.capture.duration_s() / self.interval_s;
        Ok(TrainingViews {
            train,
            held: Vec::new(),
            timeline: Timeline { frames: frames.len().max(2), intervals },
        })
    }

    /// The views of step `step`: photographs of the step before it that it still sees, and `new` ones; and a few held-out
    /// ones, which are read here.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn views(&self, step: usize, before: Loaded, new: Loaded) -> Result<TrainingViews, Fault> {
        let sees = |photo_id: PhotoId| self.windows.sees(step, self.time_s(photo_id));
        let mut train: Loaded = before.into_iter().filter(|(photo_id, _)| sees(*photo_id)).collect();
        train.extend(new);
        let held: Vec<PhotoId> = self.held.iter().copied().filter(|photo_id| sees(*photo_id)).collect();
        let mut held = load_views(self.capture_files, &evenly(&held, CHECKED_MAX), &|| {})?;
        let [from_s, to_s] = self.windows.span_s(step);
        for (photo_id, view) in train.iter_mut().chain(&mut held) {
            view.time = (self.time_s(*photo_id) - from_s) / self.interval_s;
        }
        let frames: BTreeSet<usize> = train.iter().map(|(photo_id, _)| photo_id.frame).collect();
        let timeline = Timeline { frames: frames.len().max(2), intervals: (to_s - from_s) / self.interval_s };
        Ok(TrainingViews { train, held: held.into_iter().map(|(_, view)| view).collect(), timeline })
    }
}
