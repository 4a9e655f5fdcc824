//! [`coverage`]: counts the fragments that a player shades.
//!
//! A player draws a splat as a quad along the axes of its footprint. Pixel centres inside the quad are
//! its fragments; their number depends on the radius of the quad.

use codec::{ALPHA_MIN, Camera};
use glam::{DVec2, dvec2};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::{RenderScene, alive, evaluate};
use crate::raster::Splat;

/// Rows of pixels at once: as many numbers as a vector of 256 bits has.
const LANES: usize = 4;

/// Half the side of a splat's quad, in standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// Where alpha falls to 1/255 at the instant: nothing visible is cut off, and fading splats shrink.
    Exact,
    /// The exact radius, limited to this.
    AtMost(f64),
    /// The same for all splats; `sqrt(8)` is common in players.
    Fixed(f64),
}

/// Counts of one frame, of all its eyes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// Gaussians whose opacity at the instant is at least 1/255.
    pub alive: usize,
    /// Gaussians whose quad contains at least one pixel centre of an eye's image.
    pub drawn: usize,
    /// Pixel centres inside quads, summed over all splats and eyes.
    pub fragments: u64,
}

/// Counts the fragments of `scene`, plate included, in the images of `eyes` at clip time `t`. Each of `eyes` must satisfy
/// [`Camera::check`].
pub fn coverage(scene: &RenderScene, eyes: &[Camera], t: f64, radius: Radius) -> Coverage {
    let mut coverage = Coverage { alive: 0, drawn: 0, fragments: 0 };
    for prefix in scene.prefixes.iter().chain(&scene.plates) {
        let Some(t) = prefix.clip_time(t) else { continue };
        let alive = alive::alive(prefix.field, prefix.rows, t);
        let mut is_drawn = vec![false; prefix.rows];
        for eye in eyes {
            let splats = evaluate::evaluate(prefix.field, &alive, eye, t);
            let fragments = |splat: &Splat<f64>| fragments(splat, radius, eye.width, eye.height);
            let counts: Vec<u64> = splats.par_iter().map(fragments).collect();
            for (splat, fragments) in splats.iter().zip(counts) {
                is_drawn[splat.row as usize] |= fragments > 0;
                coverage.fragments += fragments;
            }
        }
        coverage.alive += alive.len();
        coverage.drawn += is_drawn.into_iter().filter(|is_drawn| *is_drawn).count();
    }
    coverage
}

/// Number of pixel centres of the image inside the quad of `splat`.
pub(super) fn fragments(splat: &Splat<f64>, radius: Radius, width: u32, height: u32) -> u64 {
    Arch::new().dispatch(Quad { splat, radius, width, height })
}

/// A quad whose pixels are counted.
struct Quad<'a> {
    splat: &'a Splat<f64>,
    radius: Radius,
    width: u32,
    height: u32,
}

impl NullaryFnOnce for Quad<'_> {
    type Output = u64;

    #[inline(always)]
    fn call(self) -> u64 {
        let Quad { splat, radius, width, height } = self;
        // Where alpha falls to its least: sqrt(2 ln(o / ALPHA_MIN)).
        let exact = (2.0 * libm::log(splat.opacity / ALPHA_MIN)).max(0.0).sqrt();
        let radius = match radius {
            Radius::Exact => exact,
            Radius::AtMost(most) => exact.min(most),
            Radius::Fixed(radius) => radius,
        };
        let (axis, sigma) = principal_axes(splat.covariance);
        let half = radius * sigma;
        let half_height = (half.x * axis.y).abs() + (half.y * axis.x).abs();
        let [center_x, center_y] = splat.center;
        let rows = pixels_between(center_y - half_height, center_y + half_height, height);
        let inverse = axis.recip();
        let mut counts = [0.0; LANES];
        for first in rows.clone().step_by(LANES) {
            // Several rows at once, the last ones perhaps beyond the end.
            for (lane, count) in counts.iter_mut().enumerate() {
                let y = f64::from(first) + lane as f64;
                let dy = y + 0.5 - center_y;
                // |axis . d| <= half.x and |normal . d| <= half.y are intervals of d.x in this row.
                let along = interval(inverse.x, axis.y * dy, half.x);
                let across = interval(-inverse.y, axis.x * dy, half.y);
                let (left, right) = (along.0.max(across.0), along.1.min(across.1));
                let columns = columns_between(center_x + left, center_x + right, width);
                *count += if y < f64::from(rows.end) { columns } else { 0.0 };
            }
        }
        counts.iter().sum::<f64>() as u64
    }
}

/// Unit vector along the major axis of a covariance, and the standard deviations along and across it. Square roots alone
/// are the same on every machine, and counts of fragments choose what a package keeps.
fn principal_axes([xx, xy, yy]: [f64; 3]) -> (DVec2, DVec2) {
    let (mean, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let spread = (half_difference * half_difference + xy * xy).sqrt();
    // Cosine and sine of twice the angle, halved without loss of digits on either side of 45 degrees.
    let axis = match dvec2(half_difference, xy) / spread {
        double if !double.is_finite() => DVec2::X,
        double if double.x >= 0.0 => {
            let cos = (0.5 * (1.0 + double.x)).sqrt();
            dvec2(cos, 0.5 * double.y / cos)
        }
        double => {
            let sin = (0.5 * (1.0 - double.x)).sqrt();
            dvec2(0.5 * double.y / sin, sin)
        }
    };
    (axis, dvec2((mean + spread).sqrt(), (mean - spread).max(0.0).sqrt()))
}

/// Number of pixels of a row of `width` with centres in `[start, end]`.
#[inline(always)]
fn columns_between(start: f64, end: f64, width: u32) -> f64 {
    let first = (start - 0.5).ceil().max(0.0);
    let last = ((end - 0.5).floor() + 1.0).min(f64::from(width));
    (last - first).max(0.0)
}

/// Interval of `x` with `|x / inverse + b| <= half`; an empty interval has its ends swapped.
#[inline(always)]
fn interval(inverse: f64, b: f64, half: f64) -> (f64, f64) {
    let all = if b.abs() <= half { f64::INFINITY } else { f64::NEG_INFINITY };
    let (p, q) = ((-half - b) * inverse, (half - b) * inverse);
    if inverse.is_infinite() { (-all, all) } else { (p.min(q), p.max(q)) }
}

/// Pixels of a column of `size` with centres in `[start, end]`.
fn pixels_between(start: f64, end: f64, size: u32) -> std::ops::Range<u32> {
    // Casts saturate.
    let first = (start - 0.5).ceil().max(0.0) as u32;
    let last = ((end - 0.5).floor() + 1.0).clamp(0.0, f64::from(size)) as u32;
    first.min(last)..last
}
