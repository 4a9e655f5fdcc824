//! [`PanelLayer`]: the images of the panel, shown as a quad in the room.
//!
//! A new picture is drawn only when the panel changes; until then the runtime shows the last one.

#![allow(unsafe_code, reason = "images of the runtime are wrapped")]

use glam::UVec2;
use openxr as xr;
use program::Fault;

use super::quad::quad;
use super::swapchain::{make, wrap};
use crate::gpu::{Gpu, Pixels, RuntimeFormat, RuntimeTargets, UiPainter};
use crate::xr::panel::{PIXELS_PER_POINT, Painting, PanelQuad};
use crate::xr::runtime::calls::{Stopwatch, SwapchainImages};
use crate::xr::runtime::error::{During, Halt};
use crate::xr::runtime::frame::Images;

/// The panel in a session.
pub(in crate::xr) struct PanelLayer {
    // Before the images that they wrap.
    targets: RuntimeTargets,
    images: Images<SwapchainImages>,
    /// Whether a picture was drawn.
    painted: bool,
    /// Whether pictures can be read back.
    readable: bool,
    stopwatch: Stopwatch,
}

impl PanelLayer {
    /// Creates the images, which can be read back if `readable`.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn open(
        session: &xr::Session<xr::Vulkan>,
        gpu: &Gpu,
        format: RuntimeFormat,
        readable: bool,
        stopwatch: Stopwatch,
    ) -> Result<PanelLayer, Halt> {
        let size = UVec2::from(Painting::SIZE);
        let swapchain = make(session, format, size, 1, readable)?;
        // SAFETY: `make` had the same arguments; `targets` goes before `images`, which owns them, and is drawn
        // into only between acquiring and releasing.
        let images = unsafe { wrap(&swapchain, size, 1, format, readable) }?;
        Ok(PanelLayer {
            targets: RuntimeTargets::new(gpu, &images)?,
            images: Images::new(SwapchainImages { swapchain, stopwatch: stopwatch.clone() }),
            painted: false,
            readable,
            stopwatch,
        })
    }

    /// Draws a new picture.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn paint(
        &mut self,
        gpu: &Gpu,
        painter: &mut UiPainter,
        painting: Painting,
    ) -> Result<(), Halt> {
        let image = self.images.acquire().halt("taking an image of the panel")?;
        let mut encoder = gpu.encoder();
        let target = self.targets.ui_target(image.index());
        let (triangles, textures) = painting.into_parts();
        painter.draw(gpu, &mut encoder, &target, &triangles, PIXELS_PER_POINT, textures);
        if self.readable {
            self.targets.record_read(&mut encoder, image.index());
        }
        self.stopwatch.time(|| gpu.submit(encoder));
        image.release().halt("handing over an image of the panel")?;
        self.painted = true;
        Ok(())
    }

    /// The layer that shows the picture on `panel`; `None` before the first picture.
    pub(in crate::xr) fn quad<'a>(
        &'a self,
        stage: &'a xr::Space,
        panel: &PanelQuad,
    ) -> Option<xr::CompositionLayerQuad<'a, xr::Vulkan>> {
        let swapchain = &self.images.calls().swapchain;
        let pixels = UVec2::from(Painting::SIZE);
        self.painted.then(|| quad(swapchain, pixels, stage, panel.pose(), panel.size_m()))
    }

    /// Waits for the last picture; `None` if there is none or it cannot be read.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub(in crate::xr) fn read(&self, gpu: &Gpu) -> Result<Option<Pixels>, Fault> {
        if !self.painted {
            return Ok(None);
        }
        Ok(self.targets.read(gpu)?.pop())
    }
}
