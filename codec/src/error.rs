//! [`Error`] and `EncodeError`: why a package cannot be decoded, or a field not be packaged.

#[cfg(feature = "encode")]
use crate::format::LAYERS_MAX;
use crate::format::VERSION_MAJOR;

/// Why a package could not be decoded.
///
/// Every message is one sentence that names the byte offset at which decoding stopped, for
/// example `damaged head: CRC-32 is 1c291ca3, 00000000 expected, at byte 236`.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The bytes are not a package, or a damaged one.
    #[error("{error}, at byte {offset}")]
    Format {
        /// Offset of the first wrong byte, from the start of the package.
        offset: usize,
        /// What is wrong there.
        error: FormatError,
    },
    /// The package has another major version of the format than [`VERSION_MAJOR`].
    #[error(
        "package version {major}.{minor} cannot be read, at byte 4; this program reads {VERSION_MAJOR}.x"
    )]
    Version {
        /// Major version of the package.
        major: u16,
        /// Minor version of the package.
        minor: u16,
    },
    /// Decoding needs more than [`Limits`](crate::Limits) allows.
    #[error("the package asks for {needed} {quantity}, {limit} allowed, at byte {offset}")]
    Limits {
        /// Offset of the count that asks for too much.
        offset: usize,
        /// The limited quantity, in the plural: `Gaussians` or `bytes of memory`.
        quantity: &'static str,
        /// Amount that the package needs.
        needed: usize,
        /// Amount that the limits allow.
        limit: usize,
    },
}

/// What is wrong with the bytes of a package.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// The first bytes are not the magic number `AARC`.
    #[error("not an .aarc package")]
    Magic,
    /// The bytes end before the first layer does. More bytes may cure this one.
    #[error("package cut short: {needed} bytes needed for the first layer, {available} present")]
    Truncated {
        /// Bytes needed to get further: the end of the prefix, of the head or of the first layer.
        needed: usize,
        /// Bytes given.
        available: usize,
    },
    /// The package is a take, where a clip is expected: [`package`](crate::package()) reads both.
    #[error("the package is a take of several segments, not a clip")]
    Take,
    /// A segment contradicts the table of its take: it was damaged or exchanged.
    #[error("segment {segment} is not the one in the table: {expected} expected, {found} found")]
    Segment {
        /// Number of the segment, from 0.
        segment: usize,
        /// What the table announces.
        expected: String,
        /// What the segment is.
        found: String,
    },
    /// A part of the package ends before its last number.
    #[error("{part} is too short")]
    Short {
        /// Name of the part.
        part: &'static str,
    },
    /// Bytes follow the end of a part.
    #[error("{count} extra bytes after {part}")]
    Extra {
        /// Number of bytes.
        count: usize,
        /// Name of the part.
        part: &'static str,
    },
    /// A checksum differs from the bytes it covers.
    #[error("damaged {part}: CRC-32 is {computed:08x}, {stored:08x} expected")]
    Crc {
        /// Name of the part that the checksum covers.
        part: &'static str,
        /// Checksum in the package.
        stored: u32,
        /// Checksum of the bytes given.
        computed: u32,
    },
    /// A number or text lies outside its range.
    #[error("bad {field}: {value}")]
    Value {
        /// Name of the number or text.
        field: &'static str,
        /// Its value.
        value: String,
    },
    /// A critical section is of an unknown kind.
    #[error("unknown section kind {kind}, marked critical")]
    UnknownSection {
        /// Number of the kind.
        kind: u8,
    },
    /// The section table contradicts the counts in the head.
    #[error("section table: {expected} expected, {found} found")]
    Sections {
        /// Entry that the counts require.
        expected: String,
        /// Entry in the table.
        found: String,
    },
    /// A compressed payload does not expand to its announced length.
    #[error("damaged payload: {reason}")]
    Payload {
        /// Reason given by the decompressor.
        reason: String,
    },
    /// The stored time index contradicts the rows it describes.
    #[error("time index puts row {row} of the dynamic region in the wrong cell")]
    TimeIndex {
        /// Number of the row.
        row: usize,
    },
}

impl Error {
    pub(crate) fn format(offset: usize, error: FormatError) -> Error {
        Error::Format { offset, error }
    }

    /// The same error in a file in which the package begins at `base`.
    pub fn rebased(self, base: usize) -> Error {
        match self {
            Error::Format { offset, error } => Error::format(offset.saturating_add(base), error),
            Error::Limits { offset, quantity, needed, limit } => {
                Error::Limits { offset: offset.saturating_add(base), quantity, needed, limit }
            }
            Error::Version { major, .. } => Error::value(base.saturating_add(4), "major version", major),
        }
    }

    pub(crate) fn value(offset: usize, field: &'static str, value: impl std::fmt::Debug) -> Error {
        Error::format(offset, FormatError::Value { field, value: format!("{value:?}") })
    }
}

/// Why a field could not be packaged: the source or the options are invalid.
#[cfg(feature = "encode")]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// The field is empty.
    #[error("the field has no Gaussians")]
    Empty,
    /// A field breaks its invariants, or holds numbers too large to code.
    #[error("the {part} cannot be packaged: {reason}")]
    Field {
        /// `field` or `plate`.
        part: &'static str,
        /// One sentence.
        reason: String,
    },
    /// Duration, axes or viewpoints are out of range; see [`ClipInfo::check`](crate::ClipInfo::check).
    #[error("the clip's metadata cannot be packaged: bad {field}: {value}")]
    Info {
        /// Name of the number or text.
        field: &'static str,
        /// Its value.
        value: String,
    },
    /// Layer ends are zero, do not rise, or are too many.
    #[error("layers must be at most {LAYERS_MAX} rising counts above 0, got {layers:?}")]
    Layers {
        /// The layer ends given.
        layers: Vec<usize>,
    },
    /// The precision is not a number, or belongs to another field.
    #[error("the precision cannot be used: {reason}")]
    Precision {
        /// One sentence.
        reason: String,
    },
    /// The segments cannot make a take.
    #[error("the take cannot be written: {reason}")]
    Take {
        /// One sentence.
        reason: String,
    },
    /// Bytes that should be a whole clip package are none.
    #[error("the package cannot be changed: {0}")]
    Package(Error),
    /// The package would exceed 4 GiB, the range of its 32-bit offsets.
    #[error("the package would be larger than 4 GiB")]
    TooLarge,
}
