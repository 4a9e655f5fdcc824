//! How far pictures are from those of the reference.

use refine::image::Image;
use refine::metrics::ssim;
use xtask::report::knob::Errors;

/// Width and height in pixels of the tiles of which the worst is told.
const TILE: u32 = 32;

/// What the reference draws of the whole field.
pub(super) struct Expected {
    /// Its pictures.
    pub(super) pictures: Vec<Image>,
    /// Those of the turning head, sorted by distance from the eye.
    pub(super) turn: Vec<Image>,
}

impl Expected {
    /// The errors of as many pictures of the same sizes.
    pub(super) fn errors(&self, pictures: &[Image], turn: &[Image]) -> Errors {
        let pairs = || self.pictures.iter().zip(pictures);
        let squares: f64 = pairs().map(|(a, b)| a.squared_error(b)).sum();
        let pixels: usize = self.pictures.iter().map(|image| image.pixels.len()).sum();
        let worst = pairs().map(|(a, b)| worst_tile(a, b)).fold(f64::INFINITY, f64::min);
        Errors {
            psnr_db: psnr(squares / (3 * pixels) as f64),
            ssim: Some(pairs().map(|(a, b)| ssim(a, b)).sum::<f64>() / pictures.len() as f64),
            worst_tile_db: Some(worst).filter(|db| db.is_finite()),
            flicker: Some(flicker(&self.turn, turn)),
        }
    }
}

/// PSNR in dB of a mean squared error; `None` where there is none.
fn psnr(mean_square: f64) -> Option<f64> {
    (mean_square > 0.0).then(|| -10.0 * mean_square.log10())
}

/// PSNR of the worst tile in dB, infinite where the images are the same.
fn worst_tile(a: &Image, b: &Image) -> f64 {
    let mut worst = 0f64;
    for top in (0..a.height).step_by(TILE as usize) {
        for left in (0..a.width).step_by(TILE as usize) {
            let (bottom, right) = ((top + TILE).min(a.height), (left + TILE).min(a.width));
            let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
            let squares: f64 = pixels.map(|(x, y)| squared(a.pixel(x, y), b.pixel(x, y))).sum();
            worst = worst.max(squares / f64::from(3 * (bottom - top) * (right - left)));
        }
    }
    psnr(worst).unwrap_or(f64::INFINITY)
}

/// Sum of the squared differences of two pixels over black.
fn squared(a: [f64; 4], b: [f64; 4]) -> f64 {
    (0..3).map(|c| (a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0)).powi(2)).sum()
}

/// Root mean square of the change of the error from each frame to the next, in 255ths.
fn flicker(expected: &[Image], frames: &[Image]) -> f64 {
    let errors = |(expected, frame): (&Image, &Image)| -> Vec<[f64; 3]> {
        let pixels = frame.pixels.iter().zip(&expected.pixels);
        pixels.map(|(a, b)| [0, 1, 2].map(|c| a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0))).collect()
    };
    let errors: Vec<Vec<[f64; 3]>> = expected.iter().zip(frames).map(errors).collect();
    let changes = errors.windows(2).flat_map(|pair| pair[0].iter().flatten().zip(pair[1].iter().flatten()));
    let (squares, count) =
        changes.fold((0.0, 0u64), |(sum, count), (a, b)| (sum + (b - a).powi(2), count + 1));
    255.0 * (squares / count.max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(value: f64) -> Image {
        Image { width: 64, height: 40, pixels: vec![[value, value, value, 1.0]; 64 * 40] }
    }

    #[test]
    fn the_worst_tile_is_the_one_with_the_error() {
        let mut image = gray(0.5);
        // In the tile at the lower right, which is 32 by 8 pixels.
        image.pixels[39 * 64 + 63] = [0.5, 0.5, 1.0, 1.0];
        let expected = Expected { pictures: vec![gray(0.5)], turn: Vec::new() };
        let errors = expected.errors(&[image], &[]);
        let db = |squares: f64, pixels: f64| -10.0 * (squares / (3.0 * pixels)).log10();
        assert!((errors.psnr_db.unwrap() - db(0.25, 64.0 * 40.0)).abs() < 1e-9);
        assert!((errors.worst_tile_db.unwrap() - db(0.25, 32.0 * 8.0)).abs() < 1e-9);
        assert!(errors.ssim.unwrap() < 1.0);
    }

    #[test]
    fn what_stays_as_wrong_does_not_flicker() {
        let expected = [0.2, 0.3, 0.4].map(gray);
        assert!(flicker(&expected, &[0.3, 0.4, 0.5].map(gray)) < 1e-9);
        // The error comes and goes.
        let flickers = flicker(&expected, &[0.2, 0.4, 0.4].map(gray));
        assert!((flickers - 25.5).abs() < 1e-9, "{flickers}");
    }

    #[test]
    fn no_error_is_none() {
        let expected = Expected { pictures: vec![gray(0.5)], turn: vec![gray(0.5)] };
        let errors = expected.errors(&[gray(0.5)], &[gray(0.5)]);
        assert_eq!((errors.psnr_db, errors.worst_tile_db, errors.flicker), (None, None, Some(0.0)));
    }
}
