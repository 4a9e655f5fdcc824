//! [`Desk`]: a folder in memory, where the system has one, to lay inputs out in.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

/// Where Linux keeps files in memory.
const MEMORY: &str = "/dev/shm";

/// A folder that goes with the process.
pub(crate) struct Desk(TempDir);

impl Desk {
    /// With these files in it, by their paths.
    pub(crate) fn with(files: impl IntoIterator<Item = (impl AsRef<Path>, Vec<u8>)>) -> Desk {
        let memory = Path::new(MEMORY);
        let place = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let desk = Desk(Builder::new().prefix("aarc-fuzz-").tempdir_in(place).expect("a temporary folder"));
        for (path, bytes) in files {
            desk.put(path, &bytes);
        }
        desk
    }

    /// A path on the desk.
    pub(crate) fn path(&self, path: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(path)
    }

    /// Writes a file, in the place of the one that is there.
    pub(crate) fn put(&self, path: impl AsRef<Path>, bytes: &[u8]) {
        let path = self.path(path);
        let folder = path.parent().expect("a file is in a folder");
        fs::create_dir_all(folder).expect("folders can be made");
        fs::write(path, bytes).expect("files can be written");
    }

    /// Removes a file, if it is there.
    pub(crate) fn take(&self, path: impl AsRef<Path>) {
        let _ = fs::remove_file(self.path(path));
    }
}

/// Checks that an error is one line about data.
///
/// # Panics
/// If it is a defect, or says more.
pub(crate) fn check_refusal(error: &anyhow::Error) {
    let fault = error.downcast_ref::<program::Fault>().unwrap_or_else(|| panic!("a defect: {error:?}"));
    assert_eq!(fault.exit_code(), 3, "{fault}");
    let text = fault.to_string();
    assert!(!text.is_empty() && !text.contains('\n'), "one line: {text}");
}
