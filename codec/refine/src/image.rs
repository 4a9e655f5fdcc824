//! [`Image`]: pictures of the reference renderer, and their differences.

/// An RGBA image, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` pixels: red, green and blue premultiplied by alpha, then alpha. Display-referred;
    /// alpha is 0 to 1, and the colours of what is drawn are 0 to alpha.
    pub pixels: Vec<[f64; 4]>,
}

impl Image {
    /// A transparent black image.
    pub fn new(width: u32, height: u32) -> Image {
        Image { width, height, pixels: vec![[0.0; 4]; width as usize * height as usize] }
    }

    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    pub fn pixel(&self, x: u32, y: u32) -> [f64; 4] {
        assert!(x < self.width && y < self.height, "pixel {x},{y} of {}x{}", self.width, self.height);
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// Puts this image in front of another.
    ///
    /// # Panics
    /// If the sizes differ.
    pub(crate) fn put_before(&mut self, behind: &Image) {
        assert_eq!((self.width, self.height), (behind.width, behind.height), "images of one size");
        for (pixel, behind) in self.pixels.iter_mut().zip(&behind.pixels) {
            let through = 1.0 - pixel[3];
            pixel.iter_mut().zip(behind).for_each(|(channel, behind)| *channel += through * behind);
        }
    }

    /// The image over black in 8 bits per channel: `width * height * 3` bytes, colours clamped to 0 to 1 and
    /// rounded to nearest.
    pub fn to_rgb8(&self) -> Vec<u8> {
        let byte = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
        self.pixels.iter().flat_map(|&[r, g, b, _]| [byte(r), byte(g), byte(b)]).collect()
    }

    /// Peak signal-to-noise ratio in dB of two images over black, colours clamped to 0 to 1; `+inf` for
    /// equal images.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn psnr(&self, other: &Image) -> f64 {
        psnr(self.squared_error(other), self.pixels.len())
    }

    /// Sum of squared differences over all channels of all pixels, over black, colours clamped to 0 to 1.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn squared_error(&self, other: &Image) -> f64 {
        assert_eq!((self.width, self.height), (other.width, other.height), "images of one size");
        self.colors(other).map(|(a, b)| (a - b) * (a - b)).sum()
    }

    /// Sum of squared differences as in [`Image::squared_error`] over the pixels with an alpha above 0 in this
    /// image, and the number of these pixels.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn squared_error_covered(&self, other: &Image) -> (f64, usize) {
        assert_eq!((self.width, self.height), (other.width, other.height), "images of one size");
        let (mut sum, mut count) = (0.0, 0);
        for (a, b) in self.pixels.iter().zip(&other.pixels).filter(|(a, _)| a[3] > 0.0) {
            for channel in 0..3 {
                let error = a[channel].clamp(0.0, 1.0) - b[channel].clamp(0.0, 1.0);
                sum += error * error;
            }
            count += 1;
        }
        (sum, count)
    }

    /// Largest absolute difference of a channel, over black, colours clamped to 0 to 1.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn max_difference(&self, other: &Image) -> f64 {
        assert_eq!((self.width, self.height), (other.width, other.height), "images of one size");
        self.colors(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    fn colors<'a>(&'a self, other: &'a Image) -> impl Iterator<Item = (f64, f64)> + 'a {
        let pairs = self.pixels.iter().zip(&other.pixels);
        pairs.flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c].clamp(0.0, 1.0), b[c].clamp(0.0, 1.0))))
    }
}

/// Peak signal-to-noise ratio in dB of a sum of squared errors over `pixels` pixels of three channels;
/// `+inf` for no error.
pub fn psnr(squared_error: f64, pixels: usize) -> f64 {
    if squared_error == 0.0 {
        f64::INFINITY
    } else {
        -10.0 * libm::log10(squared_error / (3 * pixels) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_round_to_nearest_and_clip() {
        let image = Image { width: 1, height: 1, pixels: vec![[1.7, 0.5 / 255.0, 1.49 / 255.0, 1.0]] };
        assert_eq!(image.to_rgb8(), [255, 1, 1]);
    }

    #[test]
    fn psnr_of_a_known_error() {
        let black = Image::new(4, 2);
        let mut gray = black.clone();
        for pixel in &mut gray.pixels {
            *pixel = [0.1, 0.1, 0.1, 1.0];
        }
        assert!((black.psnr(&gray) - 20.0).abs() < 1e-9);
        assert!((black.max_difference(&gray) - 0.1).abs() < 1e-12);
        assert_eq!(black.psnr(&black), f64::INFINITY);
    }
}
