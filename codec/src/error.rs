//! [`Error`]: why bytes are not a clip, by whose fault, and at which byte.

use crate::header::VERSION_MAJOR;

/// Why a package could not be decoded. Every message names the byte it happened at.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The bytes are no package, or a damaged one.
    #[error("{error}, at byte {offset}")]
    Format {
        /// Offset of the first byte that is wrong, from the start of the package.
        offset: usize,
        /// What is wrong there.
        error: FormatError,
    },
    /// The package is of a format version that this decoder does not read.
    #[error(
        "package version {major}.{minor} cannot be read, at byte 4; this program reads {VERSION_MAJOR}.x"
    )]
    Version {
        /// Major version of the package.
        major: u16,
        /// Minor version of the package.
        minor: u16,
    },
    /// Decoding needs more than the caller allows.
    #[error("the package asks for {needed} {what}, {limit} allowed, at byte {offset}")]
    Limits {
        /// Offset of the number that asks for too much.
        offset: usize,
        /// What is limited, in the plural.
        what: &'static str,
        /// Amount the package asks for.
        needed: usize,
        /// Amount allowed by [`Limits`](crate::Limits).
        limit: usize,
    },
}

/// What is wrong with the bytes of a package.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// The first bytes are not the magic number.
    #[error("not an .aarc package")]
    Magic,
    /// The bytes end before the first layer does.
    #[error("package cut short: {needed} bytes needed for the first layer, {available} present")]
    Cut {
        /// Length up to which the package would have to reach.
        needed: usize,
        /// Length it has.
        available: usize,
    },
    /// A part ends before its last field.
    #[error("{part} is too short")]
    Short {
        /// The part.
        part: &'static str,
    },
    /// Bytes follow where none belong.
    #[error("{count} extra bytes after {part}")]
    Extra {
        /// Number of bytes.
        count: usize,
        /// What should have been the last thing.
        part: &'static str,
    },
    /// A checksum differs from the bytes it covers.
    #[error("damaged {part}: CRC-32 is {computed:08x}, {stored:08x} expected")]
    Crc {
        /// What the checksum covers.
        part: &'static str,
        /// Checksum in the package.
        stored: u32,
        /// Checksum of the bytes present.
        computed: u32,
    },
    /// A number or text lies outside its range.
    #[error("bad {field}: {value}")]
    Value {
        /// Name of the field.
        field: &'static str,
        /// What it holds.
        value: String,
    },
    /// A section that must be understood is of an unknown kind.
    #[error("unknown section kind {kind}, marked critical")]
    UnknownSection {
        /// The kind.
        kind: u8,
    },
    /// The section table does not fit the counts in the header.
    #[error("section table: {expected} expected, {found} found")]
    Sections {
        /// What the counts ask for.
        expected: String,
        /// What the table has.
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
        /// The row.
        row: usize,
    },
}

impl Error {
    pub(crate) fn format(offset: usize, error: FormatError) -> Error {
        Error::Format { offset, error }
    }

    pub(crate) fn value(offset: usize, field: &'static str, value: impl std::fmt::Debug) -> Error {
        Error::Format { offset, error: FormatError::Value { field, value: format!("{value:?}") } }
    }
}

/// Why a field could not be packaged; always the caller's fault.
#[cfg(feature = "encode")]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// There is nothing to package.
    #[error("the field has no Gaussians")]
    Empty,
    /// A field breaks its own invariants or holds numbers too large to code.
    #[error("the {part} cannot be packaged: {reason}")]
    Field {
        /// `field` or `plate`.
        part: &'static str,
        /// One sentence.
        reason: String,
    },
    /// Duration, axes or viewpoints are out of range.
    #[error("the clip's metadata cannot be packaged: bad {field}: {value}")]
    Info {
        /// Name of the field.
        field: &'static str,
        /// What it holds.
        value: String,
    },
    /// Layer ends are zero, do not rise, or are too many.
    #[error("layers must be at most {} rising counts above 0, got {layers:?}", crate::header::LAYERS_MAX)]
    Layers {
        /// The layer ends given.
        layers: Vec<usize>,
    },
    /// The precision asked for is no number, or is that of another field.
    #[error("the precision cannot be used: {reason}")]
    Precision {
        /// One sentence.
        reason: String,
    },
    /// The package would pass 4 GiB, the reach of its offsets.
    #[error("the package would be larger than 4 GiB")]
    TooLarge,
}
