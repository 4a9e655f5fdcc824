//! [`TakeSource`]: the bytes of a take, read in parts: never the whole take is in memory.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use program::{Fault, read_error};

/// A file of a take. It stays open: a file that takes its place later changes nothing.
#[derive(Debug)]
pub(crate) struct TakeSource {
    path: PathBuf,
    file: Mutex<File>,
}

impl TakeSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be opened.
    pub(crate) fn open(path: &Path) -> Result<TakeSource, Fault> {
        let file = File::open(path)
            .map_err(|error| Fault::Data(format!("{}: {}", path.display(), read_error(&error))))?;
        Ok(TakeSource { path: path.to_owned(), file: Mutex::new(file) })
    }

    /// Name of the source for messages.
    pub(crate) fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// Length in bytes.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read.
    pub(crate) fn len(&self) -> Result<u64, Fault> {
        let file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.metadata().map(|metadata| metadata.len()).map_err(|error| self.unreadable(&error))
    }

    /// Reads `range`; less at the end of the file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read.
    pub(crate) fn read(&self, range: Range<u64>) -> Result<Vec<u8>, Fault> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(range.start))
            .and_then(|_| (&mut *file).take(range.end - range.start).read_to_end(&mut bytes))
            .map_err(|error| self.unreadable(&error))?;
        Ok(bytes)
    }

    fn unreadable(&self, error: &io::Error) -> Fault {
        Fault::Data(format!("{}: {}", self.name(), read_error(error)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_read_and_the_end_is_short() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"0123456789").unwrap();
        let source = TakeSource::open(&path).unwrap();
        assert_eq!(source.len().unwrap(), 10);
        for (range, bytes) in
            [(0..4, &b"0123"[..]), (7..9, b"78"), (8..20, b"89"), (30..40, b""), (3..3, b"")]
        {
            assert_eq!(source.read(range).unwrap(), bytes);
        }
        // A file that takes its place is another one.
        std::fs::write(folder.path().join("b"), b"abcdefghijk").unwrap();
        std::fs::rename(folder.path().join("b"), &path).unwrap();
        assert_eq!((source.read(0..2).unwrap(), source.len().unwrap()), (b"01".to_vec(), 10));
        let missing = TakeSource::open(&folder.path().join("c")).unwrap_err();
        assert!(missing.to_string().contains("c: "), "{missing}");
    }
}
