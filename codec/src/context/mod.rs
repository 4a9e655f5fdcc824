//! The coder `context`: the model of a Gaussian of [`gaussian`](crate::gaussian) with an adaptive binary range
//! coder.
//!
//! A number is coded under an expectation of its magnitude as the bit length of the magnitude in unary, the sign,
//! then the bits below the top one.

mod bit;
mod integer;
mod math;
mod range;
mod search;

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
    decode_with(payload, version_major, columns, offset, out, |bytes| range::Decoder::new(bytes, observer))
}

/// Encodes `rows` of a field as a chunk, as [`encode_with`] does.
#[cfg(feature = "encode")]
pub(crate) fn encode(source: &Prepared, rows: &[usize], columns: Columns, form: ChunkForm) -> EncodedChunk {
    encode_with::<range::Encoder>(source, rows, columns, form, decode)
}
