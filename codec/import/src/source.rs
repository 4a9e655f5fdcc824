//! [`FieldSource`]: a file or folder by its format, and its rows.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use crate::budget::ImportBudget;
use crate::error::ImportError;
use crate::imported::Imported;
use crate::ply::Ply;
use crate::{
    clean, compressed_ply, field_file, freetime, glb, inria, ksplat, sog, spacetime, splat, splatv, spz,
};

/// The formats that [`crate::import`] reads, for messages.
pub const FORMATS: &str = "PLY (3D Gaussian Splatting, Spacetime Gaussians lite, FreeTimeGS, compressed, or this tool's own), \
                           a folder of numbered PLYs, .splatv, .spz, SOG (.sog, or meta.json with its images), .glb and \
                           .gltf with KHR_gaussian_splatting, .splat, .ksplat";

/// Extensions of files that [`crate::import`] reads, in lower case. An unbundled SOG is a `meta.json` besides.
pub const EXTENSIONS: [&str; 8] = ["ply", "splatv", "spz", "sog", "glb", "gltf", "splat", "ksplat"];

/// A file or folder, by its format.
pub(crate) enum FieldSource {
    /// The folder and the index of an unbundled SOG.
    Sog(PathBuf, OsString),
    SogBundle(Vec<u8>),
    Ply(Vec<u8>),
    Splat(Vec<u8>),
    Splatv(Vec<u8>),
    Spz(Vec<u8>),
    Ksplat(Vec<u8>),
    /// The file, and the folder of its buffers.
    Glb(Vec<u8>, PathBuf),
    /// The text, and the folder of its buffers.
    Gltf(Vec<u8>, PathBuf),
}

impl FieldSource {
    /// Reads a file and detects its format.
    ///
    /// # Errors
    /// [`ImportError`] for a path at which no field can be.
    pub(crate) fn open(path: &Path, budget: &mut ImportBudget) -> Result<FieldSource, ImportError> {
        const INDEX: &str = "meta.json";
        let fault = |what: String| Err(ImportError::new(path, what));
        let metadata = fs::metadata(path).map_err(|error| ImportError::unreadable(path, &error))?;
        if metadata.is_dir() {
            return match path.join(INDEX).exists() {
                true => Ok(FieldSource::Sog(path.into(), INDEX.into())),
                false => fault(format!("a folder without {INDEX} is no field (SOG); name a file")),
            };
        }
        let name = path.file_name().unwrap_or_default();
        if name == "lod-meta.json" {
            return fault(format!("it lists several fields; name one of their folders, or its {INDEX}"));
        }
        if !metadata.is_file() {
            return fault(format!("not a file; a field is one of: {FORMATS}"));
        }
        let bytes = budget.read_file(path).map_err(|what| ImportError::new(path, what))?;
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
        let folder = || path.parent().unwrap_or(Path::new(".")).into();
        Ok(match &bytes[..] {
            [] => return fault("the file is empty; get it again, or export it again".into()),
            // The only formats without a magic number.
            _ if extension == "splat" => FieldSource::Splat(bytes),
            _ if extension == "ksplat" => FieldSource::Ksplat(bytes),
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => FieldSource::Ply(bytes),
            [b'g', b'l', b'T', b'F', ..] => FieldSource::Glb(bytes, folder()),
            [0x4b, 0x67, 0, 0, ..] => FieldSource::Splatv(bytes),
            [0x1f, 0x8b, ..] | [b'N', b'G', b'S', b'P', ..] => FieldSource::Spz(bytes),
            [b'P', b'K', 3, 4, ..] => FieldSource::SogBundle(bytes),
            [b'A', b'A', b'R', b'C', ..] => {
                return fault(
                    "this is a package already; play it with `aarc`, or make a field of it with `export --ply`"
                        .into(),
                );
            }
            _ if extension == "gltf" => FieldSource::Gltf(bytes, folder()),
            _ if extension == "json" => FieldSource::Sog(folder(), name.into()),
            _ => {
                let start: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
                let start = start.join(" ");
                return fault(format!(
                    "not a known format (starts with {start}); a field is one of: {FORMATS}"
                ));
            }
        })
    }

    /// Reads the rows, repaired, of the file at `path`. There may be none.
    ///
    /// # Errors
    /// [`ImportError`] that names the file and the problem.
    pub(crate) fn read_clean(&self, path: &Path, budget: &mut ImportBudget) -> Result<Imported, ImportError> {
        let mut imported = self.read_complete(path, budget)?;
        imported.field = clean::clean(imported.field, &mut imported.repairs);
        Ok(imported)
    }

    /// As [`FieldSource::read_clean`], for rows whose numbers matter: also returns those that cannot be used, which are
    /// invisible.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn read_in_place(
        &self,
        path: &Path,
        budget: &mut ImportBudget,
    ) -> Result<(Imported, Vec<usize>), ImportError> {
        let mut imported = self.read_complete(path, budget)?;
        let (field, lost) = clean::clean_in_place(imported.field, &mut imported.repairs);
        imported.field = field;
        Ok((imported, lost))
    }

    /// Reads the rows unchecked. Most of the rows must be there.
    fn read_complete(&self, path: &Path, budget: &mut ImportBudget) -> Result<Imported, ImportError> {
        let read = |budget: &mut ImportBudget| -> Result<Imported, String> {
            let imported = self.read(budget)?;
            imported.check_complete()?;
            Ok(imported)
        };
        read(budget).map_err(|what| match budget.is_exceeded() {
            true => ImportError::new(path, what),
            false => ImportError::new(path, format!("{what}; get the file again, or export it again")),
        })
    }

    /// Reads the rows unchecked: [`Imported::field`] may be invalid.
    fn read(&self, budget: &mut ImportBudget) -> Result<Imported, String> {
        match self {
            FieldSource::Sog(folder, index) => sog::read_folder(folder, index, budget),
            FieldSource::SogBundle(bytes) => sog::read_bundle(bytes, budget),
            FieldSource::Ply(bytes) => read_ply(&Ply::parse(bytes, budget)?, budget),
            FieldSource::Splat(bytes) => splat::read(bytes, budget),
            FieldSource::Splatv(bytes) => splatv::read(bytes, budget),
            FieldSource::Spz(bytes) => spz::read(bytes, budget),
            FieldSource::Ksplat(bytes) => ksplat::read(bytes, budget),
            FieldSource::Glb(bytes, folder) => glb::read_binary(bytes, folder, budget),
            FieldSource::Gltf(bytes, folder) => glb::read_text(bytes, folder, budget),
        }
    }
}

fn read_ply(ply: &Ply, budget: &mut ImportBudget) -> Result<Imported, String> {
    let Some(vertex) = ply.table("vertex") else {
        return Err("PLY without a vertex element".into());
    };
    let (mut hints, filter) = (field_file::hints(ply)?, field_file::filter(ply)?);
    let mut imported = if field_file::is_marked(ply) {
        // A field file is complete: where it states no near distance, it has none.
        hints.near.get_or_insert(0.0);
        field_file::read(vertex, budget)
    } else if ply.table("chunk").is_some() {
        compressed_ply::read(ply, vertex, budget)
    } else if vertex.has("trbf_center") {
        spacetime::read(vertex, budget)
    } else if freetime::is_one(vertex) {
        freetime::read(vertex, budget)
    } else {
        inria::read(vertex, budget)
    }?;
    imported.field.filter = filter;
    Ok(Imported { hints, ..imported })
}
