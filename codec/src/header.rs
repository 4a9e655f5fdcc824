//! [`Contents`]: reads and writes the head of a package.
//!
//! The head is everything before the first section: magic, version, metadata, counts, viewpoints
//! and the section table, with one CRC-32 over all of it. Sections follow without gaps. The counts
//! determine their order, chunking and uncompressed lengths, so the table is checked against the
//! counts instead of trusted.

use crate::{
    ClipInfo, Error, LayerEnd, Limits, MOTION_ORDER_MAX, PixelFilter, SH_DEGREE_MAX, Viewpoint,
    bytes::Reader,
    columns::{Columns, TemporalColumns},
    counters::Work,
    error::FormatError,
    fixed,
    format::{
        CHUNK_ROWS, ENTRY_BYTES, FIXED_BYTES, LAYERS_MAX, MAGIC, PREFIX_BYTES, VERSIONS, VIEWPOINTS_MAX,
    },
    limits::Budget,
    section::{Region, Section, SectionKind},
};

/// Flags of the head: the dynamic region has rotation rates; from version 2, the mip filter of the static and
/// the dynamic region, and that of the plate. Format.
const ROTATION_RATES: u8 = 1;
const MIP: u8 = 2;
const PLATE_MIP: u8 = 4;

/// Coding of the Gaussians of a package.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coder {
    /// The paper's trajectory coding: FP16 and INT8 attributes, 10-bit motion coefficients, zstd.
    #[default]
    Fixed,
    /// Quantisation steps from the visibility of each Gaussian, and an adaptive range coder. Not in
    /// the paper.
    Context,
}

impl Coder {
    /// All coders.
    pub const ALL: [Coder; 2] = [Coder::Fixed, Coder::Context];

    /// Name on command lines and in reports: `fixed` or `context`.
    pub fn name(self) -> &'static str {
        match self {
            Coder::Fixed => "fixed",
            Coder::Context => "context",
        }
    }

    #[cfg(feature = "encode")]
    fn id(self) -> u8 {
        match self {
            Coder::Fixed => 1,
            Coder::Context => 2,
        }
    }
}

/// The head of a package: metadata, counts and section table.
#[derive(Clone, Debug, PartialEq)]
pub struct Contents {
    /// Major version of the format, one of [`VERSIONS`].
    pub version_major: u16,
    /// Minor version of the format.
    pub version_minor: u16,
    /// Duration, axes, viewpoints.
    pub info: ClipInfo,
    /// Corners of the box around all centres while alive: `[min, max]`, in source units.
    pub bounds: [[f32; 3]; 2],
    /// Coding of all Gaussians, the plate included.
    pub coder: Coder,
    /// Degree of the spherical harmonics of the static and the dynamic region, 0 to 3.
    pub sh_degree: u8,
    /// Highest power of time in the trajectories of the dynamic region, 0 to 3.
    pub motion_order: u8,
    /// Whether the dynamic region has rotation rates.
    pub rotation_rates: bool,
    /// Filter of the static and the dynamic region.
    pub filter: PixelFilter,
    /// Gaussians up to the end of each layer; 1 to 16 entries.
    pub layers: Vec<LayerEnd>,
    /// Number of Gaussians in the plate; 0 without a plate.
    pub plate_len: usize,
    /// Degree of the plate's spherical harmonics, 0 to 3.
    pub plate_sh_degree: u8,
    /// Filter of the plate; the default without a plate.
    pub plate_filter: PixelFilter,
    /// Length of the head in bytes: the offset of the first section.
    pub head_bytes: usize,
    /// The section table, in file order.
    pub sections: Vec<Section>,
}

/// Reads the head of a package without decoding any Gaussian.
///
/// `bytes` may be any prefix of a package that holds the whole head; sections may then end after
/// `bytes`.
///
/// # Errors
/// - [`Error::Format`] if the head is damaged or inconsistent, or bytes follow the last section.
///   With [`FormatError::Truncated`], `bytes` is too short to tell.
/// - [`Error::Version`] if the major version is none of [`VERSIONS`].
/// - [`Error::Limits`] if the package announces more Gaussians than `limits` allow, or its section
///   table needs more memory.
pub fn contents(bytes: &[u8], limits: &Limits) -> Result<Contents, Error> {
    contents_within(bytes, limits, &mut Budget::new(limits))
}

