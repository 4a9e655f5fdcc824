//! [`GpuClip`]: a clip, or what is resident of a take, in GPU memory, with the columns that the CPU culls and sorts by.
//!
//! Its Gaussians belong to segments, each with a [`Span`] and a clip time of its own, in up to [`SLOTS`] slots. A clip
//! is one segment that spans all of it. So there is one path from the instant to the sorted rows.

use std::sync::Arc;

use codec::{Clip, Field, LayerEnd};
use glam::DVec3;
use program::Fault;
use shaders::layout::{self, Ranges};
use shaders::{ROW_BITS, SLOTS};

use super::device::Gpu;
use super::layer_run::LayerRun;
use super::pack::{RecordFormat, features, motion_units, origin, pack};
use super::span::Span;
use super::stages::alive::{LayerRows, Rows};
use super::stages::evaluate::Buffers;

/// A clip, or what is resident of a take, in GPU memory. Columns that it lacks take no memory. A clone shares the
/// memory.
#[derive(Clone)]
pub struct GpuClip {
    /// Origin of the centres in GPU memory, in the world of the clip.
    pub(super) origin: DVec3,
    /// Depth before an eye from which on Gaussians are drawn whole; 0 if none fades.
    pub(super) near: f32,
    /// Duration in the unit of the spans.
    pub(super) duration_s: f64,
    pub(super) clip: GaussianSet,
    pub(super) plate: Option<GaussianSet>,
    /// Bytes that the latest upload wrote.
    pub(super) uploaded_bytes: usize,
}

/// Gaussians that are sorted together: the clip's, or its plate's.
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

/// Where the rows of a segment are. Those of layers that are not there yet have their room, too.
pub(super) struct GpuSegment {
    pub(super) rows: Rows,
    /// First row in the buffers.
    pub(super) first: u32,
    pub(super) motion_units: [f32; 3],
    /// The room in the buffers, shared by all states of the segment: it is taken as long as one of them is referred to.
    pub(super) _room: Arc<()>,
}

impl GpuClip {
    /// Packs and uploads the layers of `clip`, into buffers with room for all that are announced.
    ///
    /// # Errors
    /// [`Fault::Device`] if the clip does not fit the device with all its layers.
    pub fn upload(gpu: &Gpu, clip: &Clip) -> Result<GpuClip, Fault> {
        let plate = clip.plate.as_ref().filter(|plate| !plate.is_empty());
        let fields = [&clip.static_field, &clip.dynamic_field];
        let room = clip.layers_announced.last().copied().unwrap_or_default();
        let format = RecordFormat {
            features: features(fields, room),
            origin: origin(&clip.static_field, &clip.dynamic_field),
            motion_units: motion_units(clip.bounds),
        };
        let plate = plate.map(|plate| GaussianSet::upload_static(gpu, plate, format.origin)).transpose()?;
        let near = clip.near();
        let (clip, bytes) = GaussianSet::upload(gpu, &LayerRun::of_clip(clip, 0), room, &format)?;
        let uploaded_bytes = bytes + plate.as_ref().map_or(0, |(_, bytes)| *bytes);
        Ok(GpuClip {
            origin: format.origin,
            near,
            duration_s: Span::WHOLE.duration_s,
            clip,
            plate: plate.map(|(plate, _)| plate),
            uploaded_bytes,
        })
    }

    /// This clip with the layers of `clip` that it lacks: packs and uploads only these. It shares its memory with this
    /// one, which stays as it is. `clip` has the layers that were uploaded and further ones, see
    /// [`Clip::append`](codec::Clip::append).
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    ///
    /// # Panics
    /// If `clip` has fewer layers, or other ones.
    pub fn extended(&self, gpu: &Gpu, clip: &Clip) -> Result<GpuClip, Fault> {
        let slot = self.clip.slots[0].as_ref().expect("it is a clip, not a take");
        let there: Vec<LayerEnd> = slot.segment.rows.layer_ends().collect();
        assert!(clip.layers.starts_with(&there), "it is the same clip, with further layers");
        let format = RecordFormat {
            features: self.clip.buffers.features,
            origin: self.origin,
            motion_units: slot.segment.motion_units,
        };
        let (clip, uploaded_bytes) =
            self.clip.extended(gpu, &LayerRun::of_clip(clip, there.len()), &format)?;
        Ok(GpuClip { clip, uploaded_bytes, ..self.clone() })
    }

    /// Uploads a version of a clip: only the layers that the version `before` lacks, if it continues one. It becomes the
    /// version before the next.
    ///
    /// # Errors
    /// As for [`GpuClip::upload`].
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(crate) fn following(
        gpu: &Gpu,
        before: &mut Option<Arc<GpuClip>>,
        clip: &Clip,
    ) -> Result<Arc<GpuClip>, Fault> {
        let uploaded = Arc::new(match before.take() {
            Some(before) => before.extended(gpu, clip)?,
            None => GpuClip::upload(gpu, clip)?,
        });
        *before = Some(uploaded.clone());
        Ok(uploaded)
    }

