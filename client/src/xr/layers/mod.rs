//! The layers of a frame: the room, the clip for both eyes, the panel and the pointer rays.
//!
//! `swapchain` makes their images, `canvas` draws and composes them.

pub(super) mod canvas;
pub(super) mod panel_layer;
pub(super) mod passthrough;
mod quad;
pub(super) mod ray_layer;
pub(super) mod swapchain;
