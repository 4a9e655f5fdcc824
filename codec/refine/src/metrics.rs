//! Image quality metrics of the paper's tables, between a picture and a photograph.
//!
//! The picture is over black and rounded to 8 bits, as in a file; the photograph is multiplied by its
//! mask. Colours are aligned by one transform for all photographs of a camera: [`AlignedPsnr::of_camera`].

use std::ops::AddAssign;

use crate::capture::{Photo, SUBJECT};
use crate::fit::{Lpips, ssim_and_gradient};
use crate::image::Image;

pub use crate::color_alignment::ColorSums;
pub use crate::median::median;
pub use crate::temporal_median::TemporalMedian;

/// Quality metrics of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageMetrics {
    /// PSNR in dB over the pixels of the subject; `None` without such pixels, `+inf` if all are equal.
    pub psnr_fg: Option<f64>,
    /// PSNR in dB over all valid pixels of the photograph, see [`Photo::seen`].
    pub psnr_full: f64,
    /// PSNR in dB over the pixels that move, see [`TemporalMedian::moving`]; `None` without such pixels.
    pub psnr_moving: Option<f64>,
    /// Mean structural similarity over the whole image, see [`ssim`].
    pub ssim: f64,
    /// LPIPS over the whole image (Zhang et al. 2018); `None` without a network.
    pub lpips: Option<f64>,
}

/// Sums over the pixels of a picture, from which the errors after any affine transform of its colours follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSums {
    /// Pixels of the subject.
    pub subject: ColorSums,
    /// All valid pixels.
    pub seen: ColorSums,
    /// Pixels that move.
    pub moving: ColorSums,
}

/// How many pixels a drawn subject shares with a mask; sums are over photographs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overlap {
    /// Pixels of both.
    pub intersection: usize,
    /// Pixels of either.
    pub union: usize,
}

/// PSNR of a picture after the affine transform of colours that brings all pictures of its camera nearest to their
/// photographs: the difference without the camera's own colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignedPsnr {
    /// In dB over the pixels of the subject, after the transform that fits these best; `None` without such pixels.
    pub fg: Option<f64>,
    /// In dB over all valid pixels, after the transform that fits these best.
    pub full: f64,
    /// In dB over the pixels that move, after the transform of all valid ones; `None` without such pixels.
    pub moving: Option<f64>,
}

impl ImageMetrics {
    /// Compares `picture` with `photo`, without `psnr_moving`.
    ///
    /// # Panics
    /// If the sizes differ, or are too small for `lpips`, see [`Lpips::check_size`].
    pub fn measure(picture: &Image, photo: &Photo, lpips: Option<&Lpips<f32>>) -> ImageMetrics {
        ImageMetrics::with_sums(picture, photo, None, lpips).0
    }

    /// Compares `picture` with `photo`, a photograph of a camera with this median over time. The sums are for the alignment
    /// of colours.
    ///
    /// # Panics
    /// If the sizes differ, or are too small for `lpips`, see [`Lpips::check_size`].
    pub fn with_sums(
        picture: &Image,
        photo: &Photo,
        median: Option<&TemporalMedian>,
        lpips: Option<&Lpips<f32>>,
    ) -> (ImageMetrics, ImageSums) {
        let mut saved = rounded(picture);
        for (pixel, _) in saved.pixels.iter_mut().zip(&photo.seen).filter(|(_, seen)| !**seen) {
            *pixel = [0.0; 4];
        }
        let taken = &photo.image;
        let sums = ImageSums::measure(&saved, photo, median);
        let metrics = ImageMetrics {
            psnr_fg: sums.subject.psnr(),
            psnr_full: sums.seen.psnr().unwrap_or(f64::INFINITY),
            psnr_moving: sums.moving.psnr(),
            ssim: ssim(&saved, taken),
            lpips: lpips.map(|lpips| {
                let single = |image: &Image| -> Vec<[f32; 4]> {
                    image.pixels.iter().map(|pixel| pixel.map(|c| c as f32)).collect()
                };
                lpips.distance(&single(&saved), &single(taken), taken.width as usize)
            }),
        };
        (metrics, sums)
    }
}