/// Reads the head as [`contents`] does, with the memory of `budget`, which its section table keeps.
///
/// # Errors
/// See [`contents`].
pub(crate) fn contents_within(bytes: &[u8], limits: &Limits, budget: &mut Budget) -> Result<Contents, Error> {
    let head = head_bytes(bytes)?;
    let (body, stored) = head.split_at(head.len() - 4);
    Work::Bytes.count(body.len());
    let computed = crc32fast::hash(body);
    let stored = Reader::new(stored, body.len(), "head").u32()?;
    if stored != computed {
        return Err(Error::format(body.len(), FormatError::Crc { part: "head", stored, computed }));
    }
    let contents = parse(body, limits, budget)?;
    contents.check_table()?;
    let end = contents.package_bytes();
    if bytes.len() > end {
        let error = FormatError::Extra { count: bytes.len() - end, part: "the last section" };
        return Err(Error::format(end, error));
    }
    Ok(contents)
}

/// Checks magic, version and length of the head, and returns the head with its checksum.
fn head_bytes(bytes: &[u8]) -> Result<&[u8], Error> {
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
    let major = u16::from_le_bytes([prefix[4], prefix[5]]);
    if !VERSIONS.contains(&major) {
        return Err(Error::Version { major, minor: u16::from_le_bytes([prefix[6], prefix[7]]) });
    }
    let length = u32::from_le_bytes([prefix[8], prefix[9], prefix[10], prefix[11]]) as usize;
    if length < FIXED_BYTES + 4 {
        return Err(Error::value(8, "length of the head", length));
    }
    bytes.get(..length).ok_or(truncated(length))
}

/// Parses the head without its checksum, which has been checked.
// Long: one field after the other, in their order in the file.
fn parse(body: &[u8], limits: &Limits, budget: &mut Budget) -> Result<Contents, Error> {
    let mut reader = Reader::new(body, 0, "head");
    reader.take(PREFIX_BYTES)?;
    let version_major = u16::from_le_bytes([body[4], body[5]]);
    let version_minor = u16::from_le_bytes([body[6], body[7]]);
    let mut info = ClipInfo {
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
    let coder = match reader.u8()? {
        1 => Coder::Fixed,
        2 => Coder::Context,
        other => return Err(Error::value(60, "coder", other)),
    };
    let degree = |field, at, value, max| {
        if value > max { Err(Error::value(at, field, value)) } else { Ok(value) }
    };
    let sh_degree = degree("SH degree", 61, reader.u8()?, SH_DEGREE_MAX)?;
    let motion_order = degree("motion order", 62, reader.u8()?, MOTION_ORDER_MAX)?;
    let known_flags = if version_major >= 2 { ROTATION_RATES | MIP | PLATE_MIP } else { ROTATION_RATES };
    let flags = degree("flags", 63, reader.u8()?, known_flags)?;
    let layer_count = usize::from(reader.u8()?);
    if !(1..=LAYERS_MAX).contains(&layer_count) {
        return Err(Error::value(64, "number of layers", layer_count));
    }
    let viewpoint_count =
        usize::from(degree("number of viewpoints", 65, reader.u8()?, VIEWPOINTS_MAX as u8)?);
    let plate_sh_degree = degree("SH degree of the plate", 66, reader.u8()?, SH_DEGREE_MAX)?;
    degree("reserved byte", 67, reader.u8()?, 0)?;
    let plate_len = reader.u32()? as usize;
    if flags & PLATE_MIP != 0 && plate_len == 0 {
        return Err(Error::value(63, "flags", flags));
    }
    let section_count = reader.u32()? as usize;

    let mut layers = Vec::with_capacity(layer_count);
    let mut end = LayerEnd::default();
    for _ in 0..layer_count {
        let at = reader.at();
        let (static_count, dynamic_count) = (reader.u32()? as usize, reader.u32()? as usize);
        if static_count == 0 && dynamic_count == 0 {
            return Err(Error::value(at, "size of a layer", 0));
        }
        end.static_count = end.static_count.saturating_add(static_count);
        end.dynamic_count = end.dynamic_count.saturating_add(dynamic_count);
        let needed = end.static_count.saturating_add(end.dynamic_count).saturating_add(plate_len);
        // Row numbers of the time index have 32 bits.
        let limit = limits.max_gaussians.min(u32::MAX as usize);
        if needed > limit {
            return Err(Error::Limits { offset: at, quantity: "Gaussians", needed, limit });
        }
        layers.push(end);
    }

    let viewpoints_at = reader.at();
    for _ in 0..viewpoint_count {
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
    })?;

    let table_bytes = body.len() - reader.at();
    if section_count.checked_mul(ENTRY_BYTES) != Some(table_bytes) {
        let expected = format!("{section_count} entries of {ENTRY_BYTES} bytes");
        return Err(Error::format(
            reader.at(),
            FormatError::Sections { expected, found: format!("{table_bytes} bytes") },
        ));
    }
    let mut sections = budget.vec(section_count)?;
    for _ in 0..section_count {
        sections.push(Section::read(&mut reader)?);
    }
    reader.finish()?;
    Ok(Contents {
        version_major,
        version_minor,
        info,
        bounds,
        coder,
        sh_degree,
        motion_order,
        rotation_rates: flags & ROTATION_RATES != 0,
        filter: filter(flags, MIP),
        layers,
        plate_len,
        plate_sh_degree,
        plate_filter: filter(flags, PLATE_MIP),
        head_bytes: body.len() + 4,
        sections,
    })
}

