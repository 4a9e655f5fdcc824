//! [`Pipelines`]: the pipelines of a device. Each is compiled once: the pipelines of a clip serve the next clips, and
//! what the driver made of them serves the next run.
//!
//! A pipeline is named by its source, its target and its views: the source declares the bindings and holds the
//! constants. wgpu and the driver reject what another device or driver left.

#![allow(unsafe_code, reason = "drivers trust what they saved")]

use std::collections::HashMap;
use std::num::NonZeroU32;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};

use shaders::{FRAGMENT_ENTRY, VERTEX_ENTRY};

use crate::worker::join_in_time;

/// The parts of a pipeline that draws without vertex buffers.
pub(in crate::gpu) struct PipelineParts<'a> {
    /// Name for messages.
    pub(in crate::gpu) label: &'static str,
    /// WGSL with both entry points.
    pub(in crate::gpu) source: String,
    /// Layouts of the bindings that `source` declares.
    pub(in crate::gpu) groups: &'a [Option<&'a wgpu::BindGroupLayout>],
    pub(in crate::gpu) target: wgpu::ColorTargetState,
    /// Number of eyes of a pass.
    pub(in crate::gpu) views: u32,
}

impl PipelineParts<'_> {
    /// The key of the pipeline.
    pub(super) fn key(&self) -> PipelineKey {
        PipelineKey {
            source: self.source.clone(),
            target: self.target.clone(),
            multiview_mask: multiview_mask(self.views),
        }
    }
}

/// Where compiled pipelines are kept between runs. Failures are for the store to log.
pub trait PipelineStore: Send + Sync {
    /// The bytes saved last under `name`; `None` if there are none, or they are damaged.
    fn load(&self, name: &str) -> Option<Vec<u8>>;

    /// Replaces the bytes under `name`. Called from a thread of its own.
    fn save(&self, name: &str, bytes: &[u8]);
}

/// What tells a pipeline from others.
#[derive(PartialEq, Eq, Hash)]
pub(super) struct PipelineKey {
    source: String,
    target: wgpu::ColorTargetState,
    multiview_mask: Option<NonZeroU32>,
}

/// The pipelines of a device.
#[derive(Default)]
pub(super) struct Pipelines {
    built: Mutex<HashMap<PipelineKey, wgpu::RenderPipeline>>,
    compiled: AtomicU64,
    kept: Option<KeptPipelines>,
}

/// The driver's cache of compiled pipelines, and its store.
struct KeptPipelines {
    cache: wgpu::PipelineCache,
    name: String,
    store: Arc<dyn PipelineStore>,
    /// Whether a pipeline was built since the last save.
    changed: AtomicBool,
    saving: Mutex<Option<JoinHandle<()>>>,
}

impl Pipelines {
    /// The pipeline of `key`, if it was built.
    pub(super) fn get(&self, key: &PipelineKey) -> Option<wgpu::RenderPipeline> {
        lock(&self.built).get(key).cloned()
    }

    /// Adds a valid pipeline; returns another thread's pipeline, if that thread was faster.
    pub(super) fn add(&self, key: PipelineKey, pipeline: wgpu::RenderPipeline) -> wgpu::RenderPipeline {
        if let Some(kept) = &self.kept {
            kept.changed.store(true, Ordering::Release);
        }
        lock(&self.built).entry(key).or_insert(pipeline).clone()
    }

    /// Drops all pipelines.
    pub(super) fn clear(&self) {
        lock(&self.built).clear();
    }

    /// Has the driver keep what is compiled on `device` from now on in `store`, under `name`.
    pub(super) fn keep(&mut self, device: &wgpu::Device, name: String, store: Arc<dyn PipelineStore>) {
        let cache = store.load(&name).and_then(|bytes| pipeline_cache(device, Some(&bytes)));
        let Some(cache) = cache.or_else(|| pipeline_cache(device, None)) else { return };
        let (changed, saving) = (AtomicBool::new(false), Mutex::default());
        self.kept = Some(KeptPipelines { cache, name, store, changed, saving });
    }

    /// Saves in the background what was compiled since the last time.
    pub(super) fn save(&self) {
        if let Some(kept) = &self.kept {
            kept.save();
        }
    }

    /// Number of pipelines compiled so far.
    pub(super) fn compiled(&self) -> u64 {
        self.compiled.load(Ordering::Relaxed)
    }

    /// Compiles the pipeline of `key` with bindings of `groups`.
    pub(super) fn compile(
        &self,
        device: &wgpu::Device,
        label: &'static str,
        key: &PipelineKey,
        groups: &[Option<&wgpu::BindGroupLayout>],
    ) -> wgpu::RenderPipeline {
        self.compiled.fetch_add(1, Ordering::Relaxed);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(key.source.as_str().into()),
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: groups,
            immediate_size: 0,
        });
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(VERTEX_ENTRY),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(FRAGMENT_ENTRY),
                compilation_options: Default::default(),
                targets: &[Some(key.target.clone())],
            }),
            multiview_mask: key.multiview_mask,
            cache: self.kept.as_ref().map(|kept| &kept.cache),
        })
    }
}

/// A cache of the driver that starts with the `bytes` of an earlier one; `None` if the device rejects them.
fn pipeline_cache(device: &wgpu::Device, bytes: Option<&[u8]>) -> Option<wgpu::PipelineCache> {
    let memory = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let validity = device.push_error_scope(wgpu::ErrorFilter::Validation);
    let descriptor = wgpu::PipelineCacheDescriptor { label: Some("pipelines"), data: bytes, fallback: true };
    // SAFETY: the store returns what was saved, undamaged, and wgpu checks that it is of this driver.
    let cache = unsafe { device.create_pipeline_cache(&descriptor) };
    let errors = [pollster::block_on(validity.pop()), pollster::block_on(memory.pop())];
    errors.iter().flatten().for_each(|error| log::debug!("pipelines of an earlier run: {error}"));
    errors.iter().all(Option::is_none).then_some(cache)
}

impl KeptPipelines {
    fn save(&self) {
        if !self.changed.load(Ordering::Acquire) {
            return;
        }
        let mut saving = lock(&self.saving);
        if saving.as_ref().is_some_and(|thread| !thread.is_finished()) {
            return;
        }
        self.changed.store(false, Ordering::Release);
        let (cache, name, store) = (self.cache.clone(), self.name.clone(), self.store.clone());
        let save = move || {
            if let Some(bytes) = cache.get_data() {
                store.save(&name, &bytes);
            }
        };
        let thread = Builder::new().name("pipelines".into()).spawn(save);
        *saving = thread.inspect_err(|error| log::debug!("pipelines are not kept: {error}")).ok();
    }
}

impl Drop for KeptPipelines {
    fn drop(&mut self) {
        if let Some(thread) = lock(&self.saving).take() {
            join_in_time(thread);
        }
    }
}

/// Layer mask of a pass of `views` eyes; `None` for one eye.
pub(in crate::gpu) fn multiview_mask(views: u32) -> Option<NonZeroU32> {
    if views > 1 { NonZeroU32::new((1 << views) - 1) } else { None }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
