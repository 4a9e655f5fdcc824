//! [`Capture`]: what calibrated cameras saw of a scene.
//!
//! A capture names its cameras and its photographs: which camera took them, and when. It holds no
//! pixels; whoever reads them turns each into a [`Photo`], free of lens distortion and cut out by
//! its mask where there is one.

mod lens;
mod split;

use codec::Camera;

use crate::image::Image;
pub use lens::Lens;
pub use split::{Holdout, Split, SplitError};

/// Cameras, and what they photographed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Capture {
    /// The cameras, as calibrated.
    pub cameras: Vec<CalibratedCamera>,
    /// Clip time of each frame, ascending within `[0, 1]`; a static scene has one frame.
    pub times: Vec<f64>,
    /// Each camera at most once in each frame.
    pub shots: Vec<CaptureShot>,
}

/// A camera of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedCamera {
    /// What the capture calls it.
    pub name: String,
    /// The camera, as if it had no lens.
    pub camera: Camera,
    /// What its lens does to a picture.
    pub lens: Lens,
    /// Whether the capture says that it is held out.
    pub held: bool,
}

/// A photograph of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CaptureShot {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Number of the camera.
    pub camera: usize,
}

/// Clip times of `frames` frames at even distances: 0 for the first, 1 for the last.
pub fn even_times(frames: usize) -> Vec<f64> {
    (0..frames).map(|frame| frame as f64 / (frames.max(2) - 1) as f64).collect()
}

/// A photograph as its camera would have taken it without a lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Colours multiplied by the mask; alpha is the mask, 1 everywhere where there is none.
    pub image: Image,
    /// Of each pixel, whether the photograph shows what is there: not where it ends, nor where the
    /// lens folds.
    pub seen: Vec<bool>,
}

impl Photo {
    /// A photograph through `lens` by a camera with these intrinsics, undone.
    pub fn undistorted(taken: Image, camera: &Camera, lens: &Lens) -> Photo {
        if lens.is_none() {
            let seen = vec![true; taken.pixels.len()];
            return Photo { image: taken, seen };
        }
        let mut image = Image::new(taken.width, taken.height);
        let mut seen = Vec::with_capacity(image.pixels.len());
        let ([fx, fy], [cx, cy]) = ([camera.k[0][0], camera.k[1][1]], [camera.k[0][2], camera.k[1][2]]);
        for y in 0..taken.height {
            for x in 0..taken.width {
                let straight = [(f64::from(x) + 0.5 - cx) / fx, (f64::from(y) + 0.5 - cy) / fy];
                let found = lens
                    .distort(straight)
                    .and_then(|bent| sample(&taken, [bent[0] * fx + cx - 0.5, bent[1] * fy + cy - 0.5]));
                if let Some(pixel) = found {
                    image.pixels[seen.len()] = pixel;
                }
                seen.push(found.is_some());
            }
        }
        Photo { image, seen }
    }
}

/// The image at a point, in pixels from the centre of its first one; `None` beyond its pixels.
fn sample(image: &Image, [x, y]: [f64; 2]) -> Option<[f64; 4]> {
    let (last_x, last_y) = (image.width - 1, image.height - 1);
    // Half a pixel more: to the edge of the outermost pixels, which have no neighbour there.
    let near = |at: f64, last: u32| (-0.5..=f64::from(last) + 0.5).contains(&at);
    if !near(x, last_x) || !near(y, last_y) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, f64::from(last_x)), y.clamp(0.0, f64::from(last_y)));
    let (left, top) = (x as u32, y as u32);
    let (u, v) = (x - f64::from(left), y - f64::from(top));
    let (right, bottom) = ((left + 1).min(last_x), (top + 1).min(last_y));
    let corners =
        [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| image.pixel(x, y));
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    Some(std::array::from_fn(|c| corners.iter().zip(weights).map(|(corner, w)| w * corner[c]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 32, 24)
    }

    /// Pixels that say where they are.
    fn ramp() -> Image {
        let mut image = Image::new(32, 24);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = [(i % 32) as f64, (i / 32) as f64, 0.0, 1.0];
        }
        image
    }

    #[test]
    fn without_a_lens_nothing_changes() {
        let photo = Photo::undistorted(ramp(), &camera(), &Lens::default());
        assert_eq!(photo.image, ramp());
        assert!(photo.seen.iter().all(|seen| *seen));
    }

    #[test]
    fn a_pixel_comes_from_where_the_lens_put_it() {
        let (camera, lens) = (camera(), Lens { k1: -0.1, ..Lens::default() });
        let photo = Photo::undistorted(ramp(), &camera, &lens);
        let (f, cx, cy) = (camera.k[0][0], camera.k[0][2], camera.k[1][2]);
        let (x, y) = ((25.5 - cx) / f, (6.5 - cy) / f);
        let shrink = 1.0 - 0.1 * (x * x + y * y);
        let [u, v, _, alpha] = photo.image.pixel(25, 6);
        assert!(
            (u - (x * shrink * f + cx - 0.5)).abs() < 1e-9 && (v - (y * shrink * f + cy - 0.5)).abs() < 1e-9
        );
        assert!(photo.seen.iter().all(|seen| *seen) && alpha == 1.0, "a barrel sees more than a pinhole");
    }

    #[test]
    fn what_was_not_photographed_is_not_seen() {
        let photo = Photo::undistorted(ramp(), &camera(), &Lens { k1: 0.5, ..Lens::default() });
        assert!(!photo.seen[0] && photo.seen[12 * 32 + 16]);
        assert_eq!(photo.image.pixels[0], [0.0; 4]);
    }

    #[test]
    fn times_run_from_0_to_1() {
        assert_eq!(even_times(5), [0.0, 0.25, 0.5, 0.75, 1.0]);
        assert_eq!(even_times(1), [0.0]);
        assert!(even_times(0).is_empty());
    }
}
