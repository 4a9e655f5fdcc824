//! Importers, as the commands use them: those of the crate `import`, with faults for errors, and the record of a fit.

mod fit_record;

use std::path::Path;

use ::import::ImportError;
use program::Fault;

pub use ::import::{
    EXTENSIONS, FIELD_FILE_VERSION, FORMATS, Hints, ImportLimits, Imported, Repairs, SequenceFiles, up_of,
};
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

/// Reads a fitted field as [`import`] does, within `limits`.
///
/// # Errors
/// Those of [`import`].
pub fn import_within(path: &Path, limits: ImportLimits) -> anyhow::Result<Imported> {
    let imported = ::import::import_within(path, limits).map_err(fault)?;
    FitRecord::of(&imported.hints).map_err(|what| {
        Fault::Data(format!("{}: {what}; get the file again, or export it again", path.display()))
    })?;
    Ok(imported)
}

/// Reads a sequence of static fields as one moving field, within the default limits.
///
/// # Errors
/// [`Fault::Data`], as for [`::import::import_sequence`].
pub fn import_sequence(files: &SequenceFiles) -> anyhow::Result<Imported> {
    Ok(::import::import_sequence(files, ImportLimits::default()).map_err(fault)?)
}

/// The fault of a file that cannot be imported.
fn fault(error: ImportError) -> Fault {
    Fault::Data(error.to_string())
}
