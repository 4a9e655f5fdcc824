//! Stage `alive`: which Gaussians can be seen at an instant, and how far away they are.
//!
//! The time index gives the candidates; those whose temporal opacity reaches 1/255 are alive; of
//! these, those that can reach into an image, and are not too faint to matter, are handed to the
//! stage `sort`. It runs for every Gaussian in every frame, so what does not change from frame to
//! frame is worked out once, the ends of a window instead of its exponential for one, and the rest
//! batch by batch.

mod eye;
mod region;
#[cfg(test)]
mod tests;

use std::ops::Range;

use codec::{Field, LayerEnd, TimeIndex};
use glam::{DVec3, Vec3A};

use super::sort::Item;
use crate::gpu::settings::{Settings, SortOrder};
use crate::view::{MiddleEye, View};
use eye::Eye;
pub(in crate::gpu) use eye::slope_limits;
use region::{BATCH, Batch, Places, Region};

/// Most eyes that one frame has.
pub(in crate::gpu) const EYES_MAX: usize = 2;

/// What the CPU keeps of a clip: the columns of the two equations, and how far Gaussians reach.
pub(in crate::gpu) struct Rows {
    still: Region,
    moving: Region,
    layers: Vec<LayerEnd>,
    time_index: TimeIndex,
    middle: DVec3,
}

/// What of a part of a clip can be seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gpu) struct Seen {
    /// Rows that are alive.
    pub(in crate::gpu) alive: u32,
    /// Those of them that are in sight and were left out all the same, see [`Settings::least_px`].
    pub(in crate::gpu) faint: u32,
}

impl Rows {
    /// `middle`: of the clip, in the world of the fields.
    pub(in crate::gpu) fn new(
        [still, moving]: [&Field; 2],
        middle: DVec3,
        layers: Vec<LayerEnd>,
        time_index: TimeIndex,
    ) -> Rows {
        let [still, moving] = [still, moving].map(|field| Region::new(field, middle));
        Rows { still, moving, layers, time_index, middle }
    }

    pub(in crate::gpu) fn len(&self) -> usize {
        self.still.len() + self.moving.len()
    }

    /// Gaussians in the first layer, the first two, and so on.
    pub(in crate::gpu) fn layer_ends(&self) -> impl Iterator<Item = usize> {
        self.layers.iter().map(|end| end.total())
    }

    /// Replaces `items` by the rows that, by `settings`, are to be drawn at clip time `t` in one of
    /// `views`, still rows first, rows rising within a region's ranges.
    pub(in crate::gpu) fn alive(
        &self,
        t: f64,
        views: &[View],
        settings: &Settings,
        items: &mut Vec<Item>,
    ) -> Seen {
        items.clear();
        let layers = settings.layers.map_or(self.layers.len(), |layers| layers.min(self.layers.len()));
        let Some(end) = layers.checked_sub(1).map(|last| self.layers[last]) else {
            return Seen::default();
        };
        let mut eyes = [Eye::NONE; EYES_MAX];
        for (eye, view) in eyes.iter_mut().zip(views) {
            *eye = Eye::new(view, self.middle);
        }
        let mut sieve = Sieve {
            t,
            eyes: &eyes[..views.len().min(EYES_MAX)],
            depth: Depth::new(views, self.middle, settings.sort),
            least_px: settings.least_px,
            items,
            seen: Seen::default(),
        };
        sieve.pass(&self.still, 0..end.static_count, 0);
        let first = self.still.len();
        for rows in self.time_index.candidates(t, layers) {
            sieve.pass(&self.moving, rows, first);
        }
        sieve.seen
    }
}

/// Lets through what can be seen.
struct Sieve<'a> {
    t: f64,
    eyes: &'a [Eye],
    depth: Depth,
    least_px: f32,
    items: &'a mut Vec<Item>,
    seen: Seen,
}

impl Sieve<'_> {
    /// Passes `rows` of a region whose first row counts as `first`.
    fn pass(&mut self, region: &Region, rows: Range<usize>, first: usize) {
        let mut batch = Batch::EMPTY;
        for begin in rows.clone().step_by(BATCH) {
            let rows = begin..rows.end.min(begin + BATCH);
            region.evaluate(rows.clone(), self.t, &mut batch);
            let mut in_sight = [0; BATCH];
            for eye in self.eyes {
                eye.mark_seen(&batch.places, &region.reach[rows.clone()], &mut in_sight);
            }
            let depths = self.depth.of(&batch.places);
            for (i, row) in rows.enumerate() {
                self.seen.alive += batch.alive[i];
                if batch.alive[i] & in_sight[i] == 0 {
                    continue;
                }
                if self.least_px > 0.0 {
                    let place = Vec3A::from_array(batch.places.map(|axis| axis[i]));
                    let (d, faintness) = (batch.since[i], &region.faintness[row]);
                    let is_faint = |eye: &Eye| eye.weight_px(place, d, faintness) < self.least_px;
                    if self.eyes.iter().all(is_faint) {
                        self.seen.faint += 1;
                        continue;
                    }
                }
                self.items.push(Item::new(depths[i], (first + row) as u32));
            }
        }
    }
}

/// How far away Gaussians are, as far as their order goes.
struct Depth {
    order: SortOrder,
    /// Between the eyes, from the middle of the clip, in units of the field.
    from: Vec3A,
    /// Where both eyes together look, of length 1.
    forward: Vec3A,
}

impl Depth {
    fn new(views: &[View], middle: DVec3, order: SortOrder) -> Depth {
        let eye = MiddleEye::of(views);
        Depth { order, from: (eye.position - middle).as_vec3a(), forward: eye.forward.as_vec3a() }
    }

    fn of(&self, [xs, ys, zs]: &Places) -> [f32; BATCH] {
        let Depth { from, forward, .. } = self;
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
