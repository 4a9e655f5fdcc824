//! [`Gpu`]: the graphics device and what it can do.

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
        let mut features = adapter.features() & (wgpu::Features::MULTIVIEW | wgpu::Features::TIMESTAMP_QUERY);
        if !draws_multiview_right(&info) {
            features.remove(wgpu::Features::MULTIVIEW);
        }
        let offered = adapter.limits();
        let limits = wgpu::Limits {
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            max_texture_dimension_2d: offered.max_texture_dimension_2d,
            max_multiview_view_count: offered.max_multiview_view_count,
            ..wgpu::Limits::downlevel_defaults()
        };
        let descriptor = wgpu::DeviceDescriptor {
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| Fault::Device(format!("graphics device {}: {error}", info.name)))?;
        Ok(Gpu {
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
        })
    }

    /// A recorder of GPU work.
    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Hands recorded work to the GPU.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) {
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
