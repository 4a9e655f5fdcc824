//! Errors of images against the reference.

use crate::parameter::ImageErrors;
use codec::Camera;
use glam::{DMat3, DVec2, DVec3};
use program::Fault;
use refine::image::{Image, psnr};
use refine::metrics::ssim;

/// Side of a tile in pixels.
const TILE: u32 = 32;

/// The reference's images of the whole field.
pub(super) struct Expected {
    /// Images of [`ViewSet::pictures`](super::views::ViewSet).
    pub(super) pictures: Vec<Image>,
    /// Images of the turning head, sorted by distance from the eye.
    pub(super) turn: Vec<Image>,
    /// Cameras of the turning head, all at one position.
    pub(super) cameras: Vec<Camera>,
}

impl Expected {
    /// The errors of images of the same views.
    ///
    /// # Errors
    /// [`Fault::Device`] if a pixel is no number: its error would be none, and read as no error.
    pub(super) fn errors(&self, pictures: &[Image], turn: &[Image]) -> Result<ImageErrors, Fault> {
        let is_number = |image: &Image| image.pixels.iter().flatten().all(|channel| !channel.is_nan());
        if !pictures.iter().chain(turn).all(is_number) {
            let what =
                "the renderer draws pixels that are no numbers; look for the case with report --stability";
            return Err(Fault::Device(what.into()));
        }
        let pairs = || self.pictures.iter().zip(pictures);
        let squares: f64 = pairs().map(|(a, b)| a.squared_error(b)).sum();
        let pixels: usize = self.pictures.iter().map(|image| image.pixels.len()).sum();
        let worst = pairs().map(|(a, b)| worst_tile(a, b)).fold(f64::INFINITY, f64::min);
        Ok(ImageErrors {
            psnr_db: Some(psnr(squares, pixels)).filter(|db| db.is_finite()),
            ssim: Some(pairs().map(|(a, b)| ssim(a, b)).sum::<f64>() / pictures.len() as f64),
            worst_tile_db: Some(worst).filter(|db| db.is_finite()),
            flicker: Some(self.flicker(turn)),
        })
    }

    /// Root mean square change of the error from each frame of the turning head to the next, in 255ths. An error that
    /// keeps its place in the world is no flicker.
    fn flicker(&self, frames: &[Image]) -> f64 {
        let errors: Vec<_> = frames.iter().zip(&self.turn).map(|(a, b)| error(a, b)).collect();
        let (mut squares, mut count) = (0.0, 0u64);
        for (i, pair) in errors.windows(2).enumerate() {
            let before_from_after = before_from_after(&self.cameras[i], &self.cameras[i + 1]);
            let width = frames[i].width;
            for (j, after) in (0u32..).zip(&pair[1]) {
                let pixel = DVec3::new(f64::from(j % width) + 0.5, f64::from(j / width) + 0.5, 1.0);
                let at = before_from_after * pixel;
                if let Some(before) = sample(&pair[0], width, at.truncate() / at.z) {
                    squares += (0..3).map(|c| (after[c] - before[c]).powi(2)).sum::<f64>();
                    count += 3;
                }
            }
        }
        255.0 * (squares / count.max(1) as f64).sqrt()
    }
}

/// PSNR of the worst tile in dB; infinite if the images are equal.
fn worst_tile(a: &Image, b: &Image) -> f64 {
    let mut worst = f64::INFINITY;
    for top in (0..a.height).step_by(TILE as usize) {
        for left in (0..a.width).step_by(TILE as usize) {
            let (bottom, right) = ((top + TILE).min(a.height), (left + TILE).min(a.width));
            let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
            let squares: f64 = pixels.map(|(x, y)| squared(a.pixel(x, y), b.pixel(x, y))).sum();
            worst = worst.min(psnr(squares, ((bottom - top) * (right - left)) as usize));
        }
    }
    worst
}

/// Sum of the squared differences of two pixels over black.
fn squared(a: [f64; 4], b: [f64; 4]) -> f64 {
    (0..3).map(|c| (a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0)).powi(2)).sum()
}

/// Differences of the colours of two images, both clamped to the displayed range.
fn error(image: &Image, expected: &Image) -> Vec<[f64; 3]> {
    let pixels = image.pixels.iter().zip(&expected.pixels);
    pixels.map(|(a, b)| [0, 1, 2].map(|c| a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0))).collect()
}

