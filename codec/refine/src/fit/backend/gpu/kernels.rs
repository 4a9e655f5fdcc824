//! [`Kernels`]: the compiled stages, and [`Dispatch`], a kernel with its buffers.

use std::collections::HashMap;

use shaders::fit::{Columns, GROUP, SUM_GROUP, Stage, compose};

use super::buffers::{PARTS_MAX, tiles};
use super::device::{Buffer, Device};

/// Largest number of groups of a dispatch along an axis.
const GROUPS_MAX: u64 = 65_535;

/// Largest number of groups of threads that go on until all is done: enough for any device.
const STRIDED_MAX: u64 = 1 << 14;

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
    /// So many or fewer: a thread goes on until all is done.
    Strided(u64),
    /// One group per block of a series of this length.
    Blocks(u32),
    /// One group per part of a series to sort, which has at most this length.
    Parts(u32),
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
        for stage in Stage::ALL {
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
            Threads::Strided(count) => groups(count.min(STRIDED_MAX * u64::from(GROUP))),
            Threads::Blocks(length) => split(length.div_ceil(SUM_GROUP).into()),
            Threads::Parts(length) => [length.div_ceil(SUM_GROUP).clamp(1, PARTS_MAX), 1],
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
    split(threads.div_ceil(u64::from(GROUP)))
}

/// So many groups, or a few more, along either axis.
fn split(groups: u64) -> [u32; 2] {
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
