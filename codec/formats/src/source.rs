//! [`FieldSource`]: a file or folder by its format, and its rows.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::ImportError;
use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::table::{Format, Reader, extension_of, titles};
use crate::{clean, deformation, sog, text};

/// The end of a sentence that does not say what to do behind a semicolon: the file is damaged.
const ADVICE: &str = "get the file again, or export it again";

/// A file by its format; of a file set, the file that names the others.
pub(crate) struct FieldSource {
    read: Reader,
    bytes: Vec<u8>,
    /// Where the other files are.
    folder: PathBuf,
}

impl FieldSource {
    /// Reads a file and detects its format.
    ///
    /// # Errors
    /// [`ImportError`] for a path at which no field can be.
    pub(crate) fn open(path: &Path, budget: &mut ImportBudget) -> Result<FieldSource, ImportError> {
        let fault = |what: String| ImportError::new(path, what);
        let metadata = fs::metadata(path).map_err(|error| ImportError::unreadable(path, &error))?;
        if metadata.is_dir() {
            return FieldSource::open_folder(path, budget).map_err(fault);
        }
        if !metadata.is_file() {
            return Err(fault(format!("not a file; a field is one of: {}", titles())));
        }
        if let Some(why) = deformation::refused(path) {
            return Err(fault(why));
        }
        let mut bytes = budget.read_file(path).map_err(fault)?;
        if bytes.is_empty() {
            return Err(fault("the file is empty; get it again, or export it again".into()));
        }
        let name = path.file_name().unwrap_or_default();
        if name == sog::STREAMED_INDEX {
            return Err(fault(sog::streamed(&bytes)));
        }
        if text::has_mark(&bytes) && matches!(bytes.get(text::MARK.len()), Some(b'p' | b'{')) {
            bytes.drain(..text::MARK.len());
        }
        match Format::detect(&bytes, &extension_of(path)) {
            Some(format) if format.is_binary_without_start() && text::is_text(&bytes) => Err(fault(format!(
                "this is text and no {}; get the file again: {}",
                format.title,
                text::start(&bytes)
            ))),
            Some(format) => {
                let folder = path.parent().unwrap_or(Path::new(".")).into();
                Ok(FieldSource { read: format.read, bytes, folder })
            }
            None => Err(fault(unknown(&bytes))),
        }
    }

    /// Opens an unbundled SOG.
    fn open_folder(folder: &Path, budget: &mut ImportBudget) -> Result<FieldSource, String> {
        let (index, streamed) = (folder.join(sog::INDEX), folder.join(sog::STREAMED_INDEX));
        if !index.exists() {
            return Err(match budget.read_file(&streamed) {
                Ok(bytes) => sog::streamed(&bytes),
                Err(what) if streamed.exists() => advised(what),
                Err(_) => format!("a folder without {} is no field (SOG); name a file", sog::INDEX),
            });
        }
        let bytes = budget.read_file(&index).map_err(advised)?;
        Ok(FieldSource { read: sog::read, bytes, folder: folder.into() })
    }

    /// Reads the rows, repaired, of the file at `path`. There may be none.
    ///
    /// # Errors
    /// [`ImportError`] that names the file and the problem.
    pub(crate) fn read_clean(&self, path: &Path, budget: &mut ImportBudget) -> Result<Imported, ImportError> {
        let mut imported = self.read_complete(path, budget)?;
        imported.field = clean::clean(imported.field, &mut imported.account.repairs);
        Ok(imported)
    }

    /// As [`FieldSource::read_clean`], for rows whose numbers matter: also returns the rows that cannot be used, which
    /// are invisible.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn read_in_place(
        &self,
        path: &Path,
        budget: &mut ImportBudget,
    ) -> Result<(Imported, Vec<usize>), ImportError> {
        let mut imported = self.read_complete(path, budget)?;
        let (field, lost) = clean::clean_in_place(imported.field, &mut imported.account.repairs);
        imported.field = field;
        Ok((imported, lost))
    }

    /// Reads the rows unchecked: [`Imported::field`] may be invalid. Most of the rows must be there.
    fn read_complete(&self, path: &Path, budget: &mut ImportBudget) -> Result<Imported, ImportError> {
        let read = |budget: &mut ImportBudget| -> Result<Imported, String> {
            let imported = (self.read)(&self.bytes, &self.folder, budget)?;
            imported.check_complete()?;
            Ok(imported)
        };
        read(budget).map_err(|what| ImportError::new(path, advised(what)))
    }
}

/// Why a file cannot be read and what to do, which some reasons say themselves.
fn advised(what: String) -> String {
    if what.contains("; ") { what } else { format!("{what}; {ADVICE}") }
}

/// The sentence on a file of no format.
fn unknown(bytes: &[u8]) -> String {
    if bytes.starts_with(&codec::MAGIC) {
        return "this is a package already; play it with `aarc`, or make a field of it with `export --ply`"
            .into();
    }
    let start: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
    format!("not a known format (starts with {}); a field is one of: {}", start.join(" "), titles())
}
