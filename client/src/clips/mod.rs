//! Clips: where they come from, and which one plays next.
//!
//! ```text
//! file | URL | demo --source--> loader (a thread) --LoadEvent--> state --Change--> window | headset | images
//!         playlist --queue-----------^                            |
//!                                    +--------- LoadRequest ------+
//! ```
//!
//! `source` opens one clip as a take, `playlist` the list that names several, and `queue` orders them. The `loader`
//! carries requests out on the thread of a `worker`, up to takes that a `ClipTarget` can show. `state`
//! decides what to load and what to show; `controller` joins it with the thread.

mod advice;
#[cfg_attr(
    not(feature = "xr"),
    allow(dead_code, reason = "a headset uses all of it, images and a window less")
)]
mod controller;
pub(crate) mod demo;
mod event;
#[cfg(feature = "formats")]
mod field;
mod file;
mod folder;
mod loader;
pub mod playlist;
mod progress;
mod queue;
mod source;
mod source_options;
#[cfg_attr(
    not(feature = "xr"),
    allow(dead_code, reason = "a headset uses all of it, images and a window less")
)]
mod state;
mod url;
mod worker;

pub(crate) use advice::advice;
pub(crate) use controller::ClipController;
pub use event::LoadEvent;
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use folder::Direction;
pub use folder::Neighbours;
#[cfg(all(feature = "xr", any(target_os = "android", test)))]
pub(crate) use folder::clips_in;
#[cfg(not(target_os = "android"))]
pub(crate) use loader::too_few_layers;
pub(crate) use loader::{Beginning, ClipTarget, LoadOptions};
pub use progress::Progress;
pub use queue::{Entry, Queue};
#[cfg(not(target_os = "android"))]
pub use source::cache_dir;
pub use source::{Arrival, Wait, open};
pub use source_options::SourceOptions;
pub(crate) use state::Change;
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use state::Transition;
#[cfg(any(feature = "net", feature = "window", feature = "xr"))]
pub(crate) use url::is_url;
pub(crate) use url::redacted;
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use url::title;
#[cfg(feature = "net")]
pub(crate) use url::{has_user_info, is_secure, resolve};
pub(crate) use worker::{Report, Worker};
