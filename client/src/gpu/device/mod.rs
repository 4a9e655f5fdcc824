//! [`Gpu`]: the graphics device and its capabilities.
//!
//! [`DeviceRequest`] chooses features and limits from the adapter's. A headset's runtime opens the
//! device itself, see [`vulkan`].

mod loss;
mod pipelines;
#[cfg(feature = "xr")]
pub(crate) mod vulkan;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
#[cfg(any(feature = "window", feature = "xr"))]
use std::sync::{Mutex, PoisonError};
use std::thread::ThreadId;

use glam::UVec2;
use program::Fault;

pub(super) use loss::{Fragile, Loss};
pub use pipelines::PipelineStore;
use pipelines::Pipelines;
pub(super) use pipelines::{PipelineParts, multiview_mask};

/// Default log filter, without `RUST_LOG`: messages of drivers and loaders are off.
pub const LOG_FILTER: &str = "error,wgpu_hal=off";

/// Message once another device has replaced a lost one.
pub(crate) const DEVICE_REPLACED: &str =
    "the graphics device stopped working: the clip goes on with another one";

/// Frames that a device must have drawn before its loss to be replaced. A device that is lost at once would
/// be lost again and again.
const LASTING_FRAMES: u64 = 50;

/// Optional capabilities and limits of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caps {
    /// Whether both eyes can be drawn in one pass. Clear it to draw them one after the other.
    pub multiview: bool,
    /// Whether the GPU has timestamps.
    pub timestamps: bool,
    /// Whether the fragment stage calculates in f16, for which the device must have it, see [`Gpu::has_f16`]. Off in a
    /// new device, until [`choose_f16`](super::choose_f16).
    pub f16: bool,
    /// Largest width and height of an image in pixels.
    pub max_image_side: u32,
    /// Largest storage buffer in bytes.
    pub max_buffer_bytes: u64,
}

/// The graphics device.
pub struct Gpu {
    /// Capabilities of the device.
    pub caps: Caps,
    /// Name of the adapter.
    pub adapter_name: String,
    /// Name and version of the driver.
    pub driver: String,
    #[cfg(feature = "window")]
    pub(crate) adapter: wgpu::Adapter,
    pub(crate) device: wgpu::Device,
    pub(super) queue: Fragile<wgpu::Queue>,
    instance: wgpu::Instance,
    pub(super) loss: Loss,
    pipelines: Pipelines,
    /// Whether the adapter is a processor, not a GPU.
    is_software: bool,
    /// Name for compiled pipelines of this device; `None` if its driver does not give them out.
    pipelines_name: Option<String>,
    /// The only thread that may submit work; `None` for any.
    submitter: Option<ThreadId>,
    waits: AtomicU64,
}

/// Features and limits to request from an adapter.
struct DeviceRequest {
    features: wgpu::Features,
    limits: wgpu::Limits,
}

impl DeviceRequest {
    /// Intersects the features and limits that the renderer uses with the features and limits of the adapter `info`.
    fn new(info: &wgpu::AdapterInfo, features: wgpu::Features, limits: &wgpu::Limits) -> DeviceRequest {
        let used = wgpu::Features::MULTIVIEW
            | wgpu::Features::TIMESTAMP_QUERY
            | wgpu::Features::PIPELINE_CACHE
            | wgpu::Features::SHADER_F16;
        let mut features = features & used;
        if !has_correct_multiview(info) {
            features.remove(wgpu::Features::MULTIVIEW);
        }
        let limits = wgpu::Limits {
            max_buffer_size: limits.max_buffer_size,
            max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
            max_texture_dimension_2d: limits.max_texture_dimension_2d,
            max_multiview_view_count: limits.max_multiview_view_count,
            ..wgpu::Limits::downlevel_defaults()
        };
        DeviceRequest { features, limits }
    }

    fn descriptor(&self) -> wgpu::DeviceDescriptor<'static> {
        wgpu::DeviceDescriptor {
            required_features: self.features,
            required_limits: self.limits.clone(),
            ..Default::default()
        }
    }
}

