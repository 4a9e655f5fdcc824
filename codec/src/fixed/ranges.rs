//! [`Ranges`]: the head of a chunk of the coder `fixed`, which gives the codes their meaning.

use crate::{
    Error, MOTION_ORDER_MAX, SH_DEGREE_MAX,
    bytes::Reader,
    columns::Columns,
    quant::{Range8, Signed},
    sh_coefficients,
};

/// Length of a chunk of `rows` Gaussians before compression, in bytes.
pub(crate) fn raw_bytes(columns: Columns, rows: usize) -> usize {
    let degree = usize::from(columns.sh_degree);
    let mut ranges = 4 + 2 + 2 + degree;
    let mut row_bytes = 6 + 3 + 4 + 1 + 3 * sh_coefficients(columns.sh_degree);
    let mut motion_columns = 0;
    if let Some(temporal) = columns.temporal {
        let order = usize::from(temporal.motion_order);
        ranges += order + usize::from(temporal.rotation_rates);
        row_bytes += 4 + 4 * usize::from(temporal.rotation_rates);
        motion_columns = 3 * order;
    }
    4 * ranges + rows * row_bytes + motion_columns * (rows + rows.div_ceil(4))
}

/// Ranges of the codes of a chunk. Absent columns have a step of zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ranges {
    /// Origin of the centres.
    pub(super) origin: [f32; 3],
    /// Unit of the centres' distances from the origin.
    pub(super) extent: f32,
    pub(super) log_scale: Range8,
    pub(super) dc: Range8,
    /// Per degree of the spherical harmonics, from 1.
    pub(super) sh: [Signed<8>; SH_DEGREE_MAX as usize],
    /// Per power of time, from 1.
    pub(super) motion: [Signed<10>; MOTION_ORDER_MAX as usize],
    pub(super) rates: Signed<8>,
}

impl Ranges {
    pub(super) fn read(reader: &mut Reader, columns: Columns) -> Result<Ranges, Error> {
        let mut ranges = Ranges { origin: reader.f32x3()?, extent: reader.f32()?, ..Ranges::default() };
        ranges.log_scale = Range8 { min: reader.f32()?, step: reader.f32()? };
        ranges.dc = Range8 { min: reader.f32()?, step: reader.f32()? };
        for range in &mut ranges.sh[..usize::from(columns.sh_degree)] {
            range.step = reader.f32()?;
        }
        if let Some(temporal) = columns.temporal {
            for range in &mut ranges.motion[..usize::from(temporal.motion_order)] {
                range.step = reader.f32()?;
            }
            if temporal.rotation_rates {
                ranges.rates.step = reader.f32()?;
            }
        }
        Ok(ranges)
    }

    /// Checks that every code has a finite value. Centres are checked one by one, because FP16
    /// codes may be infinite or NaN.
    pub(super) fn check(&self, offset: usize) -> Result<(), Error> {
        // Values are monotonic in the code, so the extreme codes suffice.
        let ends = [self.log_scale, self.dc].map(|range| [range.value(0), range.value(255)]);
        let lowest =
            self.sh.map(|range| range.value(0)).into_iter().chain(self.motion.map(|range| range.value(0)));
        match ends.into_iter().flatten().chain(lowest).chain([self.rates.value(0)]).find(|x| !x.is_finite()) {
            None => Ok(()),
            Some(x) => Err(Error::value(offset, "range of a column", x)),
        }
    }
}
