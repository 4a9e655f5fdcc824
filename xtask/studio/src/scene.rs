//! Scenes: what a package is made from. The package `formats` describes their files.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use codec::{ClipInfo, Field, Surroundings, Viewpoint};
use formats::{
    FieldPath, ImportLimits, Imported, ImportedScene, NoField, Overrides, POINT_CLOUDS, Repairs, SOG_INDEX,
    SceneFiles, has_field, import_plate, is_field_file, list_folder, titles,
};
use program::Fault;

use crate::fields::{FitRecord, check_record, fault, import};
use crate::messages::unreadable;

pub use formats::{DEFAULT_DURATION_S, DEFAULT_FPS, DEFAULT_METRES_PER_UNIT, DEFAULT_UP, plate_path};

/// File name of the cameras of a field folder. The file name of a single field's cameras is the field's name with this
/// end.
const CAMERAS: &str = "cameras.json";

/// File name that marks a field folder, a take of segments.
pub(crate) const FIELD_FOLDER: &str = "field.json";

/// The key of `scene.json` that states viewpoints.
const VIEWPOINTS: &str = "viewpoints";

/// What a package is made from.
#[derive(Debug)]
pub struct Scene {
    /// Name of the folder or file, without extension.
    pub name: String,
    /// The field.
    pub subject: Imported,
    /// The background; always a static field.
    pub plate: Option<Imported>,
    /// Duration, axes and viewpoints. There is at least one viewpoint.
    pub info: ClipInfo,
    /// Keys of `scene.json` for which `info` holds the defaults.
    pub assumed: Vec<&'static str>,
    /// Whether it is a segment of a take, whose head has the viewpoints.
    pub is_segment: bool,
    surroundings: OnceLock<Arc<Surroundings>>,
}

impl Scene {
    /// Reads a scene from a field file or a folder.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file or folder: missing, without a field or with several,
    /// a field that cannot be imported, a plate that moves, a bad `scene.json`.
    pub fn load(path: &Path) -> anyhow::Result<Scene> {
        if !fs::metadata(path).map_err(|error| unreadable(path, &error))?.is_dir() {
            return Scene::read(name_of_file(path), &SceneFiles::of_file(path));
        }
        let names = list_folder(path).map_err(fault)?;
        if names.iter().any(|name| name == FIELD_FOLDER) {
            let what = "a take of several segments, where one field is expected; name a field file in it";
            return Err(Fault::Data(format!("{}: {what}", path.display())).into());
        }
        let field = field_in(path, &names)?;
        Scene::read(name_of_folder(path), &SceneFiles::in_folder(path, field, &names))
    }

    /// Reads the scene of a folder without a field, with the field file `field`.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub fn load_with(folder: &Path, field: &Path) -> anyhow::Result<Scene> {
        let names = list_folder(folder).map_err(fault)?;
        let files = SceneFiles::in_folder(folder, FieldPath::File(field.to_owned()), &names);
        Scene::read(name_of_folder(folder), &files)
    }

    /// Reads a segment of a take from its field file and its background's field file; the take gives duration and frame
    /// rate.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub(crate) fn of_segment(
        field: &Path,
        plate: Option<&Path>,
        duration_s: f32,
        fps: f32,
    ) -> anyhow::Result<Scene> {
        let limits = ImportLimits::default();
        let plate = plate.map(|plate| import_plate(plate, limits)).transpose().map_err(fault)?;
        let of_take = Overrides { duration_s: Some(duration_s), fps: Some(fps), ..Overrides::default() };
        let parts = ImportedScene::new(field, import(field)?, plate, of_take).map_err(fault)?;
        Ok(Scene { is_segment: true, ..Scene::new(name_of_file(field), parts) })
    }

    /// Whether `path` is a folder with a field file.
    pub(crate) fn has_field(path: &Path) -> bool {
        list_folder(path).is_ok_and(|names| has_field(path, &names))
    }

    fn read(name: String, files: &SceneFiles) -> anyhow::Result<Scene> {
        let parts = files.read(ImportLimits::default()).map_err(fault)?;
        if let Some(path) = files.field.file() {
            check_record(path, &parts.subject.hints)?;
        }
        Ok(Scene::new(name, parts))
    }

    fn new(name: String, parts: ImportedScene) -> Scene {
        let ImportedScene { subject, plate, info, assumed } = parts;
        let surroundings = OnceLock::new();
        Scene { name, subject, plate, info, assumed, is_segment: false, surroundings }
    }

    /// Whether `path` is a folder with a capture and no field.
    pub fn is_capture(path: &Path) -> bool {
        let names = if path.is_dir() { list_folder(path).unwrap_or_default() } else { Vec::new() };
        !has_field(path, &names)
            && !names.iter().any(|name| name == FIELD_FOLDER)
            && names.iter().any(|name| is_capture_name(name))
    }

    /// Number of captured frames, the first at the start and the last at the end, if the field file records
    /// it; `scene.json` changes only the playback rate.
    pub fn frames(&self) -> Option<usize> {
        let hints = &self.subject.hints;
        hints
            .frames
            .or_else(|| hints.duration_s.zip(hints.fps).map(|(duration_s, fps)| frames_in(duration_s, fps)))
    }

    /// The photographs that the field was fitted to, as far as its file records them.
    pub(crate) fn fit_record(&self) -> FitRecord {
        FitRecord::from_hints(&self.subject.hints).unwrap_or_default()
    }

    /// A scene of a field in memory.
    pub fn made(name: &str, field: Field, info: ClipInfo) -> Scene {
        let subject = Imported::new("made up", field, Repairs::default());
        Scene::new(name.to_owned(), ImportedScene { subject, plate: None, info, assumed: Vec::new() })
    }

    /// Where its content is and where people stand, in the field as it is when this is called for the first time; of a segment,
    /// in its take.
    pub(crate) fn surroundings(&self) -> &Arc<Surroundings> {
        self.surroundings.get_or_init(|| {
            let plate = self.plate.as_ref().map(|plate| &plate.field);
            Arc::new(Surroundings::new(&self.subject.field, plate, self.info.up))
        })
    }

    /// Whether the source states viewpoints.
    pub(crate) fn states_viewpoints(&self) -> bool {
        !self.assumed.contains(&VIEWPOINTS) && !self.info.viewpoints.is_empty()
    }

    /// The scene as a part of a take, with the `surroundings` and the `viewpoints` of the take, which the source of the take
    /// may have stated.
    pub(crate) fn in_take(
        mut self,
        surroundings: &Arc<Surroundings>,
        viewpoints: &[Viewpoint],
        is_stated: bool,
    ) -> Scene {
        self.assumed.retain(|key| *key != VIEWPOINTS);
        self.assumed.extend((!is_stated).then_some(VIEWPOINTS));
        self.info.viewpoints = viewpoints.to_vec();
        Scene { surroundings: OnceLock::from(Arc::clone(surroundings)), ..self }
    }

    /// The metadata of its package.
    pub(crate) fn head_info(&self) -> ClipInfo {
        match self.is_segment {
            true => ClipInfo { viewpoints: Vec::new(), ..self.info.clone() },
            false => self.info.clone(),
        }
    }
}

