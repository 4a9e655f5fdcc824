//! [`TakeSource`]: the bytes of a take, read in parts: never the whole take is in memory.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use program::{Fault, read_error};

#[cfg(feature = "net")]
use crate::net::RemoteFile;

/// Where the bytes of a take come from.
#[derive(Debug)]
pub(crate) enum TakeSource {
    /// A file. It stays open: a file that takes its place later changes nothing.
    File { path: PathBuf, file: Mutex<File> },
    /// A file on a server.
    #[cfg(feature = "net")]
    Remote(Box<RemoteFile>),
}

impl TakeSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be opened.
    pub(crate) fn open(path: &Path) -> Result<TakeSource, Fault> {
        let file = File::open(path)
            .map_err(|error| Fault::Data(format!("{}: {}", path.display(), read_error(&error))))?;
        Ok(TakeSource::File { path: path.to_owned(), file: Mutex::new(file) })
    }

    /// Name of the source for messages.
    pub(crate) fn name(&self) -> String {
        match self {
            TakeSource::File { path, .. } => path.display().to_string(),
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.name(),
        }
    }

    /// Length in bytes; `None` if a server does not say, or nothing was read of it yet.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read.
    pub(crate) fn length(&self) -> Result<Option<u64>, Fault> {
        match self {
            TakeSource::File { path, file } => {
                let file = file.lock().unwrap_or_else(PoisonError::into_inner);
                file.metadata().map(|metadata| Some(metadata.len())).map_err(|error| unreadable(path, &error))
            }
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => Ok(file.total()),
        }
    }

    /// Reads `range`; less at the end of the file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read; [`Fault::Network`] if it does not arrive.
    pub(crate) fn read(&self, range: Range<u64>) -> Result<Vec<u8>, Fault> {
        match self {
            TakeSource::File { path, file } => {
                let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
                let mut bytes = Vec::new();
                file.seek(SeekFrom::Start(range.start))
                    .and_then(|_| (&mut *file).take(range.end - range.start).read_to_end(&mut bytes))
                    .map_err(|error| unreadable(path, &error))?;
                Ok(bytes)
            }
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.read(range).map_err(|fault| fault.about(&file.name())),
        }
    }

    /// Ends a read that waits for a server, and those that follow, until [`TakeSource::resume`].
    pub(crate) fn cancel(&self) {
        match self {
            TakeSource::File { .. } => {}
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.cancel(),
        }
    }

    /// Ends a read that waits for a server for good.
    pub(crate) fn close(&self) {
        match self {
            TakeSource::File { .. } => {}
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.close(),
        }
    }

    /// Takes back [`TakeSource::cancel`].
    pub(crate) fn resume(&self) {
        match self {
            TakeSource::File { .. } => {}
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.resume(),
        }
    }
}

fn unreadable(path: &Path, error: &io::Error) -> Fault {
    Fault::Data(format!("{}: {}", path.display(), read_error(error)))
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
        assert_eq!(source.length().unwrap(), Some(10));
        for (range, bytes) in
            [(0..4, &b"0123"[..]), (7..9, b"78"), (8..20, b"89"), (30..40, b""), (3..3, b"")]
        {
            assert_eq!(source.read(range).unwrap(), bytes);
        }
        // A file that takes its place is another one.
        std::fs::write(folder.path().join("b"), b"abcdefghijk").unwrap();
        std::fs::rename(folder.path().join("b"), &path).unwrap();
        assert_eq!((source.read(0..2).unwrap(), source.length().unwrap()), (b"01".to_vec(), Some(10)));
        let missing = TakeSource::open(&folder.path().join("c")).unwrap_err();
        assert!(missing.to_string().contains("c: "), "{missing}");
    }
}
