//! Stage `evaluate`: the buffers of packed Gaussians. The arithmetic is in evaluate.wgsl, the format of the
//! records in [`super::super::pack`].

use std::mem::size_of;

use codec::Field;
use program::Fault;
use shaders::layout::{Gaussian, Ranges};
use shaders::{Features, GAUSSIANS, MOTION, ORDER, RANGES, SH, sh_words};

use crate::gpu::device::Gpu;
use crate::gpu::pack::Packed;

/// The packed Gaussians of a set in GPU memory.
pub(in crate::gpu) struct Buffers {
    pub(in crate::gpu) features: Features,
    ranges: wgpu::Buffer,
    gaussians: wgpu::Buffer,
    motion: Option<wgpu::Buffer>,
    sh: Option<wgpu::Buffer>,
}

impl Buffers {
    /// Checks that the records of a set fit the storage buffers of the device.
    ///
    /// # Errors
    /// [`Fault::Device`] with both sizes.
    pub(in crate::gpu) fn check_size(
        gpu: &Gpu,
        static_field: &Field,
        dynamic_field: &Field,
    ) -> Result<(), Fault> {
        let sh = sh_words(static_field.sh_degree.max(dynamic_field.sh_degree)) * size_of::<u32>();
        let per_row = size_of::<Gaussian>().max(sh) as u64;
        let bytes = per_row * (static_field.len() + dynamic_field.len()) as u64;
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
            ranges: gpu.buffer("ranges of the clip", ranges, wgpu::BufferUsages::UNIFORM)?,
            gaussians: gpu.buffer("the clip", bytemuck::cast_slice(gaussians), storage)?,
            motion: words("the clip's motion", &packed.motion)?,
            sh: words("the clip's colours", &packed.sh)?,
        })
    }

    /// GPU memory in bytes.
    pub(in crate::gpu) fn bytes(&self) -> u64 {
        let optional = self.motion.iter().chain(&self.sh).map(wgpu::Buffer::size).sum::<u64>();
        self.ranges.size() + self.gaussians.size() + optional
    }

    /// Layout of bind group 1 for the features of the set.
    pub(in crate::gpu) fn layout(&self, gpu: &Gpu) -> wgpu::BindGroupLayout {
        let storage = wgpu::BufferBindingType::Storage { read_only: true };
        let mut entries = vec![
            entry(RANGES, wgpu::BufferBindingType::Uniform, size_of::<Ranges>()),
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

    /// Bind group 1 with the buffers and the sorted rows.
    pub(in crate::gpu) fn bind(
        &self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        order: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let bind = |binding, buffer: &wgpu::Buffer| (binding, buffer.clone());
        let mut bound =
            vec![bind(RANGES, &self.ranges), bind(GAUSSIANS, &self.gaussians), bind(ORDER, order)];
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
