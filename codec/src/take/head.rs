//! Reads and writes the head of a take.
//!
//! The head begins like a clip's head, with 0 layers. The exact duration, the viewpoints, the near distance and the
//! table of segments follow. Offsets are not stored: segments follow the head and each other without gaps.

use crate::{
    Error, Segment, SegmentLayer, Take,
    bytes::Reader,
    counters::Work,
    error::FormatError,
    format::{FIXED_BYTES, SEGMENT_BYTES, SEGMENT_LAYER_BYTES, SEGMENTS_MAX},
    limits::Budget,
    preamble::{Head, read_near, read_viewpoints},
};

/// Offset of the number of segments.
const COUNT_OFFSET: usize = FIXED_BYTES - 4;

/// Reads the head of a take package. `available` bytes of the package are given. The table keeps its memory of
/// `budget`.
///
/// # Errors
/// See [`package`](crate::package()).
// Long: one field of the head after the other.
pub(crate) fn read_take(head: &Head, available: usize, budget: &mut Budget) -> Result<Take, Error> {
    let (preamble, mut reader) = head.preamble()?;
    let duration_s = reader.f64()?;
    // Rounding to f32 leaves a duration that is checked below.
    if duration_s as f32 != preamble.info.duration_s {
        return Err(Error::value(FIXED_BYTES, "exact duration", duration_s));
    }
    let mut info = preamble.info;
    read_viewpoints(&mut reader, &mut info, preamble.viewpoint_count)?;
    let near = read_near(&mut reader, preamble.has_near)?;

    let count = preamble.entry_count;
    let table_at = reader.at();
    let table_bytes = head.bytes() - 4 - table_at;
    if count > SEGMENTS_MAX || count * (SEGMENT_BYTES + SEGMENT_LAYER_BYTES) > table_bytes {
        return Err(Error::value(COUNT_OFFSET, "number of segments", count));
    }
    let before = budget.left();
    let mut segments = budget.vec(count)?;
    let mut offset = head.bytes() as u64;
    for _ in 0..count {
        let segment = read_entry(&mut reader, offset, budget)?;
        // At most 2^16 times 2^32 bytes.
        offset += segment.bytes() as u64;
        segments.push(segment);
    }
    reader.finish()?;
    let take = Take {
        version_minor: head.version_minor,
        info,
        duration_s,
        bounds: preamble.bounds,
        coder: preamble.coder,
        sh_degree: preamble.columns.sh_degree,
        motion_order: preamble.columns.temporal.motion_order,
        rotation_rates: preamble.columns.temporal.rotation_rates,
        filter: preamble.filter,
        plate_len: preamble.plate_len,
        plate_sh_degree: preamble.columns.plate_sh_degree,
        plate_filter: preamble.plate_filter,
        by_device: preamble.by_device,
        near,
        segments,
        head_bytes: head.bytes(),
        table_bytes: before - budget.left(),
    };
    take.check().map_err(|broken| {
        let entries = take.segments.iter().take(broken.segment.unwrap_or(0));
        let at = match broken.segment {
            Some(_) => table_at + entries.map(entry_bytes).sum::<usize>(),
            None => COUNT_OFFSET,
        };
        Error::format(at, FormatError::Value { field: broken.field, value: broken.value })
    })?;
    let end = take.package_bytes();
    if available as u64 > end {
        let count = (available as u64 - end) as usize;
        return Err(Error::format(end as usize, FormatError::Extra { count, part: "the last segment" }));
    }
    Ok(take)
}

