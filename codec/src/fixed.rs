//! The coder `fixed`: the paper's FP16 and INT8 attributes and 10-bit motion, then zstd.
//!
//! A chunk of Gaussians is a list of ranges, then one plane of bytes per column and component
//! (numbers wider than a byte are split into planes too), so that bytes of one meaning lie
//! together when zstd sees them. Ranges belong to the chunk: chunks decode independently, and an
//! outlier costs precision in its own chunk only.

use crate::{
    Error, MOTION_ORDER_MAX, SH_DEGREE_MAX,
    bytes::Reader,
    quant::{Range8, Signed, f16_value, opacity_value, rotation_value},
    rows::{Rows, TemporalRows},
    sh_coefficients,
};

#[cfg(feature = "encode")]
mod encode;

#[cfg(feature = "encode")]
pub(crate) use encode::{columns_needed, encode};

/// Which columns the Gaussians of a region have.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Columns {
    pub(crate) sh_degree: u8,
    pub(crate) temporal: Option<TemporalColumns>,
}

/// Which columns Gaussians have that change over time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct TemporalColumns {
    pub(crate) motion_order: u8,
    pub(crate) rotation_rates: bool,
}

/// Bytes of a chunk of `rows` Gaussians before compression.
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

/// What the codes of a chunk mean. Columns that are absent have a step of zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Ranges {
    /// Added to the offsets of the centres.
    origin: [f32; 3],
    /// Unit of the offsets of the centres.
    extent: f32,
    log_scale: Range8,
    dc: Range8,
    /// Per degree of the spherical harmonics from 1.
    sh: [Signed<8>; SH_DEGREE_MAX as usize],
    /// Per power of time from 1.
    motion: [Signed<10>; MOTION_ORDER_MAX as usize],
    rates: Signed<8>,
}

impl Ranges {
    fn read(reader: &mut Reader, columns: Columns) -> Result<Ranges, Error> {
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

    /// Checks that no code stands for a number that is not finite. Centres are checked one by
    /// one, as FP16 codes may themselves not be finite.
    fn check(&self, offset: usize) -> Result<(), Error> {
        // All of these grow or fall steadily with the code, so that the ends speak for the rest.
        let ends = [self.log_scale, self.dc].map(|range| [range.value(0), range.value(255)]);
        let lowest =
            self.sh.map(|range| range.value(0)).into_iter().chain(self.motion.map(|range| range.value(0)));
        match ends.into_iter().flatten().chain(lowest).chain([self.rates.value(0)]).find(|x| !x.is_finite()) {
            None => Ok(()),
            Some(x) => Err(Error::value(offset, "range of a column", x)),
        }
    }
}

/// A column of 16-bit codes: a plane of upper bytes and one of lower bytes.
#[derive(Clone, Copy)]
struct Sixteen<'a> {
    upper: &'a [u8],
    lower: &'a [u8],
}

impl Sixteen<'_> {
    fn code(self, i: usize) -> u16 {
        u16::from_be_bytes([self.upper[i], self.lower[i]])
    }
}

/// A column of 10-bit codes: a plane of upper bytes and one of lower 2 bits, four to a byte.
#[derive(Clone, Copy)]
struct Ten<'a> {
    upper: &'a [u8],
    lower: &'a [u8],
}

impl Ten<'_> {
    fn code(self, i: usize) -> u16 {
        u16::from(self.upper[i]) << 2 | u16::from(self.lower[i / 4] >> (2 * (i % 4)) & 3)
    }
}

/// The planes of a chunk, read one after the other.
struct Planes<'a> {
    reader: Reader<'a>,
    rows: usize,
}

impl<'a> Planes<'a> {
    fn eight(&mut self) -> Result<&'a [u8], Error> {
        self.reader.take(self.rows)
    }

    fn sixteen(&mut self) -> Result<Sixteen<'a>, Error> {
        Ok(Sixteen { upper: self.eight()?, lower: self.eight()? })
    }

    fn ten(&mut self) -> Result<Ten<'a>, Error> {
        Ok(Ten { upper: self.eight()?, lower: self.reader.take(self.rows.div_ceil(4))? })
    }
}

