//! The renderer: the only module that uses the graphics API.
//!
//! Once per device, [`choose_f16`] measures whether the fragment stage may calculate in f16.
//! Once per take, [`Renderer::new_take`] builds buffers of fixed size and the pipelines that the device does not have yet.
//! While it plays, its segments are packed by a loader ([`PackedSegment::new`], [`PackedLayers::new`]), and come and go
//! between frames ([`Slots`]). A clip is the only segment.
//! Per frame, [`Renderer::prepare`] runs the stages `alive` and `sort` on the CPU, and [`Renderer::record`] records
//! `evaluate` and `splat`, and for a foveated frame `foveate`, for the GPU.

mod counts;
mod device;
mod division;
mod footprint;
mod foveation;
mod frame_views;
mod half_precision;
mod layer_run;
mod layers;
mod level;
mod pack;
mod pass;
#[cfg(feature = "window")]
mod picture;
mod readback;
mod renderer;
#[cfg(feature = "xr")]
mod runtime_targets;
mod segment;
mod settings;
mod slots;
mod span;
mod stages;
#[cfg(feature = "window")]
mod surface;
mod target;
mod timing;
#[cfg(any(feature = "window", feature = "xr"))]
mod ui;

pub use counts::{Coverage, FrameCounts};
pub(crate) use device::DEVICE_REPLACED;
pub use device::{Caps, Gpu, LOG_FILTER, PipelineStore};
pub use footprint::{RESIDENT_BYTES, UPLOAD_BYTES};
pub use foveation::Foveation;
pub use half_precision::{choose_f16, f16_psnr};
pub use level::Level;
pub use readback::Pixels;
pub use renderer::{FrameLayout, Renderer};
pub use segment::{PackedLayers, PackedSegment, PlateLayout, TakeLayout};
pub use settings::{Cutoff, RenderSettings, SortOrder};
pub use slots::{SlotId, Slots};
pub use span::Span;
pub use stages::clip::GpuClip;
pub use stages::linear_light::LinearLight;
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
