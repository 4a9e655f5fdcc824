//! Takes: everything that plays is one. A clip is a take of one segment, and so is a field of another program. A long take
//! is in memory only in the parts that playing needs.
//!
//! ```text
//! file | URL | demo --source--> opened (head, table) --> loader (a thread) --packed segments--> player --> slots of the renderer
//!                                      |                     ^  most urgent first                 |
//!                                      +------> plan --------+------------------------------------+
//! ```
//!
//! `plan` says which segments a position needs; it is pure. `player` is between two frames: it gives the loader the
//! missing ones, makes room, and uploads a bounded number of bytes.

mod buffered;
mod layers;
mod loader;
mod opened;
mod plan;
mod player;
mod source;

#[cfg(feature = "net")]
pub(crate) use layers::Traffic;
pub use opened::OpenTake;
pub use player::{Extent, TakeCounts, TakePlayer, UPLOAD_BYTES_MAX};
pub(crate) use source::TakeSource;
