//! [`Head`] and [`Preamble`]: what the heads of clip and take packages share.
//!
//! Both begin with magic number, version, length, metadata and the columns of the Gaussians, in the same
//! bytes, and end with a checksum. Byte 64 tells them apart: a clip has 1 to 16 layers, a take 0.

use crate::{
    ClipInfo, Coder, Error, MOTION_ORDER_MAX, PixelFilter, SH_DEGREE_MAX, Viewpoint,
    bytes::Reader,
    columns::{PackageColumns, TemporalColumns},
    counters::Work,
    error::FormatError,
    format::{FIXED_BYTES, LAYERS_MAX, LAYERS_OFFSET, MAGIC, PREFIX_BYTES, VERSION_MAJOR, VIEWPOINTS_MAX},
};

/// Flags of the head: the dynamic region has rotation rates, the mip filter of the static and the dynamic region, that
/// of the plate, whether a graphics device computed numbers of the Gaussians, and whether the near distance is above 0.
/// Format.
const ROTATION_RATES: u8 = 1;
const MIP: u8 = 2;
const PLATE_MIP: u8 = 4;
const BY_DEVICE: u8 = 8;
const NEAR: u8 = 16;
const KNOWN_FLAGS: u8 = ROTATION_RATES | MIP | PLATE_MIP | BY_DEVICE | NEAR;

/// A head whose magic number, version, length and checksum are right.
pub(crate) struct Head<'a> {
    /// All bytes but the checksum.
    body: &'a [u8],
    pub(crate) version_minor: u16,
    pub(crate) crc: u32,
}

