//! The player of a take: the segments that playing needs, in GPU memory. A long take is there only in parts.
//!
//! ```text
//! OpenTake --loader (a thread)--packed segments--> take_player --> slots of the renderer
//!    |           ^  most urgent first                 |
//!    +-> plan ---+------------------------------------+
//! ```
//!
//! `take_player` is between two frames: it gives the loader the missing segments, makes room, and uploads a bounded
//! number of bytes. `layers` says how many layers of a segment a network brings in time.

mod beginning;
mod buffered;
mod layers;
mod loader;
mod take_player;

pub(crate) use beginning::Beginning;
pub use take_player::{Extent, TakeCounts, TakePlayer, UPLOAD_BYTES_MAX};
