//! Scenes: what a package is made from.
//!
//! A scene is a fitted field file, or a folder that holds exactly one, perhaps with a static
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

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use codec::{ALPHA_MIN, ClipInfo, Field, Viewpoint};
use program::Fault;
use serde::Deserialize;

use crate::import::{
    EXTENSIONS, FORMATS, FitRecord, Hints, Imported, Repairs, SequenceFiles, import, import_sequence,
};
use crate::messages::unreadable;

/// Default duration in seconds: clip time then equals seconds.
pub const DEFAULT_DURATION_S: f32 = 1.0;

/// Default frames per second.
pub const DEFAULT_FPS: f32 = 30.0;

/// Default up axis: that of upright cameras in COLMAP's and OpenCV's axes.
pub const DEFAULT_UP: [f32; 3] = [0.0, -1.0, 0.0];

/// Default scale.
pub const DEFAULT_METRES_PER_UNIT: f32 = 1.0;

/// Fraction of the Gaussians, at either end of an axis, that the default viewpoint need not show: fits
/// leave strays far outside.
const STRAYS: f64 = 0.02;

/// Clouds of points without Gaussians that captures and fitting programs put beside a field.
const POINT_CLOUDS: [&str; 4] = ["input.ply", "points3D.ply", "points3d.ply", "sparse_pc.ply"];

/// File name of a scene's background, and end of the name of one that belongs to the field with the same name before it.
const PLATE: &str = "plate.ply";

/// File name of the cameras of a field folder, and end of the name of those of the field with the same name before it.
const CAMERAS: &str = "cameras.json";

/// File name of a scene's overrides.
const OVERRIDES: &str = "scene.json";

/// File name that marks a field folder, a take of segments.
pub(crate) const FIELD_FOLDER: &str = "field.json";

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
}

impl Scene {
    /// Reads a scene from a field file or a folder.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file or folder: missing, without a field or with several,
    /// a field that cannot be imported, a plate that moves, a bad `scene.json`.
    pub fn load(path: &Path) -> anyhow::Result<Scene> {
        if !fs::metadata(path).map_err(|error| unreadable(path, &error))?.is_dir() {
            let plate = fitted_plate(path)?;
            return Ok(Scene::new(path, name_of_file(path), import(path)?, plate, Overrides::default())?);
        }
        let names = list(path)?;
        if names.iter().any(|name| name == FIELD_FOLDER) {
            let what = "a take of several segments, where one field is expected; name a field file in it";
            return Err(Fault::Data(format!("{}: {what}", path.display())).into());
        }
        Scene::in_folder(path, &path.join(field_in(path, &names)?), &names)
    }

