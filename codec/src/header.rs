//! [`Contents`]: reads and writes the head of a package.
//!
//! The head is everything before the first section: magic, version, metadata, counts, viewpoints
//! and the section table, with one CRC-32 over all of it. Sections follow without gaps. The counts
//! determine their order, chunking and uncompressed lengths, so the table is checked against the
//! counts instead of trusted.

#[cfg(feature = "encode")]
use crate::preamble::{Preamble, finish_head, u32_of, write_viewpoints};
use crate::{
    ClipInfo, Coder, Error, LayerEnd, Limits, PixelFilter,
    columns::{PackageColumns, TemporalColumns},
    counters::Work,
    error::FormatError,
    fixed,
    format::{CHUNK_ROWS, COUNTS_OFFSET, ENTRY_BYTES, LAYERS_OFFSET, POSTER_BYTES},
    limits::Budget,
    preamble::{Head, read_near, read_viewpoints},
    section::{Region, Section, SectionKind},
};

/// The head of a package: metadata, counts and section table.
#[derive(Clone, Debug, PartialEq)]
pub struct Contents {
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
    /// Whether a graphics device computed numbers of the Gaussians, so that the same field may give another package
    /// elsewhere. Decoding does not depend on it.
    pub by_device: bool,
    /// [`Field::near`](crate::Field::near) of all regions and the plate.
    pub near: f32,
    /// Length of the head in bytes: the offset of the first section.
    pub head_bytes: usize,
    /// CRC-32 (IEEE 802.3) of the head, as its last four bytes store it.
    pub head_crc: u32,
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
/// - [`Error::Version`] if the major version is not [`VERSION_MAJOR`](crate::VERSION_MAJOR).
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
    let head = Head::checked(bytes)?;
    if head.is_take() {
        return Err(Error::format(LAYERS_OFFSET, FormatError::Take));
    }
    contents_of(&head, bytes.len(), limits, budget)
}

/// Parses the head of a clip package, with the memory of `budget`. `available` bytes of the package are given.
///
/// # Errors
/// See [`contents`].
pub(crate) fn contents_of(
    head: &Head,
    available: usize,
    limits: &Limits,
    budget: &mut Budget,
) -> Result<Contents, Error> {
    let contents = parse(head, limits, budget)?;
    contents.check_table()?;
    check_end(&contents, available)?;
    Ok(contents)
}

/// Checks that a package has at most the Gaussians of `limits`.
///
/// # Errors
/// [`Error::Limits`] if it has more.
pub(crate) fn check_count(contents: &Contents, limits: &Limits) -> Result<(), Error> {
    let needed = contents.layers.last().map_or(0, |end| end.total()) + contents.plate_len;
    let limit = limits.max_gaussians;
    if needed <= limit {
        return Ok(());
    }
    Err(Error::Limits { offset: COUNTS_OFFSET, quantity: "Gaussians", needed, limit })
}

/// Checks that `available` bytes are no more than the package has.
///
/// # Errors
/// [`FormatError::Extra`] if they are.
pub(crate) fn check_end(contents: &Contents, available: usize) -> Result<(), Error> {
    let end = contents.package_bytes();
    if available <= end {
        return Ok(());
    }
    Err(Error::format(end, FormatError::Extra { count: available - end, part: "the last section" }))
}

