//! [`Runtime`]: the OpenXR runtime, its headset, and the Vulkan objects that it creates.
//!
//! `frame` proves the order of `calls` for frames and images, `extensions` are optional, and `error` gives each
//! failure a sentence.

#![allow(unsafe_code, reason = "a library is loaded, and handles of Vulkan are handed over")]

pub(super) mod calls;
pub(super) mod error;
pub(super) mod extensions;
pub(super) mod frame;

use std::ffi::c_void;
use std::time::Duration;

use ash::vk::{self, Handle as _};
use glam::{UVec2, uvec2};
use openxr as xr;
use program::Fault;

use super::System;
use crate::gpu::VulkanRuntime;
use crate::headset::notify;
use error::{During, STARTING};

/// View configuration of a headset with two eyes.
pub(in crate::xr) const EYES: xr::ViewConfigurationType = xr::ViewConfigurationType::PRIMARY_STEREO;

/// Number of times to ask again for a headset that is not available, and the delay in between.
const RETRIES: u32 = 60;
const RETRY_DELAY: Duration = Duration::from_millis(500);

/// A runtime and its headset.
pub(in crate::xr) struct Runtime {
    pub(in crate::xr) instance: xr::Instance,
    pub(in crate::xr) system: xr::SystemId,
    pub(in crate::xr) extensions: xr::ExtensionSet,
    pub(in crate::xr) blends: Blends,
    /// Size of an eye's image in pixels that the runtime recommends.
    pub(in crate::xr) eye_size: UVec2,
    /// Name and version of the runtime.
    pub(in crate::xr) name: String,
    /// Name of the headset.
    pub(in crate::xr) headset: String,
}

impl Runtime {
    /// Starts the system's runtime and waits, for half a minute, for its headset.
    ///
    /// # Errors
    /// [`Fault::Device`] that names what is missing.
    pub(in crate::xr) fn open(system: &mut System) -> Result<Runtime, Fault> {
        let entry = system.entry()?;
        let offered = entry.enumerate_extensions().fault(STARTING)?;
        if !offered.khr_vulkan_enable2 {
            return Err(Fault::Device(
                "the OpenXR runtime lacks XR_KHR_vulkan_enable2, which drawing goes through: update it, or \
                 choose another"
                    .into(),
            ));
        }
        let extensions = extensions::supported(&offered);
        let application = xr::ApplicationInfo {
            application_name: "aarc client",
            application_version: 1,
            engine_name: "",
            engine_version: 0,
            // Later versions are used through extensions; old loaders refuse more than 1.0.
            api_version: xr::Version::new(1, 0, 0),
        };
        let instance = system.start(&entry, &application, &extensions).fault(STARTING)?;
        let properties = instance.properties().fault(STARTING)?;
        let name = format!("{} {}", properties.runtime_name, properties.runtime_version);
        let system = find_headset(&instance, system)?;
        let headset = instance.system_properties(system).fault("looking at the headset")?.system_name;

        let views = instance.enumerate_view_configuration_views(system, EYES).fault("counting the eyes")?;
        if views.len() != 2 {
            return Err(error::other_eyes(views.len()));
        }
        let sizes = views
            .iter()
            .map(|view| uvec2(view.recommended_image_rect_width, view.recommended_image_rect_height));
        let blends =
            instance.enumerate_environment_blend_modes(system, EYES).fault("asking how it blends")?;
        Ok(Runtime {
            blends: Blends::new(&blends),
            eye_size: sizes.fold(UVec2::ONE, UVec2::max),
            instance,
            system,
            extensions,
            name,
            headset,
        })
    }

    /// Waits, for half a minute, until the headset is available again.
    ///
    /// # Errors
    /// [`Fault::Device`] if it stays away.
    pub(in crate::xr) fn wait_for_headset(&self, system: &mut System) -> Result<(), Fault> {
        find_headset(&self.instance, system).map(drop)
    }
}

/// Finds the headset of a runtime. Waits for one that is known and not available, and says so.
fn find_headset(instance: &xr::Instance, system: &mut System) -> Result<xr::SystemId, Fault> {
    let ask = || instance.system(xr::FormFactor::HEAD_MOUNTED_DISPLAY);
    retry(ask, |attempt| {
        if attempt == 0 {
            notify("waiting for the headset: connect it, switch it on, put it on");
        }
        !system.wait(RETRY_DELAY)
    })
    .fault("looking for the headset")
}

/// Asks until the answer is not "unavailable", at most [`RETRIES`] more times. In between it calls `wait` with
/// the number of the attempt, which returns whether to continue.
fn retry<T>(mut ask: impl FnMut() -> xr::Result<T>, mut wait: impl FnMut(u32) -> bool) -> xr::Result<T> {
    for attempt in 0..RETRIES {
        match ask() {
            Err(xr::sys::Result::ERROR_FORM_FACTOR_UNAVAILABLE) if wait(attempt) => {}
            answer => return answer,
        }
    }
    ask()
}

/// Environment blend modes: with and without the room behind the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::xr) struct Blends {
    usual: xr::EnvironmentBlendMode,
    passthrough: Option<xr::EnvironmentBlendMode>,
}

impl Blends {
    /// Chooses from the modes that a runtime offers, its preferred one first.
    fn new(offered: &[xr::EnvironmentBlendMode]) -> Blends {
        use xr::EnvironmentBlendMode as Mode;
        let usual = [Mode::OPAQUE].into_iter().find(|mode| offered.contains(mode));
        let passthrough = [Mode::ALPHA_BLEND].into_iter().find(|mode| offered.contains(mode));
        // Glasses that only add light offer nothing else.
        Blends { usual: usual.or(offered.first().copied()).unwrap_or(Mode::OPAQUE), passthrough }
    }

