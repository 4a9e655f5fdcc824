//! Decodes chunks of the coder `fixed`.

use super::ranges::Ranges;
use crate::{
    Error,
    bytes::Reader,
    columns::{Columns, TemporalColumns},
    quant::{f16_value, opacity_value, rotation_value},
    rows::{Rows, TemporalRows},
    sh_coefficients,
};

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

/// The planes of a chunk, in order.
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

/// Decodes a chunk into `out`, which has as many rows as the chunk, and the given columns or more: those keep
/// their zeros.
///
/// `raw` is the decompressed payload of [`raw_bytes`](super::raw_bytes) bytes, `offset` the offset of
/// its section, for errors.
///
/// # Errors
/// [`Error::Format`] if a number is out of range.
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
    decode_sh(&mut planes, columns.sh_degree, &ranges, out.sh_degree, out.sh)?;
    if let (Some(columns), Some(out)) = (columns.temporal, out.temporal) {
        decode_temporal(&mut planes, columns, &ranges, offset, out)?;
    }
    planes.reader.finish()
}

fn decode_sh(
    planes: &mut Planes,
    sh_degree: u8,
    ranges: &Ranges,
    out_degree: u8,
    out: &mut [[f32; 3]],
) -> Result<(), Error> {
    let mut coefficients = Vec::with_capacity(sh_coefficients(sh_degree));
    for _ in 0..sh_coefficients(sh_degree) {
        coefficients.push([planes.eight()?, planes.eight()?, planes.eight()?]);
    }
    for (i, out) in out.chunks_exact_mut(sh_coefficients(out_degree)).enumerate() {
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
    columns: TemporalColumns,
    ranges: &Ranges,
    offset: usize,
    out: TemporalRows,
) -> Result<(), Error> {
    let (tau_codes, s_codes) = (planes.sixteen()?, planes.sixteen()?);
    for (i, (out_tau, out_s)) in out.tau.iter_mut().zip(out.s).enumerate() {
        let (tau, s) = (f16_value(tau_codes.code(i)), f16_value(s_codes.code(i)));
        // An infinite width means always on.
        if !tau.is_finite() || s.is_nan() || s <= 0.0 {
            return Err(Error::value(offset, "window (centre, width)", (tau, s)));
        }
        (*out_tau, *out_s) = (tau, s);
    }
    let order = usize::from(out.motion_order);
    for (k, range) in ranges.motion[..usize::from(columns.motion_order)].iter().enumerate() {
        let v = [planes.ten()?, planes.ten()?, planes.ten()?];
        for (i, out) in out.motion.iter_mut().skip(k).step_by(order).enumerate() {
            *out = v.map(|axis| range.value(axis.code(i)));
        }
    }
    if let (true, Some(rates)) = (columns.rotation_rates, out.rotation_rates) {
        let components = [planes.eight()?, planes.eight()?, planes.eight()?, planes.eight()?];
        for (i, out) in rates.iter_mut().enumerate() {
            *out = components.map(|component| ranges.rates.value(u16::from(component[i])));
        }
    }
    Ok(())
}
