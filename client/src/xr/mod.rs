//! The headset: plays a clip on any OpenXR runtime. Only this module names OpenXR.
//!
//! ```text
//! run -> runtime -> session -> frame: tracking -> show -> layers
//!                                     (eyes,      (clip, clock,    (eyes, panel, rays,
//!                                      hands)      interaction,     passthrough)
//!                                                  panel)
//! ```
//!
//! `run` opens the device and the sessions, and replaces both when they are lost. `session` runs a frame:
//! `tracking` locates eyes and hands, `show` moves the clip and the panel by them, `layers` draws and composes
//! them, `report` records. `session::state` (the lifecycle), `tracking::eye` (projections) and `runtime::frame`
//! (the order of calls) decide without a runtime, and so do `interaction`, `panel`, `show::quality` and `pacing`.
//! Operating systems differ only in `system`.
//!
//! One thread runs the frames, and only it submits to the GPU, because the runtime uses the same queue within
//! its calls ([`Gpu::submit`](crate::gpu::Gpu::submit) checks the thread). Another one loads clips up to buffers
//! and pipelines, which takes no submission.

pub mod interaction;
mod layers;
mod pacing;
pub mod panel;
mod report;
mod run;
mod runtime;
mod session;
mod show;
mod system;
mod tracking;

#[cfg(not(target_os = "android"))]
pub use run::run;
use system::System;
pub use system::clip_limits;
