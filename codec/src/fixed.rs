//! The coder `fixed`: the paper's FP16 and INT8 attributes and 10-bit motion coefficients, then
//! zstd.
//!
//! A chunk is a list of ranges, then one plane of bytes per column and component; wider numbers are
//! split into planes too. So bytes of one meaning lie together for zstd. Ranges belong to the chunk:
//! chunks decode independently. An outlier that would cost its chunk too much precision is cut to the range of the others.

mod decode;
#[cfg(feature = "encode")]
mod encode;
mod ranges;

pub(crate) use decode::decode;
#[cfg(feature = "encode")]
pub(crate) use encode::{encode, nonzero_columns};
pub(crate) use ranges::raw_bytes;
