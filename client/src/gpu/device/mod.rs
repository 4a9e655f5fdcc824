//! [`Gpu`]: the graphics device and what it can do.
//!
//! Whoever opens it, the device is asked for the same: [`Wanted`] decides from what an adapter
//! offers. In [`vulkan`] a headset's runtime opens it.

mod loss;
#[cfg(feature = "xr")]
pub(crate) mod vulkan;

#[cfg(any(feature = "window", feature = "xr"))]
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ThreadId;

use program::Fault;

pub(super) use loss::{Fragile, Loss};

/// What to log unless `RUST_LOG` says otherwise: what drivers and loaders say matters only to
/// those who look for it.
pub const LOG_FILTER: &str = "error,wgpu_hal=off";

/// What is printed once another device has taken the place of a lost one.
pub(crate) const DEVICE_REPLACED: &str =
    "the graphics device stopped working: the clip goes on with another one";

/// Frames that a lost device must have drawn to be replaced: one that is lost over and over is no use.
const LASTING_FRAMES: u64 = 50;

/// What an adapter offers beyond what every one does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caps {
    /// Both eyes can be drawn in one pass. Clear it to draw them one after the other.
    pub multiview: bool,
    /// The GPU can say how long it took.
    pub timestamps: bool,
    /// Largest width and height of an image in pixels.
    pub max_image_side: u32,
    /// Largest buffer that a shader can read, in bytes.
    pub max_buffer_bytes: u64,
}

/// The graphics device.
pub struct Gpu {
    /// What the adapter offers.
    pub caps: Caps,
    /// Name of the adapter.
    pub adapter_name: String,
    /// Name and version of its driver.
    pub driver: String,
    #[cfg(feature = "window")]
    pub(crate) adapter: wgpu::Adapter,
    pub(crate) device: wgpu::Device,
    pub(super) queue: Fragile<wgpu::Queue>,
    instance: wgpu::Instance,
    pub(super) loss: Loss,
    /// The only thread that may hand over work; `None` where any may.
    submitter: Option<ThreadId>,
}

/// What to ask of an adapter.
struct Wanted {
    features: wgpu::Features,
    limits: wgpu::Limits,
}

impl Wanted {
    /// What the renderer makes use of and the adapter `info`, which has `features` and `limits`, offers.
    fn of(info: &wgpu::AdapterInfo, features: wgpu::Features, limits: &wgpu::Limits) -> Wanted {
        let mut features = features & (wgpu::Features::MULTIVIEW | wgpu::Features::TIMESTAMP_QUERY);
        if !draws_multiview_right(info) {
            features.remove(wgpu::Features::MULTIVIEW);
        }
        let limits = wgpu::Limits {
            max_buffer_size: limits.max_buffer_size,
            max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
            max_texture_dimension_2d: limits.max_texture_dimension_2d,
            max_multiview_view_count: limits.max_multiview_view_count,
            ..wgpu::Limits::downlevel_defaults()
        };
        Wanted { features, limits }
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
    /// A device to draw into images with; needs no display.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is no driver, or none that is capable enough.
    pub fn new_headless() -> Result<Gpu, Fault> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        Gpu::from_instance(&instance, None)
    }

