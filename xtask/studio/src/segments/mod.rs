//! Takes of segments: packages on disk, field folders, and what is made of them.
//!
//! ```text
//! join:    fields, packages, folders -> field folder
//! package: field folder, or a field cut into levels -> budgets -> package by package -> take
//! trim:    take -> the segments that overlap a part of it, byte for byte -> take
//! ```
//!
//! Every stage holds one segment in memory at a time; only [`DecodedTake`] holds all that it is asked for.

mod agreement;
mod budget;
mod course;
mod decoded;
mod file;
mod folder;
mod join;
mod package;
mod report;
mod sources;
mod span;
mod trim;
#[cfg(feature = "measure")]
mod walk;
mod writer;

pub(crate) use course::course;
pub use course::{Course, CourseRow};
pub use decoded::DecodedTake;
pub use file::TakeFile;
pub(crate) use folder::FolderEntry;
pub use folder::{FIELD_FOLDER_VERSION, FieldFolder};
pub use join::{JoinPlan, JoinedTake};
pub use package::package_take;
pub use report::{SegmentReport, TakeReport};
pub use sources::SegmentSources;
pub use span::Span;
pub(crate) use span::{gaps, order_of};
pub use trim::{TrimmedTake, trim};
#[cfg(feature = "measure")]
pub(crate) use walk::TakeWalk;
