//! Swapchains: images that the runtime owns and shows and that the renderer draws into.

#![allow(unsafe_code, reason = "images of the runtime are wrapped")]

use std::sync::Arc;

use ash::vk::{self, Handle as _};
use glam::UVec2;
use openxr as xr;
use program::Fault;

use crate::gpu::{Gpu, RuntimeFormat, RuntimeImages, RuntimeTargets};
use crate::xr::runtime::calls::{Stopwatch, SwapchainImages};
use crate::xr::runtime::error::{During, Halt};
use crate::xr::runtime::frame::Images;

/// The best of the formats that the runtime offers.
///
/// # Errors
/// See [`Halt`].
pub(in crate::xr) fn choose_format(session: &xr::Session<xr::Vulkan>) -> Result<RuntimeFormat, Halt> {
    let offered = session.enumerate_swapchain_formats().halt("asking for its formats")?;
    let offered: Vec<_> = offered.into_iter().map(|format| vk::Format::from_raw(format as i32)).collect();
    RuntimeFormat::choose(&offered).ok_or_else(|| {
        let what = "the OpenXR runtime takes no 8-bit images with red, green, blue and alpha: update it, or \
                    choose another";
        Halt::Fault(Fault::Device(what.into()))
    })
}

/// The images of a swapchain.
#[derive(Clone, Copy, Debug)]
pub(in crate::xr) struct ImageLayout {
    pub(in crate::xr) format: RuntimeFormat,
    pub(in crate::xr) size: UVec2,
    /// One per eye, or one for all.
    pub(in crate::xr) layers: u32,
    /// Whether they can be read back.
    pub(in crate::xr) readable: bool,
}

/// A swapchain with a render target in each of its images.
pub(in crate::xr) struct TargetSwapchain {
    // Before the images that they wrap.
    pub(in crate::xr) targets: RuntimeTargets,
    pub(in crate::xr) images: Images<SwapchainImages>,
}

impl TargetSwapchain {
    /// Creates the images, and targets for drawing into them on `gpu`, the device of the session.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn open(
        session: &xr::Session<xr::Vulkan>,
        gpu: &Arc<Gpu>,
        layout: ImageLayout,
        stopwatch: Stopwatch,
    ) -> Result<TargetSwapchain, Halt> {
        let swapchain = make(session, layout)?;
        let handles = swapchain.enumerate_images().halt("making images")?;
        let handles = handles.into_iter().map(|image| vk::Image::from_raw(image as _)).collect();
        let ImageLayout { format, size, layers, readable } = layout;
        // SAFETY: `make` had the same layout, and XR_KHR_vulkan_enable2 hands out images in the layout of a
        // colour attachment. The targets go before `images`, which owns them, and are used only between acquiring
        // and releasing.
        let wrapped = unsafe { RuntimeImages::new(handles, size, layers, format, readable) };
        let images = Images::new(SwapchainImages { swapchain, stopwatch, gpu: gpu.clone() });
        Ok(TargetSwapchain { targets: RuntimeTargets::new(gpu, &wrapped)?, images })
    }

    /// The swapchain, for layers that show its image released last.
    pub(in crate::xr) fn swapchain(&self) -> &xr::Swapchain<xr::Vulkan> {
        &self.images.calls().swapchain
    }
}

/// Creates images for drawing and, if they are readable, for copying.
fn make(session: &xr::Session<xr::Vulkan>, layout: ImageLayout) -> Result<xr::Swapchain<xr::Vulkan>, Halt> {
    let ImageLayout { format, size, layers, readable } = layout;
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