    /// Reads the scene of a folder without a field, with the field file `field`.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub fn load_with(folder: &Path, field: &Path) -> anyhow::Result<Scene> {
        Scene::in_folder(folder, field, &list(folder)?)
    }

    /// Reads a segment of a take from its field file and that of its background; the take gives duration and frame
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
        let plate = plate.map(load_plate).transpose()?;
        let of_take = Overrides { duration_s: Some(duration_s), fps: Some(fps), ..Overrides::default() };
        let scene = Scene::new(field, name_of_file(field), import(field)?, plate, of_take)?;
        Ok(Scene { is_segment: true, ..scene })
    }

    /// Whether `path` is a folder with a field file.
    pub(crate) fn has_field(path: &Path) -> bool {
        list(path).is_ok_and(|names| names.iter().any(|name| is_field_name(name)))
    }

    /// The scene of a folder with entries `names`.
    fn in_folder(folder: &Path, field: &Path, names: &[String]) -> anyhow::Result<Scene> {
        let subject = import(field)?;
        let plate = match names.iter().any(|name| name == PLATE) {
            true => Some(load_plate(&folder.join(PLATE))?),
            false => fitted_plate(field)?,
        };
        let (source, overrides) = if names.iter().any(|name| name == OVERRIDES) {
            let path = folder.join(OVERRIDES);
            let overrides = Overrides::load(&path)?;
            (path, overrides)
        } else {
            (field.to_owned(), Overrides::default())
        };
        Ok(Scene::new(&source, name_of_folder(folder), subject, plate, overrides)?)
    }

    /// Whether `path` is a folder with a capture and no field.
    pub fn is_capture(path: &Path) -> bool {
        let names = if path.is_dir() { list(path).unwrap_or_default() } else { Vec::new() };
        !names.iter().any(|name| is_field_name(name) || name == FIELD_FOLDER)
            && names.iter().any(|name| is_capture_name(name))
    }

    /// Combines overrides, hints and defaults, in this precedence. Errors name `source`.
    fn new(
        source: &Path,
        name: String,
        subject: Imported,
        plate: Option<Imported>,
        overrides: Overrides,
    ) -> Result<Scene, Fault> {
        let hints = &subject.hints;
        let mut assumed = Vec::new();
        let up = known(overrides.up.and_then(normalized).or(hints.up), "up", DEFAULT_UP, &mut assumed);
        let mut viewpoints = match overrides.viewpoints {
            Some(views) => views.into_iter().map(Viewpoint::from).collect(),
            None => hints.viewpoints.clone(),
        };
        if viewpoints.is_empty() {
            assumed.push("viewpoints");
            viewpoints.push(Viewpoint::framing(box_without_strays(&subject.field), up));
        }
        let mut number =
            |key, over: Option<f32>, hint, default| known(over.or(hint), key, default, &mut assumed);
        let info = ClipInfo {
            duration_s: number("duration_s", overrides.duration_s, hints.duration_s, DEFAULT_DURATION_S),
            fps: number("fps", overrides.fps, hints.fps, DEFAULT_FPS),
            up,
            metres_per_unit: number(
                "metres_per_unit",
                overrides.metres_per_unit,
                hints.metres_per_unit,
                DEFAULT_METRES_PER_UNIT,
            ),
            viewpoints,
        };
        let fault = |(field, value)| {
            Fault::Data(format!("{}: bad {field}: {value}; set another in scene.json", source.display()))
        };
        info.check().map_err(fault)?;
        Ok(Scene { name, subject, plate, info, assumed, is_segment: false })
    }

    /// Number of captured frames, the first at the start and the last at the end, if the field file records
    /// it; `scene.json` changes only the playback rate.
    pub fn frames(&self) -> Option<usize> {
        let (duration_s, fps) = self.subject.hints.duration_s.zip(self.subject.hints.fps)?;
        Some(frames_in(duration_s, fps))
    }

    /// The photographs that the field was fitted to, as far as its file records them.
    pub(crate) fn fit_record(&self) -> FitRecord {
        FitRecord::of(&self.subject.hints).unwrap_or_default()
    }

    /// A scene of a field in memory.
    pub fn made(name: &str, field: Field, info: ClipInfo) -> Scene {
        let (hints, repairs) = (Hints::default(), Repairs::default());
        let subject = Imported { field, hints, repairs, format: "made up", notes: Vec::new() };
        Scene { name: name.to_owned(), subject, plate: None, info, assumed: Vec::new(), is_segment: false }
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

/// The contents of `scene.json`.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Overrides {
    duration_s: Option<f32>,
    fps: Option<f32>,
    up: Option<[f32; 3]>,
    metres_per_unit: Option<f32>,
    viewpoints: Option<Vec<ViewpointEntry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewpointEntry {
    name: String,
    position: [f32; 3],
    target: [f32; 3],
    fov_y_deg: f32,
}

impl Overrides {
    fn load(path: &Path) -> Result<Overrides, Fault> {
        let text = fs::read_to_string(path).map_err(|error| unreadable(path, &error))?;
        let fault = |what: String| Fault::Data(format!("{}: {what}", path.display()));
        let overrides: Overrides = serde_json::from_str(&text)
            .map_err(|error| fault(format!("{error}; `package --help` shows its keys")))?;
        overrides.check().map_err(fault)?;
        Ok(overrides)
    }

    fn check(&self) -> Result<(), String> {
        let positive = |key: &str, value: Option<f32>| match value {
            Some(x) if !(x.is_finite() && x > 0.0) => {
                Err(format!("{key} must be a positive number, not {x}"))
            }
            _ => Ok(()),
        };
        positive("duration_s", self.duration_s)?;
        positive("fps", self.fps)?;
        positive("metres_per_unit", self.metres_per_unit)?;
        if let Some(up) = self.up
            && normalized(up).is_none()
        {
            return Err(format!("up must be a direction, not {up:?}"));
        }
        let views = self.viewpoints.as_deref().unwrap_or_default();
        for (i, view) in views.iter().enumerate() {
            let at = format!("viewpoints[{i}]");
            if view.name.is_empty() {
                return Err(format!("{at}.name is empty; name it"));
            }
            if views[..i].iter().any(|other| other.name == view.name) {
                return Err(format!("{at}.name \"{}\" is there twice; rename one", view.name));
            }
            if !view.position.iter().chain(&view.target).all(|x| x.is_finite()) {
                return Err(format!("{at}: a coordinate is not a finite number; correct it"));
            }
            if view.position == view.target {
                return Err(format!("{at}: position and target are the same point; move one"));
            }
            if !(view.fov_y_deg > 0.0 && view.fov_y_deg < 180.0) {
                return Err(format!("{at}.fov_y_deg must lie between 0 and 180, not {}", view.fov_y_deg));
            }
        }
        Ok(())
    }
}

/// The value, or its default, whose key is then added to `assumed`.
fn known<T>(value: Option<T>, key: &'static str, default: T, assumed: &mut Vec<&'static str>) -> T {
    value.unwrap_or_else(|| {
        assumed.push(key);
        default
    })
}

/// Corners of a box around nearly all Gaussians, halfway through the clip.
fn box_without_strays(field: &Field) -> [[f32; 3]; 2] {
    let visible = (0..field.len()).filter(|&i| field.opacity_at(i, 0.5) >= ALPHA_MIN);
    let centers: Vec<[f64; 3]> = visible.map(|i| field.position_at(i, 0.5)).collect();
    if centers.is_empty() {
        return field.bounds();
    }
    let strays = (STRAYS * centers.len() as f64) as usize;
    let mut corners = [[0.0; 3]; 2];
    for axis in 0..3 {
        let mut column: Vec<f64> = centers.iter().map(|center| center[axis]).collect();
        column.sort_by(f64::total_cmp);
        corners[0][axis] = column[strays] as f32;
        corners[1][axis] = column[column.len() - 1 - strays] as f32;
    }
    corners
}

impl From<ViewpointEntry> for Viewpoint {
    fn from(view: ViewpointEntry) -> Viewpoint {
        Viewpoint {
            name: view.name,
            position: view.position,
            target: view.target,
            fov_y: view.fov_y_deg.to_radians(),
        }
    }
}

/// Path of the background that belongs to a field file.
pub fn plate_path(field: &Path) -> PathBuf {
    beside(field, PLATE)
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
            let names = list(path).unwrap_or_default();
            [of_folder(path), field_in(path, &names).ok().map(|field| cameras_path(&path.join(field)))]
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

/// The background that belongs to a field file, if there is one.
fn fitted_plate(field: &Path) -> anyhow::Result<Option<Imported>> {
    Some(plate_path(field)).filter(|plate| plate.is_file()).as_deref().map(load_plate).transpose()
}

fn load_plate(path: &Path) -> anyhow::Result<Imported> {
    let plate = import(path)?;
    if plate.field.temporal.is_some() {
        let what = "a background plate must be static, but this field moves or fades; export one instant of it with `export --at`";
        return Err(Fault::Data(format!("{}: {what}", path.display())).into());
    }
    Ok(plate)
}

/// Names of the entries of a folder, sorted, hidden ones left out.
fn list(folder: &Path) -> Result<Vec<String>, Fault> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        let entry = entry.map_err(|error| unreadable(folder, &error))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.retain(|name| !name.starts_with('.'));
    names.sort();
    Ok(names)
}

/// Name of the one field file among the entries of a folder.
fn field_in<'a>(folder: &Path, names: &'a [String]) -> Result<&'a str, Fault> {
    let fault = |what: String| Err(Fault::Data(what));
    let fields: Vec<&str> = names.iter().map(String::as_str).filter(|name| is_field_name(name)).collect();
    let folder = folder.display();
    match fields[..] {
        [field] => Ok(field),
        [] if names.iter().any(|name| is_capture_name(name)) => fault(format!(
            "no field in {folder}, only a capture; run `fit {folder}` first, or put a fitted field there ({FORMATS})"
        )),
        [] => {
            fault(format!("no field in {folder}; put one there, a file of one of these formats: {FORMATS}"))
        }
        _ => fault(format!("{folder} holds several fields; name one of them: {}", fields.join(", "))),
    }
}

fn is_field_name(name: &str) -> bool {
    let is_plate = name.strip_suffix(PLATE).is_some_and(|before| before.is_empty() || before.ends_with('.'));
    if is_plate || POINT_CLOUDS.contains(&name) {
        return false;
    }
    is_field_file(name)
}

/// Whether a file of this name has a field format.
fn is_field_file(name: &str) -> bool {
    name == "meta.json" || EXTENSIONS.contains(&extension_of(name).as_str())
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
    match path.file_name() == Some(OsStr::new("meta.json")) {
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

fn normalized(v: [f32; 3]) -> Option<[f32; 3]> {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    (length.is_finite() && length > 1e-6).then(|| v.map(|x| x / length))
}
