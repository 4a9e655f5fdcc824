//! A value in a file of its own, with the version of its contents and a checksum.

use std::path::Path;

use program::output;
use serde::{Serialize, de::DeserializeOwned};

use super::plan::crc;

/// First bytes of a file; the last one is the version of its contents.
pub(super) type Magic = [u8; 8];

const CRC_BYTES: usize = 4;

/// Why a file does not hold a value.
pub(super) enum Unstored {
    /// It is of another kind or version.
    Version,
    /// Its bytes are not those that were written.
    Damaged,
}

/// The value in the `bytes` of a file.
pub(super) fn stored<T: DeserializeOwned>(magic: Magic, bytes: &[u8]) -> Result<T, Unstored> {
    let body = bytes.strip_prefix(&magic).ok_or(Unstored::Version)?;
    let (checksum, body) = body.split_first_chunk().ok_or(Unstored::Damaged)?;
    if u32::from_le_bytes(*checksum) != crc(body) {
        return Err(Unstored::Damaged);
    }
    postcard::from_bytes(body).map_err(|_| Unstored::Damaged)
}

/// Writes a value to `path`, whole or not at all, and durably.
///
/// # Errors
/// [`Fault::Usage`](program::Fault::Usage) that names the path.
pub(super) fn store(path: &Path, magic: Magic, value: &impl Serialize) -> anyhow::Result<()> {
    let mut bytes = postcard::to_extend(value, [&magic[..], &[0; CRC_BYTES]].concat())?;
    let (head, body) = bytes.split_at_mut(magic.len() + CRC_BYTES);
    head[magic.len()..].copy_from_slice(&crc(body).to_le_bytes());
    Ok(output::write_durable(path, &bytes)?)
}
