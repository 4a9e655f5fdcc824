//! [`LayerRun`]: consecutive layers of a clip or a segment, to be packed and prepared for culling.

use std::ops::Range;

use codec::{Clip, Field, LayerEnd, Layers, TimeIndex};

/// Consecutive layers of a clip or a segment.
pub(crate) struct LayerRun<'a> {
    /// The static and the dynamic Gaussians; their `rows` are in these layers.
    pub(crate) fields: [&'a Field; 2],
    pub(crate) rows: [Range<usize>; 2],
    /// Number of rows of the layers before.
    pub(crate) before: LayerEnd,
    /// Number of rows up to the end of each of these layers, the layers before included.
    pub(crate) ends: Vec<LayerEnd>,
    /// Index of the dynamic rows, counted from the first of these layers.
    pub(crate) time_index: TimeIndex,
}

impl<'a> LayerRun<'a> {
    /// The layers of `clip` from layer `first` on, counted from 0.
    pub(crate) fn of_clip(clip: &'a Clip, first: usize) -> LayerRun<'a> {
        let before = LayerEnd::before(&clip.layers, first);
        LayerRun {
            fields: [&clip.static_field, &clip.dynamic_field],
            rows: [
                before.static_count..clip.static_field.len(),
                before.dynamic_count..clip.dynamic_field.len(),
            ],
            before,
            ends: clip.layers[first..].to_vec(),
            time_index: clip.time_index.since(first),
        }
    }

    /// One layer of static Gaussians. `empty` is a field without rows.
    pub(crate) fn of_static(field: &'a Field, empty: &'a Field) -> LayerRun<'a> {
        LayerRun {
            fields: [field, empty],
            rows: [0..field.len(), 0..0],
            before: LayerEnd::default(),
            ends: vec![LayerEnd { static_count: field.len(), dynamic_count: 0 }],
            time_index: TimeIndex::default(),
        }
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.count().total()
    }

    /// Number of rows of both kinds.
    pub(crate) fn count(&self) -> LayerEnd {
        let [static_count, dynamic_count] = self.rows.clone().map(|rows| rows.len());
        LayerEnd { static_count, dynamic_count }
    }
}

impl<'a> From<&'a Layers> for LayerRun<'a> {
    fn from(layers: &'a Layers) -> LayerRun<'a> {
        let Layers { before, static_field, dynamic_field, ends, time_index } = layers;
        LayerRun {
            fields: [static_field, dynamic_field],
            rows: [0..static_field.len(), 0..dynamic_field.len()],
            before: *before,
            ends: ends.clone(),
            time_index: time_index.clone(),
        }
    }
}
