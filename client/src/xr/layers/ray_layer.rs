//! [`RayLayer`]: the image of the pointer rays, of a single colour, filled once.

#![allow(unsafe_code, reason = "images of the runtime are wrapped")]

use glam::UVec2;
use openxr as xr;

use super::quad::quad;
use super::swapchain::{make, wrap};
use crate::gpu::{Gpu, RuntimeFormat, RuntimeTargets};
use crate::xr::panel::PointerRay;
use crate::xr::runtime::calls::{Stopwatch, SwapchainImages};
use crate::xr::runtime::error::{During, Halt};
use crate::xr::runtime::frame::Images;

/// Some runtimes refuse smaller images.
const SIZE: UVec2 = UVec2::splat(16);

/// Half transparent white, premultiplied.
const COLOR: [f64; 4] = [0.5; 4];

/// The pointer rays in a session.
pub(in crate::xr) struct RayLayer {
    // Before the images that they wrap.
    _targets: RuntimeTargets,
    images: Images<SwapchainImages>,
}

impl RayLayer {
    /// Creates the image and fills it.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn open(
        session: &xr::Session<xr::Vulkan>,
        gpu: &Gpu,
        format: RuntimeFormat,
    ) -> Result<RayLayer, Halt> {
        let swapchain = make(session, format, SIZE, 1, false)?;
        // SAFETY: `make` had the same arguments; `_targets` goes before `images`, which owns them, and is drawn
        // into only between acquiring and releasing.
        let wrapped = unsafe { wrap(&swapchain, SIZE, 1, format, false) }?;
        let targets = RuntimeTargets::new(gpu, &wrapped)?;
        let mut images = Images::new(SwapchainImages { swapchain, stopwatch: Stopwatch::default() });
        let image = images.acquire().halt("taking an image of a ray")?;
        let mut encoder = gpu.encoder();
        targets.fill(&mut encoder, image.index(), COLOR);
        gpu.submit(encoder);
        image.release().halt("handing over an image of a ray")?;
        Ok(RayLayer { _targets: targets, images })
    }

    /// The layer that shows `ray`.
    pub(in crate::xr) fn quad<'a>(
        &'a self,
        stage: &'a xr::Space,
        ray: &PointerRay,
    ) -> xr::CompositionLayerQuad<'a, xr::Vulkan> {
        quad(&self.images.calls().swapchain, SIZE, stage, ray.pose(), ray.size_m())
    }
}
