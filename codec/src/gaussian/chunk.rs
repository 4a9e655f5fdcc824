//! [`Chunk`]: the head of a chunk, before its symbols.

use std::ops::RangeInclusive;

use super::grid;
use crate::{Error, bytes::Reader};

/// The head of a chunk.
#[derive(Clone, Debug)]
pub(super) struct Chunk {
    /// Quantisation step of a colour at visibility index 0.
    pub(super) step: f32,
    /// Standard deviation, in source units, to which a pixel blurs a point.
    pub(super) footprint: f32,
    /// Lowest corner of the grid.
    pub(super) origin: [f32; 3],
    /// Length of the edges of a cell.
    pub(super) cell_size: f32,
    /// Binary logarithm of the number of cells along an edge of the grid.
    pub(super) axis_bits: u8,
    /// Whether neighbours predict.
    pub(super) has_neighbors: bool,
}

/// Bit of the flags: neighbours do not predict. Format.
const WITHOUT_NEIGHBORS: u8 = 1;

/// Valid steps and footprints. Format.
pub(super) const STEP: RangeInclusive<f32> = 1e-9..=1e3;
pub(super) const FOOTPRINT: RangeInclusive<f32> = 1e-15..=1e15;

impl Chunk {
    /// Reads the head of a chunk.
    pub(super) fn read(reader: &mut Reader) -> Result<Chunk, Error> {
        let at = reader.at();
        let mut chunk = Chunk {
            step: reader.f32()?,
            footprint: reader.f32()?,
            origin: reader.f32x3()?,
            cell_size: reader.f32()?,
            axis_bits: reader.u8()?,
            has_neighbors: true,
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
        let at = reader.at();
        let flags = reader.u8()?;
        if flags & !WITHOUT_NEIGHBORS != 0 {
            return Err(Error::value(at, "flags of a chunk", flags));
        }
        chunk.has_neighbors = flags & WITHOUT_NEIGHBORS == 0;
        Ok(chunk)
    }

    /// Writes the head of a chunk.
    #[cfg(feature = "encode")]
    pub(super) fn write(&self, writer: &mut crate::bytes::Writer) {
        writer.f32(self.step);
        writer.f32(self.footprint);
        writer.f32x3(self.origin);
        writer.f32(self.cell_size);
        writer.u8(self.axis_bits);
        writer.u8(if self.has_neighbors { 0 } else { WITHOUT_NEIGHBORS });
    }
}