/// Reads an entry of the table, of a segment that begins at `offset`.
fn read_entry(reader: &mut Reader, offset: u64, budget: &mut Budget) -> Result<Segment, Error> {
    Work::Sections.count(1);
    let (start_s, duration_s) = (reader.f64()?, reader.f64()?);
    let (level, layer_count) = (reader.u8()?, usize::from(reader.u8()?));
    let at = reader.at();
    let reserved = reader.u16()?;
    if reserved != 0 {
        return Err(Error::value(at, "reserved bytes", reserved));
    }
    let head_crc = reader.u32()?;
    let mut layers = budget.vec(layer_count)?;
    for _ in 0..layer_count {
        layers.push(SegmentLayer { bytes: reader.u32()? as usize, gaussians: reader.u32()? as usize });
    }
    Ok(Segment { start_s, duration_s, level, offset, head_crc, layers })
}

/// Length of an entry of the table in bytes.
fn entry_bytes(segment: &Segment) -> usize {
    SEGMENT_BYTES + segment.layers.len() * SEGMENT_LAYER_BYTES
}

#[cfg(feature = "encode")]
mod encode {
    use super::*;
    use crate::{
        ClipInfo, Contents, EncodeError, PixelFilter,
        bytes::Writer,
        columns::PackageColumns,
        format::VERSION_MINOR,
        preamble::{Preamble, finish_head, u32_of, write_viewpoints},
        take::table::prefixes,
    };

