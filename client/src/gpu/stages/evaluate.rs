//! Stage `evaluate`: the buffers of packed Gaussians. The arithmetic is in evaluate.wgsl, the format of the
//! records in [`super::super::pack`].

use std::mem::size_of;

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
    /// Ranges of a clip; those of a take change from frame to frame and are the renderer's.
    ranges: Option<wgpu::Buffer>,
    gaussians: wgpu::Buffer,
    motion: Option<wgpu::Buffer>,
    sh: Option<wgpu::Buffer>,
}

impl Buffers {
    /// Checks that the records of `rows` Gaussians with `features` fit the storage buffers of the device.
    ///
    /// # Errors
    /// [`Fault::Device`] with both sizes.
    pub(in crate::gpu) fn check_size(gpu: &Gpu, features: Features, rows: usize) -> Result<(), Fault> {
        let bytes = size_of::<Gaussian>().max(sh_bytes(features)) as u64 * rows as u64;
        if bytes <= gpu.caps.max_buffer_bytes {
            return Ok(());
        }
        Err(Fault::Device(format!(
            "the clip takes a buffer of {} MiB, and {} has at most {} MiB: package it with a smaller --budget",
            bytes >> 20,
            gpu.adapter_name,
            gpu.caps.max_buffer_bytes >> 20,
        )))
    }

    /// Uploads packed Gaussians.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub(in crate::gpu) fn upload(gpu: &Gpu, packed: &Packed) -> Result<Buffers, Fault> {
        let storage = wgpu::BufferUsages::STORAGE;
        let words = |label: &str, words: &[u32]| match words {
            [] => Ok(None),
            words => gpu.buffer(label, bytemuck::cast_slice(words), storage).map(Some),
        };
        // A binding must not be empty, even if nothing is drawn from it.
        let nothing = [Gaussian::default()];
        let gaussians = if packed.gaussians.is_empty() { &nothing[..] } else { &packed.gaussians };
        let ranges = bytemuck::bytes_of(&packed.ranges);
        Ok(Buffers {
            features: packed.features,
            rows: packed.gaussians.len(),
            ranges: Some(gpu.buffer("ranges of the clip", ranges, wgpu::BufferUsages::UNIFORM)?),
            gaussians: gpu.buffer("the clip", bytemuck::cast_slice(gaussians), storage)?,
            motion: words("the clip's motion", &packed.motion)?,
            sh: words("the clip's colours", &packed.sh)?,
        })
    }

    /// Room for `rows` Gaussians of segments with `features`. Each row has room for motion, whether it is dynamic or
    /// not: so a range of rows is all that a segment needs.
    ///
    /// # Errors
    /// As for [`Buffers::check_size`], and [`Fault::Device`] if there is not enough memory.
    pub(in crate::gpu) fn with_capacity(
        gpu: &Gpu,
        features: Features,
        rows: usize,
    ) -> Result<Buffers, Fault> {
        Buffers::check_size(gpu, features, rows)?;
        let column = |label, row_bytes: usize| {
            (row_bytes > 0).then(|| {
                gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    size: (row_bytes * rows.max(1)) as u64,
                    usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            })
        };
        gpu.allocate("the take", || {
            Some(Buffers {
                features,
                rows,
                ranges: None,
                gaussians: column("the take", size_of::<Gaussian>())?,
                motion: column("the take's motion", motion_bytes(features)),
                sh: column("the take's colours", sh_bytes(features)),
            })
        })
        .map(|buffers| buffers.expect("a record has bytes"))
    }

    /// Writes, for the next submission, at most `budget` bytes of `packed` from byte `start` of its columns, one after
    /// the other, to the rows from `first` on. Returns the number of bytes, 0 at the end.
    pub(in crate::gpu) fn write(
        &self,
        gpu: &Gpu,
        packed: &Packed,
        first: usize,
        start: usize,
        budget: usize,
    ) -> usize {
        let first_dynamic = first + packed.ranges.first_dynamic as usize;
        let columns: [(_, &[u8], _); 3] = [
            (Some(&self.gaussians), bytemuck::cast_slice(&packed.gaussians), first * size_of::<Gaussian>()),
            (
                self.motion.as_ref(),
                bytemuck::cast_slice(&packed.motion),
                first_dynamic * motion_bytes(self.features),
            ),
            (self.sh.as_ref(), bytemuck::cast_slice(&packed.sh), first * sh_bytes(self.features)),
        ];
        // Writes are multiples of a word.
        let budget = budget / size_of::<u32>() * size_of::<u32>();
        let (mut skipped, mut written) = (start, 0);
        for (buffer, bytes, place) in columns {
            let Some(buffer) = buffer else { continue };
            let begin = skipped.min(bytes.len());
            skipped -= begin;
            let piece = &bytes[begin..bytes.len().min(begin + budget - written)];
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

    /// Bind group 1 with the buffers, the slots if it is a take, and the sorted rows.
    pub(in crate::gpu) fn bind(
        &self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        slots: Option<&wgpu::Buffer>,
        order: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let bind = |binding, buffer: &wgpu::Buffer| (binding, buffer.clone());
        let ranges = self.ranges.as_ref().or(slots).expect("a clip has ranges, a take slots");
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
