//! [`Canvas`]: the images of a session, and how they are drawn and laid over one another.

use std::sync::Arc;

use glam::UVec2;
use openxr as xr;

use super::panel_layer::PanelLayer;
use super::passthrough::PassthroughMode;
use super::ray_layer::RayLayer;
use super::swapchain::TargetSwapchain;
use crate::gpu::{Foveation, FrameCounts, Gpu, LinearLight, Pixels};
use crate::headset::panel::{Painting, PointerRay};
use crate::headset::show::Show;
use crate::view::View;
use crate::xr::runtime::calls::{SessionFrames, Stopwatch};
use crate::xr::runtime::error::{During, Halt};
use crate::xr::runtime::extensions::sharpening::Sharpening;
use crate::xr::runtime::frame::Frame;
use crate::xr::tracking::Eyes;
use crate::xr::tracking::eye;
use program::Fault;

/// Background while no clip is loaded: dark, and not the black of a defect.
const EMPTY: [f64; 4] = [0.06, 0.06, 0.07, 1.0];

/// Most layers of a frame: the room, the eyes, the panel and two rays. Every runtime takes 16.
const LAYERS: usize = 5;

/// What a session draws into.
pub(in crate::xr) struct Canvas {
    pub(in crate::xr) panel: PanelLayer,
    pub(in crate::xr) rays: RayLayer,
    pub(in crate::xr) eyes: TargetSwapchain,
    /// What foveated frames need; `None` if there is no memory for it.
    pub(in crate::xr) foveation: Option<Foveation>,
    pub(in crate::xr) passthrough: PassthroughMode,
    /// What frames over the room need; `None` if the room cannot be shown or there is no memory for it.
    pub(in crate::xr) linear: Option<LinearLight>,
    /// Size of an eye's image in pixels; a frame may use less of it.
    pub(in crate::xr) size: UVec2,
    pub(in crate::xr) stopwatch: Stopwatch,
    pub(in crate::xr) gpu: Arc<Gpu>,
}

/// The clip as a frame shows it.
pub(in crate::xr) struct DrawnClip {
    pub(in crate::xr) views: [View; 2],
    pub(in crate::xr) counts: FrameCounts,
}

