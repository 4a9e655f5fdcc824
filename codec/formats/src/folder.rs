//! [`FieldPath`]: where the field of a folder is, a file or the frames of a sequence.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use codec::MAGIC;

use crate::error::ImportError;
use crate::import_within;
use crate::imported::Imported;
use crate::limits::ImportLimits;
use crate::sequence::{SequenceFiles, import_sequence, last_stage};
use crate::sog::{INDEX, STREAMED_INDEX};
use crate::table::{extension_of, extensions};

/// Clouds of points without Gaussians that captures and fitting programs put beside a field.
pub const POINT_CLOUDS: [&str; 4] = ["input.ply", "points3D.ply", "points3d.ply", "sparse_pc.ply"];

/// File name of a scene's background, and end of the name of one that belongs to the field with the same name before it.
pub(crate) const PLATE: &str = "plate.ply";

/// A field on disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FieldPath {
    /// A field file; of an unbundled SOG its `meta.json`.
    File(PathBuf),
    /// The last of this many field files, which are stages of one fit.
    Stage(PathBuf, usize),
    /// Static fields, one a frame.
    Sequence(SequenceFiles),
}

/// Why a folder has no field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoField {
    /// No file has a field's name.
    None,
    /// These files are fields, and no sequence.
    Several(Vec<String>),
}

impl FieldPath {
    /// The one field of a folder with entries `names`. The index of a streamed SOG, which is not read, is none beside
    /// another.
    ///
    /// # Errors
    /// [`NoField`] if there is none or are several.
    pub fn in_folder(folder: &Path, names: &[String]) -> Result<FieldPath, NoField> {
        let mut fields: Vec<&str> =
            names.iter().map(String::as_str).filter(|name| is_field_name(name)).collect();
        if fields.len() > 1 {
            fields.retain(|name| *name != STREAMED_INDEX);
        }
        match fields[..] {
            [] => last_iteration(folder, names).ok_or(NoField::None),
            [field] => Ok(FieldPath::File(folder.join(field))),
            _ => {
                let stage = last_stage(&fields).map(|name| FieldPath::Stage(folder.join(name), fields.len()));
                let sequence = || SequenceFiles::find(folder, &fields).map(FieldPath::Sequence);
                let several = || NoField::Several(fields.iter().copied().map(String::from).collect());
                stage.or_else(sequence).ok_or_else(several)
            }
        }
    }

    /// The field file; `None` for a sequence.
    pub fn file(&self) -> Option<&Path> {
        match self {
            FieldPath::File(path) | FieldPath::Stage(path, _) => Some(path),
            FieldPath::Sequence(_) => None,
        }
    }

    /// Reads the field.
    ///
    /// # Errors
    /// As [`import_within`] and [`import_sequence`] have them.
    pub fn import(&self, limits: ImportLimits) -> Result<Imported, ImportError> {
        match self {
            FieldPath::File(path) => import_within(path, limits),
            FieldPath::Stage(path, stages) => {
                let mut imported = import_within(path, limits)?;
                imported
                    .account
                    .assumed
                    .push(format!("the last of {stages} stages of one fit, {}", path.display()));
                Ok(imported)
            }
            FieldPath::Sequence(files) => import_sequence(files, limits),
        }
    }
}

/// Whether a folder with entries `names` has a field, or several.
pub fn has_field(folder: &Path, names: &[String]) -> bool {
    FieldPath::in_folder(folder, names) != Err(NoField::None)
}

/// The field of the last iteration in the output folder of 3D Gaussian Splatting:
/// `point_cloud/iteration_30000/point_cloud.ply`.
fn last_iteration(folder: &Path, names: &[String]) -> Option<FieldPath> {
    let clouds = folder.join(names.iter().find(|name| *name == "point_cloud")?);
    let iterations = list_folder(&clouds).ok()?;
    let numbers = iterations.iter().filter_map(|name| name.strip_prefix("iteration_")?.parse().ok());
    let fields =
        numbers.map(|number: u64| (number, clouds.join(format!("iteration_{number}/point_cloud.ply"))));
    let fields: BTreeMap<u64, PathBuf> = fields.filter(|(_, field)| field.is_file()).collect();
    let stages = fields.len();
    let last = fields.into_values().next_back()?;
    Some(if stages > 1 { FieldPath::Stage(last, stages) } else { FieldPath::File(last) })
}

