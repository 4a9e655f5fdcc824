//! Clips: where they come from, and which one plays next.
//!
//! ```text
//! source (file, URL, demo) -> loader (a thread) -> controller -> window | headset | images
//!   playlist -> queue ------------^                  |
//!                                 +---- LoadRequest --+
//! ```
//!
//! `source` opens one clip, `playlist` the list that names several, and `queue` orders them. The
//! controller decides what to load and what to show; a thread loads, and reports [`LoadEvent`]s.

pub(crate) mod demo;
mod event;
mod file;
pub mod playlist;
mod progress;
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) mod queue;
mod source;
mod url;

pub use event::LoadEvent;
#[cfg(feature = "xr")]
pub(crate) use file::clips_in;
#[cfg(feature = "net")]
pub(crate) use file::decode;
pub use file::load_file;
pub use progress::Progress;
#[cfg(not(target_os = "android"))]
pub use source::cache_dir;
pub use source::{Arrival, open};
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use url::title;
pub(crate) use url::{is_url, printable, redacted};
