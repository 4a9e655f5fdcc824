//! The Vulkan device of a headset's runtime, and images that the runtime owns.
//!
//! The runtime creates the Vulkan instance and device itself and chooses the GPU, see [`VulkanRuntime`];
//! [`Gpu::from_vulkan`] wraps them for the renderer. [`RuntimeImages`] are the runtime's swapchain images,
//! and [`RuntimeImages::wrap`] wraps them as textures.

#![allow(unsafe_code, reason = "handles of Vulkan cross between the renderer and a runtime")]

use ash::vk;
use glam::UVec2;
use program::Fault;
use wgpu_hal::vulkan::Api as Vulkan;

use super::{DeviceRequest, Gpu};

/// Requested version of Vulkan. On a device of 1.3 the shader compiler emits SPIR-V 1.6, which an instance of
/// a lower version must not be given.
const VERSION: u32 = vk::API_VERSION_1_3;

/// Queue family of all submissions: the graphics API uses the first.
const QUEUE_FAMILY: u32 = 0;

/// A runtime that creates the Vulkan objects of a device and shares it.
///
/// # Safety
/// Returned handles must be valid and created from the given arguments.
pub(crate) unsafe trait VulkanRuntime {
    /// The lowest version of Vulkan that the runtime supports.
    ///
    /// # Errors
    /// [`Fault::Device`] if the runtime fails.
    fn version_min(&self) -> Result<u32, Fault>;

    /// Creates the instance.
    ///
    /// # Errors
    /// [`Fault::Device`] if the runtime fails.
    ///
    /// # Safety
    /// As for `vkCreateInstance`, and `loader` must be the function of a Vulkan loader that stays loaded.
    unsafe fn create_instance(
        &self,
        loader: vk::PFN_vkGetInstanceProcAddr,
        info: &vk::InstanceCreateInfo<'_>,
    ) -> Result<vk::Instance, Fault>;

    /// The GPU that the headset is connected to.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is none.
    ///
    /// # Safety
    /// `instance` must come from [`VulkanRuntime::create_instance`].
    unsafe fn physical_device(&self, instance: vk::Instance) -> Result<vk::PhysicalDevice, Fault>;

    /// Creates the device.
    ///
    /// # Errors
    /// [`Fault::Device`] if the runtime fails.
    ///
    /// # Safety
    /// As for `vkCreateDevice` and [`VulkanRuntime::create_instance`]; `physical` must come from
    /// [`VulkanRuntime::physical_device`].
    unsafe fn create_device(
        &self,
        loader: vk::PFN_vkGetInstanceProcAddr,
        physical: vk::PhysicalDevice,
        info: &vk::DeviceCreateInfo<'_>,
    ) -> Result<vk::Device, Fault>;
}

/// The Vulkan objects of a [`Gpu`], valid as long as it lives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VulkanHandles {
    pub(crate) instance: vk::Instance,
    pub(crate) physical: vk::PhysicalDevice,
    pub(crate) device: vk::Device,
    pub(crate) queue_family: u32,
    pub(crate) queue: u32,
}

