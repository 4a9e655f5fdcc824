//! Takes: clips of minutes, as segments that overlap in time.

mod decode;
mod head;
mod package;
mod span;
#[cfg(feature = "encode")]
mod split;
mod table;

#[cfg(feature = "encode")]
pub(crate) use head::write_take;
#[cfg(feature = "encode")]
pub use head::{SegmentPackage, encode_take_head};
pub use package::package;
pub use span::{Resident, SPAN_TOLERANCE_S, span_holds};
#[cfg(feature = "encode")]
pub use split::{SegmentGrid, SplitSegment, retime, split};
#[cfg(feature = "encode")]
pub(crate) use table::prefixes;
#[cfg(feature = "encode")]
pub use table::take_order;
pub use table::{Segment, SegmentLayer, Take};
