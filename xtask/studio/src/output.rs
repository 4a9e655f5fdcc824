//! Writing results: whole or not at all.

use std::io::{Cursor, Write};
use std::path::Path;

use image::{ImageFormat, RgbImage};
use tempfile::Builder;

use crate::fault::Fault;

/// Checks, before any work is done, that a file could be written to `path`: its folder exists
/// and it is not itself a folder.
///
/// # Errors
/// [`Fault::Usage`] that names the path.
pub fn check(path: &Path) -> Result<(), Fault> {
    if path.is_dir() || path.file_name().is_none() {
        return Err(Fault::Usage(format!("cannot write {}: it is a folder, name a file", path.display())));
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        let (path, folder) = (path.display(), folder.display());
        return Err(Fault::Usage(format!("cannot write {path}: there is no folder {folder}, make it first")));
    }
    Ok(())
}

/// Writes a file through a temporary one in the same folder, so that `path` never holds half of
/// it, and what was there before stays until the new file is whole.
///
/// # Errors
/// [`Fault::Usage`] that names the path and the reason.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Fault> {
    check(path)?;
    let fault = |error: std::io::Error| Fault::Usage(format!("cannot write {}: {error}", path.display()));
    let mut builder = Builder::new();
    #[cfg(unix)]
    {
        // What other programs get for a new file; the user's umask still applies.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.prefix(".writing-").tempfile_in(folder_of(path)).map_err(fault)?;
    file.write_all(bytes).map_err(fault)?;
    file.persist(path).map_err(|error| fault(error.error))?;
    Ok(())
}

/// Writes a picture as PNG, as [`write()`] does.
///
/// # Errors
/// Those of [`write()`].
pub fn write_png(path: &Path, picture: &RgbImage) -> anyhow::Result<()> {
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png)?;
    Ok(write(path, png.get_ref())?)
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}
