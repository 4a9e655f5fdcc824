//! [`TrainingViews`]: the photographs of a fit, decoded.

use std::collections::{BTreeMap, BTreeSet};

use program::Fault;
use rayon::prelude::*;
use refine::capture::{Capture, Holdout, PhotoId, Response, Split};
use refine::fit::{self, Learned, Photograph, RenderedImage, Rig, Timeline, TrainingView};

use crate::capture::CaptureFiles;

/// Maximum number of held-out photographs that the table of a fit measures.
pub(super) const CHECKED_MAX: usize = 8;

/// Memory budget for decoding photographs in parallel, and the bytes that decoding a pixel takes: as in
/// the file, as 16 bits per channel, as doubles, and as doubles without lens distortion. A decoded pixel
/// takes 4 bytes.
const DECODING_BYTES: usize = 2 << 30;
const BYTES_PER_PIXEL: usize = 8 + 8 + 32 + 32;

/// Photographs to fit to, and a few held-out ones.
#[derive(Debug)]
pub struct TrainingViews {
    /// Photographs that the loss compares with.
    pub train: Vec<(PhotoId, TrainingView)>,
    /// A few photographs of all held-out splits, for the table; empty if none is held out.
    pub held: Vec<TrainingView>,
    /// Number and times of the frames.
    pub timeline: Timeline,
    /// The response of each camera of the capture.
    pub responses: Vec<Response>,
}

impl TrainingViews {
    /// Decodes the photographs of a capture; calls `on_photo` after each.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file, or if `holdout` leaves no photograph to fit to.
    pub fn load(
        capture_files: &CaptureFiles,
        holdout: Holdout,
        on_photo: impl Fn() + Sync,
    ) -> Result<TrainingViews, Fault> {
        let splits = splits(capture_files, holdout)?;
        let select = |is_selected: &dyn Fn(Split) -> bool| -> Vec<PhotoId> {
            splits.iter().filter(|(_, split)| is_selected(*split)).map(|(photo_id, _)| *photo_id).collect()
        };
        let fitted = select(&|split| split == Split::Train);
        let timeline = Timeline::from_capture(&capture_files.capture, &fitted);
        let held = evenly(&select(&|split| split != Split::Train), CHECKED_MAX);
        let [held, train] = [&held, &fitted].map(|ids| load_views(capture_files, ids, &on_photo));
        let (mut held, mut train) = (held?, train?);
        for (photo_id, view) in held.iter_mut().chain(&mut train) {
            view.time = capture_files.capture.clip_time(*photo_id) * timeline.intervals;
        }
        let held = held.into_iter().map(|(_, view)| view).collect();
        let responses = responses(&capture_files.capture);
        Ok(TrainingViews { train, held, timeline, responses })
    }

    /// The same photographs as they were taken, without masks and mattes.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read.
    pub(super) fn whole(
        &self,
        capture_files: &CaptureFiles,
        holdout: Holdout,
    ) -> Result<TrainingViews, Fault> {
        let mut capture_files = capture_files.clone();
        capture_files.see_whole();
        let whole = TrainingViews::load(&capture_files, holdout, || ())?;
        Ok(TrainingViews { responses: self.responses.clone(), ..whole })
    }

    /// Whether no photograph has a mask, so that they show the background, too.
    pub fn are_whole(&self) -> bool {
        !self.train.iter().any(|(_, view)| view.photograph.is_masked())
    }

    /// The cameras of these views; `learned` says what is learned of them.
    pub(super) fn rig(&self, learned: Learned) -> Rig {
        self.rig_from(learned, &self.responses)
    }

    /// The same, from these responses.
    pub(super) fn rig_from(&self, learned: Learned, responses: &[Response]) -> Rig {
        let first = self.train.iter().map(|(photo_id, _)| photo_id.camera).min().unwrap_or(0);
        Rig::new(learned, responses.to_vec(), first)
    }
}

/// The response of each camera.
pub(super) fn responses(capture: &Capture) -> Vec<Response> {
    capture.cameras.iter().map(|camera| camera.response).collect()
}

