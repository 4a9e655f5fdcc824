//! [`BlendedPhotographs`]: predictions of held frames that need no fit, from the photographs around them.
//!
//! ```text
//! compared photographs, camera by camera -> fitted: kept -> blend of two -> measured against the held one between them
//! ```

use std::collections::VecDeque;

use program::Fault;
use refine::capture::{Capture, Photo, PhotoId, Split};
use refine::fit::Lpips;
use refine::image::Image;
use refine::metrics::{ImageMetrics, TemporalMedian};

use super::{Comparison, Judged, Measured, align, by_camera};
use crate::capture::CaptureFiles;

/// Fitted photographs in memory: those before and after a held one.
const KEPT: usize = 2;

/// Predicts each held frame of a fitted camera by the blend, linear in time, of the camera's photographs at the two fitted
/// frames around it; before the first and after the last of them, by that photograph alone. A fit must be better.
///
/// Blends are compared with the photographs that pictures were compared with: over the same pixels of the subject.
pub struct BlendedPhotographs<'a> {
    capture_files: &'a CaptureFiles,
    lpips: Option<&'a Lpips<f32>>,
    /// The fitted photographs, camera by camera; empty if no frame of a fitted camera is held.
    fitted: Vec<PhotoId>,
    /// Those that were compared or read last.
    kept: VecDeque<(PhotoId, Image)>,
    /// Held photographs whose next fitted one is not compared yet: reading it now would turn a video back.
    waiting: VecDeque<Held>,
    measured: Vec<Measured>,
}

/// A held photograph, and what it is predicted from.
struct Held {
    photo_id: PhotoId,
    photo: Photo,
    median: Option<TemporalMedian>,
    around: Vec<Weighted>,
}

/// A fitted photograph and its weight in a blend, above 0 and at most 1.
type Weighted = (PhotoId, f64);

impl<'a> BlendedPhotographs<'a> {
    /// Predicts the held frames among the photographs with these `splits`; measures LPIPS if its network is given.
    pub fn new(
        capture_files: &'a CaptureFiles,
        splits: Vec<(PhotoId, Split)>,
        lpips: Option<&'a Lpips<f32>>,
    ) -> BlendedPhotographs<'a> {
        let is_held = splits.iter().any(|(_, split)| *split == Split::InterpB);
        let fitted = by_camera(splits).into_iter().filter(|(_, split)| is_held && *split == Split::Train);
        BlendedPhotographs {
            capture_files,
            lpips,
            fitted: fitted.map(|(photo_id, _)| photo_id).collect(),
            kept: VecDeque::new(),
            waiting: VecDeque::new(),
            measured: Vec::new(),
        }
    }

    /// Takes the photograph of a comparison. They come camera by camera, in the order of frames.
    ///
    /// # Errors
    /// [`Fault::Data`] if a fitted photograph that was not compared cannot be read.
    pub fn add(&mut self, comparison: &Comparison) -> Result<(), Fault> {
        let Comparison { photo_id, photo, median, .. } = *comparison;
        match comparison.split {
            Split::Train if !self.fitted.is_empty() => self.keep(photo_id, photo.image.clone()),
            Split::InterpB => {
                let around = around(&self.capture_files.capture, &self.fitted, photo_id);
                if !around.is_empty() {
                    let (photo, median) = (photo.clone(), median.cloned());
                    self.waiting.push_back(Held { photo_id, photo, median, around });
                }
            }
            _ => {}
        }
        self.measure_until(place(&photo_id))
    }

    /// The measures of all blends; empty if none was possible.
    ///
    /// # Errors
    /// Those of [`BlendedPhotographs::add`].
    pub fn judged(mut self) -> Result<Vec<Judged>, Fault> {
        self.measure_until((usize::MAX, usize::MAX))?;
        Ok(align(&self.measured, &self.capture_files.capture))
    }

    /// Measures the blends of photographs up to this place.
    fn measure_until(&mut self, reached: Place) -> Result<(), Fault> {
        let is_ready = |held: &Held| held.around.iter().all(|(photo_id, _)| place(photo_id) <= reached);
        while let Some(Held { photo_id, photo, median, around }) =
            self.waiting.pop_front_if(|held| is_ready(held))
        {
            let mut blend = Image::new(photo.image.width, photo.image.height);
            for (fitted, weight) in around {
                let pixels = blend.pixels.iter_mut().zip(&self.colors(fitted)?.pixels);
                pixels.for_each(|(pixel, color)| (0..4).for_each(|c| pixel[c] += weight * color[c]));
            }
            let (measures, sums) = ImageMetrics::with_sums(&blend, &photo, median.as_ref(), self.lpips);
            self.measured.push(Measured { photo_id, split: Split::InterpB, measures, sums, overlap: None });
        }
        Ok(())
    }

    /// The colours of a fitted photograph, which is read if it was not compared: a folder may lack its picture.
    fn colors(&mut self, photo_id: PhotoId) -> Result<&Image, Fault> {
        if !self.kept.iter().any(|(kept, _)| *kept == photo_id) {
            let image = self.capture_files.colors(photo_id)?.image;
            self.keep(photo_id, image);
        }
        let kept = self.kept.iter().find(|(kept, _)| *kept == photo_id);
        Ok(kept.map(|(_, image)| image).expect("it was just kept"))
    }

    fn keep(&mut self, photo_id: PhotoId, image: Image) {
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        self.kept.push_back((photo_id, image));
    }
}

/// Number of a camera, and of a frame: photographs are compared in this order.
type Place = (usize, usize);

fn place(photo_id: &PhotoId) -> Place {
    (photo_id.camera, photo_id.frame)
}

/// The photographs around `held` of the same camera among those `fitted`, which are in the order of their places; one of
/// them at either end, none if the camera has none.
fn around(capture: &Capture, fitted: &[PhotoId], held: PhotoId) -> Vec<Weighted> {
    let next = fitted.partition_point(|photo_id| place(photo_id) < place(&held));
    let of_camera =
        |i: Option<usize>| fitted.get(i?).copied().filter(|photo_id| photo_id.camera == held.camera);
    match (of_camera(next.checked_sub(1)), of_camera(Some(next))) {
        (Some(before), Some(after)) => {
            let [start_s, held_s, end_s] = [before, held, after].map(|photo_id| capture.time_s(photo_id));
            let part = (held_s - start_s) / (end_s - start_s);
            vec![(before, 1.0 - part), (after, part)]
        }
        (Some(end), None) | (None, Some(end)) => vec![(end, 1.0)],
        (None, None) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_between_the_fitted_ones_of_its_camera() {
        let photo_id = |camera, frame| PhotoId { camera, frame };
        let capture = Capture {
            cameras: vec![crate::eval::fixtures::camera(false); 3],
            frame_times_s: vec![0.0, 0.1, 0.4, 0.5, 0.6],
            ..Capture::default()
        };
        let fitted = [photo_id(0, 0), photo_id(0, 2), photo_id(0, 4), photo_id(1, 2)];
        let around = |camera, frame| around(&capture, &fitted, photo_id(camera, frame));
        assert_eq!(around(0, 1), [(photo_id(0, 0), 0.75), (photo_id(0, 2), 0.25)]);
        assert_eq!(around(1, 1), [(photo_id(1, 2), 1.0)], "another camera's photograph shows another view");
        assert_eq!(around(1, 3), [(photo_id(1, 2), 1.0)]);
        assert!(around(2, 1).is_empty());
    }
}
