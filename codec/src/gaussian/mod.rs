//! The model of a Gaussian that the coders `context` and `rans` share: quantisation steps from its visibility,
//! predictions, and the order of its numbers.
//!
//! The encoder quantises the visibility of every Gaussian to half octaves, a little off where that takes fewer bits. This
//! index and the numbers already decoded determine all other steps, so that errors of all numbers are
//! equally visible. Gaussians come along a Morton curve; each number is coded under an expectation of its
//! magnitude that adapts to the last ones. [`row`] codes one Gaussian, with the same code for both
//! directions, against two traits that a coder implements: [`Symbols`] codes symbols, [`Arithmetic`] computes
//! the numbers that they stand for.
//!
//! Chunks are independent. Decoded numbers are the same on every machine: they are integers or
//! binary64 IEEE arithmetic in the order written.

mod arithmetic;
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
mod observer;
mod quantity;
mod rotation;
mod row;
mod symbols;
mod trajectory;

pub(crate) use arithmetic::{Arithmetic, Unit, half_octaves};
pub(crate) use decode::{DecodeChunk, Reading, WORK_BYTES, decode_with};
#[cfg(feature = "encode")]
pub(crate) use encode::{ChunkForm, EncodedChunk, Steps, encode_with};
pub(crate) use neighbors::{NEAREST, Search, WINDOW};
#[cfg(feature = "encode")]
pub(crate) use observer::BitStats;
pub(crate) use observer::{Attribute, BitObserver};
pub(crate) use quantity::CONTEXTS;
#[cfg(feature = "encode")]
pub(crate) use symbols::Writing;
pub(crate) use symbols::{Integer, Prior, Symbols, Tree};