impl Gpu {
    /// Opens the device of `runtime`, which shares it: only the calling thread may submit.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is no Vulkan, the runtime fails, or the GPU does not meet the
    /// requirements.
    pub(crate) fn from_vulkan(runtime: &impl VulkanRuntime) -> Result<(Gpu, VulkanHandles), Fault> {
        // Long: a sequence in which each handle is made from the handles before, and the safety of each call
        // follows from the calls above it.
        let failed = |what: &str, error: &dyn std::fmt::Display| {
            Fault::Device(format!("graphics device of the headset: {what}: {error}: update its driver"))
        };
        // SAFETY: the Vulkan loader of the system is what it says.
        let entry = unsafe { ash::Entry::load() }.map_err(|error| {
            log::info!("{error}");
            Fault::Device("no Vulkan loader was found: install it (Debian and Ubuntu: libvulkan1)".into())
        })?;
        let loader = entry.static_fn().get_instance_proc_addr;
        // SAFETY: the entry points were just loaded.
        let offered = unsafe { entry.try_enumerate_instance_version() };
        let offered = offered.map_err(|error| failed("version", &error))?.unwrap_or(vk::API_VERSION_1_0);
        let version = version(offered, runtime.version_min()?)?;

        let flags = wgpu::InstanceFlags::empty().with_env();
        let extensions = <Vulkan as wgpu_hal::Api>::Instance::desired_extensions(&entry, version, flags)
            .map_err(|error| failed("extensions", &error))?;
        let names: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
        let application =
            vk::ApplicationInfo::default().application_name(c"aarc client").api_version(version);
        let info =
            vk::InstanceCreateInfo::default().application_info(&application).enabled_extension_names(&names);
        // SAFETY: `info` points to what outlives the call, and asks for what the loader offers.
        let instance = unsafe { runtime.create_instance(loader, &info) }?;
        // SAFETY: the runtime made the instance with this loader.
        let instance = unsafe { ash::Instance::load(entry.static_fn(), instance) };
        // SAFETY: the instance comes from the runtime.
        let physical = unsafe { runtime.physical_device(instance.handle()) }?;

        // SAFETY: the instance was made from this loader with these extensions and this version; it
        // is handed over, and goes away with the device.
        let hal = unsafe {
            <Vulkan as wgpu_hal::Api>::Instance::from_raw(
                entry.clone(),
                instance.clone(),
                version,
                android_version(),
                None,
                extensions,
                flags,
                wgpu::MemoryBudgetThresholds::default(),
                false,
                None,
            )
        }
        .map_err(|error| failed("instance", &error))?;
        let exposed = hal.expose_adapter(physical).ok_or_else(|| {
            Fault::Device(
                "graphics device of the headset: its driver is too old for the renderer: update it".into(),
            )
        })?;
        let request = DeviceRequest::new(&exposed.info, exposed.features, &exposed.capabilities.limits);

        let extensions = exposed.adapter.required_device_extensions(request.features);
        let names: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
        let mut features = exposed.adapter.physical_device_features(&extensions, request.features);
        let queues =
            [vk::DeviceQueueCreateInfo::default().queue_family_index(QUEUE_FAMILY).queue_priorities(&[1.0])];
        let info =
            vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
        let info = features.add_to_device_create(info);
        // SAFETY: `info` points to what outlives the call, and asks for what the GPU offers.
        let device = unsafe { runtime.create_device(loader, physical, &info) }?;
        // SAFETY: the runtime made the device from this instance.
        let device = unsafe { ash::Device::load(instance.fp_v1_0(), device) };
        let handles = VulkanHandles {
            instance: instance.handle(),
            physical,
            device: device.handle(),
            queue_family: QUEUE_FAMILY,
            queue: 0,
        };
        // SAFETY: the device was made from this adapter with these extensions and features, and has
        // the queue; it is handed over.
        let open = unsafe {
            exposed.adapter.device_from_raw(
                device,
                None,
                &extensions,
                request.features,
                &request.limits,
                &wgpu::MemoryHints::Performance,
                QUEUE_FAMILY,
                0,
            )
        }
        .map_err(|error| failed("device", &error))?;

        // SAFETY: the instance was made above and is given away here.
        let instance = unsafe { wgpu::Instance::from_hal::<Vulkan>(hal) };
        // SAFETY: the adapter belongs to this instance.
        let adapter = unsafe { instance.create_adapter_from_hal(exposed) };
        // SAFETY: the device was opened on this adapter.
        let opened = unsafe { adapter.create_device_from_hal(open, &request.descriptor()) }
            .map_err(|error| failed("device", &error))?;
        let here = std::thread::current().id();
        Ok((Gpu::opened(instance, adapter, &request, opened, Some(here)), handles))
    }
}

/// API level of Android, by which workarounds for drivers are chosen; 0 elsewhere.
fn android_version() -> u32 {
    #[cfg(target_os = "android")]
    return android_activity::AndroidApp::sdk_version().unsigned_abs();
    #[cfg(not(target_os = "android"))]
    0
}

/// Version of the instance, for a loader that supports up to `offered` and a runtime that needs `least`.
fn version(offered: u32, least: u32) -> Result<u32, Fault> {
    let version = VERSION.min(offered).max(least);
    if version > offered || vk::api_version_major(version) != 1 {
        let text = |version| format!("{}.{}", vk::api_version_major(version), vk::api_version_minor(version));
        return Err(Fault::Device(format!(
            "the headset's runtime needs Vulkan {}; this machine has {}: update its driver",
            text(least),
            text(offered)
        )));
    }
    Ok(version)
}

/// Format of a runtime's images: as stored, and as drawn into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RuntimeFormat {
    /// The Vulkan format.
    pub(crate) vulkan: vk::Format,
    stored: wgpu::TextureFormat,
    drawn: wgpu::TextureFormat,
}

/// Formats in the order of preference. Colours are display-referred and blended as such: they are written
/// unconverted into images that the runtime interprets as sRGB.
const FORMATS: [RuntimeFormat; 4] = {
    use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgba8Unorm, Rgba8UnormSrgb};
    [
        RuntimeFormat { vulkan: vk::Format::R8G8B8A8_SRGB, stored: Rgba8UnormSrgb, drawn: Rgba8Unorm },
        RuntimeFormat { vulkan: vk::Format::B8G8R8A8_SRGB, stored: Bgra8UnormSrgb, drawn: Bgra8Unorm },
        RuntimeFormat { vulkan: vk::Format::R8G8B8A8_UNORM, stored: Rgba8Unorm, drawn: Rgba8Unorm },
        RuntimeFormat { vulkan: vk::Format::B8G8R8A8_UNORM, stored: Bgra8Unorm, drawn: Bgra8Unorm },
    ]
};

impl RuntimeFormat {
    /// The preferred one of the `offered` formats; `None` if none is supported.
    pub(crate) fn choose(offered: &[vk::Format]) -> Option<RuntimeFormat> {
        let chosen = FORMATS.into_iter().find(|format| offered.contains(&format.vulkan))?;
        if chosen.stored == chosen.drawn {
            log::warn!("the headset's runtime has no sRGB images: colours will be too bright");
        }
        Some(chosen)
    }

