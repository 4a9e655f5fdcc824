//! Plates: what the cameras of a capture show without its subject.
//!
//! Cameras that stand still show the same background in all photographs. A capture states pictures of it, or else they are
//! medians of photographs. With plates, photographs without masks get mattes, and the background is taken out of pixels that
//! show it through the rim of the subject.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use image::Luma;
use program::Fault;
use rayon::prelude::*;
use refine::capture::{Photo, PhotoId};
use refine::image::Image;
use refine::matte::Plate;

use super::capture_files::CaptureFiles;
use super::image_file::{Mask, bad, check_size, read, read_image};

/// Most photographs of a camera that a median is of, and least: fewer show too little of what is behind the subject.
const PICTURES_MAX: usize = 33;
const PICTURES_MIN: usize = 8;

/// Bytes that more than the fewest may have.
const BYTES_MAX: usize = 210 << 20;

/// The plate of a camera.
#[derive(Clone, Debug, Default)]
pub(super) struct CameraPlate {
    /// The picture that the capture states.
    stated: Option<PathBuf>,
    /// Known from its first use on; `None` if the camera has none.
    known: Arc<OnceLock<Option<Plate>>>,
}

impl CameraPlate {
    /// The picture at `path`, which must be a file.
    ///
    /// # Errors
    /// [`Fault::Data`] that names it.
    pub(super) fn stated(path: PathBuf) -> Result<CameraPlate, Fault> {
        let missing = "this plate is missing; put it there, or remove plates from capture.json";
        match path.is_file() {
            true => Ok(CameraPlate { stated: Some(path), ..CameraPlate::default() }),
            false => Err(bad(&path, missing)),
        }
    }
}

/// What photographs keep of the background.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Background {
    /// Whether photographs without masks get mattes.
    pub is_matted: bool,
    /// Whether photographs keep the colours of the background; their alpha is the mask in any case.
    pub is_kept: bool,
}

impl CaptureFiles {
    /// Whether photographs have masks, in files of their own or as transparency; looks at one photograph of each camera.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read.
    pub fn has_masks(&self) -> Result<bool, Fault> {
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

    /// Whether a plate of each camera is stated or can be found.
    pub fn can_have_plates(&self) -> bool {
        let photos_of = |camera: usize| self.capture.photos.iter().filter(|id| id.camera == camera).count();
        (0..self.capture.cameras.len())
            .all(|camera| self.plates[camera].stated.is_some() || photos_of(camera) >= PICTURES_MIN)
    }

    /// Finds the plates that are not stated: medians of photographs from all over the capture, every other frame, so that
    /// held frames have no part in them. From then on, photographs without masks get mattes.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a file that cannot be read, or a camera with too few photographs.
    pub fn find_plates(&mut self) -> anyhow::Result<()> {
        // Photographs of frames that are not selected show the background, too.
        let whole = CaptureFiles::open(&self.folder)?;
        let unknown = |camera: &usize| {
            self.plates[*camera].stated.is_none() && self.plates[*camera].known.get().is_none()
        };
        let find = |camera: usize| -> Result<(), Fault> {
            let name = &self.capture.cameras[camera].name;
            let in_whole = whole.camera(name)?;
            let plate = whole.median_plate(in_whole)?;
            let _ = self.plates[camera].known.set(Some(plate));
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
        let Some(plate) = self.plate(camera)? else { return Ok(None) };
        let pixels = plate.colors().iter().map(|color| {
            let [r, g, b] = color.map(|c| f64::from(c) / 255.0);
            [r, g, b, 1.0]
        });
        let file_camera = &self.file_cameras[camera];
        let image = Image { width: file_camera.width, height: file_camera.height, pixels: pixels.collect() };
        Ok(Some(self.seen(camera, image)))
    }

    /// The plate of a camera, if it is stated or was found.
    pub(super) fn plate(&self, camera: usize) -> Result<Option<&Plate>, Fault> {
        let CameraPlate { stated, known } = &self.plates[camera];
        let Some(path) = stated.as_ref().filter(|_| known.get().is_none()) else {
            return Ok(known.get().and_then(Option::as_ref));
        };
        let picture = read(path)?.into_rgb8();
        check_size(path, picture.dimensions(), &self.file_cameras[camera])?;
        let colors: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
        Ok(known.get_or_init(|| Some(Plate::of(&[&colors], picture.width() as usize))).as_ref())
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
        let bytes = 3 * self.pixels_max();
        let count = (BYTES_MAX / bytes).clamp(PICTURES_MIN, PICTURES_MAX).min(from.len());
        let spread = (0..count).map(|i| from[i * (from.len() - 1) / (count - 1)]);
        let pictures = spread.map(|photo_id| Ok(colors_of(&self.taken(photo_id)?)));
        let pictures: Vec<Vec<[u8; 3]>> = pictures.collect::<Result<_, Fault>>()?;
        let pictures: Vec<&[[u8; 3]]> = pictures.iter().map(Vec::as_slice).collect();
        Ok(Plate::of(&pictures, self.file_cameras[camera].width as usize))
    }
}

/// The 8-bit colours of a picture over black.
fn colors_of(image: &Image) -> Vec<[u8; 3]> {
    image.pixels.iter().map(|&[r, g, b, _]| [r, g, b].map(|c| (c * 255.0).round() as u8)).collect()
}

/// The matte of a photograph.
pub(super) fn matte(plate: &Plate, image: &Image) -> Mask {
    let alpha = plate.matte(&colors_of(image));
    let mut alpha = alpha.into_iter().map(|alpha| u16::from(alpha) * (u16::MAX / u16::from(u8::MAX)));
    Mask::from_fn(image.width, image.height, |_, _| Luma([alpha.next().expect("a value for each pixel")]))
}

/// Takes the background out of a photograph with this mask: what is left of the colours when the plate is not seen through
/// the rim of the subject any more.
pub(super) fn take_out(image: &mut Image, plate: &Plate) {
    let gains = plate.gains(&colors_of(image));
    for (pixel, behind) in image.pixels.iter_mut().zip(plate.colors()) {
        let alpha = pixel[3];
        for (c, gain) in gains.into_iter().enumerate() {
            let seen_through = (1.0 - alpha) * gain * f64::from(behind[c]) / 255.0;
            pixel[c] = (pixel[c] - seen_through).clamp(0.0, alpha);
        }
    }
}
