//! Files of clips: bounded reading, and decoding on all cores.

use std::fs::File;
use std::io::Read;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread;

use codec::{Clip, Error, Limits, decode_parallel};
use program::Fault;

/// Reads and decodes a package.
///
/// # Errors
/// [`Fault::Data`] with the path and the reason.
pub fn load_file(path: &Path, limits: &Limits) -> Result<Clip, Fault> {
    let fault = |reason: String| Fault::Data(format!("{}: {reason}", path.display()));
    if path.is_dir() {
        return Err(fault("is a folder: name an .aarc file".into()));
    }
    let bytes = read(path, limits.max_bytes).map_err(fault)?;
    decode(&bytes, limits).map_err(|error| fault(error.to_string()))
}

/// Reads a file of at most `max_bytes`.
///
/// # Errors
/// The system's message, or that the file is larger.
pub(crate) fn read(path: &Path, max_bytes: usize) -> Result<Vec<u8>, String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    file.take(max_bytes as u64 + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() > max_bytes {
        return Err(format!("larger than {} MiB, the most that is read", max_bytes >> 20));
    }
    Ok(bytes)
}

/// Decodes a package on all cores.
pub(crate) fn decode(bytes: &[u8], limits: &Limits) -> Result<Clip, Error> {
    let threads = thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    decode_parallel(bytes, limits, threads)
}

/// The paths of the clips in a folder, sorted by name.
pub(crate) fn clips_in(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    let mut clips: Vec<_> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "aarc"))
        .collect();
    clips.sort();
    clips
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        for bytes in [None, Some(&b""[..]), Some(b"not a package")] {
            bytes.map_or(Ok(()), |bytes| std::fs::write(&path, bytes)).unwrap();
            let Err(Fault::Data(message)) = load_file(&path, &Limits::default()) else {
                panic!("{bytes:?} is bad data")
            };
            assert!(message.starts_with(&path.display().to_string()), "{message}");
        }
        assert!(matches!(load_file(folder.path(), &Limits::default()), Err(Fault::Data(_))));
    }
}
