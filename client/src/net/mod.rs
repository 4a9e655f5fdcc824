//! Clips from URLs: [`Download`] fetches one, opens it when its first layer is there, and caches it.
//! `document` does the same for a file that is not a clip.
//!
//! ```text
//! request -> transfer -> partial_file -> OpenTake -> LoadEvent   request: HTTP; head: status and headers
//!      (fetch: a thread)           |                             transfer: what to request next
//!                                cache                           partial_file: the bytes, and what plays
//!                                                                cache: files of earlier runs, on disk
//! ```
//!
//! A `watch` ends a cancelled fetch, and a request whose bytes come too slowly; `wire` asks it below HTTP and
//! TLS.
//!
//! A take is no download: `remote_file` reads parts of it as playing needs them.
//!
//! A cached clip plays at once while the server is asked for a newer version. [`codec::Limits`] bounds
//! memory: a longer file is not fetched, and while the rest arrives, at most the bytes being decoded exist
//! twice.

mod cache;
mod document;
mod download;
mod fetch;
mod head;
mod meter;
mod partial_file;
mod remote_file;
mod request;
mod request_error;
mod retry;
mod transfer;
mod watch;
mod wire;

pub use cache::{CACHE_BYTES, Cache};
pub(crate) use document::document;
pub use download::{Download, Options};
pub(crate) use fetch::ArrivingFile;
pub(crate) use remote_file::RemoteFile;
pub use retry::RetryPolicy;
