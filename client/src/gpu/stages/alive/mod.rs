//! Stage `alive`: finds the visible Gaussians at an instant and their sort keys.
//!
//! The time index gives candidates. A candidate is alive if its temporal opacity is at least 1/255. Alive
//! Gaussians are culled against the view frusta; the others go to the stage `sort`.
//! The stage runs for all candidates in every frame, so it precomputes what does not change (the ends of a
//! window replace its exponential) and processes rows in batches. A [`Culler`] holds what a frame culls by, and collects
//! the [`Rows`] of one segment after another.

mod columns;
mod eye;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::Arc;

use codec::{LayerEnd, TimeIndex};
use glam::{DVec3, Vec3A};

use super::sort::Item;
use crate::gpu::frame_views::{EYES_MAX, FrameViews};
use crate::gpu::layer_run::LayerRun;
use crate::gpu::settings::{RenderSettings, SortOrder};
use crate::view::{CyclopeanEye, View};
pub(in crate::gpu) use columns::ROW_BYTES;
use columns::{BATCH, Batch, Places, RowColumns};
use eye::Eye;
pub(in crate::gpu) use eye::slope_limits;

/// The columns of a clip, or of a segment, in CPU memory that culling and sorting read, as they arrived: nothing is copied
/// when further layers do.
pub(in crate::gpu) struct Rows {
    runs: Vec<Arc<LayerRows>>,
    /// First dynamic row, behind the room for all static ones.
    pub(in crate::gpu) first_dynamic: u32,
}

/// The columns of consecutive layers.
pub(in crate::gpu) struct LayerRows {
    static_field: RowColumns,
    dynamic_field: RowColumns,
    /// Rows of the layers before.
    before: LayerEnd,
    /// Rows up to the end of each layer, the layers before included.
    ends: Vec<LayerEnd>,
    /// Counts from the first of these dynamic rows.
    time_index: TimeIndex,
}

impl Rows {
    /// Rows of first layers, with room for `first_dynamic` static ones.
    pub(in crate::gpu) fn new(rows: LayerRows, first_dynamic: u32) -> Rows {
        Rows { runs: vec![Arc::new(rows)], first_dynamic }
    }

    /// These rows and the rows of further layers.
    pub(in crate::gpu) fn followed_by(&self, rows: LayerRows) -> Rows {
        let runs = self.runs.iter().cloned().chain([Arc::new(rows)]).collect();
        Rows { runs, first_dynamic: self.first_dynamic }
    }

    /// Number of Gaussians in the first k layers, for k from 1.
    #[cfg(test)]
    fn layer_ends(&self) -> impl Iterator<Item = LayerEnd> {
        self.runs.iter().flat_map(|run| run.ends.iter().copied())
    }

    /// Culls the rows at clip time `t`: of the layers as they arrived, static rows first, then the candidates of the time
    /// index in order. In the draw order they count from `first`.
    pub(in crate::gpu) fn alive(&self, t: f64, first: u32, culler: &mut Culler<'_>) {
        let mut layers = culler.layers.unwrap_or(usize::MAX);
        for run in &self.runs {
            run.alive(t, layers, [first, first + self.first_dynamic], culler);
            layers = layers.saturating_sub(run.ends.len());
        }
    }
}

impl LayerRows {
    /// Prepares the rows of layers; `origin` is the clip's origin, in the world of the fields.
    pub(in crate::gpu) fn new(run: &LayerRun<'_>, origin: DVec3) -> LayerRows {
        let columns = |region: usize| RowColumns::new(run.fields[region], run.rows[region].clone(), origin);
        LayerRows {
            static_field: columns(0),
            dynamic_field: columns(1),
            before: run.before,
            ends: run.ends.clone(),
            time_index: run.time_index.clone(),
        }
    }

    pub(in crate::gpu) fn len(&self) -> usize {
        self.static_field.len() + self.dynamic_field.len()
    }

    /// Rows of the layers before.
    pub(in crate::gpu) fn before(&self) -> LayerEnd {
        self.before
    }

    /// Rows up to the end of the last of these layers, the layers before included.
    pub(in crate::gpu) fn end(&self) -> LayerEnd {
        self.ends.last().copied().unwrap_or(self.before)
    }

