//! [`PanelLayer`]: the images of the panel, shown as a quad in the room.
//!
//! A new picture is drawn only when the panel changes; until then the runtime shows the last one.

use std::sync::Arc;

use glam::UVec2;
use openxr as xr;
use program::Fault;

use super::quad::quad;
use super::swapchain::{ImageLayout, TargetSwapchain};
use crate::gpu::{Gpu, LinearLight, Pixels, RuntimeFormat, UiPainter};
use crate::headset::panel::{PIXELS_PER_POINT, Painting, PanelQuad};
use crate::xr::runtime::calls::Stopwatch;
use crate::xr::runtime::error::{During, Halt};

/// The panel in a session.
pub(in crate::xr) struct PanelLayer {
    layer: TargetSwapchain,
    /// What a picture is drawn into before it is converted.
    drawn: LinearLight,
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
        gpu: &Arc<Gpu>,
        format: RuntimeFormat,
        readable: bool,
        stopwatch: Stopwatch,
    ) -> Result<PanelLayer, Halt> {
        let size = UVec2::from(Painting::SIZE);
        let layout = ImageLayout { format, size, layers: 1, readable };
        Ok(PanelLayer {
            layer: TargetSwapchain::open(session, gpu, layout, stopwatch.clone())?,
            drawn: LinearLight::new(gpu, format.drawn(), 1, size)?,
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
        let TargetSwapchain { targets, images } = &mut self.layer;
        let image = images.acquire().halt("taking an image of the panel")?;
        let mut encoder = gpu.encoder();
        let (triangles, textures) = painting.into_parts();
        painter.draw(gpu, &mut encoder, &self.drawn.ui_target(), &triangles, PIXELS_PER_POINT, textures);
        self.drawn.convert(&mut encoder, &targets.targets(image.index())[0]);
        if self.readable {
            targets.record_read(&mut encoder, image.index());
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
        let pixels = UVec2::from(Painting::SIZE);
        self.painted.then(|| quad(self.layer.swapchain(), pixels, stage, panel.pose(), panel.size_m()))
    }

    /// Waits for the last picture; `None` if there is none or it cannot be read.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub(in crate::xr) fn read(&self, gpu: &Gpu) -> Result<Option<Pixels>, Fault> {
        if !self.painted {
            return Ok(None);
        }
        Ok(self.layer.targets.read(gpu)?.pop())
    }
}
