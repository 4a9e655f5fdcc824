//! The renderer: the only part that knows the graphics API.
//!
//! Once per clip: [`GpuClip::upload`] packs it into buffers, [`Renderer::new`] builds the
//! pipelines it needs. Per frame: [`Renderer::draw`] runs the stages `alive` and `sort` on the
//! CPU, `evaluate` and `splat` on the GPU.

mod clip;
mod device;
mod layers;
mod level;
mod pack;
#[cfg(feature = "window")]
mod picture;
mod readback;
mod renderer;
#[cfg(feature = "xr")]
mod runtime_targets;
mod settings;
mod stages;
#[cfg(feature = "window")]
mod surface;
mod target;
mod timing;
#[cfg(any(feature = "window", feature = "xr"))]
mod ui;

pub use clip::GpuClip;
pub(crate) use device::DEVICE_REPLACED;
pub use device::{Caps, Gpu, LOG_FILTER};
pub use level::Level;
pub use readback::Pixels;
pub use renderer::{Coverage, FrameCounts, Renderer};
pub use settings::{Cutoff, RenderSettings, SortOrder};
pub use stages::sort::{DIGIT_BITS as SORT_DIGIT_BITS, DIGITS as SORT_DIGITS};
pub use target::{ChannelDepth, Offscreen};
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use ui::UiPainter;
#[cfg(feature = "xr")]
pub(crate) use {
    device::Failures,
    device::vulkan::{RuntimeFormat, RuntimeImages, VulkanHandles, VulkanRuntime},
    runtime_targets::RuntimeTargets,
};
#[cfg(feature = "window")]
pub(crate) use {
    picture::Picture,
    surface::{Format, SurfaceFrame, WindowSurface},
};
