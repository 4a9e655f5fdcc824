//! Takes: clips of minutes, as segments that overlap in time.

mod decode;
mod head;
mod package;
#[cfg(feature = "encode")]
mod split;
mod table;

#[cfg(feature = "encode")]
pub use head::{SegmentPackage, encode_take_head};
pub use package::{Package, package};
#[cfg(feature = "encode")]
pub use split::{SplitSegment, split};
#[cfg(feature = "encode")]
pub use table::take_order;
pub use table::{Segment, SegmentLayer, Take};
