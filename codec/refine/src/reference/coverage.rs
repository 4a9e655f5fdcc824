//! [`coverage`]: how many fragments a player shades, counted instead of timed.
//!
//! A player draws a splat as a rectangle along the axes of its footprint. The pixel centres inside
//! are the fragments; their number depends on how far the rectangle reaches.

use codec::Camera;
use glam::{DVec2, dvec2};
use rayon::prelude::*;

use super::evaluate::Splat;
use super::{FieldPrefix, RenderScene, alive, evaluate_parts};

/// Half the side of a splat's rectangle, in standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// Where alpha falls to 1/255 at this instant: nothing is cut off, and what fades shrinks.
    Exact,
    /// The exact radius, but no more than this.
    AtMost(f64),
    /// The same for all splats; players commonly draw `sqrt(8)`.
    Fixed(f64),
}

/// What it takes to draw one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// Gaussians whose opacity at the instant reaches 1/255.
    pub alive: usize,
    /// Those whose rectangle holds a pixel centre of the image.
    pub drawn: usize,
    /// Pixel centres in the rectangles, over all splats.
    pub fragments: u64,
}

/// Counts what drawing `scene` from `camera` at clip time `t` takes, plate included. `camera` must
/// satisfy [`Camera::check`].
pub fn coverage(scene: &RenderScene, camera: &Camera, t: f64, radius: Radius) -> Coverage {
    let mut parts = scene.parts.clone();
    parts.extend(scene.plate.map(|plate| FieldPrefix { field: plate, rows: plate.len() }));
    let alive = parts.iter().map(|part| alive::alive(part.field, part.rows, t).len()).sum();
    let fragments_of = |splat: &Splat| fragments(splat, radius, camera.width, camera.height);
    let (drawn, fragments) = evaluate_parts(&parts, camera, t)
        .par_iter()
        .map(fragments_of)
        .map(|fragments| (usize::from(fragments > 0), fragments))
        .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    Coverage { alive, drawn, fragments }
}

/// Number of pixel centres of the image in the rectangle of `splat`.
fn fragments(splat: &Splat, radius: Radius, width: u32, height: u32) -> u64 {
    let radius = match radius {
        Radius::Exact => splat.radius(),
        Radius::AtMost(most) => splat.radius().min(most),
        Radius::Fixed(radius) => radius,
    };
    let (axis, sigma) = principal_axes(splat.covariance);
    let half = radius * sigma;
    let reach = (half.x * axis.y).abs() + (half.y * axis.x).abs();
    let rows = pixels_between(splat.center.y - reach, splat.center.y + reach, height);
    let mut count = 0;
    for y in rows {
        let dy = f64::from(y) + 0.5 - splat.center.y;
        // |axis . d| <= half.x and |normal . d| <= half.y, each an interval of d.x in this row.
        let along = interval(axis.x, axis.y * dy, half.x);
        let across = interval(-axis.y, axis.x * dy, half.y);
        let (left, right) = (along.0.max(across.0), along.1.min(across.1));
        let columns = pixels_between(splat.center.x + left, splat.center.x + right, width);
        count += columns.len() as u64;
    }
    count
}

/// Unit vector along the longer axis of a covariance, and the standard deviations along and
/// across it.
fn principal_axes([xx, xy, yy]: [f64; 3]) -> (DVec2, DVec2) {
    let mean = 0.5 * (xx + yy);
    let spread = (0.5 * (xx - yy)).hypot(xy);
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    (DVec2::from_angle(angle), dvec2((mean + spread).sqrt(), (mean - spread).max(0.0).sqrt()))
}

/// The `x` with `|a x + b| <= half`; empty intervals come out with their ends swapped.
fn interval(a: f64, b: f64, half: f64) -> (f64, f64) {
    if a == 0.0 {
        let inside = b.abs() <= half;
        return if inside { (f64::NEG_INFINITY, f64::INFINITY) } else { (f64::INFINITY, f64::NEG_INFINITY) };
    }
    let (p, q) = ((-half - b) / a, (half - b) / a);
    (p.min(q), p.max(q))
}

/// The pixels of a row or column of `size` whose centres lie in `[start, end]`.
fn pixels_between(start: f64, end: f64, size: u32) -> std::ops::Range<u32> {
    // Conversions saturate, whatever the numbers.
    let first = (start - 0.5).ceil().max(0.0) as u32;
    let last = ((end - 0.5).floor() + 1.0).clamp(0.0, f64::from(size)) as u32;
    first.min(last)..last
}
