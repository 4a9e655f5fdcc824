//! Comparing images within a tolerance.
//!
//! A failed comparison writes `NAME.actual.png`, `NAME.expected.png` and `NAME.difference.png`
//! (absolute differences, magnified) to `target/test-images`. Golden images are in `tests/golden`. With
//! `UPDATE_GOLDEN=1` in the environment they are rewritten and the test fails once, so that no image
//! changes unseen.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use client::gpu::Gpu;
use image::{ImageBuffer, Rgb};
use refine::image::Image;

/// Largest accepted difference of two images over black, clamped to the displayable range.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Largest difference of a channel, in 1/255.
    pub max_diff: f64,
    /// Number of pixels in which a channel may differ by more than 1/255.
    pub diff_pixels: usize,
    /// Lowest peak signal-to-noise ratio in dB.
    pub psnr: f64,
}

impl Tolerance {
    /// The tolerance of comparisons with the reference on this device. SwiftShader rounds corners to 1/16 of a
    /// pixel, the coarsest that Vulkan allows (`subPixelPrecisionBits`; lavapipe: 1/256). The opacity of the
    /// smallest Gaussians, of 0.55 pixels, falls by up to 9/255 in 1/32 of a pixel; 6.9/255 and twice
    /// as many pixels as elsewhere were measured.
    pub fn on(self, gpu: &Gpu) -> Tolerance {
        match gpu.adapter_name.contains("SwiftShader") {
            true => Tolerance {
                max_diff: 4.5 * self.max_diff,
                diff_pixels: self.diff_pixels.saturating_mul(3),
                psnr: self.psnr,
            },
            false => self,
        }
    }
}

/// Difference of two images.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Largest difference of a channel, in 1/255.
    pub max_diff: f64,
    /// Number of pixels in which a channel differs by more than 1/255.
    pub diff_pixels: usize,
    /// Peak signal-to-noise ratio in dB; `+inf` for equal images.
    pub psnr: f64,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "max {:.3}/255, {} pixels differ, {:.2} dB", self.max_diff, self.diff_pixels, self.psnr)
    }
}

/// Measures the difference of two images of one size.
///
/// # Panics
/// If the sizes differ.
pub fn difference(actual: &Image, expected: &Image) -> Difference {
    Difference {
        max_diff: 255.0 * actual.max_difference(expected),
        diff_pixels: pixels_beyond(1.0, actual, expected),
        psnr: actual.psnr(expected),
    }
}

/// Number of pixels in which a channel differs by more than `limit`, in 1/255.
pub fn pixels_beyond(limit: f64, actual: &Image, expected: &Image) -> usize {
    let pairs = actual.pixels.iter().zip(&expected.pixels);
    pairs.filter(|(a, b)| channel_difference(a, b) > limit).count()
}

/// Largest difference of a channel of two pixels, in 1/255.
fn channel_difference(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    (0..3).map(|c| 255.0 * (a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0)).abs()).fold(0.0, f64::max)
}

/// Compares two images. `name` names their files if they differ and must be unique.
///
/// # Errors
/// If the tolerance is exceeded, with the paths of the images.
pub fn check(
    name: &str,
    actual: &Image,
    expected: &Image,
    tolerance: Tolerance,
) -> Result<Difference, String> {
    if (actual.width, actual.height) != (expected.width, expected.height) {
        return Err(format!(
            "{name}: {}x{} pixels where {}x{} are expected",
            actual.width, actual.height, expected.width, expected.height
        ));
    }
    let found = difference(actual, expected);
    let paths = Paths::new(name);
    if found.max_diff <= tolerance.max_diff
        && found.diff_pixels <= tolerance.diff_pixels
        && found.psnr >= tolerance.psnr
    {
        paths.remove();
        return Ok(found);
    }
    paths.write(actual, expected);
    Err(format!(
        "{name}: {found}; allowed: max {}/255, {} pixels, {} dB; see\n  {}\n  {}\n  {}",
        tolerance.max_diff,
        tolerance.diff_pixels,
        tolerance.psnr,
        paths.actual.display(),
        paths.expected.display(),
        paths.difference.display()
    ))
}