    /// The fastest device of `instance`, able to show on `surface` if there is one.
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
        let wanted = Wanted::of(&info, adapter.features(), &adapter.limits());
        let opened = pollster::block_on(adapter.request_device(&wanted.descriptor()))
            .map_err(|error| Fault::Device(format!("graphics device {}: {error}", info.name)))?;
        Ok(Gpu::opened(instance.clone(), adapter, &wanted, opened, None))
    }

    /// The device `opened` of `adapter`, which has been given what was `wanted`.
    fn opened(
        instance: wgpu::Instance,
        adapter: wgpu::Adapter,
        wanted: &Wanted,
        (device, queue): (wgpu::Device, wgpu::Queue),
        submitter: Option<ThreadId>,
    ) -> Gpu {
        let info = adapter.get_info();
        let Wanted { features, limits } = wanted;
        let loss = Loss::watch(&device);
        Gpu {
            caps: Caps {
                multiview: features.contains(wgpu::Features::MULTIVIEW),
                timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
                max_image_side: limits.max_texture_dimension_2d,
                max_buffer_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            },
            adapter_name: info.name,
            driver: format!("{} {}", info.driver, info.driver_info),
            #[cfg(feature = "window")]
            adapter,
            instance,
            queue: Fragile::new(queue, &loss),
            loss,
            device,
            submitter,
        }
    }

    /// A recorder of GPU work.
    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Hands recorded work to the GPU.
    ///
    /// # Panics
    /// If a headset's runtime shares the device, and this is not the thread that opened it: the
    /// runtime uses the same queue within the calls that thread makes, and nobody guards it.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) {
        let here = std::thread::current().id();
        assert!(self.submitter.is_none_or(|thread| thread == here), "only the thread of the frames submits");
        self.queue.submit([encoder.finish()]);
    }

    /// Blocks until all work handed over is done.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub fn wait(&self) -> Result<(), Fault> {
        self.loss.wait(&self.device).map_err(|why| self.gone(&why))
    }

    /// Creates a resource, turning want of memory into an error.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory, or the device was lost.
    ///
    /// # Panics
    /// If `create` asks for what is invalid, which is a defect of the program.
    pub(crate) fn allocate<T>(&self, what: &str, create: impl FnOnce() -> T) -> Result<T, Fault> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        // What is made of a resource that there is no memory for is invalid, too.
        let validity = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let created = create();
        let invalid = pollster::block_on(validity.pop());
        let want = pollster::block_on(memory.pop());
        if let Some(why) = self.loss.why() {
            return Err(self.gone(why));
        }
        let name = &self.adapter_name;
        match (want, invalid) {
            (None, None) => Ok(created),
            (Some(_), _) => {
                Err(Fault::Device(format!("graphics device {name}: not enough memory for {what}")))
            }
            (None, Some(error)) => panic!("{what}: {error}"),
        }
    }

    /// Creates a buffer that holds `bytes`, a multiple of four of them.
    ///
    /// # Errors
    /// As for [`Gpu::allocate`].
    pub(crate) fn buffer(
        &self,
        what: &str,
        bytes: &[u8],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, Fault> {
        let buffer = self.allocate(what, || {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: bytes.len() as u64,
                usage,
                mapped_at_creation: true,
            })
        })?;
        match buffer.get_mapped_range_mut(..) {
            Ok(mut mapped) => mapped.copy_from_slice(bytes),
            Err(error) => return Err(self.gone(self.loss.why().unwrap_or(&error.to_string()))),
        }
        buffer.unmap();
        Ok(buffer)
    }

    /// The fault of a device that is gone, and why.
    fn gone(&self, why: &str) -> Fault {
        let name = &self.adapter_name;
        Fault::Device(format!("graphics device {name} stopped working ({why}): start again"))
    }

    /// Whether the device is lost, and worked for long enough that another one may as well: it has drawn
    /// this many `frames`.
    pub(crate) fn is_worth_replacing(&self, frames: u64) -> bool {
        self.loss.why().is_some() && frames >= LASTING_FRAMES
    }

    /// Whether the device is gone: what is drawn with it is drawn nowhere.
    #[cfg(feature = "window")]
    pub(crate) fn is_lost(&self) -> bool {
        self.loss.why().is_some()
    }

    /// Does what panics on a device that is gone, or goes meanwhile; not, or not to the end, on such a
    /// one.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(crate) fn unless_lost(&self, work: impl FnOnce()) {
        if self.loss.why().is_none() {
            // Who draws is told of the loss at the end of the frame.
            let _ = self.loss.catch(work);
        }
    }

    /// Destroys the device under all that uses it, as a driver that is reset does: to try what comes
    /// of that.
    pub fn lose(&self) {
        self.device.destroy();
        // Until it is waited for, a device that was destroyed goes on.
        let _ = self.wait();
    }

    /// Objects of the graphics interface that are held, by kind; of all devices that one headset or
    /// window has.
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

    /// Bytes of GPU memory that are held for objects, where the device counts them.
    pub fn allocated_bytes(&self) -> Option<u64> {
        self.device.generate_allocator_report().map(|report| report.total_allocated_bytes)
    }
}

/// The first failure that a device reports by itself, from any thread.
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) struct Failures(Arc<Mutex<Option<String>>>);

#[cfg(any(feature = "window", feature = "xr"))]
impl Failures {
    /// Keeps what would otherwise end the program in a panic.
    pub(crate) fn watch(gpu: &Gpu) -> Failures {
        let failure: Arc<Mutex<Option<String>>> = Arc::default();
        let uncaptured = failure.clone();
        gpu.device.on_uncaptured_error(Arc::new(move |error| {
            let mut first = uncaptured.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| error.to_string());
        }));
        Failures(failure)
    }

    /// Whether all is well with `gpu`.
    ///
    /// # Errors
    /// [`Fault::Device`] with the failure.
    pub(crate) fn check(&self, gpu: &Gpu) -> Result<(), Fault> {
        if let Some(why) = gpu.loss.why() {
            return Err(gpu.gone(why));
        }
        match self.0.lock().unwrap_or_else(PoisonError::into_inner).take() {
            None => Ok(()),
            Some(failure) => Err(Fault::Device(format!("graphics device {}: {failure}", gpu.adapter_name))),
        }
    }
}

/// Mesa's software rasteriser before version 25 draws triangles that need clipping into the first
/// layer for every eye.
fn draws_multiview_right(info: &wgpu::AdapterInfo) -> bool {
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
}