/// Names of the entries of a folder, sorted, hidden ones left out.
///
/// # Errors
/// If the folder cannot be read.
pub fn list_folder(folder: &Path) -> Result<Vec<String>, ImportError> {
    let unreadable = |error| ImportError::unreadable(folder, &error);
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        names.push(entry.map_err(unreadable)?.file_name().to_string_lossy().into_owned());
    }
    names.retain(|name| !name.starts_with('.'));
    names.sort();
    Ok(names)
}

/// Whether a file of this name in a folder is taken for its field: it has a field's extension, and is neither a
/// background nor a cloud of points.
pub fn is_field_name(name: &str) -> bool {
    let is_plate = name.strip_suffix(PLATE).is_some_and(|before| before.is_empty() || before.ends_with('.'));
    !is_plate && !POINT_CLOUDS.contains(&name) && is_field_file(name)
}

/// Whether a file of this name has a field format, or says why it is none that is read.
pub fn is_field_file(name: &str) -> bool {
    let extension = extension_of(Path::new(name));
    [INDEX, STREAMED_INDEX].contains(&name) || extensions().any(|known| known == extension)
}

/// Whether a file begins as a package does, whatever its name.
pub fn is_package(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    // Opening a pipe would wait for its other end.
    path.is_file()
        && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == MAGIC
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_field_or_a_sequence() {
        let folder = Path::new("a");
        let find = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|&name| name.into()).collect();
            FieldPath::in_folder(folder, &names)
        };
        let field = FieldPath::File("a/field.PLY".into());
        assert_eq!(find(&["field.PLY", "input.ply", "plate.ply", "field.plate.ply", "b.txt"]), Ok(field));
        assert_eq!(find(&["meta.json", "means_l.webp"]), Ok(FieldPath::File("a/meta.json".into())));
        assert_eq!(find(&["input.ply", "plate.ply"]), Err(NoField::None));
        let whole = ["lod-meta.json", "scene.ply", "0_0"];
        assert_eq!(find(&whole), Ok(FieldPath::File("a/scene.ply".into())));
        assert_eq!(
            find(&whole[..1]),
            Ok(FieldPath::File("a/lod-meta.json".into())),
            "it says why it is none"
        );
        let two = || vec!["a.ply".to_owned(), "b.spz".to_owned()];
        assert_eq!(find(&["a.ply", "b.spz"]), Err(NoField::Several(two())));
        let output = tempfile::tempdir().unwrap();
        let names = ["cameras.json".to_owned(), "input.ply".to_owned(), "point_cloud".to_owned()];
        assert!(!has_field(output.path(), &names));
        let file =
            |number: u32| output.path().join(format!("point_cloud/iteration_{number}/point_cloud.ply"));
        for number in [7000, 30000, 9] {
            fs::create_dir_all(file(number).parent().unwrap()).unwrap();
            fs::write(file(number), "").unwrap();
        }
        assert_eq!(FieldPath::in_folder(output.path(), &names), Ok(FieldPath::Stage(file(30000), 3)));
        let stages = find(&["export_5000.ply", "export_10000.ply", "export_15000.ply", "plate.ply"]);
        assert_eq!(stages, Ok(FieldPath::Stage("a/export_15000.ply".into(), 3)));
        let Ok(FieldPath::Sequence(files)) = find(&["f_0.ply", "f_1.ply", "f_2.ply", "plate.ply"]) else {
            panic!("a sequence")
        };
        assert_eq!(files.steps(), 3);
    }
}
