//! The coder `context`: steps as coarse as nobody sees, and an adaptive range coder.
//!
//! The encoder is told how visible every Gaussian is and codes it in classes of half an octave;
//! all other steps follow from the class and from what is already decoded, so that an error is as
//! visible wherever it falls. Gaussians come along a Morton curve; each number is coded under an
//! expectation of its size that follows the last ones. [`row`] holds the order of things; it is
//! written once for both directions.
//!
//! Chunks are independent. Decoded numbers are the same on every machine: what is not an integer
//! is IEEE arithmetic on 64 bits in the order written.

#[cfg(feature = "encode")]
mod encode;
mod grid;
mod math;
mod model;
mod neighbors;
mod range;
mod rotation;
mod row;
mod trajectory;
mod watch;

#[cfg(feature = "encode")]
pub(crate) use encode::{Prepared, columns_needed, encode};
#[cfg(feature = "encode")]
pub(crate) use watch::{BitStats, Part};

use crate::{Error, bytes::Reader, error::FormatError, fixed::Columns, rows::Rows};
use range::Decoder;
use row::RowCoder;
use watch::BitObserver;

/// Memory that decoding takes besides the clip: the cells of a chunk and the models of all
/// columns.
pub(crate) const WORK_BYTES: usize = 1 << 20;

/// What a chunk says before its symbols.
#[derive(Clone, Debug)]
struct Chunk {
    /// Colour step of the most visible class.
    step: f32,
    /// Standard deviation that a point has at the resolution that the chunk is coded for.
    footprint: f32,
    /// Lowest corner of the grid.
    origin: [f32; 3],
    /// Length of the edges of its cells.
    cell_size: f32,
    /// Cells along an edge of the grid: 2 to the power of this.
    axis_bits: u8,
}

/// Range of steps and of footprints. Format.
const STEP: std::ops::RangeInclusive<f32> = 1e-9..=1e3;
const FOOTPRINT: std::ops::RangeInclusive<f32> = 1e-15..=1e15;

impl Chunk {
    fn read(reader: &mut Reader) -> Result<Chunk, Error> {
        let at = reader.at();
        let chunk = Chunk {
            step: reader.f32()?,
            footprint: reader.f32()?,
            origin: reader.f32x3()?,
            cell_size: reader.f32()?,
            axis_bits: reader.u8()?,
        };
        let check = |valid: bool, field, value: f32| {
            if valid { Ok(()) } else { Err(Error::value(at, field, value)) }
        };
        check(STEP.contains(&chunk.step), "step", chunk.step)?;
        check(FOOTPRINT.contains(&chunk.footprint), "footprint", chunk.footprint)?;
        for x in chunk.origin {
            check(x.is_finite(), "origin of the grid", x)?;
        }
        let size = chunk.cell_size;
        check(size.is_finite() && size >= 0.0, "size of the grid's cells", size)?;
        let bits = chunk.axis_bits;
        check(u32::from(bits) <= grid::AXIS_BITS_MAX, "bits of the grid", f32::from(bits))?;
        Ok(chunk)
    }

    #[cfg(feature = "encode")]
    fn write(&self, writer: &mut crate::bytes::Writer) {
        writer.f32(self.step);
        writer.f32(self.footprint);
        writer.f32x3(self.origin);
        writer.f32(self.cell_size);
        writer.u8(self.axis_bits);
    }
}

/// Decodes the Gaussians of a chunk into `out`, which are as many and have the columns named.
/// `offset`, where the section of `payload` starts, is for errors.
///
/// # Errors
/// If the payload is too short or too long, or a number in it is out of range.
pub(crate) fn decode(payload: &[u8], columns: Columns, offset: usize, out: Rows) -> Result<(), Error> {
    decode_watched(payload, columns, offset, out, ())
}

/// Decodes as [`decode`] does, and tells `watch` of the symbols.
///
/// # Errors
/// Those of [`decode`].
pub(crate) fn decode_watched(
    payload: &[u8],
    columns: Columns,
    offset: usize,
    mut out: Rows,
    watch: impl BitObserver,
) -> Result<(), Error> {
    let mut reader = Reader::new(payload, offset, "chunk of Gaussians");
    let chunk = Chunk::read(&mut reader)?;
    let symbols_at = reader.at();
    let mut decoder = Decoder::new(reader.rest(), watch);
    let short = || Error::format(offset + payload.len(), FormatError::Short { part: "chunk of Gaussians" });

    let mut cells = vec![0; out.centers.len()];
    grid::code(&mut decoder, u32::from(chunk.axis_bits), &mut cells);
    let mut coder = RowCoder::new(&chunk, columns);
    for (i, cell) in cells.into_iter().enumerate() {
        if decoder.overrun() {
            return Err(short());
        }
        let row = coder
            .code(&mut decoder, grid::cell(cell), None)
            .ok_or_else(|| Error::value(symbols_at, "Gaussian", "a number out of range"))?;
        row.write_to(&mut out, i);
    }
    match decoder.left() {
        _ if decoder.overrun() => Err(short()),
        0 => Ok(()),
        count => {
            let at = offset + payload.len() - count;
            Err(Error::format(at, FormatError::Extra { count, part: "chunk of Gaussians" }))
        }
    }
}