    /// Whether images need a mutable format.
    pub(crate) fn is_reinterpreted(&self) -> bool {
        self.stored != self.drawn
    }

    /// Format of the render targets.
    pub(crate) fn drawn(&self) -> wgpu::TextureFormat {
        self.drawn
    }
}

/// Images that a runtime owns, with one layer per eye.
#[derive(Debug)]
pub(crate) struct RuntimeImages {
    images: Vec<vk::Image>,
    size: UVec2,
    layers: u32,
    format: RuntimeFormat,
    readable: bool,
}

impl RuntimeImages {
    /// Describes `images` of `size` pixels and `layers` layers; `readable` ones can be copied from.
    ///
    /// # Safety
    /// The images must belong to the device of the [`Gpu`] that wraps them, match the description, be
    /// created as colour attachments, with a mutable format if [`RuntimeFormat::is_reinterpreted`], and
    /// outlive their textures. Each must be in the layout of a colour attachment when it is drawn into or
    /// copied from.
    pub(crate) unsafe fn new(
        images: Vec<vk::Image>,
        size: UVec2,
        layers: u32,
        format: RuntimeFormat,
        readable: bool,
    ) -> RuntimeImages {
        RuntimeImages { images, size, layers, format, readable }
    }

    pub(crate) fn size(&self) -> UVec2 {
        self.size
    }

    pub(crate) fn layers(&self) -> u32 {
        self.layers
    }

    pub(crate) fn format(&self) -> RuntimeFormat {
        self.format
    }

    pub(crate) fn readable(&self) -> bool {
        self.readable
    }

    /// Wraps each image as a texture in the state of a colour target.
    pub(crate) fn wrap(&self, gpu: &Gpu) -> Vec<wgpu::Texture> {
        let RuntimeImages { size, layers, format, readable, .. } = *self;
        let size = wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: layers };
        let view_formats = if format.is_reinterpreted() { vec![format.drawn] } else { vec![] };
        let mut uses = wgpu::TextureUses::COLOR_TARGET;
        let mut usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
        if readable {
            uses |= wgpu::TextureUses::COPY_SRC;
            usage |= wgpu::TextureUsages::COPY_SRC;
        }
        let of_hal = wgpu_hal::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: format.stored,
            usage: uses,
            memory_flags: wgpu_hal::MemoryFlags::empty(),
            view_formats: view_formats.clone(),
        };
        let descriptor = wgpu::TextureDescriptor {
            label: Some("image of the headset"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: format.stored,
            usage,
            view_formats: &view_formats,
        };
        let wrap = |&image: &vk::Image| {
            // Without a callback the graphics API would destroy the runtime's image.
            let keep: wgpu_hal::DropCallback = Box::new(|| ());
            // SAFETY: nothing is done to the device through the guard but wrapping the image.
            let device =
                unsafe { gpu.device.as_hal::<Vulkan>() }.expect("a runtime's device is one of Vulkan");
            // SAFETY: `new` requires that the image is what is said of it, and its memory outlives it.
            let texture = unsafe {
                let memory = wgpu_hal::vulkan::TextureMemory::External;
                device.texture_from_raw(image, &of_hal, Some(keep), memory)
            };
            drop(device);
            // SAFETY: the texture was made from this device to the same description, and `new`
            // requires that it is in the state named.
            unsafe {
                let state = wgpu::TextureUses::COLOR_TARGET;
                gpu.device.create_texture_from_hal::<Vulkan>(texture, &descriptor, state)
            }
        };
        self.images.iter().map(wrap).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_formats_are_preferred() {
        let choose = |offered: &[vk::Format]| RuntimeFormat::choose(offered).map(|format| format.vulkan);
        let (rgba, bgra) = (vk::Format::R8G8B8A8_UNORM, vk::Format::B8G8R8A8_SRGB);
        assert_eq!(choose(&[rgba, bgra]), Some(bgra));
        assert_eq!(choose(&[vk::Format::D32_SFLOAT, rgba]), Some(rgba));
        assert_eq!(choose(&[vk::Format::R16G16B16A16_SFLOAT]), None);
        assert!(FORMATS.iter().all(|format| !format.drawn.is_srgb()), "blending is display-referred");
    }

    #[test]
    fn the_version_is_supported_by_loader_and_runtime() {
        let v = vk::make_api_version;
        assert_eq!(version(v(0, 1, 4, 300), v(0, 1, 0, 0)), Ok(v(0, 1, 3, 0)));
        assert_eq!(version(v(0, 1, 1, 0), v(0, 1, 0, 0)), Ok(v(0, 1, 1, 0)));
        assert_eq!(version(v(0, 1, 4, 0), v(0, 1, 4, 0)), Ok(v(0, 1, 4, 0)));
        let Err(Fault::Device(message)) = version(v(0, 1, 1, 0), v(0, 1, 2, 0)) else { panic!() };
        assert!(message.contains("needs Vulkan 1.2; this machine has 1.1"), "{message}");
        assert!(version(v(0, 2, 0, 0), v(0, 2, 0, 0)).is_err());
    }
}
