//! Stage `count`: counts the fragments of every quad, exactly and deterministically.

use std::collections::HashSet;

use program::Fault;
use shaders::{COUNTS, Purpose, filter_variance};

use super::clip::GpuClip;
use super::drawn_set::{DrawnPart, DrawnSet};
use super::quads::Quads;
use super::splat::{self, PassUniforms};
use crate::gpu::counts::Coverage;
use crate::gpu::device::Gpu;
use crate::gpu::frame_views::FrameViews;
use crate::gpu::settings::Cutoff;
use crate::view::View;

/// Format of the target of counting passes: a target must be bound, but nothing is written.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// Pipelines and memory for counting.
pub(in crate::gpu) struct Counter {
    uniforms: PassUniforms,
    quads: Quads,
    sets: Vec<CountedSet>,
}

struct CountedSet {
    pipeline: wgpu::RenderPipeline,
    counts: wgpu::Buffer,
    readback: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Counter {
    /// For `sets` of frames that may be `foveated`.
    ///
    /// # Errors
    /// As for [`Gpu::pipeline`].
    pub(in crate::gpu) fn new(
        gpu: &Gpu,
        sets: &[DrawnSet],
        quads: Quads,
        foveated: bool,
    ) -> Result<Counter, Fault> {
        let pass_layout = PassUniforms::layout(gpu, 1);
        let counts_layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("counts"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: COUNTS,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: false },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let counted = |set: &DrawnSet| {
            let groups = [Some(&pass_layout), Some(&set.layout), Some(&counts_layout)];
            let target = wgpu::ColorTargetState {
                format: FORMAT,
                blend: None,
                write_mask: wgpu::ColorWrites::empty(),
            };
            let size = set.order_buffer.size();
            let buffer = |usage| gpu.empty_buffer("counts", size, usage);
            let counts = buffer(
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            );
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("counts"),
                layout: &counts_layout,
                entries: &[wgpu::BindGroupEntry { binding: COUNTS, resource: counts.as_entire_binding() }],
            });
            Ok(CountedSet {
                pipeline: splat::pipeline(gpu, set.features, Purpose::Count { foveated }, &groups, target)?,
                counts,
                readback: buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
                group,
            })
        };
        Ok(Counter {
            uniforms: PassUniforms::new(gpu, &pass_layout, 1),
            quads,
            sets: sets.iter().map(counted).collect::<Result<_, Fault>>()?,
        })
    }

    /// Counts the fragments of the sorted rows of `sets` in `views`; `clip` is what they show.
    pub(in crate::gpu) fn count(
        &self,
        gpu: &Gpu,
        sets: &[DrawnSet],
        t: f64,
        cutoff: Cutoff,
        views: &FrameViews,
        clip: &GpuClip,
    ) -> Result<Coverage, Fault> {
        let mut encoder = gpu.encoder();
        self.sets.iter().for_each(|set| encoder.clear_buffer(&set.counts, 0, None));
        gpu.submit(encoder);
        let count = |view: &View, part, blur| {
            self.uniforms.write(gpu, t, cutoff, std::slice::from_ref(view), blur, clip);
            self.count_view(gpu, sets, part, view)
        };
        for view in views.drawn() {
            count(view, DrawnPart::All, views.blur())?;
        }
        for division in views.divisions().unwrap_or_default() {
            count(&division.inset, DrawnPart::Inset, filter_variance(false))?;
        }
        let mut encoder = gpu.encoder();
        for set in &self.sets {
            encoder.copy_buffer_to_buffer(&set.counts, 0, &set.readback, 0, None);
        }
        gpu.submit(encoder);

        let mut coverage = Coverage::default();
        for (set, counted) in sets.iter().zip(&self.sets) {
            counted.readback.slice(..).map_async(wgpu::MapMode::Read, |_| {});
            gpu.wait()?;
            let mapped = counted.readback.slice(..).get_mapped_range().map_err(|error| {
                Fault::Device(format!("graphics device {}: {error}: start again", gpu.adapter_name))
            })?;
            let counts: &[u32] = bytemuck::cast_slice(&mapped);
            let mut drawn = HashSet::new();
            for part in [DrawnPart::All, DrawnPart::Inset] {
                for (&row, &fragments) in
                    set.rows(part).iter().zip(counts.get(set.first(part)..).unwrap_or_default())
                {
                    coverage.fragments += u64::from(fragments);
                    if fragments > 0 {
                        drawn.insert(row);
                    }
                }
            }
            coverage.drawn += drawn.len() as u32;
            drop(mapped);
            counted.readback.unmap();
        }
        Ok(coverage)
    }

    fn count_view(&self, gpu: &Gpu, sets: &[DrawnSet], part: DrawnPart, view: &View) -> Result<(), Fault> {
        let texture = gpu.allocate("counting", || {
            gpu.image("count", view.size, 1, FORMAT, wgpu::TextureUsages::empty())
        })?;
        let target = texture.create_view(&Default::default());
        let mut encoder = gpu.encoder();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("count"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Discard,
                },
            })],
            ..Default::default()
        });
        pass.set_bind_group(0, &self.uniforms.group, &[]);
        for (set, counted) in sets.iter().zip(&self.sets) {
            pass.set_pipeline(&counted.pipeline);
            pass.set_bind_group(1, &set.group, &[]);
            pass.set_bind_group(2, &counted.group, &[]);
            self.quads.draw(&mut pass, set.first_batch(part), set.count(part));
        }
        drop(pass);
        gpu.submit(encoder);
        Ok(())
    }
}
