//! [`ImportedScene`]: a field with its background and the metadata of its clip.
//!
//! A scene is a field file, or a folder that holds exactly one or the frames of a sequence, perhaps with a static
//! background `plate.ply` and a `scene.json` of this form, every key optional:
//!
//! ```json
//! {
//!   "duration_s": 1.32,
//!   "fps": 25,
//!   "up": [0, -1, 0],
//!   "metres_per_unit": 1,
//!   "viewpoints": [
//!     {"name": "front", "position": [0, 0, -3], "target": [0, 0, 0], "fov_y_deg": 50}
//!   ]
//! }
//! ```
//!
//! `up`, `position` and `target` are in the axes and units of the field file. Keys of
//! `scene.json` override the field file, which overrides the defaults below.

use std::path::{Path, PathBuf};

use codec::{ClipInfo, Field, Surroundings, Viewpoint};

use crate::error::ImportError;
use crate::folder::{FieldPath, NoField, PLATE, list_folder};
use crate::import_within;
use crate::imported::{Hints, Imported};
use crate::limits::ImportLimits;
use crate::overrides::Overrides;
use crate::table::titles;
use crate::up_axis::DEFAULT_UP;

/// Default duration in seconds: clip time then equals seconds.
pub const DEFAULT_DURATION_S: f32 = 1.0;

/// Default frames per second.
pub const DEFAULT_FPS: f32 = 30.0;

/// Default scale.
pub const DEFAULT_METRES_PER_UNIT: f32 = 1.0;

/// File name of a scene's overrides.
const OVERRIDES: &str = "scene.json";

/// The files of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFiles {
    /// The field.
    pub field: FieldPath,
    /// Unit vector that points up, whatever the files say; `None` for what they say.
    pub up: Option<[f32; 3]>,
    plate: Option<PathBuf>,
    overrides: Option<PathBuf>,
}

/// A scene in memory.
#[derive(Debug)]
pub struct ImportedScene {
    /// The field.
    pub subject: Imported,
    /// The background; always a static field.
    pub plate: Option<Imported>,
    /// Duration, axes and viewpoints. There is at least one viewpoint.
    pub info: ClipInfo,
    /// Keys of `scene.json` for which `info` holds the defaults.
    pub assumed: Vec<&'static str>,
}

impl SceneFiles {
    /// The scene of a field file, or of a folder with one field.
    ///
    /// # Errors
    /// [`ImportError`] that names the folder, which has none or several.
    pub fn at(path: &Path) -> Result<SceneFiles, ImportError> {
        if !path.is_dir() {
            return Ok(SceneFiles::of_file(path));
        }
        let names = list_folder(path)?;
        match FieldPath::in_folder(path, &names) {
            Ok(field) => Ok(SceneFiles::in_folder(path, field, &names)),
            Err(NoField::None) => Err(ImportError::new(
                path,
                format!("there is no field in this folder; a field is one of: {}", titles()),
            )),
            Err(NoField::Several(names)) => {
                let names = names.join(", ");
                Err(ImportError::new(path, format!("there are several fields; name one of them: {names}")))
            }
        }
    }

    /// The scene of a field file.
    pub fn of_file(path: &Path) -> SceneFiles {
        let plate = Some(plate_path(path)).filter(|plate| plate.is_file());
        SceneFiles { field: FieldPath::File(path.to_owned()), up: None, plate, overrides: None }
    }

    /// The scene of `field` in a folder with entries `names`.
    pub fn in_folder(folder: &Path, field: FieldPath, names: &[String]) -> SceneFiles {
        let file = |file: &str| names.iter().any(|name| name == file).then(|| folder.join(file));
        let plate = file(PLATE).or_else(|| field.file().map(plate_path).filter(|plate| plate.is_file()));
        SceneFiles { field, up: None, plate, overrides: file(OVERRIDES) }
    }

    /// Reads the scene.
    ///
    /// # Errors
    /// [`ImportError`] that names the file: a field that cannot be imported, a plate that moves, a bad `scene.json`.
    pub fn read(&self, limits: ImportLimits) -> Result<ImportedScene, ImportError> {
        let subject = self.field.import(limits)?;
        let plate = self.plate.as_deref().map(|plate| import_plate(plate, limits)).transpose()?;
        let mut overrides = self.overrides.as_deref().map_or(Ok(Overrides::default()), Overrides::load)?;
        overrides.up = self.up.or(overrides.up);
        let source = self.overrides.as_deref().unwrap_or(match &self.field {
            FieldPath::File(path) | FieldPath::Stage(path, _) => path,
            FieldPath::Sequence(files) => &files.frames[0].1,
        });
        ImportedScene::new(source, subject, plate, overrides)
    }
}

