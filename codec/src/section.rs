//! [`Section`]: an entry of the section table, and the checksum of the bytes it points to.

use crate::{Error, bytes::Reader, counters::Work, error::FormatError};

/// An entry of the section table: a checksummed run of bytes of a package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Section {
    /// Content of the section.
    pub kind: SectionKind,
    /// Whether a reader that does not know `kind` must refuse the package.
    pub critical: bool,
    /// Number of the layer, from 0; the layer is complete once all its sections are.
    pub layer: u8,
    /// The region whose Gaussians the section describes.
    pub region: Region,
    /// Number of the chunk within its layer and region, from 0.
    pub chunk: u32,
    /// Offset of the section from the start of the package, in bytes.
    pub offset: usize,
    /// Length in the package, in bytes.
    pub length: usize,
    /// Length once decompressed, in bytes; `length` where the section is not compressed.
    pub raw_length: usize,
    /// CRC-32 (IEEE 802.3) of the bytes in the package.
    pub crc: u32,
}

/// Content of a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SectionKind {
    /// Up to 4096 Gaussians.
    Gaussians,
    /// Time index of a layer, as rows per cell. Coder `fixed` only.
    TimeIndex,
    /// The sound of the clip. Not critical.
    Sound,
    /// The picture that stands for the clip, as a time and a view. Not critical.
    Poster,
    /// A kind, by its number, that a later minor version defines. Skipped.
    Unknown(u8),
}

/// The region of a clip that a Gaussian belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Region {
    /// Gaussians that are always on and motionless, without temporal columns.
    Static,
    /// Gaussians with a temporal window, motion or rotation rate.
    Dynamic,
    /// Static background, behind everything else.
    Plate,
}

impl SectionKind {
    #[cfg(feature = "encode")]
    fn id(self) -> u8 {
        match self {
            SectionKind::Gaussians => 1,
            SectionKind::TimeIndex => 2,
            SectionKind::Sound => 3,
            SectionKind::Poster => 4,
            SectionKind::Unknown(id) => id,
        }
    }

    fn from_id(id: u8) -> SectionKind {
        match id {
            1 => SectionKind::Gaussians,
            2 => SectionKind::TimeIndex,
            3 => SectionKind::Sound,
            4 => SectionKind::Poster,
            id => SectionKind::Unknown(id),
        }
    }

    /// Whether the counts in the head decide if such a section is there.
    pub(crate) fn is_counted(self) -> bool {
        matches!(self, SectionKind::Gaussians | SectionKind::TimeIndex)
    }

    /// Name for checksum errors.
    fn name(self) -> &'static str {
        match self {
            SectionKind::Gaussians => "chunk of Gaussians",
            SectionKind::TimeIndex => "time index",
            SectionKind::Sound => "sound",
            SectionKind::Poster => "poster",
            SectionKind::Unknown(_) => "unknown section",
        }
    }
}

impl Section {
    /// Reads an entry of the table and checks it by itself, not against the other entries.
    pub(crate) fn read(reader: &mut Reader) -> Result<Section, Error> {
        let at = reader.at();
        let kind = SectionKind::from_id(reader.u8()?);
        let flags = reader.u8()?;
        let critical = flags & 1 != 0;
        if let SectionKind::Unknown(kind) = kind
            && critical
        {
            return Err(Error::format(at, FormatError::UnknownSection { kind }));
        }
        if flags > 1 {
            return Err(Error::value(at + 1, "section flags", flags));
        }
        let layer = reader.u8()?;
        let region = match reader.u8()? {
            0 => Region::Static,
            1 => Region::Dynamic,
            2 => Region::Plate,
            other => return Err(Error::value(at + 3, "section region", other)),
        };
        Ok(Section {
            kind,
            critical,
            layer,
            region,
            chunk: reader.u32()?,
            offset: reader.u32()? as usize,
            length: reader.u32()? as usize,
            raw_length: reader.u32()? as usize,
            crc: reader.u32()?,
        })
    }

    /// Writes an entry of the table.
    #[cfg(feature = "encode")]
    pub(crate) fn write(&self, writer: &mut crate::bytes::Writer) -> Result<(), crate::EncodeError> {
        writer.u8(self.kind.id());
        writer.u8(u8::from(self.critical));
        writer.u8(self.layer);
        writer.u8(match self.region {
            Region::Static => 0,
            Region::Dynamic => 1,
            Region::Plate => 2,
        });
        writer.u32(self.chunk);
        for number in [self.offset, self.length, self.raw_length] {
            writer.u32(u32::try_from(number).map_err(|_| crate::EncodeError::TooLarge)?);
        }
        writer.u32(self.crc);
        Ok(())
    }

    /// Offset of the first byte after the section.
    pub fn end(&self) -> usize {
        self.offset.saturating_add(self.length)
    }

    /// Returns the bytes of the section.
    ///
    /// # Errors
    /// [`Error::Format`] if `package` ends before the section does, or the checksum differs.
    pub(crate) fn payload<'a>(&self, package: &'a [u8]) -> Result<&'a [u8], Error> {
        let truncated = FormatError::Truncated { needed: self.end(), available: package.len() };
        let bytes = package.get(self.offset..self.end()).ok_or(Error::format(package.len(), truncated))?;
        Work::Bytes.count(bytes.len());
        let computed = crc32fast::hash(bytes);
        if computed != self.crc {
            let error = FormatError::Crc { part: self.kind.name(), stored: self.crc, computed };
            return Err(Error::format(self.offset, error));
        }
        Ok(bytes)
    }
}
