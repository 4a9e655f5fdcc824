//! Swapchains: images that the runtime owns and shows and that the renderer draws into.

#![allow(unsafe_code, reason = "images of the runtime are wrapped")]

use ash::vk::{self, Handle as _};
use glam::UVec2;
use openxr as xr;
use program::Fault;

use crate::gpu::{RuntimeFormat, RuntimeImages};
use crate::xr::runtime::error::{During, Halt};

/// The best of the formats that the runtime offers.
///
/// # Errors
/// See [`Halt`].
pub(in crate::xr) fn choose_format(session: &xr::Session<xr::Vulkan>) -> Result<RuntimeFormat, Halt> {
    let offered = session.enumerate_swapchain_formats().halt("asking for its formats")?;
    let offered: Vec<_> = offered.into_iter().map(|format| vk::Format::from_raw(format as i32)).collect();
    RuntimeFormat::choose(&offered).ok_or_else(|| {
        let what = "the OpenXR runtime takes no 8-bit images with red, green, blue and alpha";
        Halt::Fault(Fault::Device(what.into()))
    })
}

/// Creates images of `size` with `layers` layers for drawing in `format` and, if `readable`, for copying.
///
/// # Errors
/// See [`Halt`].
pub(in crate::xr) fn make(
    session: &xr::Session<xr::Vulkan>,
    format: RuntimeFormat,
    size: UVec2,
    layers: u32,
    readable: bool,
) -> Result<xr::Swapchain<xr::Vulkan>, Halt> {
    let mut usage = xr::SwapchainUsageFlags::COLOR_ATTACHMENT | xr::SwapchainUsageFlags::SAMPLED;
    if format.is_reinterpreted() {
        usage |= xr::SwapchainUsageFlags::MUTABLE_FORMAT;
    }
    if readable {
        usage |= xr::SwapchainUsageFlags::TRANSFER_SRC;
    }
    session
        .create_swapchain(&xr::SwapchainCreateInfo {
            create_flags: xr::SwapchainCreateFlags::EMPTY,
            usage_flags: usage,
            format: format.vulkan.as_raw() as u32,
            sample_count: 1,
            width: size.x,
            height: size.y,
            face_count: 1,
            array_size: layers,
            mip_count: 1,
        })
        .halt("making images")
}

/// The images of a swapchain made by [`make`] with the same arguments.
///
/// # Safety
/// The images must be wrapped for the device of the session; the textures must be dropped before the
/// swapchain, and be used only between acquiring and releasing.
pub(in crate::xr) unsafe fn wrap(
    swapchain: &xr::Swapchain<xr::Vulkan>,
    size: UVec2,
    layers: u32,
    format: RuntimeFormat,
    readable: bool,
) -> Result<RuntimeImages, Halt> {
    let images = swapchain.enumerate_images().halt("making images")?;
    let images = images.into_iter().map(|image| vk::Image::from_raw(image as _)).collect();
    // SAFETY: the caller vouches for their use; XR_KHR_vulkan_enable2 hands out images in the layout of a
    // colour attachment.
    Ok(unsafe { RuntimeImages::new(images, size, layers, format, readable) })
}