/// Number of captured frames of a clip, the first at its start and the last at its end.
pub fn frames_of(info: &ClipInfo) -> usize {
    frames_in(info.duration_s, info.fps)
}

fn frames_in(duration_s: f32, fps: f32) -> usize {
    1 + (f64::from(duration_s) * f64::from(fps)).round() as usize
}

/// Path of the cameras that are learned with a field: beside a field file, in a field folder.
pub fn cameras_path(field: &Path) -> PathBuf {
    if field.is_dir() { field.join(CAMERAS) } else { beside(field, CAMERAS) }
}

/// The cameras that were learned with what is at `path`, if there are any: a field, a package of one, a field folder, a package
/// of one, or a folder with one field.
pub(crate) fn learned_cameras_of(path: &Path) -> Option<PathBuf> {
    // Other programs write a file of this name into their folders, too.
    let of_folder = |folder: &Path| folder.join(FIELD_FOLDER).is_file().then(|| folder.join(CAMERAS));
    let found = match path.is_dir() {
        true => {
            let names = list_folder(path).unwrap_or_default();
            let of_field =
                FieldPath::in_folder(path, &names).ok().and_then(|field| field.file().map(cameras_path));
            [of_folder(path), of_field]
        }
        false => [Some(cameras_path(path)), of_folder(&path.with_extension(""))],
    };
    found.into_iter().flatten().find(|path| path.is_file())
}

/// Path of a file beside a field: the field's path with another extension.
pub(crate) fn beside(field: &Path, ending: &str) -> PathBuf {
    let mut name = field.file_stem().unwrap_or_default().to_owned();
    name.push(".");
    name.push(ending);
    field.with_file_name(name)
}

/// The one field in a folder with entries `names`.
fn field_in(folder: &Path, names: &[String]) -> Result<FieldPath, Fault> {
    let shown = folder.display();
    FieldPath::in_folder(folder, names).map_err(|why| {
        Fault::Data(match why {
            NoField::None if names.iter().any(|name| is_capture_name(name)) => format!(
                "no field in {shown}, only a capture; run `fit {shown}` first, or put a fitted field there ({})",
                titles()
            ),
            NoField::None => {
                format!("no field in {shown}; put one there, a file of one of these formats: {}", titles())
            }
            NoField::Several(fields) => {
                format!("{shown} holds several fields; name one of them: {}", fields.join(", "))
            }
        })
    })
}

/// Whether an entry of this name marks a folder as a capture.
fn is_capture_name(name: &str) -> bool {
    let extension = extension_of(name);
    let known = [
        "capture.json",
        "images",
        "sparse",
        "transforms.json",
        "transforms_train.json",
        "poses_bounds.npy",
        "intri.yml",
    ];
    known.contains(&name)
        || POINT_CLOUDS.contains(&name)
        || ["mp4", "mov", "mkv", "jpg", "jpeg", "png"].contains(&extension.as_str())
        || (name.starts_with("Calib") && extension == "toml")
}

fn extension_of(name: &str) -> String {
    Path::new(name).extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase()
}

/// Name of a scene or capture: its folder or file, without the extension of a field. Derived from the path
/// alone unless it ends in `.` or `..`.
pub fn name_of(path: &Path) -> String {
    match path.file_name().and_then(OsStr::to_str) {
        Some(name) if is_field_file(name) => name_of_file(path),
        Some(name) => name.into(),
        None => name_of_folder(path),
    }
}

/// The stem of a file; for a `meta.json` the name of its folder.
fn name_of_file(path: &Path) -> String {
    match path.file_name() == Some(OsStr::new(SOG_INDEX)) {
        true => name_of_folder(&path.with_file_name("")),
        false => path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
    }
}

/// The last component of a folder's path, with `.` and `..` resolved.
fn name_of_folder(folder: &Path) -> String {
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    let absolute: PathBuf = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}