impl Canvas {
    /// Draws the clip for both eyes, `size` pixels each; `None` while there is no clip to draw. With `is_captured` the
    /// clip can be read afterwards.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn draw(
        &mut self,
        eyes: &Eyes,
        size: UVec2,
        show: &mut Show,
        is_captured: bool,
    ) -> Result<Option<DrawnClip>, Halt> {
        let views = show.stage_from_clip().and_then(|stage_from_clip| {
            let view = |i: usize| eye::view(&eyes.poses[i], eyes.views[i].fov.into(), size, &stage_from_clip);
            Some([view(0)?, view(1)?])
        });
        let (t, settings) = (show.shown_time(), show.quality().settings());
        // The runtime may yet read the image: what needs none comes first.
        let drawn = views.zip(show.renderer()).map(|(views, renderer)| {
            let counts = renderer.prepare(&self.gpu, t, &views, &settings);
            DrawnClip { views, counts }
        });
        let TargetSwapchain { targets, images } = &mut self.eyes;
        let image = images.acquire().halt("taking an image")?;
        let mut encoder = self.gpu.encoder();
        // Without the room, nothing is behind the eyes: the runtime ignores their alpha.
        let linear = self.linear.as_ref().filter(|_| show.shows_passthrough());
        if let Some(renderer) = show.renderer().filter(|_| drawn.is_some()) {
            let eyes = targets.targets(image.index());
            renderer.record(&self.gpu, &mut encoder, eyes, self.foveation.as_ref(), linear);
        }
        if drawn.is_none() {
            let color = if show.shows_passthrough() { [0.0; 4] } else { EMPTY };
            targets.fill(&mut encoder, image.index(), color);
        } else if is_captured {
            targets.record_read(&mut encoder, image.index());
        }
        self.stopwatch.time(|| self.gpu.submit(encoder));
        image.release().halt("handing an image over")?;
        Ok(drawn)
    }

    /// Draws the new picture of the panel, if there is one.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn paint_panel(
        &mut self,
        show: &mut Show,
        painting: Option<Painting>,
    ) -> Result<(), Halt> {
        match show.painter().zip(painting) {
            Some((painter, painting)) => self.panel.paint(&self.gpu, painter, painting),
            None => Ok(()),
        }
    }

    /// Ends `frame` with the layers back to front: room, eyes, panel, rays.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn compose(
        &mut self,
        frame: Frame<'_, SessionFrames>,
        stage: &xr::Space,
        eyes: &Eyes,
        size: UVec2,
        rays: [Option<PointerRay>; 2],
        show: &Show,
    ) -> Result<(), Halt> {
        let passthrough = show.shows_passthrough();
        let projections = projections(self.eyes.swapchain(), &eyes.views, size);
        let alpha = if passthrough {
            xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA
        } else {
            xr::CompositionLayerFlags::EMPTY
        };
        let layer = xr::CompositionLayerProjection::new().layer_flags(alpha).space(stage).views(&projections);
        let sharpening = Sharpening::new(self.eyes.swapchain().instance(), size != self.size);
        let layer = match &sharpening {
            Some(sharpening) => sharpening.apply(layer),
            None => layer,
        };
        let room = self.passthrough.layer(passthrough);
        let panel = show.panel_quad().and_then(|panel| self.panel.quad(stage, panel));
        let rays = rays.map(|ray| ray.map(|ray| self.rays.quad(stage, &ray)));
        let mut layers: Vec<&xr::CompositionLayerBase<'_, xr::Vulkan>> = Vec::with_capacity(LAYERS);
        layers.extend(room.as_deref());
        layers.push(&layer);
        layers.extend(panel.as_deref());
        layers.extend(rays.iter().flatten().map(|ray| &**ray));
        frame.end(&layers).halt("ending a frame")
    }

    /// Ends `frame` without the clip, which nobody sees: empty, or with the room if it `shows_room`.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn compose_room(
        &mut self,
        frame: Frame<'_, SessionFrames>,
        shows_room: bool,
    ) -> Result<(), Halt> {
        let room = self.passthrough.layer(shows_room);
        let layers: Option<&xr::CompositionLayerBase<'_, xr::Vulkan>> = room.as_deref();
        frame.end(layers.as_slice()).halt("ending a frame")
    }

    /// Waits for the images of the frame drawn last: `size` pixels of each eye, and the panel if it is
    /// shown.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub(in crate::xr) fn read(&self, size: UVec2) -> Result<(Vec<Pixels>, Option<Pixels>), Fault> {
        let eyes = self.eyes.targets.read(&self.gpu)?.iter().map(|eye| eye.corner(size)).collect();
        Ok((eyes, self.panel.read(&self.gpu)?))
    }
}

/// `size` pixels in the corner of both layers of the image released last, at the pose and angles that they
/// were drawn for.
fn projections<'a>(
    swapchain: &'a xr::Swapchain<xr::Vulkan>,
    views: &[xr::View; 2],
    size: UVec2,
) -> [xr::CompositionLayerProjectionView<'a, xr::Vulkan>; 2] {
    let extent = xr::Extent2Di { width: size.x as i32, height: size.y as i32 };
    let rect = xr::Rect2Di { offset: xr::Offset2Di::default(), extent };
    [0, 1].map(|layer: usize| {
        let sub_image = xr::SwapchainSubImage::new()
            .swapchain(swapchain)
            .image_array_index(layer as u32)
            .image_rect(rect);
        let xr::View { pose, fov } = views[layer];
        xr::CompositionLayerProjectionView::new().pose(pose).fov(fov).sub_image(sub_image)
    })
}