/// A section that the counts in the head require.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlannedSection {
    pub(crate) kind: SectionKind,
    pub(crate) layer: u8,
    pub(crate) region: Region,
    pub(crate) chunk: u32,
    /// Number of Gaussians in the section.
    pub(crate) rows: usize,
}

/// The filter that a flag of version 2 stands for.
fn filter(flags: u8, bit: u8) -> PixelFilter {
    if flags & bit != 0 { PixelFilter::Mip } else { PixelFilter::Blur }
}

impl Contents {
    /// Length of the whole package in bytes.
    pub fn package_bytes(&self) -> usize {
        self.sections.last().map_or(self.head_bytes, Section::end)
    }

    /// Offset of the end of each layer in bytes, ascending. A prefix of entry `k` bytes decodes to
    /// layers 0 to `k`.
    pub fn layer_bytes(&self) -> Vec<usize> {
        let mut ends = vec![self.head_bytes; self.layers.len()];
        for (planned, section) in self.planned_sections() {
            ends[usize::from(planned.layer)] = section.end();
        }
        ends
    }

    /// Returns the columns of a region.
    pub(crate) fn columns(&self, region: Region) -> Columns {
        match region {
            Region::Static => Columns { sh_degree: self.sh_degree, temporal: None },
            Region::Plate => Columns { sh_degree: self.plate_sh_degree, temporal: None },
            Region::Dynamic => Columns {
                sh_degree: self.sh_degree,
                temporal: Some(TemporalColumns {
                    motion_order: self.motion_order,
                    rotation_rates: self.rotation_rates,
                }),
            },
        }
    }

