//! The headset: plays a clip on any OpenXR runtime. The only part that names that interface.
//!
//! `runtime` finds runtime and headset and has them open the graphics device; `session` is what is
//! drawn into and where hands come from; `show` is the clip, its clock, the panel and what hands do;
//! `run` runs the frames. `state` decides what follows from the runtime's events, `eye` where an eye looks,
//! and `frame` the order of calls for frames and images, all without a runtime.
//! Operating systems differ in `desktop` and `android` alone.
//!
//! One thread does all that is seen: it alone submits to the GPU, because a runtime uses the same
//! queue within the calls it is given ([`Gpu::submit`](crate::gpu::Gpu::submit) checks it). Clips are loaded on another, up
//! to buffers and pipelines, which takes no submission; frames go on meanwhile.

#[cfg(target_os = "android")]
mod android;
mod calls;
mod canvas;
#[cfg(not(target_os = "android"))]
mod desktop;
mod error;
mod extensions;
mod eye;
mod frame;
mod input;
pub mod interaction;
mod pacing;
pub mod panel;
mod panel_layer;
mod passthrough;
mod quad;
mod quality;
mod ray_layer;
mod report;
#[cfg(any(target_os = "android", test))]
mod request;
mod run;
mod runtime;
mod session;
mod show;
mod space;
mod state;
mod swapchain;
mod tracking;

#[cfg(target_os = "android")]
use android::System;
#[cfg(not(target_os = "android"))]
use desktop::System;
#[cfg(not(target_os = "android"))]
pub use run::run;