impl<'a> Head<'a> {
    /// Finds the head at the beginning of `bytes` and checks it.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Version`]; with [`FormatError::Truncated`], `bytes` is too short to tell.
    pub(crate) fn checked(bytes: &'a [u8]) -> Result<Head<'a>, Error> {
        let truncated =
            |needed| Error::format(bytes.len(), FormatError::Truncated { needed, available: bytes.len() });
        if !bytes.starts_with(&MAGIC) {
            // A prefix of the magic number is a package cut short.
            let is_truncated = !bytes.is_empty() && MAGIC.starts_with(bytes);
            return Err(if is_truncated {
                truncated(PREFIX_BYTES)
            } else {
                Error::format(0, FormatError::Magic)
            });
        }
        let prefix = bytes.get(..PREFIX_BYTES).ok_or(truncated(PREFIX_BYTES))?;
        let version_major = u16::from_le_bytes([prefix[4], prefix[5]]);
        let version_minor = u16::from_le_bytes([prefix[6], prefix[7]]);
        if version_major != VERSION_MAJOR {
            return Err(Error::Version { major: version_major, minor: version_minor });
        }
        let length = u32::from_le_bytes([prefix[8], prefix[9], prefix[10], prefix[11]]) as usize;
        if length < FIXED_BYTES + 4 {
            return Err(Error::value(8, "length of the head", length));
        }
        let head = bytes.get(..length).ok_or(truncated(length))?;
        let (body, stored) = head.split_at(length - 4);
        Work::Bytes.count(body.len());
        let computed = crc32fast::hash(body);
        let stored = Reader::new(stored, body.len(), "head").u32()?;
        if stored != computed {
            return Err(Error::format(body.len(), FormatError::Crc { part: "head", stored, computed }));
        }
        Ok(Head { body, version_minor, crc: stored })
    }

    /// Offset and value of the checksum that a head at the beginning of `bytes` ends with. Only the head's magic number
    /// and length are checked. `None` if no head is there.
    pub(crate) fn stored_crc(bytes: &[u8]) -> Option<(usize, u32)> {
        let number = |at: usize| {
            let bytes = bytes.get(at..at.checked_add(4)?)?;
            Some(u32::from_le_bytes(bytes.try_into().ok()?))
        };
        let length = number(8).filter(|_| bytes.starts_with(&MAGIC))? as usize;
        let at = length.checked_sub(4).filter(|_| length >= FIXED_BYTES + 4)?;
        Some((at, number(at)?))
    }

    /// Whether this is the head of a take.
    pub(crate) fn is_take(&self) -> bool {
        self.body[LAYERS_OFFSET] == 0
    }

    /// Length in bytes, checksum included.
    pub(crate) fn bytes(&self) -> usize {
        self.body.len() + 4
    }

    /// Reads the first 76 bytes, and returns a reader of the others without the checksum.
    ///
    /// # Errors
    /// [`Error::Format`] if a number is out of range. [`ClipInfo::check`] waits for the viewpoints.
    pub(crate) fn preamble(&self) -> Result<(Preamble, Reader<'a>), Error> {
        let mut reader = Reader::new(self.body, 0, "head");
        reader.take(PREFIX_BYTES)?;
        let info = ClipInfo {
            duration_s: reader.f32()?,
            fps: reader.f32()?,
            up: reader.f32x3()?,
            metres_per_unit: reader.f32()?,
            viewpoints: Vec::new(),
        };
        let bounds = [reader.f32x3()?, reader.f32x3()?];
        if !(0..3)
            .all(|axis| bounds[0][axis] <= bounds[1][axis] && (bounds[1][axis] - bounds[0][axis]).is_finite())
        {
            return Err(Error::value(36, "bounds", bounds));
        }
        let coder = reader.u8()?;
        let coder = Coder::from_id(coder).ok_or_else(|| Error::value(60, "coder", coder))?;
        let at_most = |field, at, value, max| {
            if value > max { Err(Error::value(at, field, value)) } else { Ok(value) }
        };
        let sh_degree = at_most("SH degree", 61, reader.u8()?, SH_DEGREE_MAX)?;
        let motion_order = at_most("motion order", 62, reader.u8()?, MOTION_ORDER_MAX)?;
        let flags = at_most("flags", 63, reader.u8()?, KNOWN_FLAGS)?;
        let layer_count = usize::from(reader.u8()?);
        if layer_count > LAYERS_MAX {
            return Err(Error::value(LAYERS_OFFSET, "number of layers", layer_count));
        }
        let viewpoint_count = at_most("number of viewpoints", 65, reader.u8()?, VIEWPOINTS_MAX as u8)?;
        let plate_sh_degree = at_most("SH degree of the plate", 66, reader.u8()?, SH_DEGREE_MAX)?;
        at_most("reserved byte", 67, reader.u8()?, 0)?;
        let plate_len = reader.u32()? as usize;
        if flags & PLATE_MIP != 0 && plate_len == 0 {
            return Err(Error::value(63, "flags", flags));
        }
        let temporal = TemporalColumns { motion_order, rotation_rates: flags & ROTATION_RATES != 0 };
        let preamble = Preamble {
            info,
            bounds,
            coder,
            columns: PackageColumns { sh_degree, temporal, plate_sh_degree },
            filter: filter(flags, MIP),
            plate_filter: filter(flags, PLATE_MIP),
            by_device: flags & BY_DEVICE != 0,
            has_near: flags & NEAR != 0,
            layer_count,
            viewpoint_count: usize::from(viewpoint_count),
            plate_len,
            entry_count: reader.u32()? as usize,
        };
        Ok((preamble, reader))
    }
}

/// The first 76 bytes of a head, after the length.
pub(crate) struct Preamble {
    /// Without the viewpoints.
    pub(crate) info: ClipInfo,
    pub(crate) bounds: [[f32; 3]; 2],
    pub(crate) coder: Coder,
    pub(crate) columns: PackageColumns,
    pub(crate) filter: PixelFilter,
    pub(crate) plate_filter: PixelFilter,
    pub(crate) by_device: bool,
    /// Whether the near distance follows the viewpoints.
    pub(crate) has_near: bool,
    /// 0 in the head of a take.
    pub(crate) layer_count: usize,
    pub(crate) viewpoint_count: usize,
    /// Number of Gaussians in the plate, or in the largest plate of a take.
    pub(crate) plate_len: usize,
    /// Number of entries in the table of sections, or of segments.
    pub(crate) entry_count: usize,
}

/// The filter that a flag stands for.
fn filter(flags: u8, bit: u8) -> PixelFilter {
    if flags & bit != 0 { PixelFilter::Mip } else { PixelFilter::Blur }
}

/// Reads `count` viewpoints into `info` and checks all of it.
///
/// # Errors
/// [`Error::Format`] if a number or a name is out of range.
pub(crate) fn read_viewpoints(reader: &mut Reader, info: &mut ClipInfo, count: usize) -> Result<(), Error> {
    let viewpoints_at = reader.at();
    for _ in 0..count {
        let (position, target, fov_y) = (reader.f32x3()?, reader.f32x3()?, reader.f32()?);
        let at = reader.at();
        let length = usize::from(reader.u8()?);
        let name = String::from_utf8(reader.take(length)?.to_vec())
            .map_err(|e| Error::value(at, "name of a viewpoint", e.into_bytes()))?;
        info.viewpoints.push(Viewpoint { name, position, target, fov_y });
    }
    info.check().map_err(|(field, value)| {
        let at = if field.contains("viewpoint") { viewpoints_at } else { PREFIX_BYTES };
        Error::format(at, FormatError::Value { field, value })
    })
}

/// Reads the near distance, which follows the viewpoints of a head that `has_near`; others have 0.
///
/// # Errors
/// [`Error::Format`] if it is not finite and above 0.
pub(crate) fn read_near(reader: &mut Reader, has_near: bool) -> Result<f32, Error> {
    if !has_near {
        return Ok(0.0);
    }
    let at = reader.at();
    let near = reader.f32()?;
    if near > 0.0 && near.is_finite() { Ok(near) } else { Err(Error::value(at, "near distance", near)) }
}

#[cfg(feature = "encode")]
mod write {
    use super::*;
    use crate::{EncodeError, bytes::Writer};

