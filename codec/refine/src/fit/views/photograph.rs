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
    /// The photograph with pixels `factor` times as large, means of its own; one is valid if all in it are. What is left at
    /// the right and bottom is cut off.
    ///
    /// # Panics
    /// If `factor` is 0.
    pub fn shrunk(&self, factor: u32) -> Photograph {
        let (width, height) = (self.width / factor, self.height / factor);
        let inside = |i: u32| {
            let corner = [i % width, i / width].map(|at| at * factor);
            (0..factor * factor)
                .map(move |k| ((corner[1] + k / factor) * self.width + corner[0] + k % factor) as usize)
        };
        let mean = |i: u32| {
            let sum = inside(i).fold([0; 4], |sum: [u32; 4], at| {
                std::array::from_fn(|c| sum[c] + u32::from(self.pixels[at][c]))
            });
            sum.map(|sum| ((sum + factor * factor / 2) / (factor * factor)) as u8)
        };
        let is_valid = |i: u32| inside(i).all(|at| self.is_valid(at));
        let valid =
            if self.valid.is_empty() { Vec::new() } else { (0..width * height).map(is_valid).collect() };
        Photograph { width, height, pixels: (0..width * height).map(mean).collect(), valid }
    }

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
        if self.valid.is_empty() {
            // Whole rows without a branch: a step of a fit asks.
            let is_masked =
                |row: &[[u8; 4]]| row.iter().fold(false, |any, pixel| any | (pixel[3] <= SUBJECT));
            return self.pixels.chunks(self.width.max(1) as usize).any(is_masked);
        }
        (0..self.pixels.len()).any(|pixel| self.is_valid(pixel) && !self.is_subject(pixel))
    }

    /// The mask at a pixel as the loss compares it. 1 of 255 is 0: a device's word for a pixel has no room for all values
    /// beside the value of an invalid pixel.
    pub(in crate::fit) fn opacity(&self, pixel: usize) -> u8 {
        let mask = self.pixels[pixel][3];
        if mask > 1 { mask } else { 0 }
    }

    /// Red, green, blue and a byte more of each pixel: 0 if it is invalid, 1 outside of the subject, else the mask.
    #[cfg(feature = "gpu")]
    pub(in crate::fit) fn words(&self) -> Vec<u32> {
        if self.valid.is_empty() {
            return self
                .pixels
                .iter()
                .map(|[r, g, b, mask]| u32::from_le_bytes([*r, *g, *b, (*mask).max(1)]))
                .collect();
        }
        let word = |(i, [r, g, b, _]): (usize, &[u8; 4])| {
            let state = if self.is_valid(i) { self.opacity(i).max(1) } else { 0 };
            u32::from_le_bytes([*r, *g, *b, state])
        };
        self.pixels.iter().enumerate().map(word).collect()
    }

    /// Whether the photograph covers the pixel at this index.
    pub fn is_valid(&self, pixel: usize) -> bool {
        self.valid.get(pixel).is_none_or(|valid| *valid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_the_same_whether_all_pixels_are_valid_or_said_to_be() {
        for mask in [0, 1, 2, 127, 128, 255] {
            let pixels = vec![[7, 8, 9, 255], [7, 8, 9, mask], [7, 8, 9, 255]];
            let whole = Photograph { width: 2, height: 1, pixels, valid: Vec::new() };
            let stated = Photograph { valid: vec![true; 3], ..whole.clone() };
            assert_eq!(whole.is_masked(), mask <= 127);
            assert_eq!(whole.is_masked(), stated.is_masked());
            #[cfg(feature = "gpu")]
            assert_eq!(whole.words(), stated.words());
        }
    }

    #[test]
    fn larger_pixels_are_means() {
        let pixels: Vec<[u8; 4]> = (0..15).map(|i| [i, 10 * i, 0, 255]).collect();
        let whole = Photograph { width: 5, height: 3, pixels, valid: Vec::new() };
        let shrunk = whole.shrunk(2);
        assert_eq!((shrunk.width, shrunk.height, shrunk.valid.len()), (2, 1, 0));
        assert_eq!(shrunk.pixels, [[3, 30, 0, 255], [5, 50, 0, 255]]);
        let valid = (0..15).map(|i| i != 6).collect();
        assert_eq!(Photograph { valid, ..whole.clone() }.shrunk(2).valid, [false, true]);
        assert_eq!(whole.shrunk(1), whole);
    }
}
