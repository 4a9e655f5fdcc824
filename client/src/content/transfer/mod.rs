//! Transfers: `RemoteFile` reads a package on a server in parts, and `document` fetches a small file whole.
//!
//! ```text
//! Download --- task (a thread) --- RemoteFile <- OpenTake      remote_file: parts of one version, from the cache or not
//!                                   |      |                   whole_file: for servers without ranges
//! document --- task ---------- exchange  cache                 exchange: requests, streams, what has arrived
//!                              |      |                        state: what to request next
//!                            state  request: HTTP, by a proxy     cache: files of earlier runs, on disk
//! ```
//!
//! A `watch` ends a request that was closed, and one whose bytes come too slowly; `wire` asks it below HTTP and TLS.
//!
//! A package whose head is cached plays at once while the server is asked for a newer version. [`codec::Limits`] bounds
//! memory.

mod cache;
mod document;
mod exchange;
mod head;
mod meter;
mod options;
mod proxy;
mod remote_file;
mod request;
mod request_error;
mod retry;
mod state;
mod task;
mod watch;
mod web_page;
mod whole_file;
mod wire;

pub use cache::{CACHE_BYTES, Cache};
pub(crate) use document::document;
pub use options::Options;
pub(crate) use options::{REPORT_INTERVAL, cached_version_note};
pub(crate) use remote_file::RemoteFile;
pub use retry::RetryPolicy;
pub(crate) use task::Task;
pub(crate) use web_page::{WEB_PAGE, is_web_page};