/// Maps pixels of `after` to pixels of `before`, two cameras at one position: the homography of a turning head.
fn before_from_after(before: &Camera, after: &Camera) -> DMat3 {
    let rows = |m: [[f64; 3]; 3]| DMat3::from_cols_array_2d(&m).transpose();
    let turn = |camera: &Camera| rows([0, 1, 2].map(|r| [0, 1, 2].map(|c| camera.camera_from_world[r][c])));
    rows(before.k) * turn(before) * turn(after).transpose() * rows(after.k).inverse()
}

/// The bilinearly interpolated error at `at`, in pixels; `None` outside the outermost pixel centres.
fn sample(error: &[[f64; 3]], width: u32, at: DVec2) -> Option<[f64; 3]> {
    let (corner, height) = (at - 0.5, error.len() / width as usize);
    let (x, y) = (corner.x.floor(), corner.y.floor());
    let is_inside = x >= 0.0 && y >= 0.0 && x + 1.0 < f64::from(width) && y + 1.0 < height as f64;
    is_inside.then(|| {
        let (u, v) = (corner.x - x, corner.y - y);
        let first = y as usize * width as usize + x as usize;
        let below = first + width as usize;
        [0, 1, 2].map(|c| {
            let row = |i: usize| error[i][c] * (1.0 - u) + error[i + 1][c] * u;
            row(first) * (1.0 - v) + row(below) * v
        })
    })
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
        // In the lower right tile, which has 32x8 pixels.
        image.pixels[39 * 64 + 63] = [0.5, 0.5, 1.0, 1.0];
        let expected = Expected { pictures: vec![gray(0.5)], turn: Vec::new(), cameras: Vec::new() };
        let errors = expected.errors(&[image], &[]).unwrap();
        let db = |squares: f64, pixels: f64| -10.0 * (squares / (3.0 * pixels)).log10();
        assert!((errors.psnr_db.unwrap() - db(0.25, 64.0 * 40.0)).abs() < 1e-9);
        assert!((errors.worst_tile_db.unwrap() - db(0.25, 32.0 * 8.0)).abs() < 1e-9);
        assert!(errors.ssim.unwrap() < 1.0);
    }

    /// Images of a pattern at infinity by a camera that turns by one degree per frame.
    fn turning(pattern: impl Fn(f64) -> f64) -> (Vec<Camera>, Vec<Image>) {
        let camera = |i: usize| {
            let (sin, cos) = (i as f64).to_radians().sin_cos();
            Camera::look_at([0.0; 3], [sin, 0.0, cos], [0.0, -1.0, 0.0], 0.8, 64, 40)
        };
        let image = |i: usize| {
            let focal = camera(i).k[0][0];
            let mut image = gray(0.5);
            for (j, pixel) in (0u32..).zip(&mut image.pixels) {
                let across = (f64::from(j % 64) + 0.5 - 32.0) / focal;
                let value = 0.5 + pattern(across.atan() + (i as f64).to_radians());
                *pixel = [value, value, value, 1.0];
            }
            image
        };
        ((0..4).map(camera).collect(), (0..4).map(image).collect())
    }

    #[test]
    fn errors_that_stay_in_the_world_do_not_flicker() {
        let (cameras, frames) = turning(|angle| 0.2 * (8.0 * angle).sin());
        let expected = Expected { pictures: Vec::new(), turn: vec![gray(0.5); 4], cameras };
        let turned_along = expected.flicker(&frames);
        assert!(turned_along < 0.2, "{turned_along}");
        // The third frame lacks the error of the others.
        let mut popping = frames.clone();
        popping[2] = gray(0.5);
        assert!(expected.flicker(&popping) > 20.0);
        // An error that stays in the image moves in the world.
        assert!(expected.flicker(&vec![frames[0].clone(); 4]) > 3.0);
    }

    #[test]
    fn no_error_is_none() {
        let expected = Expected { pictures: vec![gray(0.5)], turn: vec![gray(0.5)], cameras: Vec::new() };
        let errors = expected.errors(&[gray(0.5)], &[gray(0.5)]).unwrap();
        assert_eq!((errors.psnr_db, errors.worst_tile_db, errors.flicker), (None, None, Some(0.0)));
    }

    #[test]
    fn a_pixel_that_is_no_number_is_not_no_error() {
        let expected = Expected { pictures: vec![gray(0.5)], turn: vec![gray(0.5)], cameras: Vec::new() };
        let mut image = gray(0.5);
        image.pixels[70][1] = f64::NAN;
        for (picture, frame) in [(image.clone(), gray(0.5)), (gray(0.5), image)] {
            let fault = expected.errors(&[picture], &[frame]).unwrap_err();
            assert!(matches!(fault, Fault::Device(_)), "{fault}");
        }
    }
}
