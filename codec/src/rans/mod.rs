//! The coder `rans`: the model of a Gaussian of [`gaussian`](crate::gaussian) with an adaptive rANS coder and
//! arithmetic of few operations. Packages decode in less than half the time of those of the coder `context`.
//!
//! A number is coded as one of 16 tokens, whose distribution adapts, and bypass bits; see [`token`].

mod cdf;
mod decoder;
#[cfg(test)]
mod document;
#[cfg(feature = "encode")]
mod encoder;
mod integer;
mod math;
mod search;
mod start;
mod token;
#[cfg(all(test, feature = "encode"))]
mod training;
mod uniform;

#[cfg(all(test, feature = "encode"))]
pub(crate) use math::Math;

use crate::{
    Error,
    columns::Columns,
    gaussian::{BitObserver, decode_with},
    rows::Rows,
};
#[cfg(feature = "encode")]
use crate::{
    gaussian::{ChunkForm, EncodedChunk, encode_with},
    precision::Prepared,
};

/// Decodes a chunk; see [`decode_with`].
///
/// # Errors
/// See [`decode_with`].
pub(crate) fn decode(
    payload: &[u8],
    version_major: u16,
    columns: Columns,
    offset: usize,
    out: Rows,
) -> Result<(), Error> {
    decode_observed(payload, version_major, columns, offset, out, ())
}

/// Decodes as [`decode`] does, while `observer` sees the symbols.
///
/// # Errors
/// See [`decode`].
pub(crate) fn decode_observed(
    payload: &[u8],
    version_major: u16,
    columns: Columns,
    offset: usize,
    out: Rows,
    observer: impl BitObserver,
) -> Result<(), Error> {
    decode_with(payload, version_major, columns, offset, out, |bytes| decoder::Decoder::new(bytes, observer))
}

/// Encodes `rows` of a field as a chunk, as [`encode_with`] does.
#[cfg(feature = "encode")]
pub(crate) fn encode(source: &Prepared, rows: &[usize], columns: Columns, form: ChunkForm) -> EncodedChunk {
    encode_with::<encoder::Encoder>(source, rows, columns, form, decode)
}
