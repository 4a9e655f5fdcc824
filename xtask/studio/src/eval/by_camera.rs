//! Measures that need all photographs of a camera: the median over time and the transform of colours.
//!
//! Photographs are judged camera by camera, so that one median is in memory at a time.

use std::collections::BTreeMap;

use program::Fault;
use refine::capture::{Capture, PhotoId, Split};
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

/// Aligns the colours of pictures, by one transform for each device: a camera, or all cameras of `capture` that are of one
/// [device](refine::capture::CalibratedCamera::device). Returns them in the order of their frames.
pub(super) fn align(measured: &[Measured], capture: &Capture) -> Vec<Judged> {
    let mut of_devices: BTreeMap<Device, Vec<&Measured>> = BTreeMap::new();
    for one in measured {
        let camera = one.photo_id.camera;
        let device = capture.cameras[camera].device.map_or(Device::Camera(camera), Device::Stated);
        of_devices.entry(device).or_default().push(one);
    }
    let mut judged: Vec<Judged> = Vec::with_capacity(measured.len());
    for of_device in of_devices.into_values() {
        let sums: Vec<ImageSums> = of_device.iter().map(|one| one.sums).collect();
        for (&&Measured { photo_id, split, measures, overlap, .. }, aligned) in
            of_device.iter().zip(AlignedPsnr::of_camera(&sums))
        {
            judged.push(Judged { photo_id, split, measures, aligned, overlap });
        }
    }
    judged.sort_by_key(|one| one.photo_id);
    judged
}

/// What has colours of its own.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Device {
    /// A camera with this index.
    Camera(usize),
    /// All cameras of the device with this number.
    Stated(u32),
}

#[cfg(test)]
mod tests {
    use refine::capture::{CalibratedCamera, Photo};
    use refine::image::Image;

    use super::*;
    use crate::eval::fixtures;

    /// A picture of shades of gray, and a photograph that is brighter.
    fn measured(camera: usize, brighter: f64) -> Measured {
        let shades = |offset: f64| {
            let shade = |i: usize| 0.2 + 0.4 * (i as f64 / 64.0) + offset;
            Image {
                width: 8,
                height: 8,
                pixels: (0..64).map(|i| [shade(i), shade(i), shade(i), 1.0]).collect(),
            }
        };
        let photo = Photo { image: shades(brighter), seen: vec![true; 64] };
        let (measures, sums) = ImageMetrics::with_sums(&shades(0.0), &photo, None, None);
        let photo_id = PhotoId { frame: 0, camera };
        Measured { photo_id, split: Split::Train, measures, sums, overlap: None }
    }

    #[test]
    fn cameras_of_one_device_share_a_transform() {
        let measured = [measured(0, 0.1), measured(1, -0.1)];
        let psnr = |device: Option<u32>| {
            let cameras = vec![CalibratedCamera { device, ..fixtures::camera(false) }; 2];
            let capture = Capture { cameras, ..Capture::default() };
            align(&measured, &capture).iter().map(|one| one.aligned.full).collect::<Vec<_>>()
        };
        assert!(psnr(None).iter().all(|db| *db > 50.0), "{:?}", psnr(None));
        // The mean of both offsets is none, and 0.1 is 20 dB.
        assert!(psnr(Some(4)).iter().all(|db| (db - 20.0).abs() < 0.2), "{:?}", psnr(Some(4)));
    }
}
