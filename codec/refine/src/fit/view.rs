//! [`View`] and [`Photograph`]: what a step draws, and what it is to look like.

use codec::Camera;

use crate::capture::Photo;
use crate::image::Image;

/// Mask above which a pixel belongs to the subject, of 255.
const SUBJECT: u8 = 127;

/// How far outside the image the Jacobian may be taken, as a part of tan(fov / 2).
const MARGIN: f64 = 0.3;

/// A camera at an instant.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The camera; it satisfies [`Camera::check`].
    pub camera: &'a Camera,
    /// Time in frames, from 0 for the first.
    pub frame: f64,
}

impl View<'_> {
    /// Lowest and highest x/z and y/z at which Jacobians are taken.
    pub(super) fn slope_limits(&self) -> [[f64; 2]; 2] {
        let camera = self.camera;
        let focal = [camera.k[0][0], camera.k[1][1]];
        let principal = [camera.k[0][2], camera.k[1][2]];
        let size = [f64::from(camera.width), f64::from(camera.height)];
        let margin = |axis: usize| MARGIN * 0.5 * size[axis] / focal[axis];
        [
            [0, 1].map(|axis| -principal[axis] / focal[axis] - margin(axis)),
            [0, 1].map(|axis| (size[axis] - principal[axis]) / focal[axis] + margin(axis)),
        ]
    }
}

/// A photograph as a fit keeps it: 8 bits per channel, a quarter of what floats take.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Red, green, blue multiplied by the mask, and the mask: row by row from the top left.
    pub pixels: Vec<[u8; 4]>,
    /// Of each pixel, whether the photograph shows what is there; empty where it does everywhere.
    pub seen: Vec<bool>,
}

impl From<&Photo> for Photograph {
    fn from(photo: &Photo) -> Photograph {
        let Image { width, height, pixels } = &photo.image;
        let byte = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
        let seen = if photo.seen.iter().all(|seen| *seen) { Vec::new() } else { photo.seen.clone() };
        Photograph {
            width: *width,
            height: *height,
            pixels: pixels.iter().map(|pixel| pixel.map(byte)).collect(),
            seen,
        }
    }
}

impl Photograph {
    /// Whether a pixel shows the subject.
    pub fn is_subject(&self, pixel: usize) -> bool {
        self.pixels[pixel][3] > SUBJECT && self.is_seen(pixel)
    }

    /// Whether any pixel shows the subject.
    pub fn has_subject(&self) -> bool {
        (0..self.pixels.len()).any(|pixel| self.is_subject(pixel))
    }

    /// Whether any pixel shows what is beside the subject, as a mask tells.
    pub fn is_masked(&self) -> bool {
        (0..self.pixels.len()).any(|pixel| self.is_seen(pixel) && !self.is_subject(pixel))
    }

    /// Whether the photograph shows what is at a pixel.
    pub fn is_seen(&self, pixel: usize) -> bool {
        self.seen.get(pixel).is_none_or(|seen| *seen)
    }
}
