//! Medians over time of the photographs of cameras, against which moving pixels stand out.

use program::Fault;
use refine::capture::{Photo, PhotoId};
use refine::metrics::TemporalMedian;

use super::capture_files::CaptureFiles;
use super::plates::{PICTURES_MIN, median_frames};

impl CaptureFiles {
    /// The median over time of what [`CaptureFiles::photo`] returns for a camera: of at most 33 photographs, evenly spread over
    /// the selected frames. `None` if the camera has fewer than two.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub fn temporal_median(&self, camera: usize) -> Result<Option<TemporalMedian>, Fault> {
        let photos: Vec<PhotoId> =
            self.capture.photos.iter().copied().filter(|photo_id| photo_id.camera == camera).collect();
        if photos.len() < 2 {
            return Ok(None);
        }
        let target = &self.capture.cameras[camera].camera;
        let pixels = target.width as usize * target.height as usize;
        let chosen = median_frames(photos.len(), pixels, PICTURES_MIN).into_iter();
        let pictures = chosen.map(|i| Ok(self.colors(photos[i])?.image.to_rgb8()));
        Ok(TemporalMedian::from_pictures(&pictures.collect::<Result<Vec<_>, Fault>>()?))
    }

    /// What [`CaptureFiles::photo`] returns, but where the background is kept, its alpha is not the mask, which takes time.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub(crate) fn colors(&self, photo_id: PhotoId) -> Result<Photo, Fault> {
        match self.background.is_kept {
            true => Ok(self.seen(photo_id.camera, self.taken(photo_id)?)),
            false => self.photo(photo_id),
        }
    }
}
