//! The coder `rans`: quantisation steps from the visibility of a Gaussian, predictions, and the order of its numbers.
//!
//! The encoder quantises the visibility of every Gaussian to half octaves, a little off where that takes fewer bits. This
//! index and the numbers already decoded determine all other steps, so that errors of all numbers are
//! equally visible. Gaussians come along a Morton curve; each number is coded under an expectation of its
//! magnitude that adapts to the last ones. [`row`] codes one Gaussian, with the same code for both
//! directions, against a trait that the encoder and the decoder of [`rans`](crate::rans) implement:
//! [`Symbols`](crate::rans::Symbols).
//!
//! Chunks are independent. Decoded numbers are the same on every machine: they are integers or
//! binary64 IEEE arithmetic in the order written, by the functions of [`math`](crate::rans::math).

mod chunk;
mod color;
mod decode;
mod decoded;
#[cfg(feature = "encode")]
mod encode;
mod grid;
#[cfg(feature = "encode")]
mod indices;
mod neighbors;
mod quantity;
mod rotation;
mod row;
mod search;
mod trajectory;

#[cfg(feature = "encode")]
pub(crate) use decode::decode_observed;
pub(crate) use decode::{WORK_BYTES, decode};
#[cfg(feature = "encode")]
pub(crate) use encode::{ChunkForm, Steps, encode};
