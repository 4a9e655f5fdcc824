//! The runtime of a headset: plays a clip on any OpenXR runtime. Only this module names OpenXR.
//!
//! ```text
//! run -> runtime -> session -> frame: tracking -> headset -> layers
//!                                     (eyes,      (clip, clock,    (eyes, panel,
//!                                      hands)      interaction,     rays,
//!                                                  panel)           passthrough)
//! ```
//!
//! `run` opens the device and the sessions, and replaces both when they are lost. `session` runs a frame:
//! `tracking` locates eyes and hands, [`headset`](crate::headset) moves the clip and the panel by them, `layers` draws and
//! composes them, `report` records. `session::state` (the lifecycle), `tracking::eye` (projections) and `runtime::frame`
//! (the order of calls) decide without a runtime. Operating systems differ only in `system`, and in `entry`, where
//! Android enters the library.
//!
//! One thread runs the frames, and only it submits to the GPU, because the runtime uses the same queue within
//! its calls ([`Gpu::submit`](crate::gpu::Gpu::submit) checks the thread). Another one loads clips up to buffers
//! and pipelines, which takes no submission.

#[cfg(target_os = "android")]
mod entry;
mod layers;
mod report;
mod run;
mod runtime;
mod session;
mod system;
mod tracking;

#[cfg(not(target_os = "android"))]
pub use run::run;
use system::System;
pub use system::clip_limits;
