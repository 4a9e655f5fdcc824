//! [`GpuClip`]: a clip in GPU memory, with the columns that the CPU culls and sorts by.

use codec::{Clip, Field, LayerEnd, TimeIndex};
use glam::DVec3;
use program::Fault;

use super::device::Gpu;
use super::pack::{origin, pack};
use super::stages::alive::Rows;
use super::stages::evaluate::Buffers;

/// A clip in GPU memory. Columns that the clip lacks take no memory.
pub struct GpuClip {
    /// Origin of the centres in GPU memory, in the world of the clip.
    pub(super) origin: DVec3,
    pub(super) clip: GaussianSet,
    pub(super) plate: Option<GaussianSet>,
}

/// Gaussians that are sorted together: those of the clip, or those of its plate.
pub(super) struct GaussianSet {
    pub(super) rows: Rows,
    pub(super) buffers: Buffers,
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
        Ok(GpuClip { origin, clip, plate })
    }

    /// Packs and uploads static Gaussians as a clip of one layer.
    ///
    /// # Errors
    /// As for [`GpuClip::upload`].
    pub(super) fn from_static(gpu: &Gpu, field: &Field) -> Result<GpuClip, Fault> {
        let origin = origin(field, &Field::default());
        Ok(GpuClip { origin, clip: GaussianSet::upload_static(gpu, field, origin)?, plate: None })
    }

    /// GPU memory of the clip in bytes.
    pub fn bytes(&self) -> u64 {
        self.sets().map(|set| set.buffers.bytes()).sum()
    }

    /// Number of Gaussians in the first k layers, for k from 1; the plate is in no layer.
    pub fn layer_ends(&self) -> Vec<usize> {
        self.clip.rows.layer_ends().collect()
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
        [static_field, dynamic_field]: [&Field; 2],
        origin: DVec3,
        layers: Vec<LayerEnd>,
        time_index: TimeIndex,
    ) -> Result<GaussianSet, Fault> {
        Buffers::check_size(gpu, static_field, dynamic_field)?;
        let buffers = Buffers::upload(gpu, &pack(static_field, dynamic_field, origin))?;
        Ok(GaussianSet {
            rows: Rows::new([static_field, dynamic_field], origin, layers, time_index),
            buffers,
        })
    }
}
