//! One command over many takes: shards of a list, and records of finished outputs.
//!
//! ```text
//! list -> shard -> take -> key, of its inputs and options -> record beside its output: done, begun or neither
//! ```
//!
//! There is no scheduler: each machine gets a [`Shard`] and reads only the records of its outputs.

mod key;
mod list;
mod record;

pub use key::key;
pub use list::{List, ListedTake, Shard, TAKES_MAX};
pub use record::{OutputState, Record, record_path};
