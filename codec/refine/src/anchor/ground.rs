//! Grounding: every sampled pixel of the subject puts two Gaussians on its ray (the paper's Eq.
//! ground, with K = 2 and no offset from the ray).
//!
//! Depths count along the camera's axis, so the ray is the one that goes one unit along it. What the
//! paper's head would predict follows from rules: sizes from what a pixel covers at its depth,
//! colours from the photograph, time from the frame.

use codec::{SH_C0, sh_coefficients};

use super::eye::Eye;
use super::{Anchor, DepthMap};
use crate::fit::{Parameters, Photograph};

/// Gaussians per ray.
pub(super) const PER_RAY: usize = 2;

/// Opacity of the first Gaussian on a ray.
const OPACITY: f64 = 0.5;

/// Opacity of what lies behind, by that of what lies in front.
pub(super) const BEHIND: f64 = 0.5;

/// Of views all around, about one in so many sees a point of the surface: their rays lie that much
/// denser on it than those of one view.
const VIEWS_PER_COVER: f64 = 3.0;

/// Standard deviation of a Gaussian, by the distance between sampled rays.
const SIZE: f64 = 0.7;

/// Distance of the second Gaussian behind the first, by the distance between sampled rays; at most a
/// third of what is there to be inside of.
const APART: f64 = 1.25;
const APART_MOST: f64 = 1.0 / 3.0;

/// What a view sees.
pub(super) struct Surface<'a> {
    pub(super) eye: Eye,
    pub(super) photograph: &'a Photograph,
    /// Depths in units of the capture.
    pub(super) depths: DepthMap,
    /// Depths at which the rays of the photograph's pixels enter and leave the hull; empty without
    /// one.
    pub(super) spans: Vec<[f32; 2]>,
}

impl Surface<'_> {
    /// The depth of a pixel of the subject.
    fn depth(&self, [x, y]: [u32; 2]) -> Option<f64> {
        let pixel = y as usize * self.eye.size[0] as usize + x as usize;
        if !self.photograph.is_subject(pixel) {
            return None;
        }
        self.depths.at([x, y], self.eye.size).map(f64::from)
    }

    /// Number of pixels of the subject whose depth is known.
    pub(super) fn pixels(&self) -> usize {
        let [width, height] = self.eye.size;
        let known = |y: u32| (0..width).filter(|x| self.depth([*x, y]).is_some()).count();
        (0..height).map(known).sum()
    }

    /// The Gaussians of every `step`-th pixel along either axis, `step` at least 1 and not
    /// necessarily whole, at frame `frame`. `views` put theirs on the same subject.
    pub(super) fn ground(
        &self,
        step: f64,
        views: usize,
        anchor: &Anchor,
        frame: Option<usize>,
    ) -> Parameters<f32> {
        let overlap = (views as f64 / VIEWS_PER_COVER).max(1.0).sqrt();
        let single = |v: glam::DVec3| v.to_array().map(|x| x as f32);
        let mut grounded = Parameters { sh_degree: anchor.sh_degree, ..Parameters::default() };
        for y in lattice(step, self.eye.size[1]) {
            for x in lattice(step, self.eye.size[0]) {
                let Some(depth) = self.depth([x, y]) else { continue };
                let pixel = y as usize * self.eye.size[0] as usize + x as usize;
                let ray = self.eye.ray([x, y]);
                let spacing = depth * step / self.eye.focal / overlap;
                let mut apart = APART * spacing;
                if let Some([_, leave]) = self.spans.get(pixel).filter(|[_, leave]| f64::from(*leave) > depth)
                {
                    apart = apart.min(APART_MOST * (f64::from(*leave) - depth));
                }
                let [r, g, b, alpha] = self.photograph.pixels[pixel].map(f64::from);
                let dc = [r, g, b].map(|c| (((c / alpha).min(1.0) - 0.5) / SH_C0) as f32);
                for (depth, opacity) in [(depth, OPACITY), (depth + apart, BEHIND * OPACITY)] {
                    grounded.centers.push(single(self.eye.position + depth * ray));
                    grounded.rotations.push([1.0, 0.0, 0.0, 0.0]);
                    grounded.log_scales.push([libm::log(SIZE * spacing) as f32; 3]);
                    grounded.logits.push(libm::log(opacity / (1.0 - opacity)) as f32);
                    grounded.sh.push(dc);
                    let rest = sh_coefficients(anchor.sh_degree) - 1;
                    grounded.sh.extend(std::iter::repeat_n([0.0; 3], rest));
                }
            }
        }
        if let Some(frame) = frame {
            let rows = grounded.len();
            grounded.tau = vec![frame as f32; rows];
            grounded.log_widths = vec![libm::log(anchor.width) as f32; rows];
            grounded.motion_order = anchor.motion_order;
            grounded.motion = vec![[0.0; 3]; rows * usize::from(anchor.motion_order)];
        }
        grounded
    }
}

/// The rows or columns that are sampled: every `step`-th of `size`.
pub(super) fn lattice(step: f64, size: u32) -> impl Iterator<Item = u32> {
    (0..size).map(move |k| ((f64::from(k) + 0.5) * step) as u32).take_while(move |at| *at < size)
}

/// Distance in pixels between sampled rays, for about `rays` of `pixels`.
pub(super) fn step(pixels: usize, rays: f64) -> f64 {
    (pixels as f64 / rays).sqrt().max(1.0)
}
