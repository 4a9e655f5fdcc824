//! [`CameraPlate`]: what a camera shows without the subject; mattes of its photographs, and what they keep of the background.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use codec::Camera;
use image::Luma;
use program::Fault;
use refine::image::Image;
use refine::matte::Plate;

use super::image_file::{Mask, bad, check_size, read};

/// The plate of a camera.
#[derive(Clone, Debug, Default)]
pub(super) struct CameraPlate {
    /// The picture that the capture states.
    stated: Option<PathBuf>,
    /// Known from its first use on.
    known: Arc<OnceLock<Plate>>,
    /// The same at the resolution of photographs that are shrunk, known from its first use on.
    shrunk: Arc<OnceLock<Plate>>,
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

    /// Whether it has to be found: it is neither stated nor known.
    pub(super) fn is_unknown(&self) -> bool {
        self.stated.is_none() && self.known.get().is_none()
    }

    /// The path of the picture that is stated.
    pub(super) fn stated_path(&self) -> Option<&Path> {
        self.stated.as_deref()
    }

    /// The plate at the resolution of shrunk photographs, which `make` makes of it.
    pub(super) fn shrunk(&self, make: impl FnOnce() -> Plate) -> &Plate {
        self.shrunk.get_or_init(make)
    }

    /// Forgets that one, for photographs of another resolution.
    pub(super) fn forget_shrunk(&mut self) {
        self.shrunk = Arc::default();
    }

    /// Makes a plate known that was not.
    pub(super) fn set(&self, plate: Plate) {
        let _ = self.known.set(plate);
    }

    /// The plate, if it is stated or known; `camera` is the camera of its pictures on disk.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file, if it cannot be read or has another size.
    pub(super) fn plate(&self, camera: &Camera) -> Result<Option<&Plate>, Fault> {
        let Some(path) = self.stated.as_ref().filter(|_| self.known.get().is_none()) else {
            return Ok(self.known.get());
        };
        let picture = read(path)?.into_rgb8();
        check_size(path, picture.dimensions(), camera)?;
        let colors: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
        Ok(Some(self.known.get_or_init(|| Plate::from_pictures(&[&colors], picture.width() as usize))))
    }
}

/// What photographs keep of the background.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Background {
    /// Whether photographs without masks get mattes.
    pub is_matted: bool,
    /// Whether photographs keep the colours of the background; their alpha is the mask in any case.
    pub is_kept: bool,
    /// Whether photographs are as they were taken, whatever masks and mattes they have.
    pub is_whole: bool,
}

/// The 8-bit colours of a picture over black.
pub(super) fn colors_of(image: &Image) -> Vec<[u8; 3]> {
    image.pixels.iter().map(|&[r, g, b, _]| [r, g, b].map(|c| (c * 255.0).round() as u8)).collect()
}

/// The matte of a photograph.
pub(super) fn matte(plate: &Plate, image: &Image) -> Mask {
    let alpha = plate.matte(&colors_of(image));
    let mut alpha = alpha.into_iter().map(|alpha| u16::from(alpha) * (u16::MAX / u16::from(u8::MAX)));
    Mask::from_fn(image.width, image.height, |_, _| Luma([alpha.next().expect("a value for each pixel")]))
}

/// Takes the background out of a photograph with this mask: the remainder of the colours when the plate is not seen
/// through the rim of the subject any more.
pub(super) fn take_out(image: &mut Image, plate: &Plate) {
    let gains = plate.bounded_gains(&colors_of(image));
    for (pixel, behind) in image.pixels.iter_mut().zip(plate.colors()) {
        let alpha = pixel[3];
        for (c, gain) in gains.into_iter().enumerate() {
            let seen_through = (1.0 - alpha) * gain * f64::from(behind[c]) / 255.0;
            pixel[c] = (pixel[c] - seen_through).clamp(0.0, alpha);
        }
    }
}
