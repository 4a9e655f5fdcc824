//! Decodes chunks of Gaussians with the decoder of any coder.

use super::{chunk::Chunk, grid, row::RowCoder, symbols::Symbols};
use crate::{Error, bytes::Reader, columns::Columns, error::FormatError, morton::deinterleave, rows::Rows};

/// Memory that decoding a chunk takes besides the clip: its cells, and the models of all columns.
pub(crate) const WORK_BYTES: usize = 1 << 20;

/// Decodes a chunk, as [`decode_with`] does with the decoder of a coder.
pub(crate) type DecodeChunk = fn(&[u8], u16, Columns, usize, Rows) -> Result<(), Error>;

/// A decoder.
pub(crate) trait Reading: Symbols {
    /// Whether it has read past the end.
    fn overrun(&self) -> bool;

    /// Number of bytes not read.
    fn left(&self) -> usize;

    /// Whether its final state is that of an encoder before the first symbol.
    fn is_complete(&self) -> bool;
}

/// Decodes a chunk into `out`, which has as many rows as the chunk, and the given columns or more: those keep
/// their zeros. `offset`, the offset of the section of `payload`, is for errors. `version_major` is that of the package;
/// `decoder` makes a decoder of the symbols.
///
/// # Errors
/// [`Error::Format`] if the payload is too short or too long, or a number is out of range.
pub(crate) fn decode_with<'a, S: Reading>(
    payload: &'a [u8],
    version_major: u16,
    columns: Columns,
    offset: usize,
    mut out: Rows,
    decoder: impl FnOnce(&'a [u8]) -> S,
) -> Result<(), Error> {
    const PART: &str = "chunk of Gaussians";
    let mut reader = Reader::new(payload, offset, PART);
    let chunk = Chunk::read(&mut reader, version_major)?;
    let symbols_at = reader.at();
    let mut decoder = decoder(reader.rest());
    let short = || Error::format(offset + payload.len(), FormatError::Short { part: PART });

    let mut cells = vec![0; out.centers.len()];
    grid::code(&mut decoder, u32::from(chunk.axis_bits), &mut cells);
    let mut coder = RowCoder::<S>::new(&chunk, columns);
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
