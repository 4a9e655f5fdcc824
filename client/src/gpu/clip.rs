//! [`GpuClip`]: a clip, or what is resident of a take, in GPU memory, with the columns that the CPU culls and sorts by.
//!
//! Its Gaussians are those of segments, each with a [`Span`] and a clip time of its own, in up to [`SLOTS`] slots. A clip
//! is one segment that spans all of it. So there is one path from the instant to the sorted rows.

use std::sync::Arc;

use codec::{Clip, Field, LayerEnd, PixelFilter, TimeIndex};
use glam::DVec3;
use program::Fault;
use shaders::layout::{self, Ranges};
use shaders::{ROW_BITS, SLOTS};

use super::device::Gpu;
use super::pack::{features, origin, pack};
use super::span::Span;
use super::stages::alive::Rows;
use super::stages::evaluate::Buffers;

/// A clip, or what is resident of a take, in GPU memory. Columns that it lacks take no memory. A clone shares the
/// memory.
#[derive(Clone)]
pub struct GpuClip {
    /// Origin of the centres in GPU memory, in the world of the clip.
    pub(super) origin: DVec3,
    /// Duration in the unit of the spans.
    pub(super) duration_s: f64,
    pub(super) clip: GaussianSet,
    pub(super) plate: Option<GaussianSet>,
}

/// Gaussians that are sorted together: those of the clip, or those of its plate.
#[derive(Clone)]
pub(super) struct GaussianSet {
    pub(super) buffers: Buffers,
    pub(super) slots: [Option<Slot>; SLOTS as usize],
}

/// A segment that is drawn while its span holds the instant.
#[derive(Clone)]
pub(super) struct Slot {
    pub(super) span: Span,
    pub(super) segment: Arc<GpuSegment>,
}

/// Where the rows of a segment are. Its place in the buffers is taken as long as this is referred to.
pub(super) struct GpuSegment {
    pub(super) rows: Rows,
    /// First row in the buffers.
    pub(super) first: u32,
    /// Its first dynamic row counts from the first row of the segment.
    pub(super) ranges: Ranges,
}

impl GpuClip {
    /// Packs and uploads `clip`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the clip does not fit the device.
    pub fn upload(gpu: &Gpu, clip: &Clip) -> Result<GpuClip, Fault> {
        let layers = clip.layers.clone();
        let time_index = clip.time_index.clone();
        let origin = origin(&clip.static_field, &clip.dynamic_field);
        let plate = match &clip.plate {
            Some(plate) if !plate.is_empty() => Some(GaussianSet::upload_static(gpu, plate, origin)?),
            _ => None,
        };
        let clip =
            GaussianSet::upload(gpu, [&clip.static_field, &clip.dynamic_field], origin, layers, time_index)?;
        Ok(GpuClip { origin, duration_s: Span::WHOLE.duration_s, clip, plate })
    }

    /// Packs and uploads static Gaussians as a clip of one layer.
    ///
    /// # Errors
    /// As for [`GpuClip::upload`].
    pub(super) fn from_static(gpu: &Gpu, field: &Field) -> Result<GpuClip, Fault> {
        let origin = origin(field, &Field::default());
        let clip = GaussianSet::upload_static(gpu, field, origin)?;
        Ok(GpuClip { origin, duration_s: Span::WHOLE.duration_s, clip, plate: None })
    }

    /// GPU memory of the clip, or of all that may be resident of the take, in bytes.
    pub fn bytes(&self) -> u64 {
        self.sets().map(|set| set.buffers.bytes()).sum()
    }

    /// Number of Gaussians in the first k layers of a clip, for k from 1; the plate is in no layer. A take has none.
    pub fn layer_ends(&self) -> Vec<usize> {
        let whole = self.clip.slots[0].as_ref().filter(|_| !self.clip.buffers.features.segmented);
        whole.map_or_else(Vec::new, |slot| slot.segment.rows.layer_ends().collect())
    }

    /// The sets back to front: the plate, if there is one, then the clip.
    pub(super) fn sets(&self) -> impl Iterator<Item = &GaussianSet> {
        self.plate.iter().chain([&self.clip])
    }
}

impl GaussianSet {
    /// Uploads static Gaussians in one layer.
    fn upload_static(gpu: &Gpu, field: &Field, origin: DVec3) -> Result<GaussianSet, Fault> {
        let all = LayerEnd { static_count: field.len(), dynamic_count: 0 };
        GaussianSet::upload(gpu, [field, &Field::default()], origin, vec![all], TimeIndex::default())
    }

    fn upload(
        gpu: &Gpu,
        fields: [&Field; 2],
        origin: DVec3,
        layers: Vec<LayerEnd>,
        time_index: TimeIndex,
    ) -> Result<GaussianSet, Fault> {
        let features = features(fields);
        Buffers::check_size(gpu, features, fields.map(Field::len).iter().sum())?;
        let packed = pack(fields, origin, features);
        let buffers = Buffers::upload(gpu, &packed)?;
        let rows = Rows::new(fields, origin, layers, time_index);
        let segment = Arc::new(GpuSegment { rows, first: 0, ranges: packed.ranges });
        let mut slots = NO_SLOTS;
        slots[0] = Some(Slot { span: Span::WHOLE, segment });
        Ok(GaussianSet { buffers, slots })
    }

    /// The filter of the Gaussians.
    pub(super) fn filter(&self) -> PixelFilter {
        if self.buffers.features.mip { PixelFilter::Mip } else { PixelFilter::Blur }
    }

    /// The segments whose span holds the instant `t_s` of a take of `duration_s`, with their slots and their clip times.
    pub(super) fn at(&self, t_s: f64, duration_s: f64) -> impl Iterator<Item = (usize, &GpuSegment, f64)> {
        let clip_time = move |slot: &Slot| slot.span.holds(t_s, duration_s).then(|| slot.span.clip_time(t_s));
        self.slots.iter().enumerate().filter_map(move |(number, slot)| {
            let slot = slot.as_ref()?;
            Some((number, &*slot.segment, clip_time(slot)?))
        })
    }
}

/// No segment in any slot.
pub(super) const NO_SLOTS: [Option<Slot>; SLOTS as usize] = [const { None }; SLOTS as usize];

impl GpuSegment {
    /// The entry of the draw order for the first row of the segment in slot `number`.
    pub(super) fn first_entry(&self, number: usize) -> u32 {
        (number as u32) << ROW_BITS | self.first
    }

    /// What the shaders read of the segment at clip time `t`.
    pub(super) fn uniform(&self, t: f64) -> layout::Slot {
        let time = t as f32;
        let ranges = Ranges { first_dynamic: self.first + self.ranges.first_dynamic, ..self.ranges };
        layout::Slot { ranges, time, time_rest: (t - f64::from(time)) as f32, ..Default::default() }
    }
}
