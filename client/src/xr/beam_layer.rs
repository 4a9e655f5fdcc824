//! [`BeamLayer`]: the image that the beams from hands to the panel are shown with, all of one
//! colour, filled once.

#![allow(unsafe_code, reason = "images of the runtime are wrapped")]

use glam::UVec2;
use openxr as xr;

use super::calls::{SwapchainImages, Watch};
use super::error::{During, Halt};
use super::frame::Images;
use super::panel::Beam;
use super::quad::quad;
use super::swapchain::{make, wrap};
use crate::gpu::{Gpu, RuntimeFormat, RuntimeTargets};

/// Smaller ones are refused by some runtimes.
const SIZE: UVec2 = UVec2::splat(16);

/// White, half of it: what is behind shows through.
const COLOR: [f64; 4] = [0.5; 4];

/// The beams in a session.
pub(super) struct BeamLayer {
    // Before the images that they wrap.
    _targets: RuntimeTargets,
    images: Images<SwapchainImages>,
}

impl BeamLayer {
    /// Makes the image and fills it.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn open(
        session: &xr::Session<xr::Vulkan>,
        gpu: &Gpu,
        format: RuntimeFormat,
    ) -> Result<BeamLayer, Halt> {
        let swapchain = make(session, format, SIZE, 1, false)?;
        // SAFETY: as `make` promises; `_targets` goes before `images`, which owns them, and is drawn
        // into only between acquiring and releasing.
        let wrapped = unsafe { wrap(&swapchain, SIZE, 1, format, false) }?;
        let targets = RuntimeTargets::new(gpu, &wrapped)?;
        let mut images = Images::new(SwapchainImages { swapchain, watch: Watch::default() });
        let image = images.acquire().halt("taking an image of a beam")?;
        let mut encoder = gpu.encoder();
        targets.fill(&mut encoder, image.index(), COLOR);
        gpu.submit(encoder);
        image.release().halt("handing over an image of a beam")?;
        Ok(BeamLayer { _targets: targets, images })
    }

    /// How `beam` is shown.
    pub(super) fn quad<'a>(
        &'a self,
        stage: &'a xr::Space,
        beam: &Beam,
    ) -> xr::CompositionLayerQuad<'a, xr::Vulkan> {
        quad(&self.images.calls().swapchain, SIZE, stage, beam.pose(), beam.size_m())
    }
}
