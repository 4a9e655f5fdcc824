//! [`ImportError`]: why a file cannot be imported.

use std::fmt;
use std::io::{self, ErrorKind};
use std::path::Path;

use crate::account::one_line;

/// The file or folder, what is wrong with it, and what to do, in one sentence. The input is at fault: a program ends
/// with its exit code for bad data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportError(String);

impl ImportError {
    /// The error of a file or folder.
    pub fn new(path: &Path, what: impl fmt::Display) -> ImportError {
        ImportError(format!("{}: {what}", path.display()))
    }

    /// The error of a file or folder that cannot be read.
    pub(crate) fn unreadable(path: &Path, error: &io::Error) -> ImportError {
        match error.kind() {
            ErrorKind::NotFound => ImportError::new(path, "there is no such file or folder; check the path"),
            ErrorKind::PermissionDenied => {
                ImportError::new(path, "it may not be read; change its permissions")
            }
            _ => ImportError::new(path, format!("it cannot be read ({error}); check the path")),
        }
    }
}

/// One line. Control characters, which file names and headers may contain, are escaped.
impl fmt::Display for ImportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        one_line(&self.0).try_for_each(|c| write!(f, "{c}"))
    }
}

impl std::error::Error for ImportError {}
