//! [`RayLayer`]: the image of the pointer rays, of a single colour, filled once.

use std::sync::Arc;

use glam::UVec2;
use openxr as xr;

use super::quad::quad;
use super::swapchain::{ImageLayout, TargetSwapchain};
use crate::gpu::{Gpu, RuntimeFormat};
use crate::headset::panel::PointerRay;
use crate::xr::runtime::calls::Stopwatch;
use crate::xr::runtime::error::{During, Halt};

/// Some runtimes refuse smaller images.
const SIZE: UVec2 = UVec2::splat(16);

/// Half transparent white: the light 0.5 as an sRGB image stores it, see the stage `linear_light`.
const COLOR: [f64; 4] = [0.735_357, 0.735_357, 0.735_357, 0.5];

/// The pointer rays in a session.
pub(in crate::xr) struct RayLayer(TargetSwapchain);

impl RayLayer {
    /// Creates the image and fills it.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn open(
        session: &xr::Session<xr::Vulkan>,
        gpu: &Arc<Gpu>,
        format: RuntimeFormat,
    ) -> Result<RayLayer, Halt> {
        let layout = ImageLayout { format, size: SIZE, layers: 1, readable: false };
        let mut layer = TargetSwapchain::open(session, gpu, layout, Stopwatch::default())?;
        let image = layer.images.acquire().halt("taking an image of a ray")?;
        let mut encoder = gpu.encoder();
        layer.targets.fill(&mut encoder, image.index(), COLOR);
        gpu.submit(encoder);
        image.release().halt("handing over an image of a ray")?;
        Ok(RayLayer(layer))
    }

    /// The layer that shows `ray`.
    pub(in crate::xr) fn quad<'a>(
        &'a self,
        stage: &'a xr::Space,
        ray: &PointerRay,
    ) -> xr::CompositionLayerQuad<'a, xr::Vulkan> {
        quad(self.0.swapchain(), SIZE, stage, ray.pose(), ray.size_m())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stored_color_has_the_light_of_half_transparent_white() {
        let [red, green, blue, alpha] = COLOR;
        assert!(red == green && green == blue && alpha == 0.5);
        let light = ((red + 0.055) / 1.055).powf(2.4);
        assert!((light - alpha).abs() < 1e-5, "{light}");
    }
}