impl Overlap {
    /// Compares the alpha of what is drawn with the mask of `photo`, over its valid pixels: each belongs to the subject where
    /// it is above a half.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn measure(drawn: &[f64], photo: &Photo) -> Overlap {
        assert_eq!(drawn.len(), photo.seen.len(), "images of one size");
        let mut overlap = Overlap::default();
        for (i, alpha) in drawn.iter().enumerate().filter(|(i, _)| photo.seen[*i]) {
            let (is_drawn, is_masked) = (*alpha > SUBJECT, photo.is_subject(i));
            overlap.intersection += usize::from(is_drawn && is_masked);
            overlap.union += usize::from(is_drawn || is_masked);
        }
        overlap
    }

    /// Intersection over union, from 0 to 1; `None` if both are empty.
    pub fn iou(self) -> Option<f64> {
        (self.union > 0).then(|| self.intersection as f64 / self.union as f64)
    }
}

impl AddAssign for Overlap {
    fn add_assign(&mut self, other: Overlap) {
        self.intersection += other.intersection;
        self.union += other.union;
    }
}

impl ImageSums {
    fn measure(picture: &Image, photo: &Photo, median: Option<&TemporalMedian>) -> ImageSums {
        let taken = &photo.image.pixels;
        assert_eq!(picture.pixels.len(), taken.len(), "images of one size");
        let moving = median.map(|median| median.moving(photo));
        let mut sums = ImageSums { subject: ColorSums::ZERO, seen: ColorSums::ZERO, moving: ColorSums::ZERO };
        for (i, (drawn, taken)) in picture.pixels.iter().zip(taken).enumerate() {
            if photo.seen[i] {
                sums.seen.add(drawn, taken);
            }
            if photo.is_subject(i) {
                sums.subject.add(drawn, taken);
            }
            if moving.as_ref().is_some_and(|moving| moving[i]) {
                sums.moving.add(drawn, taken);
            }
        }
        sums
    }
}

