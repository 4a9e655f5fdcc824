//! The entropy coder of the coder `rans`, whose models of numbers adapt, and its arithmetic of few operations.
//!
//! A number is coded as one of 16 tokens, whose distribution adapts, and bypass bits; see [`token`]. What the numbers
//! of a Gaussian mean is in [`gaussian`](crate::gaussian).

mod cdf;
mod decoder;
#[cfg(test)]
mod document;
#[cfg(feature = "encode")]
mod encoder;
mod integer;
pub(crate) mod math;
mod observer;
mod start;
mod symbols;
mod token;
mod uniform;

pub(crate) use decoder::Decoder;
#[cfg(feature = "encode")]
pub(crate) use encoder::Encoder;
pub(crate) use integer::{NibbleTree, TokenInteger};
#[cfg(feature = "encode")]
pub(crate) use observer::BitStats;
pub(crate) use observer::{Attribute, BitObserver};
pub(crate) use start::Prior;
pub(crate) use symbols::Symbols;
