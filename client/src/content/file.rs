//! [`read`]: a file of bounded size.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use program::read_error;

/// Reads a file of at most `max_bytes`.
///
/// # Errors
/// The reason, or that the file is larger.
pub(crate) fn read(path: &Path, max_bytes: usize) -> Result<Vec<u8>, String> {
    let file = File::open(path).map_err(|error| read_error(&error))?;
    let mut bytes = Vec::new();
    file.take(max_bytes as u64 + 1).read_to_end(&mut bytes).map_err(|error| read_error(&error))?;
    if bytes.len() > max_bytes {
        return Err(format!("larger than {} MiB, the most that is read: name another file", max_bytes >> 20));
    }
    Ok(bytes)
}
