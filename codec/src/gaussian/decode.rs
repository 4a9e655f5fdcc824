//! Decodes chunks of Gaussians.

use super::{chunk::Chunk, grid, row::RowCoder};
use crate::{
    Error,
    bytes::Reader,
    columns::Columns,
    error::FormatError,
    morton::deinterleave,
    rans::{BitObserver, Decoder},
    rows::Rows,
};

/// Memory that decoding a chunk takes besides the clip: its cells, and the models of all columns.
pub(crate) const WORK_BYTES: usize = 1 << 20;

/// Decodes a chunk into `out`, which has as many rows as the chunk, and the given columns or more: those keep
/// their zeros. `offset`, the offset of the section of `payload`, is for errors.
///
/// # Errors
/// [`Error::Format`] if the payload is too short or too long, or a number is out of range.
pub(crate) fn decode(payload: &[u8], columns: Columns, offset: usize, out: Rows) -> Result<(), Error> {
    decode_observed(payload, columns, offset, out, ())
}

/// Decodes as [`decode`] does, while `observer` sees the symbols.
///
/// # Errors
/// See [`decode`].
pub(crate) fn decode_observed(
    payload: &[u8],
    columns: Columns,
    offset: usize,
    mut out: Rows,
    observer: impl BitObserver,
) -> Result<(), Error> {
    const PART: &str = "chunk of Gaussians";
    let mut reader = Reader::new(payload, offset, PART);
    let chunk = Chunk::read(&mut reader)?;
    let symbols_at = reader.at();
    let mut decoder = Decoder::new(reader.rest(), observer);
    let short = || Error::format(offset + payload.len(), FormatError::Short { part: PART });

    let mut cells = vec![0; out.centers.len()];
    grid::code(&mut decoder, u32::from(chunk.axis_bits), &mut cells);
    let mut coder = RowCoder::new(&chunk, columns);
    for (i, cell) in cells.into_iter().enumerate() {
        if decoder.overrun() {
            return Err(short());
        }
        let row = coder
            .code(&mut decoder, deinterleave(cell), None)
            .ok_or_else(|| Error::value(symbols_at, "Gaussian", "a number out of range"))?;
        row.write_to(&mut out, i);
    }
    match decoder.left() {
        _ if decoder.overrun() => Err(short()),
        0 if !decoder.is_complete() => Err(Error::value(symbols_at, "final state", "not the initial one")),
        0 => Ok(()),
        count => Err(Error::format(offset + payload.len() - count, FormatError::Extra { count, part: PART })),
    }
}
