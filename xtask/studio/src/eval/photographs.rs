//! [`Photographs`]: the photographs that pictures are compared with, and where in them the subject is.

use program::Fault;
use refine::capture::{Capture, Photo, PhotoId};
use refine::metrics::Overlap;

use crate::capture::CaptureFiles;

/// Photographs whose alpha is the subject. All rows of a table share it, so that their errors are over the same pixels.
#[derive(Clone, Debug)]
pub struct Photographs {
    /// Without mattes where what is drawn tells the subject.
    pub(super) files: CaptureFiles,
    is_drawn: bool,
}

impl Photographs {
    /// The subject is in the masks. Without any it is what is drawn before a plate, where the table is of something that
    /// `has_plate`; else in difference mattes, where the photographs have them.
    pub fn new(capture_files: &CaptureFiles, has_plate: bool) -> Photographs {
        let mut files = capture_files.clone();
        let is_drawn = has_plate && files.has_mattes();
        if is_drawn {
            files.forget_mattes();
        }
        Photographs { files, is_drawn }
    }

    /// Their cameras and times.
    pub fn capture(&self) -> &Capture {
        &self.files.capture
    }

    /// Reads a photograph. What is drawn does not tell its subject yet, see [`Photographs::tell`].
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn read(&self, photo_id: PhotoId) -> Result<Photo, Fault> {
        self.files.photo(photo_id)
    }

    /// Compares `drawn`, the alpha of what is drawn before the plate, with the mask of a photograph that was read; without a
    /// mask makes it the subject, if it tells that, and returns `None`.
    pub(super) fn tell(&self, photo_id: PhotoId, photo: &mut Photo, drawn: &[f64]) -> Option<Overlap> {
        if self.files.has_mask(photo_id, photo) {
            return Some(Overlap::measure(drawn, photo));
        }
        if self.is_drawn {
            photo.image.pixels.iter_mut().zip(drawn).for_each(|(pixel, alpha)| pixel[3] = *alpha);
        }
        None
    }
}
