//! Stage `alive`: finds the visible Gaussians at an instant and their sort keys.
//!
//! The time index gives candidates. A candidate is alive if its temporal opacity is at least 1/255. Alive
//! Gaussians are culled against the view frusta and by contribution; the others go to the stage `sort`.
//! The stage runs for all candidates in every frame, so it precomputes what does not change (the ends of a
//! window replace its exponential) and processes rows in batches.

mod columns;
mod eye;
#[cfg(test)]
mod tests;

use std::ops::Range;

use codec::{Field, LayerEnd, PixelFilter, TimeIndex};
use glam::{DVec3, Vec3A};

use super::sort::Item;
use crate::gpu::settings::{RenderSettings, SortOrder};
use crate::view::{CyclopeanEye, View};
pub(in crate::gpu) use columns::ROW_BYTES;
use columns::{BATCH, Batch, Places, RowColumns};
use eye::Eye;
pub(in crate::gpu) use eye::slope_limits;

/// Most eyes that one frame has.
pub(in crate::gpu) const EYES_MAX: usize = 2;

/// The columns of a clip in CPU memory that culling and sorting read.
pub(in crate::gpu) struct Rows {
    static_field: RowColumns,
    dynamic_field: RowColumns,
    layers: Vec<LayerEnd>,
    time_index: TimeIndex,
    origin: DVec3,
    filter: PixelFilter,
}

/// Counts of the stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gpu) struct CullCounts {
    /// Rows that are alive.
    pub(in crate::gpu) alive: u32,
    /// Alive rows inside a frustum that were culled by [`RenderSettings::min_contribution_px`].
    pub(in crate::gpu) culled: u32,
}

impl Rows {
    /// Prepares the rows; `origin` is that of the clip, in the world of the fields.
    pub(in crate::gpu) fn new(
        [static_field, dynamic_field]: [&Field; 2],
        origin: DVec3,
        layers: Vec<LayerEnd>,
        time_index: TimeIndex,
    ) -> Rows {
        let filter = if dynamic_field.is_empty() { static_field.filter } else { dynamic_field.filter };
        let [static_field, dynamic_field] =
            [static_field, dynamic_field].map(|field| RowColumns::new(field, origin));
        Rows { static_field, dynamic_field, layers, time_index, origin, filter }
    }

    pub(in crate::gpu) fn len(&self) -> usize {
        self.static_field.len() + self.dynamic_field.len()
    }

    /// Number of Gaussians in the first k layers, for k from 1.
    pub(in crate::gpu) fn layer_ends(&self) -> impl Iterator<Item = usize> {
        self.layers.iter().map(|end| end.total())
    }

    /// Replaces `items` by the rows to draw at clip time `t` in `views` under `settings`: static rows first,
    /// then the candidates of the time index in order.
    pub(in crate::gpu) fn alive(
        &self,
        t: f64,
        views: &[View],
        settings: &RenderSettings,
        items: &mut Vec<Item>,
    ) -> CullCounts {
        items.clear();
        let layers = settings.layers.map_or(self.layers.len(), |layers| layers.min(self.layers.len()));
        let Some(end) = layers.checked_sub(1).map(|last| self.layers[last]) else {
            return CullCounts::default();
        };
        let mut eyes = [Eye::NONE; EYES_MAX];
        for (eye, view) in eyes.iter_mut().zip(views) {
            *eye = Eye::new(view, self.origin);
        }
        let mut culler = Culler {
            t,
            eyes: &eyes[..views.len().min(EYES_MAX)],
            depth: DepthKeys::new(views, self.origin, settings.sort),
            min_contribution_px: settings.min_contribution_px,
            filter: self.filter,
            items,
            seen: CullCounts::default(),
        };
        culler.cull(&self.static_field, 0..end.static_count, 0);
        let first = self.static_field.len();
        for rows in self.time_index.candidates(t, layers) {
            culler.cull(&self.dynamic_field, rows, first);
        }
        culler.seen
    }
}

/// Culls rows and collects the others in `items`.
struct Culler<'a> {
    t: f64,
    eyes: &'a [Eye],
    depth: DepthKeys,
    min_contribution_px: f32,
    filter: PixelFilter,
    items: &'a mut Vec<Item>,
    seen: CullCounts,
}

impl Culler<'_> {
    /// Culls `rows` of `columns`; the row numbers in `items` are offset by `first`.
    fn cull(&mut self, columns: &RowColumns, rows: Range<usize>, first: usize) {
        let mut batch = Batch::EMPTY;
        for begin in rows.clone().step_by(BATCH) {
            let rows = begin..rows.end.min(begin + BATCH);
            columns.evaluate(rows.clone(), self.t, &mut batch);
            let mut visible = [0; BATCH];
            for eye in self.eyes {
                eye.cull(&batch.places, &columns.support_radius[rows.clone()], &mut visible);
            }
            let depths = self.depth.of(&batch.places);
            for (i, row) in rows.enumerate() {
                self.seen.alive += batch.alive[i];
                if batch.alive[i] & visible[i] == 0 {
                    continue;
                }
                if self.min_contribution_px > 0.0 {
                    let place = Vec3A::from_array(batch.places.map(|axis| axis[i]));
                    let (d, contribution) = (batch.since[i], &columns.contribution[row]);
                    let is_negligible = |eye: &Eye| {
                        eye.weight_px(place, d, contribution, self.filter) < self.min_contribution_px
                    };
                    if self.eyes.iter().all(is_negligible) {
                        self.seen.culled += 1;
                        continue;
                    }
                }
                self.items.push(Item::new(depths[i], (first + row) as u32));
            }
        }
    }
}

/// Computes the sort keys: distances of Gaussians.
struct DepthKeys {
    order: SortOrder,
    /// Midpoint of the eyes relative to the clip's origin, in units of the field.
    from: Vec3A,
    /// Unit vector of the mean viewing direction.
    forward: Vec3A,
}

impl DepthKeys {
    fn new(views: &[View], origin: DVec3, order: SortOrder) -> DepthKeys {
        let eye = CyclopeanEye::new(views);
        DepthKeys { order, from: (eye.position - origin).as_vec3a(), forward: eye.forward.as_vec3a() }
    }

    fn of(&self, [xs, ys, zs]: &Places) -> [f32; BATCH] {
        let DepthKeys { from, forward, .. } = self;
        let mut depths = [0.0; BATCH];
        for (((x, y), z), depth) in xs.iter().zip(ys).zip(zs).zip(&mut depths) {
            let (x, y, z) = (x - from.x, y - from.y, z - from.z);
            *depth = match self.order {
                SortOrder::Depth => x * forward.x + y * forward.y + z * forward.z,
                SortOrder::Radial => (x * x + y * y + z * z).sqrt(),
            };
        }
        depths
    }
}
