//! Measures that need all photographs of a camera: the median over time and the transform of colours.
//!
//! Photographs are judged camera by camera, so that one median is in memory at a time.

use program::Fault;
use refine::capture::{PhotoId, Split};
use refine::metrics::{AlignedPsnr, ImageMetrics, ImageSums, Overlap, TemporalMedian};

use crate::capture::CaptureFiles;

/// Measures of one picture.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Camera and frame.
    pub photo_id: PhotoId,
    /// The split of the photograph.
    pub split: Split,
    /// Similarity of picture and photograph.
    pub measures: ImageMetrics,
    /// PSNR after the transform of the camera's colours.
    pub aligned: AlignedPsnr,
    /// What is drawn before the plate against the mask; `None` if nothing is drawn or the photograph has no mask.
    pub overlap: Option<Overlap>,
}

/// A compared picture whose colours are not aligned yet.
pub(super) struct Measured {
    pub photo_id: PhotoId,
    pub split: Split,
    pub measures: ImageMetrics,
    pub sums: ImageSums,
    pub overlap: Option<Overlap>,
}

/// Photographs in order, first by camera, then by frame.
pub(super) fn by_camera(mut photos: Vec<(PhotoId, Split)>) -> Vec<(PhotoId, Split)> {
    photos.sort_by_key(|(photo_id, _)| (photo_id.camera, photo_id.frame));
    photos
}

/// The median of the camera that was asked for last.
pub(super) struct Medians<'a> {
    capture_files: &'a CaptureFiles,
    last: Option<(usize, Option<TemporalMedian>)>,
}

impl Medians<'_> {
    pub(super) fn new(capture_files: &CaptureFiles) -> Medians<'_> {
        Medians { capture_files, last: None }
    }

    /// The median of a camera, see [`CaptureFiles::temporal_median`].
    pub(super) fn median(&mut self, camera: usize) -> Result<Option<&TemporalMedian>, Fault> {
        if self.last.as_ref().is_none_or(|(last, _)| *last != camera) {
            // The old one goes before the new one is made.
            self.last = None;
            self.last = Some((camera, self.capture_files.temporal_median(camera)?));
        }
        Ok(self.last.as_ref().and_then(|(_, median)| median.as_ref()))
    }
}

/// Aligns the colours of pictures in the order of [`by_camera`], by one transform for each camera. Returns them in the order
/// of their frames.
pub(super) fn align(measured: &[Measured]) -> Vec<Judged> {
    let mut judged: Vec<Judged> = Vec::with_capacity(measured.len());
    for of_camera in measured.chunk_by(|a, b| a.photo_id.camera == b.photo_id.camera) {
        let sums: Vec<ImageSums> = of_camera.iter().map(|one| one.sums).collect();
        for (&Measured { photo_id, split, measures, overlap, .. }, aligned) in
            of_camera.iter().zip(AlignedPsnr::of_camera(&sums))
        {
            judged.push(Judged { photo_id, split, measures, aligned, overlap });
        }
    }
    judged.sort_by_key(|one| one.photo_id);
    judged
}
