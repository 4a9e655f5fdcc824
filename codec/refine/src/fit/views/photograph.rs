//! [`Photograph`]: the target of a step.

use crate::capture::Photo;
use crate::image::Image;

/// Mask value, out of 255, above which a pixel belongs to the subject.
const SUBJECT: u8 = 127;

/// A photograph with 8 bits per channel: a quarter of the memory of floats.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` pixels, row by row from the top left: red, green and blue multiplied by the
    /// mask, and the mask.
    pub pixels: Vec<[u8; 4]>,
    /// Whether the photograph covers each pixel (undistortion leaves borders that it does not cover);
    /// empty if it covers all.
    pub valid: Vec<bool>,
}

impl From<&Photo> for Photograph {
    fn from(photo: &Photo) -> Photograph {
        let Image { width, height, pixels } = &photo.image;
        let byte = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
        let valid = if photo.seen.iter().all(|seen| *seen) { Vec::new() } else { photo.seen.clone() };
        Photograph {
            width: *width,
            height: *height,
            pixels: pixels.iter().map(|pixel| pixel.map(byte)).collect(),
            valid,
        }
    }
}

impl Photograph {
    /// Whether the pixel at this index shows the subject.
    pub fn is_subject(&self, pixel: usize) -> bool {
        self.pixels[pixel][3] > SUBJECT && self.is_valid(pixel)
    }

    /// Whether any pixel shows the subject.
    pub fn has_subject(&self) -> bool {
        (0..self.pixels.len()).any(|pixel| self.is_subject(pixel))
    }

    /// Whether the mask excludes any pixel that the photograph covers.
    pub fn is_masked(&self) -> bool {
        (0..self.pixels.len()).any(|pixel| self.is_valid(pixel) && !self.is_subject(pixel))
    }

    /// Whether the photograph covers the pixel at this index.
    pub fn is_valid(&self, pixel: usize) -> bool {
        self.valid.get(pixel).is_none_or(|valid| *valid)
    }
}
