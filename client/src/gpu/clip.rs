//! [`GpuClip`]: a clip in GPU memory, and what the CPU keeps of it for sorting.

use codec::{Clip, Field, LayerEnd, TimeIndex};
use glam::DVec3;

use super::device::Gpu;
use super::pack::{middle, pack};
use super::stages::alive::Rows;
use super::stages::evaluate::Buffers;
use crate::fault::Fault;

/// A clip in GPU memory. What the clip does not have takes none.
pub struct GpuClip {
    /// What centres in GPU memory are relative to, in the world of the clip.
    pub(super) middle: DVec3,
    pub(super) clip: Part,
    pub(super) plate: Option<Part>,
}

/// Gaussians that are sorted together.
pub(super) struct Part {
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
        let middle = middle(&clip.static_field, &clip.dynamic_field);
        let plate = match &clip.plate {
            Some(plate) if !plate.is_empty() => {
                let all = LayerEnd { static_count: plate.len(), dynamic_count: 0 };
                Some(Part::upload(gpu, [plate, &Field::default()], middle, vec![all], TimeIndex::default())?)
            }
            _ => None,
        };
        let clip = Part::upload(gpu, [&clip.static_field, &clip.dynamic_field], middle, layers, time_index)?;
        Ok(GpuClip { middle, clip, plate })
    }

    /// Bytes of GPU memory that the clip takes.
    pub fn bytes(&self) -> u64 {
        self.parts().map(|part| part.buffers.bytes()).sum()
    }

    /// Gaussians in the first layer, the first two layers, and so on; the plate is in none.
    pub fn layer_ends(&self) -> Vec<usize> {
        self.clip.rows.layer_ends().collect()
    }

    /// What is drawn, back to front: the plate if there is one, the clip.
    pub(super) fn parts(&self) -> impl Iterator<Item = &Part> {
        self.plate.iter().chain([&self.clip])
    }
}

impl Part {
    fn upload(
        gpu: &Gpu,
        [still, moving]: [&Field; 2],
        middle: DVec3,
        layers: Vec<LayerEnd>,
        time_index: TimeIndex,
    ) -> Result<Part, Fault> {
        Buffers::check_size(gpu, still, moving)?;
        let buffers = Buffers::upload(gpu, &pack(still, moving, middle))?;
        Ok(Part { rows: Rows::new([still, moving], middle, layers, time_index), buffers })
    }
}
