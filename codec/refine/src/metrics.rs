//! How alike a picture and a photograph are: the measures of the paper's tables.
//!
//! A picture is drawn over black and rounded to 8 bits, as it would be saved; the photograph is cut
//! out by its mask.

use crate::capture::Photo;
use crate::fit::{Lpips, ssim_and_gradient};
use crate::image::Image;

/// Measures of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// PSNR in dB over the pixels of the subject; `None` where the photograph shows none, `+inf`
    /// where all are equal.
    pub psnr_fg: Option<f64>,
    /// PSNR in dB over all pixels that the photograph shows.
    pub psnr_full: f64,
    /// Mean structural similarity of the whole frame, see [`ssim`].
    pub ssim: f64,
    /// LPIPS of the whole frame (Zhang et al. 2018), by the network whose weights are given.
    pub lpips: Option<f64>,
}

impl Measures {
    /// Compares `picture` with `photo`.
    ///
    /// # Panics
    /// If their sizes differ, or are too small for `lpips`, see [`Lpips::check_size`].
    pub fn of(picture: &Image, photo: &Photo, lpips: Option<&Lpips<f32>>) -> Measures {
        let mut saved = rounded(picture);
        for (pixel, _) in saved.pixels.iter_mut().zip(&photo.seen).filter(|(_, seen)| !**seen) {
            *pixel = [0.0; 4];
        }
        let taken = &photo.image;
        let error = |i: usize| (0..3).map(|c| (saved.pixels[i][c] - taken.pixels[i][c]).powi(2)).sum::<f64>();
        let psnr = |pixels: Vec<usize>| {
            let squares: f64 = pixels.iter().map(|&i| error(i)).sum();
            (!pixels.is_empty()).then(|| -10.0 * (squares / (3 * pixels.len()) as f64).log10())
        };
        let seen = |i: &usize| photo.seen[*i];
        let subject = |i: &usize| photo.is_subject(*i);
        let all = 0..taken.pixels.len();
        Measures {
            psnr_fg: psnr(all.clone().filter(subject).collect()),
            psnr_full: psnr(all.filter(seen).collect()).unwrap_or(f64::INFINITY),
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

/// Mean structural similarity (Wang et al., "Image quality assessment", 2004) of two images over
/// black, of all three channels: Gaussian window of 11 pixels with a standard deviation of 1.5,
/// zeros beyond the edges as in 3D Gaussian Splatting.
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
        let measures = Measures::of(&waves, &photo(saved), None);
        assert_eq!((measures.psnr_fg, measures.psnr_full), (Some(f64::INFINITY), f64::INFINITY));
        assert!((measures.ssim - 1.0).abs() < 1e-12);
    }

    /// The same formula by SciPy: `scipy.ndimage.correlate` with `mode="constant"` and the window
    /// `exp(-0.5 (k / 1.5)^2)`, k from -5 to 5.
    #[test]
    fn ssim_is_that_of_an_independent_program() {
        let a = image(|x, y| [0.5 + 0.4 * (0.5 * x).sin(), 0.5 + 0.3 * (0.4 * y).cos(), (x + y) / 40.0]);
        let b = image(|x, y| [0.5 + 0.4 * (0.5 * x + 0.3).sin(), 0.5 + 0.25 * (0.4 * y).cos(), 0.4]);
        assert!((ssim(&a, &b) - SSIM_BY_SCIPY).abs() < 1e-9, "{}", ssim(&a, &b));
    }

    const SSIM_BY_SCIPY: f64 = 0.812_673_097_721_712_1;

    #[test]
    fn the_subject_alone_counts_for_its_psnr() {
        let mut taken = photo(image(|_, _| [0.0; 3]));
        for (i, pixel) in taken.image.pixels.iter_mut().enumerate() {
            *pixel = if i % 24 < 6 { [0.4, 0.4, 0.4, 1.0] } else { [0.0; 4] };
        }
        let drawn = image(|x, _| if x < 6.0 { [0.6; 3] } else { [0.2; 3] });
        let measures = Measures::of(&drawn, &taken, None);
        let psnr = |mse: f64| -10.0 * mse.log10();
        assert!((measures.psnr_fg.unwrap() - psnr(0.04)).abs() < 1e-9);
        assert!((measures.psnr_full - psnr(0.04)).abs() < 1e-9);
        // What the lens did not show is no error.
        taken.seen.iter_mut().enumerate().for_each(|(i, seen)| *seen = i % 24 < 3);
        for (pixel, seen) in taken.image.pixels.iter_mut().zip(&taken.seen) {
            *pixel = if *seen { [0.6, 0.6, 0.6, 1.0] } else { [0.0; 4] };
        }
        let measures = Measures::of(&drawn, &taken, None);
        assert_eq!(measures.psnr_full, f64::INFINITY);
        assert!((measures.ssim - 1.0).abs() < 1e-12);
    }

    #[test]
    fn without_a_subject_there_is_no_psnr_of_it() {
        let black = image(|_, _| [0.0; 3]);
        let mut empty = photo(black.clone());
        empty.image.pixels.fill([0.0; 4]);
        assert_eq!(Measures::of(&black, &empty, None).psnr_fg, None);
    }
}
