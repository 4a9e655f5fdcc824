//! Small JSON files of what the player remembers from run to run. Each is a convenience: a missing or damaged one is a
//! fresh start.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use tempfile::NamedTempFile;

/// Reads a file of at most `max_bytes`.
///
/// # Errors
/// If it is missing, larger, or does not hold a `T`.
pub(crate) fn read<T: DeserializeOwned>(path: &Path, max_bytes: u64) -> io::Result<T> {
    let mut text = String::new();
    File::open(path)?.take(max_bytes + 1).read_to_string(&mut text)?;
    if text.len() as u64 > max_bytes {
        return Err(io::Error::other(format!("larger than {max_bytes} bytes")));
    }
    Ok(serde_json::from_str(&text)?)
}

/// The bytes of a file with these contents.
pub(crate) fn encode(contents: &impl Serialize) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(contents).expect("numbers and strings serialise");
    bytes.push(b'\n');
    bytes
}

/// Writes the file `name` in `folder`, which is made if it is missing, whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut file = NamedTempFile::new_in(folder)?;
    file.write_all(bytes)?;
    // A headset may lose power at any time: first the bytes, then the name.
    file.as_file().sync_all()?;
    file.persist(folder.join(name))?;
    Ok(())
}