impl Gpu {
    /// Opens a device without a display.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is no driver, or no adapter meets the requirements.
    pub fn new_headless() -> Result<Gpu, Fault> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        Gpu::from_instance(&instance, None)
    }

    /// Opens the fastest device of `instance` that can present to `surface`, if one is given.
    ///
    /// # Errors
    /// As for [`Gpu::new_headless`].
    pub(crate) fn from_instance(
        instance: &wgpu::Instance,
        surface: Option<&wgpu::Surface<'_>>,
    ) -> Result<Gpu, Fault> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|error| {
            log::info!("{error}");
            Fault::Device(
                "no graphics device was found: install a Vulkan driver \
                 (Debian and Ubuntu: apt-get install mesa-vulkan-drivers)"
                    .into(),
            )
        })?;
        let info = adapter.get_info();
        let request = DeviceRequest::new(&info, adapter.features(), &adapter.limits());
        let opened = pollster::block_on(adapter.request_device(&request.descriptor())).map_err(|error| {
            Fault::Device(format!("graphics device {}: {error}: update its driver", info.name))
        })?;
        Ok(Gpu::opened(instance.clone(), adapter, &request, opened, None))
    }

    /// Wraps the device that was opened on `adapter` with `request`.
    fn opened(
        instance: wgpu::Instance,
        adapter: wgpu::Adapter,
        request: &DeviceRequest,
        (device, queue): (wgpu::Device, wgpu::Queue),
        submitter: Option<ThreadId>,
    ) -> Gpu {
        let info = adapter.get_info();
        let DeviceRequest { features, limits } = request;
        let loss = Loss::listen(&device);
        let keeps_pipelines = features.contains(wgpu::Features::PIPELINE_CACHE);
        Gpu {
            pipelines: Pipelines::default(),
            pipelines_name: keeps_pipelines.then(|| wgpu::util::pipeline_cache_key(&info)).flatten(),
            caps: Caps {
                multiview: features.contains(wgpu::Features::MULTIVIEW),
                timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
                f16: false,
                max_image_side: limits.max_texture_dimension_2d,
                max_buffer_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            },
            is_software: info.device_type == wgpu::DeviceType::Cpu,
            adapter_name: info.name,
            driver: format!("{} {}", info.driver, info.driver_info),
            #[cfg(feature = "window")]
            adapter,
            instance,
            queue: Fragile::new(queue, &loss),
            loss,
            device,
            submitter,
            waits: AtomicU64::new(0),
        }
    }

    /// A new command encoder.
    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Submits recorded work.
    ///
    /// # Panics
    /// If a headset's runtime shares the device and this is not the thread that opened it. The runtime
    /// uses the same queue, unsynchronised, within the calls of that thread.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) {
        let here = std::thread::current().id();
        assert!(
            self.submitter.is_none_or(|thread| thread == here),
            "only the thread that opened the device submits"
        );
        self.queue.submit([encoder.finish()]);
    }

    /// Blocks until all submitted work is done.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub fn wait(&self) -> Result<(), Fault> {
        self.waits.fetch_add(1, Ordering::Relaxed);
        self.loss.wait(&self.device).map_err(|why| self.lost_fault(&why))
    }

    /// Number of waits for the GPU so far.
    pub fn waits(&self) -> u64 {
        self.waits.load(Ordering::Relaxed)
    }

    /// Creates a resource and reports a lack of memory as an error. `purpose` names it in messages.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory, or the device was lost.
    ///
    /// # Panics
    /// If `create` is invalid, which is a defect of the program.
    pub(crate) fn allocate<T>(&self, purpose: &str, create: impl FnOnce() -> T) -> Result<T, Fault> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        // Objects made of a resource that could not be allocated are invalid, too.
        let validity = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let created = create();
        let invalid = pollster::block_on(validity.pop());
        let exhausted = pollster::block_on(memory.pop());
        if let Some(why) = self.loss.why() {
            return Err(self.lost_fault(why));
        }
        let name = &self.adapter_name;
        match (exhausted, invalid) {
            (None, None) => Ok(created),
            (Some(_), _) => Err(Fault::Device(format!(
                "graphics device {name}: not enough memory for {purpose}: close other programs"
            ))),
            (None, Some(error)) => panic!("{purpose}: {error}"),
        }
    }

    /// The pipeline of `parts`. One that the device has is not compiled again.
    ///
    /// # Errors
    /// As for [`Gpu::allocate`].
    pub(super) fn pipeline(&self, parts: &PipelineParts<'_>) -> Result<wgpu::RenderPipeline, Fault> {
        let key = parts.key();
        if let Some(pipeline) = self.pipelines.get(&key) {
            return Ok(pipeline);
        }
        // Only valid pipelines are kept. Two threads may compile the same one: nothing waits for a compiler.
        let compile = || self.pipelines.compile(&self.device, parts.label, &key, parts.groups);
        let pipeline = self.allocate(parts.label, compile)?;
        Ok(self.pipelines.add(key, pipeline))
    }

    /// Keeps what the driver compiles from now on in `store`, and starts with what is there, if the driver can. Failures
    /// cost nothing but the time to compile.
    pub fn keep_pipelines(&mut self, store: Arc<dyn PipelineStore>) {
        if let Some(name) = self.pipelines_name.clone() {
            self.pipelines.keep(&self.device, name, store);
        }
    }

    /// Drops the pipelines compiled so far. Those in use live on.
    pub(super) fn drop_pipelines(&self) {
        self.pipelines.clear();
    }

    /// Whether shaders can calculate in f16.
    pub fn has_f16(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F16)
    }

    /// Whether the adapter is a processor, not a GPU.
    pub(super) fn is_software(&self) -> bool {
        self.is_software
    }

    /// Number of pipelines of clips and foveation compiled so far.
    pub fn pipelines_compiled(&self) -> u64 {
        self.pipelines.compiled()
    }

    /// Saves, in the background, what was compiled since the last time. For after a frame: drivers may finish compiling
    /// within the first one.
    pub(super) fn save_pipelines(&self) {
        self.pipelines.save();
    }

    /// Creates a buffer with the content `bytes`, a multiple of four bytes.
    ///
    /// # Errors
    /// As for [`Gpu::allocate`].
    pub(crate) fn buffer(
        &self,
        purpose: &str,
        bytes: &[u8],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, Fault> {
        let buffer = self.allocate(purpose, || {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(purpose),
                size: bytes.len() as u64,
                usage,
                mapped_at_creation: true,
            })
        })?;
        match buffer.get_mapped_range_mut(..) {
            Ok(mut mapped) => mapped.copy_from_slice(bytes),
            Err(error) => return Err(self.lost_fault(self.loss.why().unwrap_or(&error.to_string()))),
        }
        buffer.unmap();
        Ok(buffer)
    }

    /// Creates a buffer of `size` bytes that the GPU or later writes fill, within [`Gpu::allocate`].
    pub(in crate::gpu) fn empty_buffer(
        &self,
        label: &str,
        size: u64,
        usage: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        self.device.create_buffer(&descriptor)
    }

    /// Creates an image of `size` pixels and `layers` layers to draw into, within [`Gpu::allocate`].
    pub(in crate::gpu) fn image(
        &self,
        label: &str,
        size: UVec2,
        layers: u32,
        format: wgpu::TextureFormat,
        further: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | further,
            view_formats: &[],
        })
    }

    /// The fault of a lost device with its cause.
    fn lost_fault(&self, why: &str) -> Fault {
        let name = &self.adapter_name;
        Fault::Device(format!("graphics device {name} stopped working ({why}): start again"))
    }

    /// Whether the device is lost after drawing enough `frames` that another device is likely to work.
    pub(crate) fn is_worth_replacing(&self, frames: u64) -> bool {
        self.loss.why().is_some() && frames >= LASTING_FRAMES
    }

    /// Whether the device is lost.
    #[cfg(not(target_os = "android"))]
    pub(crate) fn is_lost(&self) -> bool {
        self.loss.why().is_some()
    }

    /// Runs `work`, which may panic on a lost device. Skips or aborts it if the device is lost.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(crate) fn unless_lost(&self, work: impl FnOnce()) {
        if self.loss.why().is_none() {
            // The end of the frame reports the loss.
            let _ = self.loss.catch(work);
        }
    }

    /// Destroys the device, as the reset of a driver does; for tests.
    pub fn lose(&self) {
        self.device.destroy();
        // The loss is reported by the next wait.
        let _ = self.wait();
    }

    /// Number of live graphics objects by kind, over all devices of the instance.
    pub fn objects(&self) -> Vec<(&'static str, usize)> {
        let Some(report) = self.instance.generate_report() else { return Vec::new() };
        let hub = report.hub_report();
        let kinds = [
            ("bind groups", &hub.bind_groups),
            ("bind group layouts", &hub.bind_group_layouts),
            ("buffers", &hub.buffers),
            ("command buffers", &hub.command_buffers),
            ("command encoders", &hub.command_encoders),
            ("devices", &hub.devices),
            ("pipeline layouts", &hub.pipeline_layouts),
            ("query sets", &hub.query_sets),
            ("render pipelines", &hub.render_pipelines),
            ("samplers", &hub.samplers),
            ("shader modules", &hub.shader_modules),
            ("textures", &hub.textures),
            ("texture views", &hub.texture_views),
        ];
        kinds.map(|(kind, registry)| (kind, registry.num_kept_from_user)).to_vec()
    }

    /// Allocated GPU memory in bytes; `None` if the device does not count it.
    pub fn allocated_bytes(&self) -> Option<u64> {
        self.device.generate_allocator_report().map(|report| report.total_allocated_bytes)
    }
}