impl ImportedScene {
    /// Combines overrides, hints and defaults, in this precedence.
    ///
    /// # Errors
    /// [`ImportError`] that names `source`: a number out of the range of a package.
    pub fn new(
        source: &Path,
        mut subject: Imported,
        mut plate: Option<Imported>,
        overrides: Overrides,
    ) -> Result<ImportedScene, ImportError> {
        let origin = subject.hints.origin.unwrap_or_default();
        if let Some(plate) = &mut plate {
            plate.move_origin(origin);
            share_near(&mut subject.field, &mut plate.field);
        }
        let hints = &subject.hints;
        let mut assumed = Vec::new();
        let up = known(overrides.up.or(hints.up), "up", DEFAULT_UP, &mut assumed);
        let relative = |p: [f32; 3]| [0, 1, 2].map(|axis| (f64::from(p[axis]) - origin[axis]) as f32);
        let mut viewpoints = overrides.viewpoints.unwrap_or_else(|| hints.viewpoints.clone());
        for Viewpoint { position, target, .. } in &mut viewpoints {
            (*position, *target) = (relative(*position), relative(*target));
        }
        if viewpoints.is_empty() {
            assumed.push("viewpoints");
            let background = plate.as_ref().map(|plate| &plate.field);
            viewpoints.push(Surroundings::new(&subject.field, background, up).opening());
        }
        let fps = overrides.fps.or(hints.fps);
        let duration_s = overrides.duration_s.or_else(|| duration_of(hints, overrides.fps));
        let mut number = |key, value: Option<f32>, default| known(value, key, default, &mut assumed);
        let info = ClipInfo {
            duration_s: number("duration_s", duration_s, DEFAULT_DURATION_S),
            fps: number("fps", fps, DEFAULT_FPS),
            up,
            metres_per_unit: number(
                "metres_per_unit",
                overrides.metres_per_unit.or(hints.metres_per_unit),
                DEFAULT_METRES_PER_UNIT,
            ),
            viewpoints,
        };
        info.check().map_err(|(key, value)| {
            ImportError::new(source, format!("bad {key}: {value}; set another in scene.json"))
        })?;
        Ok(ImportedScene { subject, plate, info, assumed })
    }
}

/// Gives both the near distance that their package has: the field's, or the plate's if the field has none.
fn share_near(field: &mut Field, plate: &mut Field) {
    let near = if field.near > 0.0 { field.near } else { plate.near };
    (field.near, plate.near) = (near, near);
}

/// The duration that a file implies: a sequence played at another rate has another one.
fn duration_of(hints: &Hints, other_fps: Option<f32>) -> Option<f32> {
    let intervals = hints.frames.map(|frames| (frames - 1) as f32);
    match (intervals, other_fps) {
        (Some(intervals), Some(fps)) => Some(intervals / fps),
        (Some(intervals), None) => Some(hints.duration_s.unwrap_or(intervals / DEFAULT_FPS)),
        (None, _) => hints.duration_s,
    }
}

/// Path of the background that belongs to a field file: the field's path with another ending.
pub fn plate_path(field: &Path) -> PathBuf {
    let mut name = field.file_stem().unwrap_or_default().to_owned();
    name.push(".");
    name.push(PLATE);
    field.with_file_name(name)
}

/// Reads a background.
///
/// # Errors
/// As [`import_within`] has them, or that it moves.
pub fn import_plate(path: &Path, limits: ImportLimits) -> Result<Imported, ImportError> {
    let plate = import_within(path, limits)?;
    match plate.field.temporal {
        None => Ok(plate),
        Some(_) => Err(ImportError::new(
            path,
            "a background plate must be static, but this field moves or fades; export one instant of it with \
             `export --at`",
        )),
    }
}

/// The value, or its default, whose key is then added to `assumed`.
fn known<T>(value: Option<T>, key: &'static str, default: T, assumed: &mut Vec<&'static str>) -> T {
    value.unwrap_or_else(|| {
        assumed.push(key);
        default
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_and_its_plate_share_a_near_distance() {
        for (near, expected) in [([0.5, 0.2], 0.5), ([0.5, 0.0], 0.5), ([0.0, 0.2], 0.2), ([0.0; 2], 0.0)] {
            let [mut field, mut plate] = near.map(|near| Field { near, ..Field::default() });
            share_near(&mut field, &mut plate);
            assert_eq!([field.near, plate.near], [expected; 2]);
        }
    }
}
