//! Grounding: every sampled pixel of the subject puts two Gaussians on its ray (the paper's
//! `eq:ground` with K = 2 and no offset from the ray).
//!
//! Depths are measured along the optical axis. Rules replace the predictions of the paper's head: sizes
//! follow from the distance between sampled rays at the depth, colours from the photograph, and time
//! from the frame.

use codec::{SH_C0, sh_coefficients};

use super::pinhole::Pinhole;
use super::{AnchorSettings, DepthMap};
use crate::fit::{Parameters, Photograph};

/// Gaussians per ray.
pub(super) const PER_RAY: usize = 2;

/// Opacity of the first Gaussian on a ray.
const OPACITY: f64 = 0.5;

/// Opacity of a Gaussian behind the surface, as a fraction of the opacity of a Gaussian on it.
pub(super) const BEHIND: f64 = 0.5;

/// With cameras all around, about one in this many sees a given point of the surface. The rays of n
/// views are n over this as dense on the surface as the rays of one view.
const VIEWS_PER_COVER: f64 = 3.0;

/// Standard deviation of a Gaussian, in distances between sampled rays.
const SIZE: f64 = 0.7;

/// Distance of the second Gaussian behind the first, in distances between sampled rays, and its upper
/// bound as a fraction of the subject's thickness.
const APART: f64 = 1.25;
const APART_MOST: f64 = 1.0 / 3.0;

/// The surface that one view sees.
pub(super) struct Surface<'a> {
    pub(super) pinhole: Pinhole,
    pub(super) photograph: &'a Photograph,
    /// Depths in units of the capture.
    pub(super) depths: DepthMap,
    /// Depths at which the ray of each pixel enters and leaves the hull; empty without a hull.
    pub(super) spans: Vec<[f32; 2]>,
}

impl Surface<'_> {
    /// Depth of a pixel; `None` if it is unknown or the pixel does not show the subject.
    fn depth(&self, [x, y]: [u32; 2]) -> Option<f64> {
        let pixel = y as usize * self.pinhole.size[0] as usize + x as usize;
        if !self.photograph.is_subject(pixel) {
            return None;
        }
        self.depths.at([x, y], self.pinhole.size).map(f64::from)
    }

    /// Number of pixels of the subject with a known depth.
    pub(super) fn pixels(&self) -> usize {
        let [width, height] = self.pinhole.size;
        let known = |y: u32| (0..width).filter(|x| self.depth([*x, y]).is_some()).count();
        (0..height).map(known).sum()
    }

    /// Gaussians of every `step`-th pixel along both axes, `step` being 1 or more and not necessarily
    /// whole. `views` is the number of views that ground the same subject. `time` gives the Gaussians
    /// a window, in intervals; `None` makes them static.
    pub(super) fn ground(
        &self,
        step: f64,
        views: usize,
        anchor: &AnchorSettings,
        time: Option<f64>,
    ) -> Parameters<f32> {
        let overlap = (views as f64 / VIEWS_PER_COVER).max(1.0).sqrt();
        let single = |v: glam::DVec3| v.to_array().map(|x| x as f32);
        let AnchorSettings { filter, near, sh_degree, .. } = *anchor;
        let mut grounded = Parameters { filter, near, sh_degree, ..Parameters::default() };
        for y in lattice(step, self.pinhole.size[1]) {
            for x in lattice(step, self.pinhole.size[0]) {
                let Some(depth) = self.depth([x, y]) else { continue };
                let pixel = y as usize * self.pinhole.size[0] as usize + x as usize;
                let ray = self.pinhole.ray([x, y]);
                let spacing = depth * step / self.pinhole.focal / overlap;
                let mut apart = APART * spacing;
                if let Some([_, leave]) = self.spans.get(pixel).filter(|[_, leave]| f64::from(*leave) > depth)
                {
                    apart = apart.min(APART_MOST * (f64::from(*leave) - depth));
                }
                let [r, g, b, alpha] = self.photograph.pixels[pixel].map(f64::from);
                let dc = [r, g, b].map(|c| (((c / alpha).min(1.0) - 0.5) / SH_C0) as f32);
                for (depth, opacity) in [(depth, OPACITY), (depth + apart, BEHIND * OPACITY)] {
                    grounded.centers.push(single(self.pinhole.position + depth * ray));
                    grounded.rotations.push([1.0, 0.0, 0.0, 0.0]);
                    grounded.log_scales.push([libm::log(SIZE * spacing) as f32; 3]);
                    grounded.logits.push(libm::log(opacity / (1.0 - opacity)) as f32);
                    grounded.sh.push(dc);
                    let rest = sh_coefficients(anchor.sh_degree) - 1;
                    grounded.sh.extend(std::iter::repeat_n([0.0; 3], rest));
                }
            }
        }
        if let Some(time) = time {
            let rows = grounded.len();
            grounded.tau = vec![time as f32; rows];
            grounded.log_widths = vec![libm::log(anchor.width) as f32; rows];
            grounded.motion_order = anchor.motion_order;
            grounded.motion = vec![[0.0; 3]; rows * usize::from(anchor.motion_order)];
        }
        grounded
    }
}

/// Rows or columns to sample: every `step`-th of `size`.
pub(super) fn lattice(step: f64, size: u32) -> impl Iterator<Item = u32> {
    (0..size).map(move |k| ((f64::from(k) + 0.5) * step) as u32).take_while(move |at| *at < size)
}

/// Distance in pixels between sampled rays, so that about `rays` of `pixels` are sampled.
pub(super) fn step(pixels: usize, rays: f64) -> f64 {
    (pixels as f64 / rays).sqrt().max(1.0)
}
