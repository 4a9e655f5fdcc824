//! [`glance`]: what a camera sees of discs, in a picture of a few pixels.
//!
//! Discs are composited from front to back. A second transmittance, of the content alone, tells how much of the content
//! would be seen if nothing stood before it.

use super::discs::{Disc, Discs};
use crate::{ALPHA_MIN, Camera, near_fade};

/// Width and height of the picture in pixels.
pub(super) const SIZE: (u32, u32) = (48, 36);

const PIXELS: usize = (SIZE.0 * SIZE.1) as usize;

/// Transmittance below which nothing behind is seen.
const OPAQUE: f64 = 1e-3;

/// What a camera sees of discs, over all instants.
#[derive(Clone, Debug)]
pub(super) struct Glance {
    /// Whether each row of the discs is seen: it changes a pixel by a step of 8 bits.
    pub(super) seen: Vec<bool>,
    /// Largest share of the picture, over the instants, that things nearer than the limit cover.
    pub(super) blocked: f64,
    /// Share of the picture, the least over the instants, that anything covers, however thinly.
    pub(super) covered: f64,
    /// Largest share of all that is seen that belongs to one row at an instant, 0 to 1.
    pub(super) largest_share: f64,
    /// Share of the content's picture that nothing covers, 0 to 1; 0 where the content is out of the picture.
    pub(super) content: f64,
    /// Share of the picture that the content would fill if nothing stood before it, 0 to 1.
    pub(super) filled: f64,
    /// Mean depth of what is seen, in source units; 0 without anything.
    pub(super) depth: f64,
    /// Mean depth of the content that is seen, in source units; 0 without visible content.
    pub(super) content_depth: f64,
}

/// Looks at `discs` with `camera`, of [`SIZE`] pixels. Things nearer than `near` block it, and fade from `fade` on.
pub(super) fn glance(discs: &Discs, camera: &Camera, near: f64, fade: f64) -> Glance {
    let mut seen = vec![false; discs.rows];
    let (mut sum, mut alone, mut covered) = (Sums::default(), 0.0, 1.0_f64);
    let (mut blocked, mut largest) = (0.0_f64, 0.0_f64);
    for instant in &discs.instants {
        let mut picture = Picture::default();
        for projected in project(instant, camera, fade) {
            let before = picture.sums.weight;
            seen[projected.disc.row] |= projected.add_to(&mut picture, near);
            largest = largest.max(picture.sums.weight - before);
        }
        let open = picture.transmittance.iter().filter(|transmittance| **transmittance == 1.0).count();
        covered = covered.min(1.0 - open as f64 / PIXELS as f64);
        let Sums { weight, depth, content, content_depth, blocked: here } = picture.sums;
        blocked = blocked.max(here / PIXELS as f64);
        alone += picture.without_content.iter().map(|transmittance| 1.0 - transmittance).sum::<f64>();
        sum.weight += weight;
        sum.depth += depth;
        sum.content += content;
        sum.content_depth += content_depth;
    }
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    Glance {
        seen,
        blocked,
        covered,
        largest_share: ratio(largest, sum.weight),
        content: ratio(sum.content, alone),
        filled: alone / (PIXELS * discs.instants.len()) as f64,
        depth: ratio(sum.depth, sum.weight),
        content_depth: ratio(sum.content_depth, sum.content),
    }
}

/// Sums over pixels and discs. A disc's weight is its visible share of the pixel, 0 to 1.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: f64,
    /// Sum of weight times depth.
    depth: f64,
    /// Weight of the content.
    content: f64,
    content_depth: f64,
    /// Weight of the discs right before the eye.
    blocked: f64,
}

/// A picture from front to back.
struct Picture {
    transmittance: [f64; PIXELS],
    /// Transmittance of the content alone.
    without_content: [f64; PIXELS],
    /// The pixels of each line that are not opaque, and those that are not by the content alone: bit x for pixel x. All others
    /// need not be drawn.
    open: [[u64; SIZE.1 as usize]; 2],
    sums: Sums,
}

impl Default for Picture {
    fn default() -> Picture {
        let clear = [1.0; PIXELS];
        let open = [[u64::MAX >> (u64::BITS - SIZE.0); SIZE.1 as usize]; 2];
        Picture { transmittance: clear, without_content: clear, open, sums: Sums::default() }
    }
}

/// A disc in the picture; lengths in pixels, depth in source units.
struct Projected<'a> {
    disc: &'a Disc,
    at: [f64; 2],
    radius: f64,
    depth: f64,
    alpha: f64,
}

