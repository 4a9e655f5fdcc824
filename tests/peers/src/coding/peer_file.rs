//! [`PeerFile`]: a field coded by another coder.

use codec::Field;

/// A file of another coder.
pub(super) struct PeerFile {
    pub(super) name: &'static str,
    /// Parts of the field that the format cannot store.
    pub(super) leaves_out: &'static str,
    pub(super) bytes: usize,
    /// The decoded field.
    pub(super) field: Field,
    /// Decodes the file.
    pub(super) decode: Box<dyn Fn() -> anyhow::Result<()>>,
}
