//! [`GpuClip`]: a clip in GPU memory, and what the CPU keeps of it for sorting.

use codec::{Clip, Field, LayerEnd, TimeIndex};
use glam::DVec3;
use program::Fault;

use super::device::Gpu;
use super::pack::{origin, pack};
use super::stages::alive::Rows;
use super::stages::evaluate::Buffers;

/// A clip in GPU memory. What the clip does not have takes none.
pub struct GpuClip {
    /// What centres in GPU memory are relative to, in the world of the clip.
    pub(super) origin: DVec3,
    pub(super) clip: GaussianSet,
    pub(super) plate: Option<GaussianSet>,
}

/// Gaussians that are sorted together.
pub(super) struct GaussianSet {
    pub(super) rows: Rows,
    pub(super) buffers: Buffers,
}

impl GpuClip {
    /// Packs and uploads `clip`.
    ///
    /// # Errors
    /// [`Fault::Device`] if it does not fit the device.
    pub fn upload(gpu: &Gpu, clip: &Clip) -> Result<GpuClip, Fault> {
        let layers = clip.layers.clone();
        let time_index = clip.time_index.clone();
        let origin = origin(&clip.static_field, &clip.dynamic_field);
        let plate = match &clip.plate {
            Some(plate) if !plate.is_empty() => {
                let all = LayerEnd { static_count: plate.len(), dynamic_count: 0 };
                Some(GaussianSet::upload(
                    gpu,
                    [plate, &Field::default()],
                    origin,
                    vec![all],
                    TimeIndex::default(),
                )?)
            }
            _ => None,
        };
        let clip =
            GaussianSet::upload(gpu, [&clip.static_field, &clip.dynamic_field], origin, layers, time_index)?;
        Ok(GpuClip { origin, clip, plate })
    }

    /// Bytes of GPU memory that the clip takes.
    pub fn bytes(&self) -> u64 {
        self.sets().map(|set| set.buffers.bytes()).sum()
    }

    /// Gaussians in the first layer, the first two layers, and so on; the plate is in none.
    pub fn layer_ends(&self) -> Vec<usize> {
        self.clip.rows.layer_ends().collect()
    }

    /// What is drawn, back to front: the plate if there is one, the clip.
    pub(super) fn sets(&self) -> impl Iterator<Item = &GaussianSet> {
        self.plate.iter().chain([&self.clip])
    }
}

impl GaussianSet {
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
