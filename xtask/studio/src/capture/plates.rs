//! Plates: what the cameras of a capture show without its subject.
//!
//! Cameras that stand still show the same background in all photographs. A capture states pictures of it, or else they are
//! medians of photographs. With plates, photographs without masks get mattes, and the background is taken out of pixels that
//! show it through the rim of the subject.

use std::path::Path;

use program::Fault;
use rayon::prelude::*;
use refine::capture::{CalibratedCamera, Holdout, Photo, PhotoId};
use refine::image::Image;
use refine::matte::Plate;

use super::camera_plate::{CameraPlate, colors_of};
use super::capture_files::CaptureFiles;
use super::image_file::read_image;

/// Most pictures of a median: its noise is a fifth of theirs then, and further ones take time to seek.
pub(crate) const PICTURES_MAX: usize = 33;

/// Bytes that more pictures than the fewest may have: 33 of 1080p, 8 of 4K.
const BYTES_MAX: usize = 210 << 20;

/// Fewest photographs of a camera that a median is of: fewer show too little of the background.
pub(crate) const PICTURES_MIN: usize = 8;

/// Cameras whose medians are made at a time.
const CAMERAS_MAX: usize = 4;

/// Numbers of the pictures from which a median is made, evenly spread over `count` of this many pixels: as many as
/// memory allows, but at least `least`, or all.
pub(crate) fn median_frames(count: usize, pixels: usize, least: usize) -> Vec<usize> {
    match (BYTES_MAX / (3 * pixels).max(1)).clamp(least, PICTURES_MAX).min(count) {
        0 | 1 => vec![0],
        chosen => (0..chosen).map(|i| i * (count - 1) / (chosen - 1)).collect(),
    }
}

/// How a capture tells its background.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BackgroundSource {
    /// Each camera that is fitted to has a plate, stated or to be found as the median of its photographs.
    Plates,
    /// Masks say what the subject is, and nothing is known of the rest.
    Masks,
    /// Photographs show the subject alone: they are transparent or black around it.
    CutOut,
    /// This camera has so few photographs that its plate cannot be found.
    Few(String, usize),
}

impl CaptureFiles {
    /// What tells the background. Photographs with masks tell it where the capture states plates: their median may be of the
    /// subject.
    ///
    /// # Errors
    /// Those of [`CaptureFiles::open`].
    pub fn background_source(&self, holdout: Holdout) -> anyhow::Result<BackgroundSource> {
        let is_fitted = |camera: &usize| !self.capture.cameras[*camera].held;
        let without_plate: Vec<usize> = (0..self.plates.len())
            .filter(|camera| is_fitted(camera) && self.plates[*camera].stated_path().is_none())
            .collect();
        let has_masks = (0..self.capture.photos.len()).any(|i| self.mask_path(i).is_some());
        if has_masks && !without_plate.is_empty() {
            return Ok(BackgroundSource::Masks);
        }
        if self.is_cut_out()? {
            return Ok(BackgroundSource::CutOut);
        }
        if !without_plate.is_empty() {
            let whole = CaptureFiles::open(&self.folder)?;
            for camera in without_plate {
                let photos = self.background_photos(&whole, camera, holdout)?.len();
                if photos < PICTURES_MIN {
                    return Ok(BackgroundSource::Few(self.capture.cameras[camera].name.clone(), photos));
                }
            }
        }
        Ok(BackgroundSource::Plates)
    }

    /// Whether the photographs of most cameras are transparent or black around the subject; a single camera may have no
    /// light. Looks at one photograph of each camera.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read.
    pub fn is_cut_out(&self) -> Result<bool, Fault> {
        let mut is_seen = vec![false; self.capture.cameras.len()];
        let (mut cut_out, mut cameras) = (0, 0);
        for (i, photo_id) in self.capture.photos.iter().enumerate() {
            if std::mem::replace(&mut is_seen[photo_id.camera], true) {
                continue;
            }
            let is_cut_out = match self.mask_path(i) {
                Some(mask) => {
                    let mask = self.mask(&mask, photo_id.camera)?;
                    self.is_premultiplied(*photo_id, &self.taken(*photo_id)?, &mask)
                }
                None if self.videos[photo_id.camera].is_some() => false,
                None => read_image(&self.path(*photo_id))?.pixels.iter().any(|pixel| pixel[3] < 0.5),
            };
            cut_out += usize::from(is_cut_out);
            cameras += 1;
        }
        Ok(2 * cut_out > cameras)
    }

    /// Finds the plates that are not stated: medians of photographs from all over the capture, of frames that `holdout` does
    /// not hold out. From then on, photographs without masks get mattes. Held cameras with too few photographs for a median
    /// get neither plates nor mattes.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read, or a fitted camera with too few photographs.
    pub fn find_plates(&mut self, holdout: Holdout) -> anyhow::Result<()> {
        let unknown = |camera: &usize| self.plates[*camera].is_unknown();
        let cameras: Vec<usize> = (0..self.capture.cameras.len()).filter(unknown).collect();
        if !cameras.is_empty() {
            self.find_medians(&cameras, holdout)?;
        }
        self.background.is_matted = true;
        Ok(())
    }

