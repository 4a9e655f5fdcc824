//! [`Quads`]: batched quads of two triangles each.

use program::Fault;
use shaders::{BATCH, CORNERS};

use crate::gpu::device::Gpu;

/// The triangles of a quad, by its corners.
const TRIANGLES: [u32; 6] = [0, 1, 2, 2, 1, 3];

/// Index buffer of [`BATCH`] quads.
#[derive(Clone)]
pub(in crate::gpu) struct Quads {
    indices: wgpu::Buffer,
}

impl Quads {
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub(in crate::gpu) fn new(gpu: &Gpu) -> Result<Quads, Fault> {
        let corners = (0..BATCH).flat_map(|quad| TRIANGLES.map(|corner| quad * CORNERS + corner));
        let corners: Vec<u16> = corners.map(|corner| corner as u16).collect();
        let indices = gpu.buffer("quads", bytemuck::cast_slice(&corners), wgpu::BufferUsages::INDEX)?;
        Ok(Quads { indices })
    }

    /// Draws `count` quads with the present pipeline, from the batch `first` of the draw order on.
    pub(in crate::gpu) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, first: u32, count: u32) {
        let (end, rest) = (first + count / BATCH, count % BATCH);
        let corners = |quads| quads * TRIANGLES.len() as u32;
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.draw_indexed(0..corners(BATCH), 0, first..end);
        pass.draw_indexed(0..corners(rest), 0, end..end + 1);
    }
}

// Indices have 16 bits.
const _: () = assert!(BATCH * CORNERS <= 1 << 16);
