//! Many takes, one command: which of them are whose, and which are done.
//!
//! ```text
//! list -> shard -> take -> key, of its inputs and options -> record beside its output: done, begun or neither
//! ```
//!
//! Nobody schedules here: each of several machines is given a [`Shard`], and looks at outputs alone.

mod key;
mod list;
mod record;

pub use key::key;
pub use list::{List, Shard, TAKES_MAX, Take};
pub use record::{Record, Standing, record_path};
