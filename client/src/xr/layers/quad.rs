//! Quad layers: flat images in the stage.

use glam::{UVec2, Vec2};
use openxr as xr;

use crate::headset::interaction::Pose;

/// The image of `swapchain` released last, `pixels` in size and premultiplied in linear light, at `pose` in `stage` and
/// `meters` wide and high.
pub(in crate::xr) fn quad<'a>(
    swapchain: &'a xr::Swapchain<xr::Vulkan>,
    pixels: UVec2,
    stage: &'a xr::Space,
    pose: &Pose,
    meters: Vec2,
) -> xr::CompositionLayerQuad<'a, xr::Vulkan> {
    let (p, q) = (pose.position, pose.orientation);
    let extent = xr::Extent2Di { width: pixels.x as i32, height: pixels.y as i32 };
    let sub_image = xr::SwapchainSubImage::new()
        .swapchain(swapchain)
        .image_rect(xr::Rect2Di { offset: xr::Offset2Di::default(), extent });
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
}
