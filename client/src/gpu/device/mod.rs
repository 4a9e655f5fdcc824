//! [`Gpu`]: the graphics device and what it can do.
//!
//! Whoever opens it, the device is asked for the same: [`Wanted`] decides from what an adapter
//! offers. In [`vulkan`] a headset's runtime opens it.

#[cfg(feature = "xr")]
pub(crate) mod vulkan;

#[cfg(any(feature = "window", feature = "xr"))]
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ThreadId;

use crate::fault::Fault;

/// What to log unless `RUST_LOG` says otherwise: what drivers and loaders say matters only to
/// those who look for it.
pub const LOG_FILTER: &str = "error,wgpu_hal=off";

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
    pub(crate) queue: wgpu::Queue,
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
        Ok(Gpu::opened(adapter, &wanted, opened, None))
    }

    /// The device `opened` of `adapter`, which has been given what was `wanted`.
    fn opened(
        adapter: wgpu::Adapter,
        wanted: &Wanted,
        (device, queue): (wgpu::Device, wgpu::Queue),
        submitter: Option<ThreadId>,
    ) -> Gpu {
        let info = adapter.get_info();
        let Wanted { features, limits } = wanted;
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
            device,
            queue,
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
        match self.device.poll(wgpu::PollType::wait_indefinitely()) {
            Ok(_) => Ok(()),
            Err(error) => Err(Fault::Device(format!("graphics device {}: {error}", self.adapter_name))),
        }
    }

    /// Creates a resource, turning want of memory into an error.
    pub(crate) fn allocate<T>(&self, what: &str, create: impl FnOnce() -> T) -> Result<T, Fault> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let created = create();
        match pollster::block_on(scope.pop()) {
            None => Ok(created),
            Some(_) => Err(Fault::Device(format!(
                "graphics device {}: not enough memory for {what}",
                self.adapter_name
            ))),
        }
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
        let keep = |failure: &Mutex<Option<String>>, message: String| {
            failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
        };
        let uncaptured = failure.clone();
        gpu.device.on_uncaptured_error(Arc::new(move |error| keep(&uncaptured, error.to_string())));
        let lost = failure.clone();
        gpu.device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                keep(&lost, format!("lost: {message}"));
            }
        });
        Failures(failure)
    }

    /// Whether all is well with `gpu`.
    ///
    /// # Errors
    /// [`Fault::Device`] with the failure, once.
    pub(crate) fn check(&self, gpu: &Gpu) -> Result<(), Fault> {
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