impl AlignedPsnr {
    /// The PSNR of each picture of a camera, given the sums of all of them.
    pub fn of_camera(sums: &[ImageSums]) -> Vec<AlignedPsnr> {
        let transform = |choose: fn(&ImageSums) -> &ColorSums| {
            let mut total = ColorSums::ZERO;
            sums.iter().for_each(|sums| total += choose(sums));
            total.transform()
        };
        let (subject, seen) = (transform(|sums| &sums.subject), transform(|sums| &sums.seen));
        let aligned = |sums: &ImageSums| AlignedPsnr {
            fg: sums.subject.psnr_after(&subject),
            full: sums.seen.psnr_after(&seen).unwrap_or(f64::INFINITY),
            moving: sums.moving.psnr_after(&seen),
        };
        sums.iter().map(aligned).collect()
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
        let metrics = ImageMetrics::measure(&waves, &photo(saved), None);
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
        let metrics = ImageMetrics::measure(&drawn, &taken, None);
        let psnr = |mse: f64| -10.0 * mse.log10();
        assert!((metrics.psnr_fg.unwrap() - psnr(0.04)).abs() < 1e-9);
        assert!((metrics.psnr_full - psnr(0.04)).abs() < 1e-9);
        // Invalid pixels do not count.
        taken.seen.iter_mut().enumerate().for_each(|(i, seen)| *seen = i % 24 < 3);
        for (pixel, seen) in taken.image.pixels.iter_mut().zip(&taken.seen) {
            *pixel = if *seen { [0.6, 0.6, 0.6, 1.0] } else { [0.0; 4] };
        }
        let metrics = ImageMetrics::measure(&drawn, &taken, None);
        assert_eq!(metrics.psnr_full, f64::INFINITY);
        assert!((metrics.ssim - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_mask_overlaps_what_is_drawn_in_valid_pixels() {
        let mut taken = photo(image(|_, _| [0.5; 3]));
        // Six of 24 columns are masked, and columns 3 to 11 drawn.
        taken
            .image
            .pixels
            .iter_mut()
            .enumerate()
            .for_each(|(i, pixel)| pixel[3] = if i % 24 < 6 { 0.6 } else { 0.4 });
        let drawn: Vec<f64> =
            (0..24 * 18).map(|i| if (3..12).contains(&(i % 24)) { 0.51 } else { 0.5 }).collect();
        let mut overlap = Overlap::measure(&drawn, &taken);
        assert_eq!((overlap.intersection, overlap.union), (3 * 18, 12 * 18));
        taken.seen.iter_mut().enumerate().for_each(|(i, seen)| *seen = i % 24 >= 5);
        let of_valid = Overlap::measure(&drawn, &taken);
        assert_eq!((of_valid.intersection, of_valid.union), (18, 7 * 18));
        overlap += of_valid;
        assert_eq!(overlap.iou(), Some(4.0 / 19.0), "of the sums, not the mean of two");
        assert_eq!(Overlap::default().iou(), None);
    }

    #[test]
    fn without_a_subject_there_is_no_psnr_fg() {
        let black = image(|_, _| [0.0; 3]);
        let mut empty = photo(black.clone());
        empty.image.pixels.fill([0.0; 4]);
        assert_eq!(ImageMetrics::measure(&black, &empty, None).psnr_fg, None);
    }

    /// A picture of colours from 0.2 to 0.6, and the photograph that is brighter by `offset`.
    fn brighter(offset: f64) -> (Image, Photo) {
        let shade = |x: f64, y: f64| [0.2 + 0.4 * x / 24.0, 0.2 + 0.4 * y / 18.0, 0.4];
        (image(shade), photo(image(|x, y| shade(x, y).map(|c| c + offset))))
    }

    #[test]
    fn a_camera_has_one_transform_for_all_its_pictures() {
        let aligned = |offsets: &[f64]| {
            let sums =
                |(picture, photo): (Image, Photo)| ImageMetrics::with_sums(&picture, &photo, None, None).1;
            AlignedPsnr::of_camera(&offsets.iter().map(|offset| sums(brighter(*offset))).collect::<Vec<_>>())
        };
        // 0.1 is 20 dB; rounding to 8 bits leaves 59 dB.
        assert!(aligned(&[0.1]).iter().all(|psnr| psnr.full > 55.0 && psnr.fg.unwrap() > 55.0));
        assert!(aligned(&[0.1, 0.1]).iter().all(|psnr| psnr.full > 55.0));
        let opposite = aligned(&[0.1, -0.1]);
        assert!(opposite.iter().all(|psnr| (psnr.full - 20.0).abs() < 0.2), "{opposite:?}");
        assert!(opposite.iter().all(|psnr| (psnr.fg.unwrap() - 20.0).abs() < 0.2), "{opposite:?}");
        assert!(AlignedPsnr::of_camera(&[]).is_empty());
    }

    #[test]
    fn the_subject_and_whole_images_have_transforms_of_their_own() {
        let (picture, mut photo) = brighter(0.1);
        // A quarter is the subject; the rest is as much darker.
        for (i, pixel) in photo.image.pixels.iter_mut().enumerate().filter(|(i, _)| i % 24 >= 6) {
            let [r, g, b, _] = picture.pixels[i];
            *pixel = [r - 0.1, g - 0.1, b - 0.1, 0.0];
        }
        let sums = ImageMetrics::with_sums(&picture, &photo, None, None).1;
        let AlignedPsnr { fg, full, moving } = AlignedPsnr::of_camera(&[sums])[0];
        assert!(fg.unwrap() > 55.0 && full < 35.0 && moving.is_none(), "{fg:?} {full}");
    }

    #[test]
    fn moving_pixels_are_measured_after_the_transform_of_all() {
        let (picture, still) = brighter(0.1);
        let mut moved = still.clone();
        // By a third, in a column of the picture.
        moved.image.pixels.iter_mut().step_by(24).for_each(|pixel| pixel[1] += 0.3);
        let median =
            TemporalMedian::from_pictures(&[&still, &moved, &still].map(|photo| photo.image.to_rgb8()))
                .unwrap();
        let (metrics, sums) = ImageMetrics::with_sums(&picture, &moved, Some(&median), None);
        // Two channels are off by 0.1 and one by 0.4.
        let expected = -10.0 * ((0.01 + 0.01 + 0.16) / 3.0f64).log10();
        assert!((metrics.psnr_moving.unwrap() - expected).abs() < 0.1, "{metrics:?} {expected}");
        // Alone, the column would be aligned away.
        let (at_rest, sums_at_rest) = ImageMetrics::with_sums(&picture, &still, Some(&median), None);
        let aligned = AlignedPsnr::of_camera(&[sums, sums_at_rest, sums_at_rest, sums_at_rest]);
        let moving = aligned[0].moving.unwrap();
        assert!((moving - -10.0 * (0.09 / 3.0f64).log10()).abs() < 1.0, "{moving}");
        assert_eq!((at_rest.psnr_moving, aligned[1].moving), (None, None), "nothing moves there");
        assert_eq!(ImageMetrics::measure(&picture, &moved, None).psnr_moving, None);
    }
}