    /// The sections that the counts require, in the only valid order: by layer; in a layer the
    /// chunks of the plate (first layer only), the static chunks, the time index (coder `fixed`
    /// only), the dynamic chunks.
    pub(crate) fn plan(&self) -> impl Iterator<Item = PlannedSection> + '_ {
        let sections = self.layers.iter().enumerate().flat_map(|(layer, end)| {
            let start = if layer == 0 { LayerEnd::default() } else { self.layers[layer - 1] };
            let layer = layer as u8;
            let dynamic = end.dynamic_count - start.dynamic_count;
            let index = PlannedSection {
                kind: SectionKind::TimeIndex,
                layer,
                region: Region::Dynamic,
                chunk: 0,
                rows: dynamic,
            };
            chunks(layer, Region::Plate, if layer == 0 { self.plate_len } else { 0 })
                .chain(chunks(layer, Region::Static, end.static_count - start.static_count))
                .chain((dynamic > 0 && self.coder == Coder::Fixed).then_some(index))
                .chain(chunks(layer, Region::Dynamic, dynamic))
        });
        sections.inspect(|_| Work::Sections.count(1))
    }

    /// The required sections, each with its entry in the table.
    pub(crate) fn planned_sections(&self) -> impl Iterator<Item = (PlannedSection, &Section)> {
        let visited = self.sections.iter().inspect(|_| Work::Sections.count(1));
        self.plan().zip(visited.filter(|s| !matches!(s.kind, SectionKind::Unknown(_))))
    }

    /// Checks the table against the counts.
    fn check_table(&self) -> Result<(), Error> {
        let mut plan = self.plan();
        let mut offset = self.head_bytes;
        let table_at = self.head_bytes - 4 - self.sections.len() * ENTRY_BYTES;
        for (i, section) in self.sections.iter().enumerate() {
            Work::Sections.count(1);
            let at = table_at + i * ENTRY_BYTES;
            let error = |expected: String, found: String| {
                Error::format(at, FormatError::Sections { expected, found })
            };
            if section.offset != offset {
                return Err(error(format!("offset {offset}"), format!("offset {}", section.offset)));
            }
            offset = section.end();
            if matches!(section.kind, SectionKind::Unknown(_)) {
                continue;
            }
            let planned =
                plan.next().ok_or_else(|| error("no further section".into(), format!("{section:?}")))?;
            let found = PlannedSection {
                kind: section.kind,
                layer: section.layer,
                region: section.region,
                chunk: section.chunk,
                rows: planned.rows,
            };
            if found != planned || !section.critical {
                return Err(error(format!("critical {planned:?}"), format!("{section:?}")));
            }
            let raw_length = match (planned.kind, self.coder) {
                (SectionKind::TimeIndex, _) | (_, Coder::Context) => section.length,
                (_, Coder::Fixed) => fixed::raw_bytes(self.columns(planned.region), planned.rows),
            };
            if section.raw_length != raw_length {
                return Err(error(format!("raw length {raw_length}"), format!("{}", section.raw_length)));
            }
        }
        match plan.next() {
            None => Ok(()),
            Some(planned) => {
                let error = FormatError::Sections {
                    expected: format!("{planned:?}"),
                    found: "the end of the table".into(),
                };
                Err(Error::format(self.head_bytes - 4, error))
            }
        }
    }

    /// Writes the head. Recomputes `head_bytes` and the offsets of the sections from the lengths.
    ///
    /// # Errors
    /// [`EncodeError::TooLarge`](crate::EncodeError::TooLarge) if a number exceeds 32 bits.
    #[cfg(feature = "encode")]
    pub(crate) fn write(&self) -> Result<Vec<u8>, crate::EncodeError> {
        let mut w = crate::bytes::Writer::default();
        let names = self.info.viewpoints.iter().map(|v| 29 + v.name.len()).sum::<usize>();
        let table = self.sections.len() * ENTRY_BYTES;
        let length = FIXED_BYTES + 8 * self.layers.len() + names + table + 4;
        let u32_of = |x: usize| u32::try_from(x).map_err(|_| crate::EncodeError::TooLarge);
        w.bytes.extend_from_slice(&MAGIC);
        w.u16(self.version_major);
        w.u16(crate::VERSION_MINOR);
        w.u32(u32_of(length)?);
        w.f32(self.info.duration_s);
        w.f32(self.info.fps);
        w.f32x3(self.info.up);
        w.f32(self.info.metres_per_unit);
        w.f32x3(self.bounds[0]);
        w.f32x3(self.bounds[1]);
        w.u8(self.coder.id());
        w.u8(self.sh_degree);
        w.u8(self.motion_order);
        let flag = |is_set, bit| if is_set { bit } else { 0 };
        w.u8(flag(self.rotation_rates, ROTATION_RATES)
            | flag(self.filter == PixelFilter::Mip, MIP)
            | flag(self.plate_filter == PixelFilter::Mip, PLATE_MIP));
        w.u8(self.layers.len() as u8);
        w.u8(self.info.viewpoints.len() as u8);
        w.u8(self.plate_sh_degree);
        w.u8(0);
        w.u32(u32_of(self.plate_len)?);
        w.u32(u32_of(self.sections.len())?);
        let mut start = LayerEnd::default();
        for end in &self.layers {
            w.u32(u32_of(end.static_count - start.static_count)?);
            w.u32(u32_of(end.dynamic_count - start.dynamic_count)?);
            start = *end;
        }
        for viewpoint in &self.info.viewpoints {
            w.f32x3(viewpoint.position);
            w.f32x3(viewpoint.target);
            w.f32(viewpoint.fov_y);
            w.u8(viewpoint.name.len() as u8);
            w.bytes.extend_from_slice(viewpoint.name.as_bytes());
        }
        let mut offset = length;
        for section in &self.sections {
            Section { offset, ..*section }.write(&mut w)?;
            offset += section.length;
        }
        let crc = crc32fast::hash(&w.bytes);
        w.u32(crc);
        Ok(w.bytes)
    }
}

/// The chunks that `rows` Gaussians are cut into.
fn chunks(layer: u8, region: Region, rows: usize) -> impl Iterator<Item = PlannedSection> {
    (0..rows.div_ceil(CHUNK_ROWS)).map(move |chunk| PlannedSection {
        kind: SectionKind::Gaussians,
        layer,
        region,
        chunk: chunk as u32,
        rows: (rows - chunk * CHUNK_ROWS).min(CHUNK_ROWS),
    })
}
