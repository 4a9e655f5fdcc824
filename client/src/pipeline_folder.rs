//! [`PipelineFolder`]: compiled pipelines on disk, for the next run.
//!
//! A file is a checksum and what the driver saved. It is replaced whole or not at all. A missing, damaged or unwritable
//! file costs only the time to compile, so that failures go to the debug log.

use std::fs;
use std::hash::{DefaultHasher, Hasher as _};
use std::path::PathBuf;

use program::output;

use crate::gpu::PipelineStore;
use crate::regular_file::read_regular;

/// Most bytes of a file that are read: more than drivers make of the pipelines of this program.
const BYTES_MAX: u64 = 32 << 20;

/// A folder of compiled pipelines, with a file for each device. Several players may share it.
pub struct PipelineFolder(PathBuf);

impl PipelineFolder {
    /// The store in `folder`, which the first save creates.
    pub fn new(folder: PathBuf) -> PipelineFolder {
        PipelineFolder(folder)
    }
}

impl PipelineStore for PipelineFolder {
    fn load(&self, name: &str) -> Option<Vec<u8>> {
        let path = self.0.join(name);
        let bytes = read_regular(&path, BYTES_MAX)
            .inspect_err(|error| log::debug!("{}: {error}: pipelines are compiled", path.display()))
            .ok()?;
        match bytes.split_first_chunk() {
            Some((sum, saved)) if u64::from_le_bytes(*sum) == checksum(saved) => Some(saved.to_vec()),
            _ => {
                log::debug!("{}: damaged: pipelines are compiled", path.display());
                None
            }
        }
    }

    fn save(&self, name: &str, bytes: &[u8]) {
        let path = self.0.join(name);
        let bytes = [&checksum(bytes).to_le_bytes(), bytes].concat();
        let written = fs::create_dir_all(&self.0)
            .map_err(|error| error.to_string())
            .and_then(|()| output::write(&path, &bytes).map_err(|fault| fault.to_string()));
        if let Err(why) = written {
            log::debug!("pipelines are not kept: {why}");
        }
    }
}

/// Another version of the standard library may have another hash: then pipelines are compiled once more.
fn checksum(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(bytes);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_files_are_as_good_as_none() {
        let folder = tempfile::tempdir().unwrap();
        let store = PipelineFolder::new(folder.path().join("made/on/demand"));
        assert_eq!(store.load("a"), None);
        store.save("a", b"old");
        store.save("a", b"pipelines");
        assert_eq!(store.load("a").as_deref(), Some(&b"pipelines"[..]));
        assert_eq!(store.load("b"), None);
        assert_eq!(fs::read_dir(&store.0).unwrap().count(), 1, "no temporary file stays");

        let path = store.0.join("a");
        let whole = fs::read(&path).unwrap();
        for end in 0..whole.len() {
            fs::write(&path, &whole[..end]).unwrap();
            assert_eq!(store.load("a"), None, "{end} bytes");
        }
        for i in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[i] ^= 4;
            fs::write(&path, damaged).unwrap();
            assert_eq!(store.load("a"), None, "byte {i}");
        }
    }

    #[test]
    fn a_place_without_files_keeps_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, b"no folder").unwrap();
        let store = PipelineFolder::new(file);
        store.save("a", b"pipelines");
        assert_eq!(store.load("a"), None);
        fs::create_dir(folder.path().join("b")).unwrap();
        let store = PipelineFolder::new(folder.path().into());
        store.save("b", b"pipelines");
        assert_eq!(store.load("b"), None, "a folder has the file's name");
    }
}
