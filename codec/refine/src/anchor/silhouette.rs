//! [`Silhouette`]: where in a photograph the subject is.

use glam::DVec3;

use super::eye::Eye;
use crate::fit::Photograph;

/// A mask, and where it was taken from.
pub(super) struct Silhouette {
    pub(super) eye: Eye,
    /// Whether each pixel shows the subject; `None` where the photograph does not say.
    subject: Vec<Option<bool>>,
    /// Number of pixels above and to the left of each corner of a pixel that may show it, the edges
    /// of the image included.
    sums: Vec<u32>,
}

impl Silhouette {
    pub(super) fn new(eye: &Eye, photograph: &Photograph) -> Silhouette {
        let pixels = 0..photograph.pixels.len();
        let subject: Vec<Option<bool>> =
            pixels.map(|i| photograph.is_valid(i).then(|| photograph.is_subject(i))).collect();
        let [width, height] = eye.size.map(|n| n as usize);
        let mut sums = vec![0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                row += u32::from(subject[y * width + x] != Some(false));
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
            }
        }
        Silhouette { eye: eye.clone(), subject, sums }
    }

    /// Whether no pixel shows the subject.
    pub(super) fn is_empty(&self) -> bool {
        !self.subject.contains(&Some(true))
    }

    /// Whether no pixel shows anything else.
    pub(super) fn is_full(&self) -> bool {
        !self.subject.contains(&Some(false))
    }

    /// Whether the subject is where the photograph shows `point`; `None` where it does not show it.
    pub(super) fn at(&self, point: DVec3) -> Option<bool> {
        let (place, _) = self.eye.project(point)?;
        self.subject[self.eye.pixel(place)?]
    }

    /// Whether the subject may be anywhere where the photograph shows a ball: `Some(false)` only if
    /// it shows all of it, and not on the subject.
    pub(super) fn near(&self, center: DVec3, radius: f64) -> Option<bool> {
        let depth = (center - self.eye.position).dot(self.eye.forward);
        let away = center.distance(self.eye.position);
        if depth <= radius {
            // Around the camera, or beside it: what is in front of it goes no farther than this.
            let [x, y] = self.eye.size.map(|n| f64::from(n) / self.eye.focal);
            let reach = radius * (1.0 + 2.0 * (1.0 + x * x + y * y).sqrt());
            return (depth >= -radius && away < reach).then_some(true);
        }
        // The outline of a ball off the axis is an ellipse, stretched by distance over depth.
        let extent = self.eye.focal_max * radius / (depth - radius) * (away / depth);
        let ([u, v], _) = self.eye.project(center)?;
        let [width, height] = self.eye.size.map(f64::from);
        if u + extent < 0.0 || v + extent < 0.0 || u - extent >= width || v - extent >= height {
            return None;
        }
        let all = u >= extent && v >= extent && u + extent < width && v + extent < height;
        let low = |at: f64| (at - extent).max(0.0) as usize;
        let high = |at: f64, most: f64| (at + extent + 1.0).min(most) as usize;
        let ((left, right), (top, bottom)) = ((low(u), high(u, width)), (low(v), high(v, height)));
        let sum = |x: usize, y: usize| self.sums[y * (self.eye.size[0] as usize + 1) + x];
        let count = sum(right, bottom) + sum(left, top) - sum(left, bottom) - sum(right, top);
        match count > 0 {
            true => Some(true),
            false => all.then_some(false),
        }
    }
}
