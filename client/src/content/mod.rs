//! What plays: everything is a take. A clip is a take of one segment, and so is a field of another program.
//!
//! ```text
//! file | URL | demo | field --open--> OpenTake (head, table) --Want--> packed segments
//!                                        |
//!                                      source: memory, a file, or transfer (parts of a file on a server, cached)
//! ```
//!
//! `open` opens a name, `opened` reads and decodes the segments, and `plan` says which of them a position needs. `download`
//! opens a URL while its server answers.

mod advice;
pub(crate) mod demo;
#[cfg(any(feature = "net", feature = "xr"))]
mod digest;
#[cfg(feature = "net")]
mod download;
mod event;
#[cfg(feature = "formats")]
mod field;
mod file;
mod open;
mod opened;
mod plan;
mod progress;
mod source;
mod source_options;
#[cfg(feature = "net")]
pub mod transfer;
pub(crate) mod url;

#[cfg(any(feature = "net", feature = "xr"))]
pub(crate) use digest::digest;
#[cfg(feature = "net")]
pub use download::Download;
pub use event::OpenEvent;
pub(crate) use file::read as read_file;
#[cfg(not(target_os = "android"))]
pub use open::cache_dir;
#[cfg(feature = "net")]
pub(crate) use open::net_options;
#[cfg(not(feature = "net"))]
pub(crate) use open::no_net;
pub use open::{Arrival, open};
pub use opened::OpenTake;
pub(crate) use opened::{LoadError, Loaded, PackedWant};
pub(crate) use plan::{Direction, Needs, Plan, Playhead, Want, needs, span};
pub use progress::Progress;
pub(crate) use progress::Traffic;
pub use source_options::SourceOptions;
#[cfg(any(feature = "net", feature = "xr"))]
pub(crate) use url::request_url;
#[cfg(feature = "net")]
pub(crate) use url::{has_user_info, host_name, is_secure, resolve};
pub(crate) use url::{is_url, redacted, title};
