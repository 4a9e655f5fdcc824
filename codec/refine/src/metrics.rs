//! Image quality metrics of the paper's tables, between a picture and a photograph.
//!
//! The picture is over black and rounded to 8 bits, as in a file; the photograph is multiplied by its
//! mask.

use crate::capture::Photo;
use crate::color_alignment::align_colors;
use crate::fit::{Lpips, ssim_and_gradient};
use crate::image::Image;

/// Quality metrics of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageMetrics {
    /// PSNR in dB over the pixels of the subject; `None` without such pixels, `+inf` if all are equal.
    pub psnr_fg: Option<f64>,
    /// The same after the affine transform of colours that fits the photograph best: what is left of the difference when
    /// the camera's own colours are taken away.
    pub psnr_fg_aligned: Option<f64>,
    /// PSNR in dB over all valid pixels of the photograph, see [`Photo::seen`].
    pub psnr_full: f64,
    /// Mean structural similarity over the whole image, see [`ssim`].
    pub ssim: f64,
    /// LPIPS over the whole image (Zhang et al. 2018); `None` without a network.
    pub lpips: Option<f64>,
}

impl ImageMetrics {
    /// Compares `picture` with `photo`.
    ///
    /// # Panics
    /// If the sizes differ, or are too small for `lpips`, see [`Lpips::check_size`].
    pub fn of(picture: &Image, photo: &Photo, lpips: Option<&Lpips<f32>>) -> ImageMetrics {
        let mut saved = rounded(picture);
        for (pixel, _) in saved.pixels.iter_mut().zip(&photo.seen).filter(|(_, seen)| !**seen) {
            *pixel = [0.0; 4];
        }
        let taken = &photo.image;
        let psnr = |shown: &Image, pixels: Vec<usize>| {
            let error =
                |i: usize| (0..3).map(|c| (shown.pixels[i][c] - taken.pixels[i][c]).powi(2)).sum::<f64>();
            let squares: f64 = pixels.iter().map(|&i| error(i)).sum();
            (!pixels.is_empty()).then(|| -10.0 * (squares / (3 * pixels.len()) as f64).log10())
        };
        let seen = |i: &usize| photo.seen[*i];
        let subject = |i: &usize| photo.is_subject(*i);
        let all = 0..taken.pixels.len();
        let aligned = rounded(&align_colors(&saved, photo));
        ImageMetrics {
            psnr_fg: psnr(&saved, all.clone().filter(subject).collect()),
            psnr_fg_aligned: psnr(&aligned, all.clone().filter(subject).collect()),
            psnr_full: psnr(&saved, all.filter(seen).collect()).unwrap_or(f64::INFINITY),
            ssim: ssim(&saved, taken),
            lpips: lpips.map(|lpips| {
                let single = |image: &Image| -> Vec<[f32; 4]> {
                    image.pixels.iter().map(|pixel| pixel.map(|c| c as f32)).collect()
                };
                lpips.distance(&single(&saved), &single(taken), taken.width as usize)
            }),
        }
    }
}

/// The image over black in 8 bits.
fn rounded(image: &Image) -> Image {
    let round = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round() / 255.0;
    let pixels = image.pixels.iter().map(|&[r, g, b, a]| [round(r), round(g), round(b), a]).collect();
    Image { width: image.width, height: image.height, pixels }
}

/// Mean structural similarity (Wang et al., "Image quality assessment", 2004) of two images over black,
/// over all three channels. The window is Gaussian with 11 pixels and a standard deviation of 1.5; pixels
/// beyond the edges are 0, as in 3D Gaussian Splatting.
///
/// # Panics
/// If the sizes differ.
pub fn ssim(a: &Image, b: &Image) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height), "images of one size");
    ssim_and_gradient(&a.pixels, &b.pixels, a.width as usize).0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(color: impl Fn(f64, f64) -> [f64; 3]) -> Image {
        let mut image = Image::new(24, 18);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            let [r, g, b] = color((i % 24) as f64, (i / 24) as f64);
            *pixel = [r, g, b, 1.0];
        }
        image
    }

    fn photo(image: Image) -> Photo {
        let seen = vec![true; image.pixels.len()];
        Photo { image, seen }
    }

    #[test]
    fn equal_images_are_alike() {
        let waves = image(|x, y| [(0.5 * x).sin().abs(), (0.3 * y).cos().abs(), 0.5]);
        let saved = rounded(&waves);
        let metrics = ImageMetrics::of(&waves, &photo(saved), None);
        assert_eq!((metrics.psnr_fg, metrics.psnr_full), (Some(f64::INFINITY), f64::INFINITY));
        assert!((metrics.ssim - 1.0).abs() < 1e-12);
    }

    /// The expected value is from SciPy: `scipy.ndimage.correlate` with `mode="constant"` and the window
    /// `exp(-0.5 (k / 1.5)^2)`, k from -5 to 5.
    #[test]
    fn ssim_agrees_with_scipy() {
        let a = image(|x, y| [0.5 + 0.4 * (0.5 * x).sin(), 0.5 + 0.3 * (0.4 * y).cos(), (x + y) / 40.0]);
        let b = image(|x, y| [0.5 + 0.4 * (0.5 * x + 0.3).sin(), 0.5 + 0.25 * (0.4 * y).cos(), 0.4]);
        assert!((ssim(&a, &b) - SSIM_BY_SCIPY).abs() < 1e-9, "{}", ssim(&a, &b));
    }

    const SSIM_BY_SCIPY: f64 = 0.812_673_097_721_712_1;

    #[test]
    fn only_the_subject_counts_for_psnr_fg() {
        let mut taken = photo(image(|_, _| [0.0; 3]));
        for (i, pixel) in taken.image.pixels.iter_mut().enumerate() {
            *pixel = if i % 24 < 6 { [0.4, 0.4, 0.4, 1.0] } else { [0.0; 4] };
        }
        let drawn = image(|x, _| if x < 6.0 { [0.6; 3] } else { [0.2; 3] });
        let metrics = ImageMetrics::of(&drawn, &taken, None);
        let psnr = |mse: f64| -10.0 * mse.log10();
        assert!((metrics.psnr_fg.unwrap() - psnr(0.04)).abs() < 1e-9);
        assert!((metrics.psnr_full - psnr(0.04)).abs() < 1e-9);
        // Invalid pixels do not count.
        taken.seen.iter_mut().enumerate().for_each(|(i, seen)| *seen = i % 24 < 3);
        for (pixel, seen) in taken.image.pixels.iter_mut().zip(&taken.seen) {
            *pixel = if *seen { [0.6, 0.6, 0.6, 1.0] } else { [0.0; 4] };
        }
        let metrics = ImageMetrics::of(&drawn, &taken, None);
        assert_eq!(metrics.psnr_full, f64::INFINITY);
        assert!((metrics.ssim - 1.0).abs() < 1e-12);
    }

    #[test]
    fn without_a_subject_there_is_no_psnr_fg() {
        let black = image(|_, _| [0.0; 3]);
        let mut empty = photo(black.clone());
        empty.image.pixels.fill([0.0; 4]);
        assert_eq!(ImageMetrics::of(&black, &empty, None).psnr_fg, None);
    }
}
