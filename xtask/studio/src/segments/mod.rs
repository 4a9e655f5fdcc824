//! Takes of segments: packages on disk and field folders.
//!
//! ```text
//! join:    fields, packages, folders -> field folder
//! trim:    take -> the segments that overlap a part of it, byte for byte -> take
//! ```
//!
//! Every stage holds one segment in memory at a time; only [`DecodedTake`] holds all that it is asked for.

mod agreement;
mod course;
mod decoded;
mod file;
mod folder;
mod join;
mod span;
mod trim;
#[cfg(feature = "measure")]
mod walk;
mod writer;

pub(crate) use agreement::Agreement;
pub(crate) use course::course;
pub use course::{Course, CourseRow};
pub use decoded::DecodedTake;
pub use file::TakeFile;
pub(crate) use folder::FolderEntry;
pub use folder::{FIELD_FOLDER_VERSION, FieldFolder};
pub use join::{JoinPlan, JoinedTake};
pub use span::Span;
pub(crate) use span::{gaps, held_at_starts, order_of};
pub use trim::{TrimmedTake, trim};
#[cfg(feature = "measure")]
pub(crate) use walk::TakeWalk;
pub(crate) use writer::TakeWriter;
