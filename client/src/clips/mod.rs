//! Clips: which one plays next.
//!
//! ```text
//! name --playlist--> queue --LoadRequest--> loader (a thread) --LoadEvent--> state --Change--> window | headset | images
//!                                ^                                             |
//!                                +---------------------------------------------+
//! ```
//!
//! `playlist` reads the list that names several clips, and `queue` orders them. The `loader` carries requests out on a
//! thread, up to clips that a `ClipTarget` can show. `state` decides what to load and what to show; `controller` joins it
//! with the thread.

#[cfg_attr(
    not(feature = "xr"),
    allow(dead_code, reason = "a headset uses all of it, images and a window less")
)]
mod controller;
mod event;
mod folder;
mod loader;
pub mod playlist;
mod queue;
#[cfg_attr(
    not(feature = "xr"),
    allow(dead_code, reason = "a headset uses all of it, images and a window less")
)]
mod state;

pub(crate) use controller::ClipController;
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use folder::Direction;
#[cfg(all(feature = "xr", any(target_os = "android", test)))]
pub(crate) use folder::clips_in;
#[cfg(not(target_os = "android"))]
pub(crate) use loader::too_few_layers;
pub(crate) use loader::{ClipTarget, LoadOptions};
pub use queue::{Entry, Queue};
pub(crate) use state::Change;
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use state::Transition;