/// Parses a head whose checksum has been checked.
// Long: one field of the head after the other.
fn parse(head: &Head, limits: &Limits, budget: &mut Budget) -> Result<Contents, Error> {
    let (preamble, mut reader) = head.preamble()?;
    let plate_len = preamble.plate_len;
    let mut layers = Vec::with_capacity(preamble.layer_count);
    let mut end = LayerEnd::default();
    for _ in 0..preamble.layer_count {
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

    let mut info = preamble.info;
    read_viewpoints(&mut reader, &mut info, preamble.viewpoint_count)?;
    let near = read_near(&mut reader, preamble.has_near)?;

    let table_bytes = head.bytes() - 4 - reader.at();
    let section_count = preamble.entry_count;
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
    let TemporalColumns { motion_order, rotation_rates } = preamble.columns.temporal;
    Ok(Contents {
        version_minor: head.version_minor,
        info,
        bounds: preamble.bounds,
        coder: preamble.coder,
        sh_degree: preamble.columns.sh_degree,
        motion_order,
        rotation_rates,
        filter: preamble.filter,
        layers,
        plate_len,
        plate_sh_degree: preamble.columns.plate_sh_degree,
        plate_filter: preamble.plate_filter,
        by_device: preamble.by_device,
        near,
        head_bytes: head.bytes(),
        head_crc: head.crc,
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

impl Contents {
    /// Compares the checksums of all sections but sections of unknown kinds with their bytes in the whole `package`,
    /// without decoding anything.
    ///
    /// # Errors
    /// [`Error::Format`] at the first section that is damaged, or that `package` ends before.
    pub fn check_sections(&self, package: &[u8]) -> Result<(), Error> {
        let is_known = |section: &&Section| !matches!(section.kind, SectionKind::Unknown(_));
        self.sections.iter().filter(is_known).try_for_each(|section| section.payload(package).map(drop))
    }

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

    /// The columns of all regions.
    pub(crate) fn columns(&self) -> PackageColumns {
        PackageColumns {
            sh_degree: self.sh_degree,
            temporal: TemporalColumns {
                motion_order: self.motion_order,
                rotation_rates: self.rotation_rates,
            },
            plate_sh_degree: self.plate_sh_degree,
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
        self.plan().zip(visited.filter(|section| section.kind.is_counted()))
    }

    /// Checks the table against the counts.
    // Long: what each kind of section requires.
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
            match section.kind {
                SectionKind::Unknown(_) => continue,
                SectionKind::Sound => {
                    let planned =
                        Section { critical: false, layer: 0, region: Region::Static, chunk: 0, ..*section };
                    if i > 0 || *section != (Section { raw_length: section.length, ..planned }) {
                        let expected = "sound first, of layer 0, not critical, not compressed";
                        return Err(error(expected.into(), format!("{section:?}")));
                    }
                    continue;
                }
                SectionKind::Poster => {
                    let required = Section {
                        critical: false,
                        layer: 0,
                        region: Region::Static,
                        chunk: 0,
                        length: POSTER_BYTES,
                        raw_length: POSTER_BYTES,
                        ..*section
                    };
                    let is_first = self.sections[..i]
                        .iter()
                        .all(|before| !before.kind.is_counted() && before.kind != section.kind);
                    if *section != required || !is_first {
                        let expected = format!(
                            "one poster before all chunks, of layer 0, not critical, of {POSTER_BYTES} bytes"
                        );
                        return Err(error(expected, format!("{section:?}")));
                    }
                    continue;
                }
                SectionKind::Gaussians | SectionKind::TimeIndex => {}
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
                (SectionKind::TimeIndex, _) | (_, Coder::Rans) => section.length,
                (_, Coder::Fixed) => fixed::raw_bytes(self.columns().in_region(planned.region), planned.rows),
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

    /// Writes the head. Recomputes its length and checksum, and the offsets of the sections from their lengths.
    ///
    /// # Errors
    /// [`EncodeError::TooLarge`](crate::EncodeError::TooLarge) if a number exceeds 32 bits.
    #[cfg(feature = "encode")]
    pub(crate) fn write(&self) -> Result<Vec<u8>, crate::EncodeError> {
        let preamble = Preamble {
            info: self.info.clone(),
            bounds: self.bounds,
            coder: self.coder,
            columns: self.columns(),
            filter: self.filter,
            plate_filter: self.plate_filter,
            by_device: self.by_device,
            has_near: self.near > 0.0,
            layer_count: self.layers.len(),
            viewpoint_count: self.info.viewpoints.len(),
            plate_len: self.plate_len,
            entry_count: self.sections.len(),
        };
        let mut w = preamble.write(self.version_minor)?;
        let mut start = LayerEnd::default();
        for end in &self.layers {
            w.u32(u32_of(end.static_count - start.static_count)?);
            w.u32(u32_of(end.dynamic_count - start.dynamic_count)?);
            start = *end;
        }
        write_viewpoints(&mut w, &self.info, self.near);
        let mut offset = w.bytes.len() + self.sections.len() * ENTRY_BYTES + 4;
        for section in &self.sections {
            Section { offset, ..*section }.write(&mut w)?;
            offset += section.length;
        }
        finish_head(w)
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
