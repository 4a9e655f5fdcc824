//! Stage `evaluate`: the buffers of packed Gaussians. The arithmetic is in evaluate.wgsl, the format of the
//! records in [`super::super::pack`].

use std::mem::size_of;

use codec::LayerEnd;
use program::Fault;
use shaders::layout::{Gaussian, Ranges, Slot};
use shaders::{Features, GAUSSIANS, MOTION, Motion, ORDER, RANGES, SH, SLOTS, sh_words};

use crate::gpu::device::Gpu;
use crate::gpu::pack::Packed;

/// The packed Gaussians of a set in GPU memory.
#[derive(Clone)]
pub(in crate::gpu) struct Buffers {
    pub(in crate::gpu) features: Features,
    /// Number of rows that they hold.
    pub(in crate::gpu) rows: usize,
    /// Ranges of the only segment. The ranges of several change from frame to frame and are the renderer's.
    ranges: Option<wgpu::Buffer>,
    gaussians: wgpu::Buffer,
    motion: Option<wgpu::Buffer>,
    sh: Option<wgpu::Buffer>,
}

impl Buffers {
    /// Buffers of `room.total()` rows with `features`; the last `room.dynamic_count` rows have room for motion. Where
    /// several segments are drawn at once, every row has: a segment then needs a range of rows and nothing else.
    ///
    /// # Errors
    /// [`Fault::Device`] if they do not fit the storage buffers of the device, with both sizes, or there is not enough
    /// memory.
    pub(in crate::gpu) fn new(
        gpu: &Gpu,
        features: Features,
        room: LayerEnd,
        motion_units: [f32; 3],
    ) -> Result<Buffers, Fault> {
        let rows = room.total();
        let largest = size_of::<Gaussian>().max(sh_bytes(features)) as u64 * rows as u64;
        if largest > gpu.caps.max_buffer_bytes {
            return Err(Fault::Device(format!(
                "the clip takes a buffer of {} MiB, and {} has at most {} MiB: package it with a smaller --budget",
                largest >> 20,
                gpu.adapter_name,
                gpu.caps.max_buffer_bytes >> 20,
            )));
        }
        let motion_rows = if features.segmented { rows } else { room.dynamic_count };
        // The shaders count rows in 32 bits, and the buffers are no larger.
        let ranges = Ranges { motion_units, first_dynamic: room.static_count as u32 };
        let ranges = (!features.segmented)
            .then(|| {
                gpu.buffer("ranges of the clip", bytemuck::bytes_of(&ranges), wgpu::BufferUsages::UNIFORM)
            })
            .transpose()?;
        // A binding must not be empty, even if nothing is drawn from it.
        let buffer = |label: &str, row_bytes: usize, rows: usize| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            gpu.empty_buffer(label, (row_bytes * rows.max(1)) as u64, usage)
        };
        let optional = |label, row_bytes, rows| (row_bytes > 0).then(|| buffer(label, row_bytes, rows));
        gpu.allocate("the clip", || Buffers {
            features,
            rows,
            ranges,
            gaussians: buffer("Gaussians", size_of::<Gaussian>(), rows),
            motion: optional("motion", motion_bytes(features), motion_rows),
            sh: optional("colours", sh_bytes(features), rows),
        })
    }

    /// Writes, for the next submission, at most `budget` bytes of `packed` from byte `start` of its columns, one after
    /// the other. The clip or segment that it belongs to has its static rows from `first` on, and its dynamic rows
    /// `first_dynamic` further. Returns the number of bytes, 0 at the end.
    pub(in crate::gpu) fn write(
        &self,
        gpu: &Gpu,
        packed: &Packed,
        [first, first_dynamic]: [usize; 2],
        start: usize,
        budget: usize,
    ) -> usize {
        let static_row = first + packed.before.static_count;
        let dynamic_row = first + first_dynamic + packed.before.dynamic_count;
        // The only segment has no room for the motion of static rows.
        let motion_row = if self.features.segmented { dynamic_row } else { packed.before.dynamic_count };
        let gaussians = packed.gaussians.split_at(packed.static_count);
        let sh = packed.sh.split_at(packed.static_count * sh_words(self.features.sh_degree));
        let columns: [(_, &[u8], _); 5] = [
            (Some(&self.gaussians), bytemuck::cast_slice(gaussians.0), static_row * size_of::<Gaussian>()),
            (Some(&self.gaussians), bytemuck::cast_slice(gaussians.1), dynamic_row * size_of::<Gaussian>()),
            (
                self.motion.as_ref(),
                bytemuck::cast_slice(&packed.motion),
                motion_row * motion_bytes(self.features),
            ),
            (self.sh.as_ref(), bytemuck::cast_slice(sh.0), static_row * sh_bytes(self.features)),
            (self.sh.as_ref(), bytemuck::cast_slice(sh.1), dynamic_row * sh_bytes(self.features)),
        ];
        // Writes are multiples of a word.
        let budget = budget / size_of::<u32>() * size_of::<u32>();
        let (mut skipped, mut written) = (start, 0);
        for (buffer, bytes, place) in columns {
            let Some(buffer) = buffer else { continue };
            let begin = skipped.min(bytes.len());
            skipped -= begin;
            let piece = &bytes[begin..bytes.len().min(begin.saturating_add(budget - written))];
            if !piece.is_empty() {
                gpu.queue.write_buffer(buffer, (place + begin) as u64, piece);
                written += piece.len();
            }
        }
        written
    }

    /// GPU memory in bytes.
    pub(in crate::gpu) fn bytes(&self) -> u64 {
        let optional = self.ranges.iter().chain(&self.motion).chain(&self.sh);
        self.gaussians.size() + optional.map(wgpu::Buffer::size).sum::<u64>()
    }

    /// Layout of bind group 1 for the features of the set.
    pub(in crate::gpu) fn layout(&self, gpu: &Gpu) -> wgpu::BindGroupLayout {
        let storage = wgpu::BufferBindingType::Storage { read_only: true };
        let ranges = match self.features.segmented {
            true => SLOTS_BYTES,
            false => size_of::<Ranges>(),
        };
        let mut entries = vec![
            entry(RANGES, wgpu::BufferBindingType::Uniform, ranges),
            entry(GAUSSIANS, storage, size_of::<Gaussian>()),
            entry(ORDER, storage, size_of::<u32>()),
        ];
        entries.extend(self.motion.as_ref().map(|_| entry(MOTION, storage, size_of::<u32>())));
        entries.extend(self.sh.as_ref().map(|_| entry(SH, storage, size_of::<u32>())));
        gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("part"),
            entries: &entries,
        })
    }

    /// Bind group 1 with the buffers, the slots if there are several segments, and the sorted rows.
    pub(in crate::gpu) fn bind(
        &self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        slots: Option<&wgpu::Buffer>,
        order: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let bind = |binding, buffer: &wgpu::Buffer| (binding, buffer.clone());
        let ranges = self.ranges.as_ref().or(slots).expect("it has ranges or slots");
        let mut bound = vec![bind(RANGES, ranges), bind(GAUSSIANS, &self.gaussians), bind(ORDER, order)];
        bound.extend(self.motion.as_ref().map(|buffer| bind(MOTION, buffer)));
        bound.extend(self.sh.as_ref().map(|buffer| bind(SH, buffer)));
        let entries: Vec<_> = bound
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("part"),
            layout,
            entries: &entries,
        })
    }
}

/// Size in bytes of the slots of a take.
pub(in crate::gpu) const SLOTS_BYTES: usize = SLOTS as usize * size_of::<Slot>();

/// Bytes of spherical harmonics per row.
fn sh_bytes(features: Features) -> usize {
    size_of::<u32>() * sh_words(features.sh_degree)
}

/// Bytes of temporal data per dynamic row.
fn motion_bytes(features: Features) -> usize {
    size_of::<u32>() * features.motion.map_or(0, Motion::words)
}

fn entry(binding: u32, ty: wgpu::BufferBindingType, min_bytes: usize) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: wgpu::BufferSize::new(min_bytes as u64),
        },
        count: None,
    }
}