    /// A segment of a take to be written: a clip package and its place in time.
    #[derive(Clone, Copy, Debug)]
    pub struct SegmentPackage<'a> {
        /// Time of the take in seconds at which clip time is 0.
        pub start_s: f64,
        /// Seconds from clip time 0 to clip time 1, above 0.
        pub duration_s: f64,
        /// Level on the dyadic grid, for information.
        pub level: u8,
        /// Head of the clip package.
        pub contents: &'a Contents,
    }

    /// Writes the head of a take of `duration_s` seconds. The packages of the segments follow it in the file,
    /// in the
    /// same order and without gaps; only their heads are needed here, so a writer need not hold them in memory.
    ///
    /// `info` gives everything but the duration: [`ClipInfo::duration_s`] does not matter.
    ///
    /// # Errors
    /// - [`EncodeError::Info`] if [`ClipInfo::check`] fails, or the duration is not a positive number.
    /// - [`EncodeError::Take`] if segments are in another order than [`take_order`](crate::take_order) returns, too
    ///   many, outside the take, or more than 32 hold one instant; if coders or filters differ; or if more than one
    ///   of the segments that hold an instant has a plate.
    /// - [`EncodeError::TooLarge`] if a number exceeds 32 bits.
    pub fn encode_take_head(
        info: &ClipInfo,
        duration_s: f64,
        segments: &[SegmentPackage],
    ) -> Result<Vec<u8>, EncodeError> {
        write_take(&describe(info, duration_s, segments)?)
    }

    /// Writes the head of a take that obeys the rules.
    ///
    /// # Errors
    /// [`EncodeError::TooLarge`] if a number exceeds 32 bits.
    pub(crate) fn write_take(take: &Take) -> Result<Vec<u8>, EncodeError> {
        let preamble = Preamble {
            info: take.info.clone(),
            bounds: take.bounds,
            coder: take.coder,
            columns: take.columns(),
            filter: take.filter,
            plate_filter: take.plate_filter,
            by_device: take.by_device,
            has_near: take.near > 0.0,
            layer_count: 0,
            viewpoint_count: take.info.viewpoints.len(),
            plate_len: take.plate_len,
            entry_count: take.segments.len(),
        };
        let mut w = preamble.write(take.version_minor)?;
        w.f64(take.duration_s);
        write_viewpoints(&mut w, &take.info, take.near);
        for segment in &take.segments {
            write_entry(&mut w, segment)?;
        }
        finish_head(w)
    }

    fn write_entry(w: &mut Writer, segment: &Segment) -> Result<(), EncodeError> {
        w.f64(segment.start_s);
        w.f64(segment.duration_s);
        w.u8(segment.level);
        w.u8(segment.layers.len() as u8);
        w.u16(0);
        w.u32(segment.head_crc);
        for layer in &segment.layers {
            w.u32(u32_of(layer.bytes)?);
            w.u32(u32_of(layer.gaussians)?);
        }
        Ok(())
    }

    /// Why clips cannot be segments of one take: different coders or filters, or two plates at an instant.
    fn contradiction(segments: &[SegmentPackage]) -> Option<String> {
        let differ = |number: fn(&Contents) -> u8, segments: &[&SegmentPackage]| {
            segments.windows(2).any(|pair| number(pair[0].contents) != number(pair[1].contents))
        };
        let all: Vec<&SegmentPackage> = segments.iter().collect();
        if differ(|head| head.coder.id(), &all) {
            return Some("its segments have different coders".into());
        }
        if differ(|head| head.filter as u8, &all) {
            return Some("its segments have different filters".into());
        }
        let mut plates: Vec<_> = segments.iter().filter(|segment| segment.contents.plate_len > 0).collect();
        if differ(|head| head.plate_filter as u8, &plates) {
            return Some("its plates have different filters".into());
        }
        plates.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        let overlap = plates.windows(2).find(|pair| pair[1].start_s < pair[0].start_s + pair[0].duration_s);
        overlap.map(|pair| format!("two segments have a plate at {} s", pair[1].start_s))
    }

    /// The take of these segments, without the lengths that its head gives it.
    fn describe(info: &ClipInfo, duration_s: f64, segments: &[SegmentPackage]) -> Result<Take, EncodeError> {
        let refused = |reason: String| Err(EncodeError::Take { reason });
        let info = ClipInfo { duration_s: duration_s as f32, ..info.clone() };
        info.check().map_err(|(field, value)| EncodeError::Info { field, value })?;
        let heads = || segments.iter().map(|segment| segment.contents);
        let Some(first) = heads().next() else {
            return refused("it has no segments".into());
        };
        if let Some(reason) = contradiction(segments) {
            return refused(reason);
        }
        let plate = heads().find(|head| head.plate_len > 0);
        let plate_filter = plate.map_or(PixelFilter::default(), |head| head.plate_filter);
        let columns = heads().map(Contents::columns).fold(PackageColumns::default(), PackageColumns::union);
        let corner = |end: usize, outer: fn(f32, f32) -> f32| {
            let corners = heads().map(|head| head.bounds[end]);
            corners.fold(first.bounds[end], |a, b| [0, 1, 2].map(|axis| outer(a[axis], b[axis])))
        };
        let bounds = [corner(0, f32::min), corner(1, f32::max)];
        let entry = |segment: &SegmentPackage| Segment {
            start_s: segment.start_s,
            duration_s: segment.duration_s,
            level: segment.level,
            offset: 0,
            head_crc: segment.contents.head_crc,
            layers: prefixes(segment.contents),
        };
        let take = Take {
            version_minor: VERSION_MINOR,
            info,
            duration_s,
            bounds,
            coder: first.coder,
            sh_degree: columns.sh_degree,
            motion_order: columns.temporal.motion_order,
            rotation_rates: columns.temporal.rotation_rates,
            filter: first.filter,
            plate_len: heads().map(|head| head.plate_len).max().unwrap_or(0),
            plate_sh_degree: columns.plate_sh_degree,
            plate_filter,
            by_device: heads().any(|head| head.by_device),
            near: heads().map(|head| head.near).fold(0.0, f32::max),
            segments: segments.iter().map(entry).collect(),
            head_bytes: 0,
            table_bytes: 0,
        };
        take.check().map_err(|broken| {
            let place = broken.segment.map_or(String::new(), |segment| format!(", segment {segment}"));
            EncodeError::Take { reason: format!("bad {}: {}{place}", broken.field, broken.value) }
        })?;
        Ok(take)
    }
}

#[cfg(feature = "encode")]
pub(crate) use encode::write_take;
#[cfg(feature = "encode")]
pub use encode::{SegmentPackage, encode_take_head};
