//! [`RowColumns`]: the columns that the stage reads, and their evaluation at an instant in batches.
//!
//! Columns are plain slices, and the operations on a batch have no branches, so the compiler vectorises
//! them to four Gaussians or more.

use std::mem::size_of;
use std::ops::Range;

use codec::{ALPHA_MIN, Field, MOTION_ORDER_MAX};
use glam::DVec3;

use crate::gpu::pack::moment::Moment;

/// Gaussians per batch: few enough for the first-level cache.
pub(super) const BATCH: usize = 64;

/// Centres of a batch relative to the clip's origin, in units of the field, by axis.
pub(super) type Places = [[f32; BATCH]; 3];

/// The columns of the static or the dynamic Gaussians of a clip, the latter as the [`Moment`]s of the
/// shaders.
pub(super) struct RowColumns {
    /// Clip times between which the opacity is at least 1/255, rounded outwards; an empty interval for rows
    /// that are never alive.
    starts: Vec<f32>,
    ends: Vec<f32>,
    /// Instants of the records in clip time; 0 for static rows.
    instants: Vec<f32>,
    /// Units of motion time per clip.
    units: Vec<f32>,
    /// Centres at the instants, relative to the clip's origin, in units of the field, by axis.
    centers: [Vec<f32>; 3],
    /// Motion coefficients in units of the field, by power and axis.
    motion: Vec<[Vec<f32>; 3]>,
    /// Distance from the centre, in units of the field, beyond which alpha is below 1/255.
    pub(super) support_radius: Vec<f32>,
}

/// Most bytes of a row in all columns.
pub(in crate::gpu) const ROW_BYTES: usize = size_of::<f32>() * (4 + 3 + 3 * MOTION_ORDER_MAX as usize + 1);

/// A batch at an instant; entries beyond its rows are unspecified.
pub(super) struct Batch {
    /// 1 for alive rows, else 0.
    pub(super) alive: [u32; BATCH],
    /// Clip time since the instants of the records.
    since: [f32; BATCH],
    /// Centres as the shaders compute them.
    pub(super) places: Places,
}

impl Batch {
    pub(super) const EMPTY: Batch =
        Batch { alive: [0; BATCH], since: [0.0; BATCH], places: [[0.0; BATCH]; 3] };
}

impl RowColumns {
    /// Prepares the columns of `rows` of `field`; `origin` is the clip's origin, in the world of the field.
    pub(super) fn new(field: &Field, rows: Range<usize>, origin: DVec3) -> RowColumns {
        let moment = |row: usize| match &field.temporal {
            Some(temporal) => Moment::new(field, temporal, row),
            None => Moment { position: field.centers[row].map(f64::from), ..Moment::default() },
        };
        let moments: Vec<Moment> = rows.clone().map(moment).collect();
        let alive = |row: usize| match field.alive_interval(row) {
            None => [f32::INFINITY, f32::NEG_INFINITY],
            Some((start, end)) => {
                // The instant of the frame is rounded, too.
                let rounding = f64::from(f32::EPSILON);
                [((start - rounding) as f32).next_down(), ((end + rounding) as f32).next_up()]
            }
        };
        let alive: Vec<[f32; 2]> = rows.clone().map(alive).collect();
        let support_radius = |row: usize| {
            let radius = (2.0 * (f64::from(field.opacities[row]) / ALPHA_MIN).ln()).max(0.0).sqrt();
            let [x, y, z] = field.log_scales[row];
            let longest = std::cmp::max_by(x, std::cmp::max_by(y, z, f32::total_cmp), f32::total_cmp);
            longest.exp() * radius as f32
        };
        let center = |axis: usize| moments.iter().map(|m| (m.position[axis] - origin[axis]) as f32).collect();
        let order = field.temporal.as_ref().map_or(0, |temporal| usize::from(temporal.motion_order));
        let of_power =
            |power: usize| [0, 1, 2].map(|axis| moments.iter().map(|m| m.motion[power][axis]).collect());
        RowColumns {
            starts: alive.iter().map(|[start, _]| *start).collect(),
            ends: alive.iter().map(|[_, end]| *end).collect(),
            instants: moments.iter().map(Moment::instant).collect(),
            units: moments.iter().map(Moment::units).collect(),
            centers: [0, 1, 2].map(center),
            motion: (0..order).map(of_power).collect(),
            support_radius: rows.map(support_radius).collect(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.support_radius.len()
    }

    /// Evaluates `rows`, at most [`BATCH`], at clip time `t`.
    pub(super) fn evaluate(&self, rows: Range<usize>, t: f64, batch: &mut Batch) {
        let time = t as f32;
        let rest = (t - f64::from(time)) as f32;
        let windows = self.starts[rows.clone()].iter().zip(&self.ends[rows.clone()]);
        for ((start, end), alive) in windows.zip(&mut batch.alive) {
            *alive = u32::from(*start <= time) & u32::from(time <= *end);
        }
        for (instant, d) in self.instants[rows.clone()].iter().zip(&mut batch.since) {
            *d = time - instant + rest;
        }
        let units = &self.units[rows.clone()];
        for (axis, places) in batch.places.iter_mut().enumerate() {
            places.fill(0.0);
            for power in self.motion.iter().rev() {
                let terms = power[axis][rows.clone()].iter().zip(units.iter().zip(&batch.since));
                for ((w, (unit, d)), place) in terms.zip(&mut *places) {
                    *place = (*place + w) * (d * unit);
                }
            }
            for (center, place) in self.centers[axis][rows.clone()].iter().zip(places) {
                *place += center;
            }
        }
    }
}
