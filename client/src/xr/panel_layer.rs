//! [`PanelLayer`]: the images that the panel is shown on, as a board in the room.
//!
//! A new picture is drawn only when something on the panel changes; until then the runtime goes on
//! showing the last one.

#![allow(unsafe_code, reason = "images of the runtime are wrapped")]

use glam::UVec2;
use openxr as xr;

use super::calls::{SwapchainImages, Watch};
use super::error::{During, Halt};
use super::frame::Images;
use super::panel::{Board, PIXELS_PER_POINT, Painting};
use super::swapchain::{make, wrap};
use crate::gpu::{Gpu, RuntimeFormat, RuntimeTargets, UiPainter};

/// The panel in a session.
pub(super) struct PanelLayer {
    // Before the images that they wrap.
    targets: RuntimeTargets,
    images: Images<SwapchainImages>,
    /// Whether there is a picture.
    painted: bool,
    watch: Watch,
}

impl PanelLayer {
    /// Makes its images.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn open(
        session: &xr::Session<xr::Vulkan>,
        gpu: &Gpu,
        format: RuntimeFormat,
        watch: Watch,
    ) -> Result<PanelLayer, Halt> {
        let size = UVec2::from(Painting::SIZE);
        let swapchain = make(session, format, size, 1, false)?;
        // SAFETY: as `make` promises; `targets` goes before `images`, which owns them, and
        // is drawn into only between acquiring and releasing.
        let images = unsafe { wrap(&swapchain, size, 1, format, false) }?;
        Ok(PanelLayer {
            targets: RuntimeTargets::new(gpu, &images)?,
            images: Images::new(SwapchainImages { swapchain, watch: watch.clone() }),
            painted: false,
            watch,
        })
    }

    /// Draws a new picture.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn paint(
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
        self.watch.time(|| gpu.submit(encoder));
        image.release().halt("handing over an image of the panel")?;
        self.painted = true;
        Ok(())
    }

    /// How it is shown on `board`; `None` before there is a picture.
    pub(super) fn quad<'a>(
        &'a self,
        stage: &'a xr::Space,
        board: &Board,
    ) -> Option<xr::CompositionLayerQuad<'a, xr::Vulkan>> {
        let ([width, height], meters, pose) = (Painting::SIZE, board.size_m(), board.pose());
        let (p, q) = (pose.position, pose.orientation);
        let extent = xr::Extent2Di { width: width as i32, height: height as i32 };
        let sub_image = xr::SwapchainSubImage::new()
            .swapchain(&self.images.calls().swapchain)
            .image_rect(xr::Rect2Di { offset: xr::Offset2Di::default(), extent });
        self.painted.then(|| {
            xr::CompositionLayerQuad::new()
                .layer_flags(xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA)
                .space(stage)
                .eye_visibility(xr::EyeVisibility::BOTH)
                .sub_image(sub_image)
                .pose(xr::Posef {
                    orientation: xr::Quaternionf { x: q.x, y: q.y, z: q.z, w: q.w },
                    position: xr::Vector3f { x: p.x, y: p.y, z: p.z },
                })
                .size(xr::Extent2Df { width: meters.x, height: meters.y })
        })
    }
}
