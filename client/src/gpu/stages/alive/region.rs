//! [`Region`]: the columns that the stage reads, and what they are at an instant, batch by batch.
//!
//! A column is a slice of plain numbers, and a batch goes through one operation after the other
//! without a branch: so the compiler makes vectors of it, four Gaussians wide and more.

use std::ops::Range;

use codec::{ALPHA_MIN, Field};
use glam::Vec2;

/// Gaussians that are looked at together: few enough to stay in the nearest cache.
pub(super) const BATCH: usize = 64;

/// Centres of a batch in units of the field, axis by axis.
pub(super) type Places = [[f32; BATCH]; 3];

/// The still or the moving Gaussians of a clip.
pub(super) struct Region {
    /// Clip times from and to which opacity reaches 1/255, outwards by a rounding; for one that never
    /// does, none between.
    starts: Vec<f32>,
    ends: Vec<f32>,
    /// Centres of the windows in clip time; of still rows, 0.
    tau: Vec<f32>,
    /// Centres at `tau`, in units of the field, axis by axis.
    centers: [Vec<f32>; 3],
    /// Motion coefficients, in units of the field per clip to that power: power by power, axis by axis.
    motion: Vec<[Vec<f32>; 3]>,
    /// Distance from the centre, in units of the field, beyond which alpha stays below 1/255.
    pub(super) reach: Vec<f32>,
    pub(super) faintness: Vec<Faintness>,
}

/// What it takes to tell how much a Gaussian can add to an image.
#[derive(Clone, Copy)]
pub(super) struct Faintness {
    /// Peak opacity.
    opacity: f32,
    /// One over the window's width in clip time; of still rows, 0.
    per_width: f32,
    /// Standard deviations along the two longest axes, the longest first, in units of the field.
    pub(super) sigmas: Vec2,
}

/// A batch at an instant. Of a batch that is not full, the rest means nothing.
pub(super) struct Batch {
    /// 1 for those that are alive.
    pub(super) alive: [u32; BATCH],
    /// Clip time since the centres of the windows.
    pub(super) since_tau: [f32; BATCH],
    /// Where the shaders put them.
    pub(super) places: Places,
}

impl Batch {
    pub(super) const EMPTY: Batch =
        Batch { alive: [0; BATCH], since_tau: [0.0; BATCH], places: [[0.0; BATCH]; 3] };
}

impl Region {
    pub(super) fn new(field: &Field) -> Region {
        let temporal = field.temporal.as_ref();
        let rows = 0..field.len();
        let radius = |row: usize| {
            let opacity = f64::from(field.opacities[row]);
            (opacity >= ALPHA_MIN).then(|| (2.0 * (opacity / ALPHA_MIN).ln()).sqrt())
        };
        let alive = |row: usize| match (radius(row), temporal) {
            (None, _) => [f32::INFINITY, f32::NEG_INFINITY],
            (Some(_), None) => [f32::NEG_INFINITY, f32::INFINITY],
            (Some(radius), Some(temporal)) => {
                let (tau, s) = (f64::from(temporal.tau[row]), f64::from(temporal.s[row]));
                // A peak of just 1/255 has radius 0, which infinite width cannot multiply.
                let reach = if s.is_finite() { s * radius } else { f64::INFINITY };
                // The instant is rounded too.
                let rounding = f64::from(f32::EPSILON);
                [((tau - reach - rounding) as f32).next_down(), ((tau + reach + rounding) as f32).next_up()]
            }
        };
        let alive: Vec<[f32; 2]> = rows.clone().map(alive).collect();
        let faintness = |row: usize| {
            let mut scales = field.log_scales[row];
            scales.sort_by(f32::total_cmp);
            Faintness {
                opacity: field.opacities[row],
                per_width: temporal.map_or(0.0, |temporal| 1.0 / temporal.s[row]),
                sigmas: Vec2::new(scales[2].exp(), scales[1].exp()),
            }
        };
        let faintness: Vec<Faintness> = rows.clone().map(faintness).collect();
        let reach = |row: usize| faintness[row].sigmas.x * radius(row).unwrap_or(0.0) as f32;
        let order = temporal.map_or(0, |temporal| usize::from(temporal.motion_order));
        let coefficients = temporal.map_or(&[][..], |temporal| &temporal.motion);
        let of_power = |power: usize| {
            [0, 1, 2].map(|axis| coefficients.iter().skip(power).step_by(order).map(|v| v[axis]).collect())
        };
        Region {
            starts: alive.iter().map(|[start, _]| *start).collect(),
            ends: alive.iter().map(|[_, end]| *end).collect(),
            tau: temporal.map_or_else(|| vec![0.0; field.len()], |temporal| temporal.tau.clone()),
            centers: [0, 1, 2].map(|axis| field.centers.iter().map(|center| center[axis]).collect()),
            motion: (0..order).map(of_power).collect(),
            reach: rows.map(reach).collect(),
            faintness,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.reach.len()
    }

    /// Works out `rows`, at most [`BATCH`] of them, at clip time `t`.
    pub(super) fn evaluate(&self, rows: Range<usize>, t: f32, batch: &mut Batch) {
        let windows = self.starts[rows.clone()].iter().zip(&self.ends[rows.clone()]);
        for ((start, end), alive) in windows.zip(&mut batch.alive) {
            *alive = u32::from(*start <= t) & u32::from(t <= *end);
        }
        for (tau, d) in self.tau[rows.clone()].iter().zip(&mut batch.since_tau) {
            *d = t - tau;
        }
        for (axis, places) in batch.places.iter_mut().enumerate() {
            places.fill(0.0);
            for power in self.motion.iter().rev() {
                let terms = power[axis][rows.clone()].iter().zip(&batch.since_tau);
                for ((v, d), place) in terms.zip(&mut *places) {
                    *place = (*place + v) * d;
                }
            }
            for (center, place) in self.centers[axis][rows.clone()].iter().zip(places) {
                *place += center;
            }
        }
    }
}

impl Faintness {
    /// Opacity at `d` after the centre of the window.
    pub(super) fn opacity_at(&self, d: f32) -> f32 {
        let z = d * self.per_width;
        self.opacity * (-0.5 * z * z).exp()
    }
}