pub(super) fn splits(capture_files: &CaptureFiles, holdout: Holdout) -> Result<Vec<(PhotoId, Split)>, Fault> {
    Split::assign(&capture_files.capture, holdout).map_err(|error| Fault::Data(error.to_string()))
}

/// Indices of the frames with photographs to fit to.
///
/// # Errors
/// [`Fault::Data`] if there are none.
pub fn train_frames(capture_files: &CaptureFiles, holdout: Holdout) -> Result<BTreeSet<usize>, Fault> {
    let train = splits(capture_files, holdout)?.into_iter().filter(|(_, split)| *split == Split::Train);
    Ok(train.map(|(photo_id, _)| photo_id.frame).collect())
}

/// Decodes photographs, as many at once as the memory budget allows; their times are 0. Calls `on_photo` after each.
///
/// # Errors
/// [`Fault::Data`] that names the file.
pub(super) fn load_views(
    capture_files: &CaptureFiles,
    photo_ids: &[PhotoId],
    on_photo: &(impl Fn() + Sync),
) -> Result<Vec<(PhotoId, TrainingView)>, Fault> {
    let load = |photo_id: &PhotoId| {
        let photograph = Photograph::from(&capture_files.photo(*photo_id)?);
        let camera = capture_files.capture.cameras[photo_id.camera].camera.clone();
        on_photo();
        Ok((*photo_id, TrainingView { camera_id: photo_id.camera, camera, time: 0.0, photograph }))
    };
    let batch = (DECODING_BYTES / (BYTES_PER_PIXEL * capture_files.pixels_max())).max(1);
    let mut loaded = Vec::with_capacity(photo_ids.len());
    for photo_ids in photo_ids.chunks(batch) {
        let load_row = |row: Vec<usize>| -> Result<Vec<_>, Fault> {
            row.into_iter().map(|i| Ok((i, load(&photo_ids[i])?))).collect()
        };
        let rows = capture_files.decoding_rows(photo_ids).into_par_iter().map(load_row);
        let mut views: Vec<_> = rows.collect::<Result<Vec<_>, Fault>>()?.into_iter().flatten().collect();
        views.sort_by_key(|(i, _)| *i);
        loaded.extend(views.into_iter().map(|(_, view)| view));
    }
    Ok(loaded)
}

/// Views by the numbers of their frames, in their order.
pub(super) fn by_frame<'a>(
    views: impl IntoIterator<Item = &'a (PhotoId, TrainingView)>,
) -> BTreeMap<usize, Vec<&'a (PhotoId, TrainingView)>> {
    let mut frames: BTreeMap<usize, Vec<_>> = BTreeMap::new();
    for view in views {
        frames.entry(view.0.frame).or_default().push(view);
    }
    frames
}

/// Mean PSNR of the subject in the held-out photographs, in dB; `None` if none is held out.
pub(super) fn mean_psnr(views: &TrainingViews, pictures: &[RenderedImage<f32>]) -> Option<f64> {
    let psnr =
        |(view, picture): (&TrainingView, &RenderedImage<f32>)| fit::subject_psnr(picture, &view.photograph);
    let known: Vec<f64> = views.held.iter().zip(pictures).filter_map(psnr).collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

/// At most `count` evenly spaced items of `all`, with its first and last.
pub(crate) fn evenly<T: Copy>(all: &[T], count: usize) -> Vec<T> {
    let count = count.min(all.len());
    (0..count).map(|i| all[if count == 1 { 0 } else { i * (all.len() - 1) / (count - 1) }]).collect()
}

#[cfg(test)]
mod tests {
    use super::evenly;

    #[test]
    fn evenly_spaced_items_include_both_ends() {
        let all: Vec<u32> = (0..100).collect();
        assert_eq!(evenly(&all, 4), [0, 33, 66, 99]);
        assert_eq!(evenly(&all[..3], 8), [0, 1, 2]);
        assert_eq!(evenly(&all, 1), [0]);
        assert!(evenly(&all[..0], 8).is_empty());
    }
}
