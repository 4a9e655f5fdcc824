//! Importers, as the commands use them: the importers of the crate `import`, with faults for errors, and the record of
//! a fit.

mod fit_record;

use std::path::Path;

use ::import::ImportError;
use program::Fault;

pub use ::import::{FIELD_FILE_VERSION, FORMATS, Hints, ImportLimits, Imported, Repairs, up_of};
pub(crate) use ::import::{field_file, splatv, spz};
pub use fit_record::FitRecord;

/// Reads a fitted field within the default limits.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem: one of [`::import::import`], or a record of the fit that cannot
/// be used.
pub fn import(path: &Path) -> anyhow::Result<Imported> {
    import_within(path, ImportLimits::default())
}

/// Reads a fitted field as [`import()`] does, within `limits`.
///
/// # Errors
/// Those of [`import()`].
pub fn import_within(path: &Path, limits: ImportLimits) -> anyhow::Result<Imported> {
    let imported = ::import::import_within(path, limits).map_err(fault)?;
    check_record(path, &imported.hints)?;
    Ok(imported)
}

/// Checks the record of the fit in the metadata of the file at `path`.
///
/// # Errors
/// [`Fault::Data`] that names the file and the comment.
pub(crate) fn check_record(path: &Path, hints: &Hints) -> Result<(), Fault> {
    let check = FitRecord::from_hints(hints).map(drop);
    check.map_err(|what| {
        Fault::Data(format!("{}: {what}; get the file again, or export it again", path.display()))
    })
}

/// The fault of a file that cannot be imported.
pub(crate) fn fault(error: ImportError) -> Fault {
    Fault::Data(error.to_string())
}
