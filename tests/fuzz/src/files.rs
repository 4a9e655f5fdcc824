//! [`InputFiles`]: a temporary folder for the files of an input, in memory if possible.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

/// Folder of Linux's in-memory file system.
const MEMORY: &str = "/dev/shm";

/// A temporary folder, removed with the process.
pub(crate) struct InputFiles(TempDir);

impl InputFiles {
    /// Creates a folder with these files.
    pub(crate) fn new(files: impl IntoIterator<Item = (impl AsRef<Path>, Vec<u8>)>) -> InputFiles {
        let memory = Path::new(MEMORY);
        let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder =
            InputFiles(Builder::new().prefix("aarc-fuzz-").tempdir_in(parent).expect("a temporary folder"));
        for (path, bytes) in files {
            folder.put(path, &bytes);
        }
        folder
    }

    /// The path of a file in the folder.
    pub(crate) fn path(&self, path: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(path)
    }

    /// Writes or replaces a file.
    pub(crate) fn put(&self, path: impl AsRef<Path>, bytes: &[u8]) {
        let path = self.path(path);
        let folder = path.parent().expect("a file is in a folder");
        fs::create_dir_all(folder).expect("folders can be made");
        fs::write(path, bytes).expect("files can be written");
    }

    /// Removes a file if it exists.
    pub(crate) fn remove(&self, path: impl AsRef<Path>) {
        let _ = fs::remove_file(self.path(path));
    }
}

/// Checks that an error reports bad data in one line.
///
/// # Panics
/// If it is a defect, or has several lines.
pub(crate) fn check_refusal(error: &anyhow::Error) {
    let fault = error.downcast_ref::<program::Fault>().unwrap_or_else(|| panic!("a defect: {error:?}"));
    assert_eq!(fault.exit_code(), 3, "{fault}");
    let text = fault.to_string();
    assert!(!text.is_empty() && !text.contains('\n'), "one line: {text}");
}