/// Compares an image with the golden one of this name.
///
/// # Errors
/// As [`check`]; also if there is no golden image, or it was rewritten.
pub fn check_golden(name: &str, actual: &Image, tolerance: Tolerance) -> Result<Difference, String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(format!("{name}.png"));
    if std::env::var_os("UPDATE_GOLDEN").is_some_and(|value| value == "1") {
        fs::create_dir_all(path.parent().expect("it is in a folder")).map_err(|error| error.to_string())?;
        write_png(&path, actual.width, actual.height, actual.to_rgb8());
        return Err(format!(
            "{} was rewritten; look at it, then run again without UPDATE_GOLDEN",
            path.display()
        ));
    }
    let golden = image::open(&path).map_err(|error| format!("{}: {error}", path.display()))?.to_rgb8();
    let expected = Image {
        width: golden.width(),
        height: golden.height(),
        pixels: golden
            .pixels()
            .map(|Rgb([r, g, b])| [*r, *g, *b, 255].map(|c| f64::from(c) / 255.0))
            .collect(),
    };
    check(name, actual, &expected, tolerance)
}

/// Paths of the images of a failed comparison.
struct Paths {
    actual: PathBuf,
    expected: PathBuf,
    difference: PathBuf,
}

impl Paths {
    fn new(name: &str) -> Paths {
        let folder = xtask::workspace::target_folder().join("test-images");
        let stem = name.replace(['/', ' '], "-");
        let path = |kind: &str| folder.join(format!("{stem}.{kind}.png"));
        Paths { actual: path("actual"), expected: path("expected"), difference: path("difference") }
    }

    fn write(&self, actual: &Image, expected: &Image) {
        fs::create_dir_all(self.actual.parent().expect("it is in a folder")).expect("target can be written");
        let (width, height) = (actual.width, actual.height);
        write_png(&self.actual, width, height, actual.to_rgb8());
        write_png(&self.expected, width, height, expected.to_rgb8());
        // 1/255 becomes a visible dark gray.
        let magnified = actual
            .pixels
            .iter()
            .zip(&expected.pixels)
            .flat_map(|(a, b)| [0, 1, 2].map(|c| ((a[c] - b[c]).abs() * 255.0 * 32.0).round() as u8));
        write_png(&self.difference, width, height, magnified.collect());
    }

    fn remove(&self) {
        for path in [&self.actual, &self.expected, &self.difference] {
            // Usually there is none.
            let _ = fs::remove_file(path);
        }
    }
}

fn write_png(path: &Path, width: u32, height: u32, rgb: Vec<u8>) {
    let image: ImageBuffer<Rgb<u8>, Vec<u8>> =
        ImageBuffer::from_raw(width, height, rgb).expect("three bytes per pixel");
    image.save(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(value: f64) -> Image {
        Image { width: 4, height: 2, pixels: vec![[value, value, value, 1.0]; 8] }
    }

    #[test]
    fn only_a_difference_beyond_the_tolerance_writes_images() {
        let tolerance = Tolerance { max_diff: 3.0, diff_pixels: 1, psnr: 40.0 };
        let mut actual = gray(0.5);
        actual.pixels[3][1] += 2.0 / 255.0;
        let found = check("harness-self-test", &actual, &gray(0.5), tolerance).unwrap();
        assert!((found.max_diff - 2.0).abs() < 1e-9 && found.diff_pixels == 1);

        actual.pixels[4][1] += 2.0 / 255.0;
        let message = check("harness-self-test", &actual, &gray(0.5), tolerance).unwrap_err();
        let paths = Paths::new("harness-self-test");
        assert!(
            message.contains("2 pixels differ") && message.contains(&*paths.difference.to_string_lossy())
        );
        let difference = image::open(&paths.difference).unwrap().to_rgb8();
        assert_eq!((difference.get_pixel(3, 0).0, difference.get_pixel(0, 0).0), ([0, 64, 0], [0, 0, 0]));

        check("harness-self-test", &gray(0.5), &gray(0.5), tolerance).unwrap();
        assert!(!paths.actual.exists(), "a pass removes the images of an earlier failure");
    }

    #[test]
    fn every_limit_is_checked() {
        let (actual, expected) = (gray(0.5 + 2.0 / 255.0), gray(0.5));
        for tolerance in [
            Tolerance { max_diff: 1.9, diff_pixels: 8, psnr: 40.0 },
            Tolerance { max_diff: 2.1, diff_pixels: 7, psnr: 40.0 },
            Tolerance { max_diff: 2.1, diff_pixels: 8, psnr: 50.0 },
        ] {
            assert!(check("harness-limits", &actual, &expected, tolerance).is_err(), "{tolerance:?}");
        }
        let wide = Tolerance { max_diff: 2.1, diff_pixels: 8, psnr: 40.0 };
        assert!(check("harness-limits", &actual, &expected, wide).is_ok());
    }

    #[test]
    fn sizes_must_agree() {
        let tolerance = Tolerance { max_diff: 255.0, diff_pixels: usize::MAX, psnr: 0.0 };
        assert!(check("harness-sizes", &Image::new(2, 3), &Image::new(3, 2), tolerance).is_err());
    }
}
