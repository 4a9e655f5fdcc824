//! The coder `context`: quantisation steps from the visibility of each Gaussian, and an adaptive
//! range coder.
//!
//! The encoder quantises the visibility of every Gaussian to half octaves. This index and the
//! numbers already decoded determine all other steps, so that errors of all numbers are
//! equally visible. Gaussians come along a Morton curve; each number is coded under an expectation of its
//! magnitude that adapts to the last ones. [`row`] codes one Gaussian, with the same code for both
//! directions.
//!
//! Chunks are independent. Decoded numbers are the same on every machine: they are integers or
//! binary64 IEEE arithmetic in the order written.

mod bit;
mod chunk;
mod decode;
#[cfg(feature = "encode")]
mod encode;
mod grid;
mod math;
mod model;
mod neighbors;
mod observer;
mod range;
mod rotation;
mod row;
mod trajectory;

#[cfg(feature = "encode")]
pub(crate) use decode::decode_observed;
pub(crate) use decode::{WORK_BYTES, decode};
#[cfg(feature = "encode")]
pub(crate) use encode::{EncodedChunk, encode};
#[cfg(feature = "encode")]
pub(crate) use observer::{Attribute, BitStats};
