//! [`Silhouette`]: the mask of a photograph, queried by points and balls of the world.

use glam::DVec3;

use super::pinhole::Pinhole;
use crate::fit::Photograph;

/// A mask and its camera.
pub(super) struct Silhouette {
    pub(super) pinhole: Pinhole,
    /// Whether each pixel shows the subject; `None` for pixels without a photograph.
    subject: Vec<Option<bool>>,
    /// Summed-area table of pixels that may show the subject: one entry per pixel corner, the edges of
    /// the image included.
    sums: Vec<u32>,
}

impl Silhouette {
    pub(super) fn new(pinhole: &Pinhole, photograph: &Photograph) -> Silhouette {
        let pixels = 0..photograph.pixels.len();
        let subject: Vec<Option<bool>> =
            pixels.map(|i| photograph.is_valid(i).then(|| photograph.is_subject(i))).collect();
        let [width, height] = pinhole.size.map(|n| n as usize);
        let mut sums = vec![0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                row += u32::from(subject[y * width + x] != Some(false));
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
            }
        }
        Silhouette { pinhole: pinhole.clone(), subject, sums }
    }

    /// Whether no pixel shows the subject.
    pub(super) fn is_empty(&self) -> bool {
        !self.subject.contains(&Some(true))
    }

    /// Whether no pixel shows background.
    pub(super) fn is_full(&self) -> bool {
        !self.subject.contains(&Some(false))
    }

    /// Whether `point` projects onto the subject; `None` if the photograph does not show the point.
    pub(super) fn at(&self, point: DVec3) -> Option<bool> {
        let (place, _) = self.pinhole.project(point)?;
        self.subject[self.pinhole.pixel(place)?]
    }

    /// Whether a ball may contain a point of the subject: `Some(false)` only if the whole ball is in the
    /// image and none of it on the subject; `None` if the ball is outside or partly outside the image
    /// and off the subject.
    pub(super) fn near(&self, center: DVec3, radius: f64) -> Option<bool> {
        let depth = (center - self.pinhole.position).dot(self.pinhole.forward);
        let away = center.distance(self.pinhole.position);
        if depth <= radius {
            // The ball surrounds the camera, or is beside it: this bounds the part in front of it.
            let [x, y] = self.pinhole.size.map(|n| f64::from(n) / self.pinhole.focal);
            let bound = radius * (1.0 + 2.0 * (1.0 + x * x + y * y).sqrt());
            return (depth >= -radius && away < bound).then_some(true);
        }
        // An off-axis ball projects to an ellipse, stretched by distance over depth.
        let extent = self.pinhole.focal_max * radius / (depth - radius) * (away / depth);
        let ([u, v], _) = self.pinhole.project(center)?;
        let [width, height] = self.pinhole.size.map(f64::from);
        if u + extent < 0.0 || v + extent < 0.0 || u - extent >= width || v - extent >= height {
            return None;
        }
        let all = u >= extent && v >= extent && u + extent < width && v + extent < height;
        let low = |at: f64| (at - extent).max(0.0) as usize;
        let high = |at: f64, most: f64| (at + extent + 1.0).min(most) as usize;
        let ((left, right), (top, bottom)) = ((low(u), high(u, width)), (low(v), high(v, height)));
        let sum = |x: usize, y: usize| self.sums[y * (self.pinhole.size[0] as usize + 1) + x];
        let count = sum(right, bottom) + sum(left, top) - sum(left, bottom) - sum(right, top);
        match count > 0 {
            true => Some(true),
            false => all.then_some(false),
        }
    }
}