/// The discs that overlap the picture, from near to far. They fade from `fade` on.
fn project<'a>(discs: &'a [Disc], camera: &Camera, fade: f64) -> Vec<Projected<'a>> {
    let (m, k) = (&camera.camera_from_world, &camera.k);
    let size = [SIZE.0, SIZE.1].map(f64::from);
    let projected = |disc: &'a Disc| {
        let [x, y, depth] =
            [0, 1, 2].map(|r| (0..3).map(|axis| m[r][axis] * disc.center[axis]).sum::<f64>() + m[r][3]);
        let alpha = disc.opacity * near_fade(depth, fade);
        if depth <= 0.0 || alpha < ALPHA_MIN {
            return None;
        }
        let at = [k[0][0] * x / depth + k[0][2], k[1][1] * y / depth + k[1][2]];
        let radius = k[1][1] * disc.radius / depth;
        let overlaps = |axis: usize| at[axis] + radius > 0.0 && at[axis] - radius < size[axis];
        (overlaps(0) && overlaps(1)).then_some(Projected { disc, at, radius, depth, alpha })
    };
    let mut projected: Vec<Projected> = discs.iter().filter_map(projected).collect();
    projected.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    projected
}

impl Projected<'_> {
    /// Composites the disc behind what is there; returns whether it is seen.
    fn add_to(&self, picture: &mut Picture, near: f64) -> bool {
        let size = [SIZE.0, SIZE.1];
        let nearest = [0, 1].map(|axis| self.at[axis].clamp(0.0, f64::from(size[axis]) - 1.0) as usize);
        // A disc of less than a pixel covers a part of the pixel that it is in.
        let area = std::f64::consts::PI * self.radius * self.radius;
        if area <= 1.0 {
            let [x, y] = nearest;
            let is_open = self.open(picture, y) >> x & 1 == 1;
            return is_open && self.add_to_pixel(picture, nearest, self.alpha * area, near);
        }
        // Pixels whose centres lie between two places on an axis.
        let range = |axis: usize, center: f64, reach: f64| {
            let low = (center - reach - 0.5).max(0.0).ceil();
            let high = (center + reach - 0.5).min(f64::from(size[axis]) - 1.0).floor();
            low as u32..(high + 1.0).max(0.0) as u32
        };
        let mut is_seen = false;
        for y in range(1, self.at[1], self.radius) {
            let dy = f64::from(y) + 0.5 - self.at[1];
            let reach = (self.radius * self.radius - dy * dy).max(0.0).sqrt();
            let columns = range(0, self.at[0], reach);
            let mut left = self.open(picture, y as usize) & bits(columns);
            while left != 0 {
                let x = left.trailing_zeros() as usize;
                left &= left - 1;
                is_seen |= self.add_to_pixel(picture, [x, y as usize], self.alpha, near);
            }
        }
        is_seen
    }

    /// The pixels of a line that the disc changes.
    fn open(&self, picture: &Picture, line: usize) -> u64 {
        let of_content = if self.disc.is_content { picture.open[1][line] } else { 0 };
        picture.open[0][line] | of_content
    }

    /// Composites `alpha` of the disc into a pixel; returns whether it is seen there.
    fn add_to_pixel(&self, picture: &mut Picture, [x, y]: [usize; 2], alpha: f64, near: f64) -> bool {
        let pixel = x + y * SIZE.0 as usize;
        let transmittance = picture.transmittance[pixel];
        let weight = alpha * transmittance;
        picture.transmittance[pixel] -= weight;
        let closed = |transmittance: f64| !(u64::from(transmittance <= OPAQUE) << x);
        picture.open[0][y] &= closed(transmittance - weight);
        let sums = &mut picture.sums;
        sums.weight += weight;
        sums.depth += weight * self.depth;
        if self.depth < near {
            sums.blocked += weight;
        }
        if self.disc.is_content {
            sums.content += weight;
            sums.content_depth += weight * self.depth;
            picture.without_content[pixel] *= 1.0 - alpha;
            picture.open[1][y] &= closed(picture.without_content[pixel]);
        }
        // The disc's own alpha, not its part of the pixel: a headset's picture shows it larger.
        self.alpha * transmittance >= ALPHA_MIN
    }
}

/// The bits of a range, at most all.
fn bits(range: std::ops::Range<u32>) -> u64 {
    let up_to = |end: u32| if end >= u64::BITS { u64::MAX } else { (1 << end) - 1 };
    up_to(range.end) & !up_to(range.start)
}
