//! [`DrawnSet`]: the pipeline of one Gaussian set and its draw order in the current frame.

use program::Fault;
use shaders::layout::Slot;
use shaders::{BATCH, Features, Purpose, SLOTS};

use super::clip::GaussianSet;
use super::evaluate::SLOTS_BYTES;
use super::sort::{Item, Sorter};
use super::splat;
use crate::gpu::device::Gpu;

/// The Gaussians of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gpu) enum DrawnPart {
    /// All that are visible.
    All,
    /// Those in the inset of a foveated frame.
    Inset,
}

/// A Gaussian set of the clip with everything that drawing it needs.
pub(in crate::gpu) struct DrawnSet {
    pub(in crate::gpu) features: Features,
    pub(in crate::gpu) layout: wgpu::BindGroupLayout,
    pub(in crate::gpu) pipeline: wgpu::RenderPipeline,
    /// Rows to draw, back to front: the rows of [`DrawnPart::All`], then, from the next batch of quads on, the rows of
    /// [`DrawnPart::Inset`].
    order: Vec<u32>,
    all: u32,
    inset: u32,
    pub(in crate::gpu) order_buffer: wgpu::Buffer,
    /// The segments of a take at the instant.
    slots: Option<wgpu::Buffer>,
    pub(in crate::gpu) group: wgpu::BindGroup,
}

impl DrawnSet {
    /// For targets of `format` and passes of `eyes_per_pass` eyes, of frames that may be `foveated`. Colours blend
    /// premultiplied.
    ///
    /// # Errors
    /// As for [`Gpu::pipeline`].
    pub(in crate::gpu) fn new(
        gpu: &Gpu,
        set: &GaussianSet,
        pass_layout: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
        eyes_per_pass: u32,
        foveated: bool,
    ) -> Result<DrawnSet, Fault> {
        let features = set.buffers.features;
        let layout = set.buffers.layout(gpu);
        let groups = [Some(pass_layout), Some(&layout)];
        let rows = set.buffers.rows;
        let capacity = if foveated { rows.next_multiple_of(BATCH as usize) + rows } else { rows };
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let order_buffer = gpu.empty_buffer("order", 4 * capacity.max(1) as u64, usage);
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let slots = features.segmented.then(|| gpu.empty_buffer("slots", SLOTS_BYTES as u64, usage));
        let purpose = Purpose::Draw { views: eyes_per_pass, foveated, f16: gpu.caps.f16 };
        let target = wgpu::ColorTargetState {
            format,
            blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
            write_mask: wgpu::ColorWrites::ALL,
        };
        Ok(DrawnSet {
            features,
            pipeline: splat::pipeline(gpu, features, purpose, &groups, target)?,
            order: Vec::with_capacity(capacity),
            all: 0,
            inset: 0,
            group: set.buffers.bind(gpu, &layout, slots.as_ref(), &order_buffer),
            slots,
            order_buffer,
            layout,
        })
    }

    /// Orders the rows of `items` from the farthest to the nearest; in a `foveated` frame also the rows of the inset.
    pub(in crate::gpu) fn sort(&mut self, sorter: &mut Sorter, items: &mut Vec<Item>, foveated: bool) {
        sorter.sort(items, &mut self.order);
        (self.all, self.inset) = (self.order.len() as u32, 0);
        if foveated {
            let all = self.order.len();
            self.order.resize(self.first(DrawnPart::Inset), 0);
            for i in 0..all {
                let (row, is_in_inset) = Item::split(self.order[i]);
                self.order[i] = row;
                if is_in_inset {
                    self.order.push(row);
                    self.inset += 1;
                }
            }
        }
    }

    /// Writes the order, and for a take the segments of `set` at the instant `t_s`, for the next submission.
    pub(in crate::gpu) fn upload(&self, gpu: &Gpu, set: &GaussianSet, t_s: f64, duration_s: f64) {
        gpu.queue.write_buffer(&self.order_buffer, 0, bytemuck::cast_slice(&self.order));
        let Some(buffer) = &self.slots else { return };
        let (mut slots, mut end) = ([Slot::default(); SLOTS as usize], 0);
        for (number, segment, t) in set.at(t_s, duration_s) {
            slots[number] = segment.uniform(t);
            end = number + 1;
        }
        gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&slots[..end]));
    }

    /// Number of rows of `part`.
    pub(in crate::gpu) fn count(&self, part: DrawnPart) -> u32 {
        match part {
            DrawnPart::All => self.all,
            DrawnPart::Inset => self.inset,
        }
    }

    /// The batch of quads in the order buffer that `part` starts with.
    pub(in crate::gpu) fn first_batch(&self, part: DrawnPart) -> u32 {
        match part {
            DrawnPart::All => 0,
            DrawnPart::Inset => self.all.div_ceil(BATCH),
        }
    }

    /// The rows of `part` in the order buffer.
    pub(in crate::gpu) fn first(&self, part: DrawnPart) -> usize {
        (self.first_batch(part) * BATCH) as usize
    }

    /// The rows of `part`, back to front.
    pub(in crate::gpu) fn rows(&self, part: DrawnPart) -> &[u32] {
        let rows = self.order.get(self.first(part)..).unwrap_or_default();
        &rows[..self.count(part) as usize]
    }
}
