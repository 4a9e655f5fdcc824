//! [`Kernels`]: the compiled stages, and [`Dispatch`], a kernel with its buffers.

use std::collections::HashMap;

use shaders::fit::{Columns, GROUP, Stage, compose};

use super::buffers::tiles;
use super::device::{Buffer, Device};

/// Largest number of groups of a dispatch along an axis.
const GROUPS_MAX: u64 = 65_535;

/// The kernels for the columns of a scene, by name.
pub(super) struct Kernels {
    pub(super) columns: Columns,
    pipelines: HashMap<&'static str, wgpu::ComputePipeline>,
}

/// A kernel with its buffers and its number of threads.
pub(super) struct Dispatch {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    threads: Threads,
}

/// The number of threads of a kernel.
#[derive(Clone, Copy)]
pub(super) enum Threads {
    /// At least this many.
    Count(u64),
    /// One per pixel of the image.
    Pixels,
    /// One group per tile of the image.
    Tiles,
    /// One per tile of the image, and one more.
    TileStarts,
    /// A single group.
    Group,
}

impl Kernels {
    /// Compiles all stages.
    pub(super) fn new(device: &Device, columns: Columns) -> Kernels {
        let mut pipelines = HashMap::new();
        let is_used = |stage: &Stage| columns.learns_cameras || *stage != Stage::Camera;
        for stage in Stage::ALL.into_iter().filter(is_used) {
            let source = compose(stage, columns);
            let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: None,
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            for kernel in stage.kernels() {
                let descriptor = wgpu::ComputePipelineDescriptor {
                    label: Some(kernel),
                    layout: None,
                    module: &module,
                    entry_point: Some(kernel),
                    // Kernels write workgroup memory before they read it.
                    compilation_options: wgpu::PipelineCompilationOptions {
                        zero_initialize_workgroup_memory: false,
                        ..Default::default()
                    },
                    cache: None,
                };
                pipelines.insert(*kernel, device.device.create_compute_pipeline(&descriptor));
            }
        }
        Kernels { columns, pipelines }
    }

    /// Binds the buffers of a kernel.
    pub(super) fn dispatch(
        &self,
        device: &Device,
        kernel: &'static str,
        buffers: &[(u32, &Buffer)],
        threads: Threads,
    ) -> Dispatch {
        let pipeline = self.pipelines[kernel].clone();
        let entries: Vec<_> = buffers
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: buffer.raw.as_entire_binding(),
            })
            .collect();
        let group = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Dispatch { pipeline, group, threads }
    }
}

impl Dispatch {
    /// Records the dispatch for an image of `size`.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass, size: [u32; 2]) {
        let [across, down] = tiles(size);
        let [x, y] = match self.threads {
            Threads::Count(count) => groups(count),
            Threads::Pixels => groups(u64::from(size[0]) * u64::from(size[1])),
            Threads::Tiles => [across, down],
            Threads::TileStarts => groups(u64::from(across) * u64::from(down) + 1),
            Threads::Group => [1, 1],
        };
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }
}

/// Groups along either axis for at least this many threads.
fn groups(threads: u64) -> [u32; 2] {
    let groups = threads.div_ceil(u64::from(GROUP));
    let down = groups.div_ceil(GROUPS_MAX).max(1);
    [groups.div_ceil(down), down].map(|side| u32::try_from(side).unwrap_or(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_cover_the_threads_within_the_limit() {
        assert_eq!((groups(0), groups(1), groups(65)), ([0, 1], [1, 1], [2, 1]));
        let most = GROUPS_MAX * u64::from(GROUP);
        assert_eq!(groups(most), [65_535, 1]);
        let [x, y] = groups(5 * most + 7);
        assert!(u64::from(x * y) * u64::from(GROUP) >= 5 * most + 7 && u64::from(x) <= GROUPS_MAX && y == 6);
    }
}