    fn find_medians(&self, cameras: &[usize], holdout: Holdout) -> anyhow::Result<()> {
        let whole = CaptureFiles::open(&self.folder)?;
        for cameras in cameras.chunks(CAMERAS_MAX) {
            cameras.par_iter().try_for_each(|&camera| -> Result<(), Fault> {
                let photos = self.background_photos(&whole, camera, holdout)?;
                let CalibratedCamera { name, held, .. } = &self.capture.cameras[camera];
                if !*held || photos.len() >= PICTURES_MIN {
                    self.plates[camera].set(whole.median_plate(name, &photos)?);
                }
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Whether the plates are found.
    pub fn has_plates(&self) -> bool {
        self.background.is_matted
    }

    /// Whether there are photographs without masks, and they get mattes.
    pub fn has_mattes(&self) -> bool {
        self.has_plates() && (0..self.capture.photos.len()).any(|i| self.mask_path(i).is_none())
    }

    /// Pictures without the subject that the capture states.
    pub fn stated_plates(&self) -> impl Iterator<Item = &Path> {
        self.plates.iter().filter_map(CameraPlate::stated_path)
    }

    /// From now on, photographs are as they were taken, without masks and mattes.
    pub fn see_whole(&mut self) {
        self.background.is_whole = true;
    }

    /// From now on, photographs without masks get no mattes.
    pub fn forget_mattes(&mut self) {
        self.background.is_matted = false;
    }

    /// Photographs in the `whole` capture that a median of a camera may be of. Those of frames that are not selected show the
    /// background, too.
    fn background_photos(
        &self,
        whole: &CaptureFiles,
        camera: usize,
        holdout: Holdout,
    ) -> Result<Vec<PhotoId>, Fault> {
        let camera = whole.camera(&self.capture.cameras[camera].name)?;
        let is_held = |frame: usize| holdout.holds(frame.abs_diff(self.selected.start));
        let photos = whole.capture.photos.iter().copied();
        Ok(photos.filter(|id| id.camera == camera && !is_held(id.frame)).collect())
    }

    /// From now on, photographs keep the colours of the background.
    pub fn keep_background(&mut self) {
        self.background.is_kept = true;
    }

    /// The plate of a camera as a photograph, without lens distortion, at the resolution of the camera; `None` if it has
    /// none.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub fn plate_photo(&self, camera: usize) -> Result<Option<Photo>, Fault> {
        let plate = self.plates[camera].plate(&self.file_cameras[camera])?;
        Ok(plate.map(|plate| self.seen_plate(camera, plate)))
    }

    /// The plate of a camera, without lens distortion, at the resolution of the camera.
    pub(super) fn seen_plate(&self, camera: usize, plate: &Plate) -> Photo {
        let pixels = plate.colors().iter().map(|color| {
            let [r, g, b] = color.map(|c| f64::from(c) / 255.0);
            [r, g, b, 1.0]
        });
        let file_camera = &self.file_cameras[camera];
        let image = Image { width: file_camera.width, height: file_camera.height, pixels: pixels.collect() };
        self.seen(camera, image)
    }

    /// The median of `photos` of the camera `name`.
    fn median_plate(&self, name: &str, photos: &[PhotoId]) -> Result<Plate, Fault> {
        if photos.len() < PICTURES_MIN {
            return Err(Fault::Data(format!(
                "camera {name} has {} of the {PICTURES_MIN} photographs that a plate needs: give masks, or plates in \
                 capture.json",
                photos.len()
            )));
        }
        let chosen = median_frames(photos.len(), self.pixels_max(), PICTURES_MIN).into_iter();
        let pictures = chosen.map(|i| Ok(colors_of(&self.taken(photos[i])?)));
        let pictures: Vec<Vec<[u8; 3]>> = pictures.collect::<Result<_, Fault>>()?;
        Ok(Plate::from_pictures(&pictures, self.file_cameras[photos[0].camera].width as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_over_the_clip_in_bounded_memory() {
        assert_eq!(median_frames(100, 1920 * 1080, 5).len(), 33);
        assert_eq!((median_frames(100, 1920 * 1080, 5)[0], median_frames(100, 1920 * 1080, 5)[32]), (0, 99));
        assert_eq!(median_frames(100, 3840 * 2160, 5).len(), 8);
        assert_eq!(median_frames(100, 7680 * 4320, 5), [0, 24, 49, 74, 99]);
        assert_eq!(median_frames(3, 64, 5), [0, 1, 2]);
        assert_eq!(median_frames(1, 64, 5), [0]);
    }
}
