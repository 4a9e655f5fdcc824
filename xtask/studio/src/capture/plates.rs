//! Plates: what the cameras of a capture show without its subject.
//!
//! Cameras that stand still show the same background in all photographs. A capture states pictures of it, or else they are
//! medians of photographs. With plates, photographs without masks get mattes, and the background is taken out of pixels that
//! show it through the rim of the subject.

use program::Fault;
use rayon::prelude::*;
use refine::capture::{Photo, PhotoId};
use refine::image::Image;
use refine::matte::Plate;

use super::camera_plate::colors_of;
use super::capture_files::CaptureFiles;
use super::image_file::read_image;

/// Most pictures of a median: its noise is a fifth of theirs then, and further ones take time to seek.
pub(crate) const PICTURES_MAX: usize = 33;

/// Bytes that more pictures than the fewest may have: 33 of 1080p, 8 of 4K.
const BYTES_MAX: usize = 210 << 20;

/// Fewest photographs of a camera that a median is of: fewer show too little of what is behind the subject.
const PICTURES_MIN: usize = 8;

/// Numbers of the pictures of which a median is made, evenly spread over `count` of this many pixels: as many as memory
/// allows, but at least `least`, or all.
pub(crate) fn median_frames(count: usize, pixels: usize, least: usize) -> Vec<usize> {
    match (BYTES_MAX / (3 * pixels).max(1)).clamp(least, PICTURES_MAX).min(count) {
        0 | 1 => vec![0],
        chosen => (0..chosen).map(|i| i * (count - 1) / (chosen - 1)).collect(),
    }
}

impl CaptureFiles {
    /// Whether photographs have no masks, but plates that give them mattes: each camera has one, or enough photographs to
    /// find it.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read.
    pub fn can_be_matted(&self) -> Result<bool, Fault> {
        let photos_of = |camera: usize| self.capture.photos.iter().filter(|id| id.camera == camera).count();
        let can_have_plates = (0..self.capture.cameras.len())
            .all(|camera| self.plates[camera].is_stated() || photos_of(camera) >= PICTURES_MIN);
        Ok(can_have_plates && !self.has_masks()?)
    }

    /// Whether photographs have masks, in files of their own or as transparency; looks at one photograph of each camera.
    fn has_masks(&self) -> Result<bool, Fault> {
        let mut is_seen = vec![false; self.capture.cameras.len()];
        for (i, photo_id) in self.capture.photos.iter().enumerate() {
            if self.mask_path(i).is_some() {
                return Ok(true);
            }
            let is_first = !std::mem::replace(&mut is_seen[photo_id.camera], true);
            if is_first && self.videos[photo_id.camera].is_none() {
                let image = read_image(&self.path(*photo_id))?;
                if image.pixels.iter().any(|pixel| pixel[3] < 0.5) {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// Finds the plates that are not stated: medians of photographs from all over the capture, every other frame, so that
    /// held frames have no part in them. From then on, photographs without masks get mattes.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read, or a camera with too few photographs.
    pub fn find_plates(&mut self) -> anyhow::Result<()> {
        // Photographs of frames that are not selected show the background, too.
        let whole = CaptureFiles::open(&self.folder)?;
        let unknown = |camera: &usize| self.plates[*camera].is_unknown();
        let find = |camera: usize| -> Result<(), Fault> {
            let name = &self.capture.cameras[camera].name;
            let in_whole = whole.camera(name)?;
            let plate = whole.median_plate(in_whole)?;
            self.plates[camera].set(plate);
            Ok(())
        };
        let cameras: Vec<usize> = (0..self.capture.cameras.len()).filter(unknown).collect();
        cameras.into_par_iter().try_for_each(find)?;
        self.background.is_matted = true;
        Ok(())
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
        let Some(plate) = self.plates[camera].plate(&self.file_cameras[camera])? else { return Ok(None) };
        let pixels = plate.colors().iter().map(|color| {
            let [r, g, b] = color.map(|c| f64::from(c) / 255.0);
            [r, g, b, 1.0]
        });
        let file_camera = &self.file_cameras[camera];
        let image = Image { width: file_camera.width, height: file_camera.height, pixels: pixels.collect() };
        Ok(Some(self.seen(camera, image)))
    }

    /// The median of photographs of a camera.
    fn median_plate(&self, camera: usize) -> Result<Plate, Fault> {
        let own = self.capture.photos.iter().copied().filter(|photo_id| photo_id.camera == camera);
        let own: Vec<PhotoId> = own.collect();
        let even: Vec<PhotoId> = own.iter().copied().filter(|id| id.frame % 2 == 0).collect();
        let from = if even.len() >= PICTURES_MIN { even } else { own };
        if from.len() < PICTURES_MIN {
            let name = &self.capture.cameras[camera].name;
            return Err(Fault::Data(format!(
                "camera {name} has {} of the {PICTURES_MIN} photographs that a plate needs: give masks, or plates in \
                 capture.json",
                from.len()
            )));
        }
        let chosen = median_frames(from.len(), self.pixels_max(), PICTURES_MIN).into_iter();
        let pictures = chosen.map(|i| Ok(colors_of(&self.taken(from[i])?)));
        let pictures: Vec<Vec<[u8; 3]>> = pictures.collect::<Result<_, Fault>>()?;
        let pictures: Vec<&[[u8; 3]]> = pictures.iter().map(Vec::as_slice).collect();
        Ok(Plate::of(&pictures, self.file_cameras[camera].width as usize))
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