/// The first error that a device reports outside any error scope, from any thread.
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) struct Failures(Arc<Mutex<Option<wgpu::Error>>>);

#[cfg(any(feature = "window", feature = "xr"))]
impl Failures {
    /// Collects errors of `gpu` for [`Failures::check`] instead of panicking where they occur.
    pub(crate) fn collect(gpu: &Gpu) -> Failures {
        let failure: Arc<Mutex<Option<wgpu::Error>>> = Arc::default();
        let uncaptured = failure.clone();
        gpu.device.on_uncaptured_error(Arc::new(move |error| {
            uncaptured.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }));
        Failures(failure)
    }

    /// Returns the error collected since the last call.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost, is out of memory or failed internally.
    ///
    /// # Panics
    /// On a validation error: the program made an invalid call, which is a defect of the program.
    pub(crate) fn check(&self, gpu: &Gpu) -> Result<(), Fault> {
        if let Some(why) = gpu.loss.why() {
            return Err(gpu.lost_fault(why));
        }
        let failure = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        failure.map_or(Ok(()), |error| Err(fault_of(&gpu.adapter_name, &error)))
    }
}

#[cfg(any(feature = "window", feature = "xr"))]
fn fault_of(adapter_name: &str, error: &wgpu::Error) -> Fault {
    match error {
        wgpu::Error::Validation { .. } => panic!("invalid use of the graphics device: {error}"),
        wgpu::Error::OutOfMemory { .. } | wgpu::Error::Internal { .. } => {
            Fault::Device(format!("graphics device {adapter_name}: {error}: start again"))
        }
    }
}

