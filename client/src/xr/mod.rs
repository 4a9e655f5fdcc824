//! The headset: plays a clip on any OpenXR runtime. Only this module names OpenXR.
//!
//! ```text
//! run -> runtime -> session -> frame: tracking -> show -> canvas -> layers
//!                                     (hands)     (clip, clock,    (eyes, panel, rays,
//!                                                  interaction,     passthrough)
//!                                                  panel)
//! ```
//!
//! `run` opens the device and the sessions, and replaces both when they are lost. `session` runs a frame:
//! `tracking` locates eyes and hands, `show` moves the clip and the panel by them, `canvas` draws and composes
//! the layers, `report` records. `state` (the lifecycle), `eye` (projections) and `frame` (the order of calls)
//! decide without a runtime, and so do `interaction`, `panel`, `quality` and `pacing`. Operating systems differ
//! only in `desktop` and `android`.
//!
//! One thread runs the frames, and only it submits to the GPU, because the runtime uses the same queue within
//! its calls ([`Gpu::submit`](crate::gpu::Gpu::submit) checks the thread). Another one loads clips up to buffers
//! and pipelines, which takes no submission.

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