    impl Preamble {
        /// Writes the first 76 bytes of a head. [`finish_head`] completes it.
        ///
        /// # Errors
        /// [`EncodeError::TooLarge`] if a number exceeds 32 bits.
        pub(crate) fn write(&self, version_minor: u16) -> Result<Writer, EncodeError> {
            let mut w = Writer::default();
            w.bytes.extend_from_slice(&MAGIC);
            w.u16(VERSION_MAJOR);
            w.u16(version_minor);
            w.u32(0);
            w.f32(self.info.duration_s);
            w.f32(self.info.fps);
            w.f32x3(self.info.up);
            w.f32(self.info.metres_per_unit);
            w.f32x3(self.bounds[0]);
            w.f32x3(self.bounds[1]);
            w.u8(self.coder.id());
            w.u8(self.columns.sh_degree);
            w.u8(self.columns.temporal.motion_order);
            let flag = |is_set, bit| if is_set { bit } else { 0 };
            w.u8(flag(self.columns.temporal.rotation_rates, ROTATION_RATES)
                | flag(self.filter == PixelFilter::Mip, MIP)
                | flag(self.plate_filter == PixelFilter::Mip, PLATE_MIP)
                | flag(self.by_device, BY_DEVICE)
                | flag(self.has_near, NEAR));
            w.u8(self.layer_count as u8);
            w.u8(self.viewpoint_count as u8);
            w.u8(self.columns.plate_sh_degree);
            w.u8(0);
            w.u32(u32_of(self.plate_len)?);
            w.u32(u32_of(self.entry_count)?);
            Ok(w)
        }
    }

    /// Writes the viewpoints of `info`, which has been checked, and the near distance if it is above 0.
    pub(crate) fn write_viewpoints(w: &mut Writer, info: &ClipInfo, near: f32) {
        for viewpoint in &info.viewpoints {
            w.f32x3(viewpoint.position);
            w.f32x3(viewpoint.target);
            w.f32(viewpoint.fov_y);
            w.u8(viewpoint.name.len() as u8);
            w.bytes.extend_from_slice(viewpoint.name.as_bytes());
        }
        if near > 0.0 {
            w.f32(near);
        }
    }

    /// Writes the length and the checksum of a head that is complete otherwise.
    ///
    /// # Errors
    /// [`EncodeError::TooLarge`] if the length exceeds 32 bits.
    pub(crate) fn finish_head(mut w: Writer) -> Result<Vec<u8>, EncodeError> {
        let length = u32_of(w.bytes.len() + 4)?;
        w.bytes[PREFIX_BYTES - 4..PREFIX_BYTES].copy_from_slice(&length.to_le_bytes());
        let crc = crc32fast::hash(&w.bytes);
        w.u32(crc);
        Ok(w.bytes)
    }

    /// A number of 32 bits.
    ///
    /// # Errors
    /// [`EncodeError::TooLarge`] if it exceeds them.
    pub(crate) fn u32_of(number: usize) -> Result<u32, EncodeError> {
        u32::try_from(number).map_err(|_| EncodeError::TooLarge)
    }
}

#[cfg(feature = "encode")]
pub(crate) use write::{finish_head, u32_of, write_viewpoints};