    /// Whether the runtime can blend the room behind the clip.
    pub(in crate::xr) fn has_passthrough(&self) -> bool {
        self.passthrough.is_some()
    }

    /// The mode with or without the room; without one for the room, the usual one.
    pub(in crate::xr) fn mode(&self, passthrough: bool) -> xr::EnvironmentBlendMode {
        self.passthrough.filter(|_| passthrough).unwrap_or(self.usual)
    }
}

// SAFETY: the runtime creates the handles for its headset.
unsafe impl VulkanRuntime for Runtime {
    fn version_min(&self) -> Result<u32, Fault> {
        let needs = self
            .instance
            .graphics_requirements::<xr::Vulkan>(self.system)
            .fault("asking what it needs of Vulkan")?;
        let least = needs.min_api_version_supported;
        Ok(vk::make_api_version(0, u32::from(least.major()), u32::from(least.minor()), 0))
    }

    // SAFETY: the trait demands the same of the caller as the runtime.
    unsafe fn create_instance(
        &self,
        loader: vk::PFN_vkGetInstanceProcAddr,
        info: &vk::InstanceCreateInfo<'_>,
    ) -> Result<vk::Instance, Fault> {
        // SAFETY: the types differ only in the names of handles and of void functions.
        let loader = unsafe {
            std::mem::transmute::<vk::PFN_vkGetInstanceProcAddr, xr::sys::platform::VkGetInstanceProcAddr>(
                loader,
            )
        };
        // SAFETY: the caller vouches for both.
        let made = unsafe {
            self.instance.create_vulkan_instance(self.system, loader, std::ptr::from_ref(info).cast())
        };
        let instance = made_by_vulkan(made, "making a Vulkan instance")?;
        Ok(vk::Instance::from_raw(instance as u64))
    }

    // SAFETY: as above.
    unsafe fn physical_device(&self, instance: vk::Instance) -> Result<vk::PhysicalDevice, Fault> {
        // SAFETY: the caller vouches for the instance.
        let device = unsafe { self.instance.vulkan_graphics_device(self.system, raw(instance)) };
        Ok(vk::PhysicalDevice::from_raw(device.fault("choosing a graphics device")? as u64))
    }

    // SAFETY: as above.
    unsafe fn create_device(
        &self,
        loader: vk::PFN_vkGetInstanceProcAddr,
        physical: vk::PhysicalDevice,
        info: &vk::DeviceCreateInfo<'_>,
    ) -> Result<vk::Device, Fault> {
        // SAFETY: as above.
        let loader = unsafe {
            std::mem::transmute::<vk::PFN_vkGetInstanceProcAddr, xr::sys::platform::VkGetInstanceProcAddr>(
                loader,
            )
        };
        let info = std::ptr::from_ref(info).cast();
        // SAFETY: the caller vouches for all of them.
        let made = unsafe { self.instance.create_vulkan_device(self.system, loader, raw(physical), info) };
        let device = made_by_vulkan(made, "making a Vulkan device")?;
        Ok(vk::Device::from_raw(device as u64))
    }
}

/// A dispatchable Vulkan handle in the type of the runtime.
pub(in crate::xr) fn raw(handle: impl vk::Handle) -> *const c_void {
    handle.as_raw() as *const c_void
}

/// The object that Vulkan created for the runtime.
fn made_by_vulkan<T>(made: xr::Result<Result<T, i32>>, what: &str) -> Result<T, Fault> {
    made.fault(what)?.map_err(|code| {
        let code = vk::Result::from_raw(code);
        Fault::Device(format!("OpenXR runtime: {what} failed ({code:?}): update the graphics driver"))
    })
}

#[cfg(test)]
mod tests {
    use xr::EnvironmentBlendMode as Mode;

    use super::*;

    #[test]
    fn the_player_waits_for_a_headset_that_comes_later() {
        let unavailable = Err(xr::sys::Result::ERROR_FORM_FACTOR_UNAVAILABLE);
        let answer_after = |refusals: u32, patience: u32, answer: xr::Result<u8>| {
            let (mut asked, mut waited) = (0, 0);
            let ask = || {
                asked += 1;
                if asked > refusals { answer } else { unavailable }
            };
            let answer = retry(ask, |attempt| {
                assert_eq!(attempt, waited);
                waited += 1;
                waited < patience
            });
            (answer, waited)
        };
        let always = u32::MAX;
        assert_eq!(answer_after(0, always, Ok(1)), (Ok(1), 0));
        assert_eq!(answer_after(7, always, Ok(1)), (Ok(1), 7));
        assert_eq!(answer_after(7, 3, Ok(1)), (unavailable, 3), "not when the program has to end");
        assert_eq!(answer_after(always, always, Ok(1)), (unavailable, RETRIES), "up to a limit");
        let unsupported = Err(xr::sys::Result::ERROR_FORM_FACTOR_UNSUPPORTED);
        assert_eq!(
            answer_after(1, always, unsupported),
            (unsupported, 1),
            "only unavailability is a reason to wait"
        );
    }

    #[test]
    fn images_are_opaque_unless_passthrough_is_requested_and_offered() {
        let blends = Blends::new(&[Mode::ALPHA_BLEND, Mode::OPAQUE]);
        assert!(blends.has_passthrough());
        assert_eq!([blends.mode(false), blends.mode(true)], [Mode::OPAQUE, Mode::ALPHA_BLEND]);
        let blends = Blends::new(&[Mode::OPAQUE]);
        assert!(!blends.has_passthrough());
        assert_eq!([blends.mode(false), blends.mode(true)], [Mode::OPAQUE; 2]);
        assert_eq!(Blends::new(&[Mode::ADDITIVE]).mode(true), Mode::ADDITIVE);
    }
}