/// Whether multiview works: Mesa's software rasteriser before version 25 draws clipped triangles of all
/// eyes into the first layer.
fn has_correct_multiview(info: &wgpu::AdapterInfo) -> bool {
    info.driver != "llvmpipe" || mesa_major(&info.driver_info).is_some_and(|major| major >= 25)
}

/// Major version in a driver string such as "Mesa 25.0.7 (LLVM 15.0.6)".
fn mesa_major(driver_info: &str) -> Option<u32> {
    let version = driver_info.split_once("Mesa ")?.1;
    version.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mesa_versions() {
        assert_eq!(mesa_major("Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)"), Some(25));
        assert_eq!(mesa_major("Mesa 22.3.6 (LLVM 15.0.6)"), Some(22));
        assert_eq!(mesa_major("570.1"), None);
    }

    #[cfg(any(feature = "window", feature = "xr"))]
    #[test]
    fn exhausted_memory_is_a_device_fault() {
        let fault = fault_of("llvmpipe", &wgpu::Error::OutOfMemory { source: "no memory".into() });
        assert_eq!(fault.exit_code(), 5);
        assert!(fault.to_string().starts_with("graphics device llvmpipe: "), "{fault}");
    }

    #[cfg(any(feature = "window", feature = "xr"))]
    #[test]
    #[should_panic(expected = "invalid use of the graphics device: ")]
    fn a_validation_error_is_a_defect() {
        let description = "bind group 1 is not set".to_owned();
        fault_of("llvmpipe", &wgpu::Error::Validation { source: "unset".into(), description });
    }
}