/// Decodes the Gaussians of a chunk into `out`, which are as many and have the columns named.
///
/// `raw` is the decompressed payload of [`raw_bytes`] bytes; `offset`, where its section starts,
/// is for errors.
///
/// # Errors
/// If a number in it is out of range.
pub(crate) fn decode(raw: &[u8], columns: Columns, offset: usize, out: Rows) -> Result<(), Error> {
    let mut reader = Reader::new(raw, offset, "chunk of Gaussians");
    let ranges = Ranges::read(&mut reader, columns)?;
    ranges.check(offset)?;
    let mut planes = Planes { reader, rows: out.centers.len() };

    let centers = [planes.sixteen()?, planes.sixteen()?, planes.sixteen()?];
    for (i, out) in out.centers.iter_mut().enumerate() {
        let offsets = centers.map(|axis| f16_value(axis.code(i)));
        *out = [0, 1, 2].map(|axis| ranges.origin[axis] + ranges.extent * offsets[axis]);
        if !out.iter().all(|x| x.is_finite()) {
            return Err(Error::value(offset, "centre", out));
        }
    }
    let log_scales = [planes.eight()?, planes.eight()?, planes.eight()?];
    for (i, out) in out.log_scales.iter_mut().enumerate() {
        *out = log_scales.map(|axis| ranges.log_scale.value(axis[i]));
    }
    let rotations = [planes.eight()?, planes.eight()?, planes.eight()?, planes.eight()?];
    for (i, out) in out.rotations.iter_mut().enumerate() {
        let rotation = rotation_value(rotations.map(|component| component[i]));
        *out = rotation.ok_or_else(|| Error::value(offset, "length of a quaternion", 0))?;
    }
    for (out, &code) in out.opacities.iter_mut().zip(planes.eight()?) {
        *out = opacity_value(code);
    }
    decode_sh(&mut planes, columns.sh_degree, &ranges, out.sh)?;
    if let Some(temporal) = out.temporal {
        decode_temporal(&mut planes, &ranges, offset, temporal)?;
    }
    planes.reader.finish()
}

fn decode_sh(planes: &mut Planes, sh_degree: u8, ranges: &Ranges, out: &mut [[f32; 3]]) -> Result<(), Error> {
    let mut coefficients = Vec::with_capacity(sh_coefficients(sh_degree));
    for _ in 0..sh_coefficients(sh_degree) {
        coefficients.push([planes.eight()?, planes.eight()?, planes.eight()?]);
    }
    for (i, out) in out.chunks_exact_mut(sh_coefficients(sh_degree)).enumerate() {
        out[0] = coefficients[0].map(|channel| ranges.dc.value(channel[i]));
        for (degree, range) in (1..=sh_degree).zip(ranges.sh) {
            let band = sh_coefficients(degree - 1)..sh_coefficients(degree);
            for (out, k) in out[band.clone()].iter_mut().zip(&coefficients[band]) {
                *out = k.map(|channel| range.value(u16::from(channel[i])));
            }
        }
    }
    Ok(())
}

fn decode_temporal(
    planes: &mut Planes,
    ranges: &Ranges,
    offset: usize,
    out: TemporalRows,
) -> Result<(), Error> {
    let (tau_codes, s_codes) = (planes.sixteen()?, planes.sixteen()?);
    for (i, (out_tau, out_s)) in out.tau.iter_mut().zip(out.s).enumerate() {
        let (tau, s) = (f16_value(tau_codes.code(i)), f16_value(s_codes.code(i)));
        // The width may be infinite: always on.
        if !tau.is_finite() || s.is_nan() || s <= 0.0 {
            return Err(Error::value(offset, "window (centre, width)", (tau, s)));
        }
        (*out_tau, *out_s) = (tau, s);
    }
    let order = usize::from(out.motion_order);
    for (k, range) in ranges.motion[..order].iter().enumerate() {
        let v = [planes.ten()?, planes.ten()?, planes.ten()?];
        for (i, out) in out.motion.iter_mut().skip(k).step_by(order).enumerate() {
            *out = v.map(|axis| range.value(axis.code(i)));
        }
    }
    if let Some(rates) = out.rotation_rates {
        let components = [planes.eight()?, planes.eight()?, planes.eight()?, planes.eight()?];
        for (i, out) in rates.iter_mut().enumerate() {
            *out = components.map(|component| ranges.rates.value(u16::from(component[i])));
        }
    }
    Ok(())
}