    /// Culls the rows of the first `layers` layers. `firsts` are the first static and the first dynamic row of the
    /// whole clip.
    fn alive(&self, t: f64, layers: usize, firsts: [u32; 2], culler: &mut Culler<'_>) {
        let layers = layers.min(self.ends.len());
        let Some(end) = layers.checked_sub(1).map(|last| self.ends[last]) else {
            return;
        };
        let LayerEnd { static_count, dynamic_count } = self.before;
        let rows = 0..end.static_count - static_count;
        culler.cull(&self.static_field, t, rows, firsts[0] + static_count as u32);
        for rows in self.time_index.candidates(t, layers) {
            culler.cull(&self.dynamic_field, t, rows, firsts[1] + dynamic_count as u32);
        }
    }
}

/// The eyes of a frame.
struct Eyes {
    eyes: [Eye; EYES_MAX],
    count: usize,
}

impl Eyes {
    fn new<'v>(views: impl ExactSizeIterator<Item = &'v View>, origin: DVec3, near: f32) -> Eyes {
        let (mut eyes, count) = ([Eye::NONE; EYES_MAX], views.len());
        eyes.iter_mut().zip(views).for_each(|(eye, view)| *eye = Eye::new(view, origin, near));
        Eyes { eyes, count }
    }

    fn iter(&self) -> impl Iterator<Item = &Eye> {
        self.eyes[..self.count].iter()
    }

    /// 1 for each row of a batch that may overlap an image, else 0.
    fn see(&self, places: &Places, support_radius: &[f32]) -> [u32; BATCH] {
        let mut visible = [0; BATCH];
        self.iter().for_each(|eye| eye.cull(places, support_radius, &mut visible));
        visible
    }
}

/// Culls rows of a frame and collects the others.
pub(in crate::gpu) struct Culler<'a> {
    /// What is drawn, in a foveated frame with larger pixels.
    drawn: Eyes,
    insets: Option<Eyes>,
    depth: DepthKeys,
    layers: Option<usize>,
    items: &'a mut Vec<Item>,
    /// Number of rows that are alive.
    pub(in crate::gpu) alive: u32,
}

impl<'a> Culler<'a> {
    /// For a frame of `views` under `settings`. Replaces `items` by the rows to draw and marks the rows in the inset;
    /// `origin` is the clip's origin in the world, `near` its near distance.
    pub(in crate::gpu) fn new(
        views: &FrameViews,
        settings: &RenderSettings,
        origin: DVec3,
        near: f32,
        items: &'a mut Vec<Item>,
    ) -> Culler<'a> {
        items.clear();
        Culler {
            drawn: Eyes::new(views.drawn().iter(), origin, near),
            insets: views
                .divisions()
                .map(|divisions| Eyes::new(divisions.iter().map(|division| &division.inset), origin, near)),
            depth: DepthKeys::new(views.full(), origin, settings.sort),
            layers: settings.layers,
            items,
            alive: 0,
        }
    }

    /// Culls `rows` of `columns` at clip time `t`; the row numbers in `items` are offset by `first`.
    fn cull(&mut self, columns: &RowColumns, t: f64, rows: Range<usize>, first: u32) {
        let mut batch = Batch::EMPTY;
        for begin in rows.clone().step_by(BATCH) {
            let rows = begin..rows.end.min(begin + BATCH);
            columns.evaluate(rows.clone(), t, &mut batch);
            let support_radius = &columns.support_radius[rows.clone()];
            let visible = self.drawn.see(&batch.places, support_radius);
            let in_inset =
                self.insets.as_ref().map_or([0; BATCH], |insets| insets.see(&batch.places, support_radius));
            let depths = self.depth.keys(&batch.places);
            for (i, row) in rows.enumerate() {
                self.alive += batch.alive[i];
                if batch.alive[i] & visible[i] == 0 {
                    continue;
                }
                let item = Item::new(depths[i], first + row as u32);
                self.items.push(if in_inset[i] == 0 { item } else { item.in_inset() });
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

    fn keys(&self, [xs, ys, zs]: &Places) -> [f32; BATCH] {
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
