//! [`Photograph`]: the target of a step.

use crate::capture::Photo;
use crate::image::Image;

/// Mask value, out of 255, above which a pixel belongs to the subject.
const SUBJECT: u8 = 127;

/// What a device has in place of the mask of a photograph without one.
pub(in crate::fit) const UNMASKED: u8 = 1;

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

    /// The mask at a pixel as the loss compares it. Less than one percent is 0: a device's word for a pixel has no room for
    /// all values beside those of invalid and unmasked pixels.
    pub(in crate::fit) fn opacity(&self, pixel: usize) -> u8 {
        let mask = self.pixels[pixel][3];
        if mask > UNMASKED + 1 { mask } else { 0 }
    }

    /// Red, green, blue and a byte more of each pixel: 0 if it is invalid, [`UNMASKED`] if the photograph has no mask, one
    /// more outside of the subject, else the mask.
    #[cfg(feature = "gpu")]
    pub(in crate::fit) fn words(&self) -> Vec<u32> {
        let is_masked = self.is_masked();
        let word = |(i, [r, g, b, _]): (usize, &[u8; 4])| {
            let state = match (self.is_valid(i), is_masked) {
                (false, _) => 0,
                (true, false) => UNMASKED,
                (true, true) => self.opacity(i).max(UNMASKED + 1),
            };
            u32::from_le_bytes([*r, *g, *b, state])
        };
        self.pixels.iter().enumerate().map(word).collect()
    }

    /// Whether the photograph covers the pixel at this index.
    pub fn is_valid(&self, pixel: usize) -> bool {
        self.valid.get(pixel).is_none_or(|valid| *valid)
    }
}