    /// Packs and uploads static Gaussians as a clip of one layer.
    ///
    /// # Errors
    /// As for [`GpuClip::upload`].
    pub(super) fn from_static(gpu: &Gpu, field: &Field) -> Result<GpuClip, Fault> {
        let origin = origin(field, &Field::default());
        let (clip, uploaded_bytes) = GaussianSet::upload_static(gpu, field, origin)?;
        Ok(GpuClip {
            origin,
            near: field.near,
            duration_s: Span::WHOLE.duration_s,
            clip,
            plate: None,
            uploaded_bytes,
        })
    }

    /// Bytes that uploading the clip wrote, or its latest layers if it was extended; 0 for a take.
    pub fn uploaded_bytes(&self) -> usize {
        self.uploaded_bytes
    }

    /// GPU memory of the clip, or of all that may be resident of the take, in bytes.
    pub fn bytes(&self) -> u64 {
        self.sets().map(|set| set.buffers.bytes()).sum()
    }

    /// Number of Gaussians in the first k layers of a clip, for k from 1; the plate is in no layer. A take has none.
    pub fn layer_ends(&self) -> Vec<usize> {
        let whole = self.clip.slots[0].as_ref().filter(|_| !self.clip.buffers.features.segmented);
        whole.map_or_else(Vec::new, |slot| slot.segment.rows.layer_ends().map(LayerEnd::total).collect())
    }

    /// The sets back to front: the plate, if there is one, then the clip.
    pub(super) fn sets(&self) -> impl Iterator<Item = &GaussianSet> {
        self.plate.iter().chain([&self.clip])
    }
}

impl GaussianSet {
    /// Uploads static Gaussians in one layer. Also returns the number of bytes.
    fn upload_static(gpu: &Gpu, field: &Field, origin: DVec3) -> Result<(GaussianSet, usize), Fault> {
        let empty = Field::default();
        let run = LayerRun::of_static(field, &empty);
        let features = features(run.fields, run.count());
        let format = RecordFormat { features, origin, motion_units: [1.0; 3] };
        GaussianSet::upload(gpu, &run, run.count(), &format)
    }

    /// Uploads first layers into buffers with room for `room` Gaussians. Also returns the number of bytes.
    fn upload(
        gpu: &Gpu,
        run: &LayerRun<'_>,
        room: LayerEnd,
        format: &RecordFormat,
    ) -> Result<(GaussianSet, usize), Fault> {
        let buffers = Buffers::of_clip(gpu, format.features, room, format.motion_units)?;
        let set = GaussianSet { buffers, slots: NO_SLOTS };
        // The shaders count rows in 32 bits, and the buffers are no larger.
        let first_dynamic = room.static_count as u32;
        set.with_layers(gpu, run, first_dynamic, format, |rows| Rows::new(rows, first_dynamic))
    }

    /// The set with further layers. Also returns the number of bytes that were uploaded.
    fn extended(
        &self,
        gpu: &Gpu,
        run: &LayerRun<'_>,
        format: &RecordFormat,
    ) -> Result<(GaussianSet, usize), Fault> {
        let rows = &self.slots[0].as_ref().expect("it has first layers").segment.rows;
        self.with_layers(gpu, run, rows.first_dynamic, format, |further| rows.followed_by(further))
    }

    /// Uploads layers. Their rows are drawn as `joined` returns them.
    fn with_layers(
        &self,
        gpu: &Gpu,
        run: &LayerRun<'_>,
        first_dynamic: u32,
        format: &RecordFormat,
        joined: impl FnOnce(LayerRows) -> Rows,
    ) -> Result<(GaussianSet, usize), Fault> {
        let packed = pack(run, format);
        let firsts = [0, first_dynamic as usize];
        let bytes = gpu.allocate("the clip", || self.buffers.write(gpu, &packed, firsts, 0, usize::MAX))?;
        let rows = joined(LayerRows::new(run, format.origin));
        let motion_units = format.motion_units;
        let segment = Arc::new(GpuSegment { rows, first: 0, motion_units, _room: Arc::default() });
        let mut slots = NO_SLOTS;
        slots[0] = Some(Slot { span: Span::WHOLE, segment });
        Ok((GaussianSet { buffers: self.buffers.clone(), slots }, bytes))
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
        let first_dynamic = self.first + self.rows.first_dynamic;
        let ranges = Ranges { motion_units: self.motion_units, first_dynamic };
        layout::Slot { ranges, time, time_rest: (t - f64::from(time)) as f32, ..Default::default() }
    }
}
