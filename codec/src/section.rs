//! [`Section`]: one entry of the section table, 24 bytes, and the checksum of what it points to.

use crate::{Error, bytes::Reader, error::FormatError};

/// Bytes of one entry of the section table. Format.
pub(crate) const ENTRY_BYTES: usize = 24;

/// A checksummed run of bytes of a package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Section {
    /// What the bytes hold.
    pub kind: SectionKind,
    /// Whether a reader that does not know `kind` must refuse the package.
    pub critical: bool,
    /// The layer whose completeness needs this section.
    pub layer: u8,
    /// The Gaussians described.
    pub region: Region,
    /// Number of the chunk within its layer and region.
    pub chunk: u32,
    /// First byte, from the start of the package.
    pub offset: usize,
    /// Bytes in the package.
    pub length: usize,
    /// Bytes once decompressed.
    pub raw_length: usize,
    /// CRC-32 (IEEE 802.3) of the bytes in the package.
    pub crc: u32,
}

/// What a section holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SectionKind {
    /// Up to 4096 Gaussians.
    Gaussians,
    /// Rows per cell of the time index of a layer.
    TimeIndex,
    /// Something that a later version defined. Skipped.
    Unknown(u8),
}

/// The part of a clip to which a Gaussian belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Region {
    /// Always on and motionless.
    Static,
    /// Windowed or moving.
    Dynamic,
    /// Static background.
    Plate,
}

impl SectionKind {
    #[cfg(feature = "encode")]
    fn id(self) -> u8 {
        match self {
            SectionKind::Gaussians => 1,
            SectionKind::TimeIndex => 2,
            SectionKind::Unknown(id) => id,
        }
    }

    fn from_id(id: u8) -> SectionKind {
        match id {
            1 => SectionKind::Gaussians,
            2 => SectionKind::TimeIndex,
            id => SectionKind::Unknown(id),
        }
    }

    /// Name for checksum errors.
    fn name(self) -> &'static str {
        match self {
            SectionKind::Gaussians => "chunk of Gaussians",
            SectionKind::TimeIndex => "time index",
            SectionKind::Unknown(_) => "unknown section",
        }
    }
}

impl Section {
    /// Reads an entry of the table. Only the entry itself is checked, not its fit to the others.
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

    /// First byte after the section. Cannot overflow: both parts come from 32-bit numbers.
    pub fn end(&self) -> usize {
        self.offset.saturating_add(self.length)
    }

    /// The bytes of the section, which must be present in `package`.
    ///
    /// # Errors
    /// If their checksum differs.
    pub(crate) fn payload<'a>(&self, package: &'a [u8]) -> Result<&'a [u8], Error> {
        let bytes = package.get(self.offset..self.end()).ok_or(Error::format(
            package.len(),
            FormatError::Cut { needed: self.end(), available: package.len() },
        ))?;
        let computed = crc32fast::hash(bytes);
        if computed != self.crc {
            let error = FormatError::Crc { part: self.kind.name(), stored: self.crc, computed };
            return Err(Error::format(self.offset, error));
        }
        Ok(bytes)
    }
}
