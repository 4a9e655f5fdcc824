//! Captures in the layout of nerfstudio and Blender's NeRF scenes: `transforms.json`, or
//! `transforms_train.json` with `transforms_test.json` for held cameras.
//!
//! Each of its frames has a camera of its own, and a `time` if the scene is dynamic. Poses are camera to
//! world in OpenGL's axes: x right, y up, z backwards.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::{DMat4, DVec3, DVec4};
use program::Fault;
use refine::capture::{CalibratedCamera, Lens};
use serde::Deserialize;
use serde_json::Value;

use super::capture_files::{CaptureBuilder, CaptureFiles, calibrated, pinhole};
use super::colmap;
use super::image_file::{
    bad, bad_layout, find_image_in, read_text, scale_of_photograph, size_of, unread_picture,
};
use super::listed_paths::{ListedPaths, advice};
use super::manifest::{about_entry, unit};
use super::photo_paths::PhotoPath;
use super::unread::{is_stated, unread_note};
use crate::scene::DEFAULT_FPS;

/// A file of transforms, and whether its cameras are held out.
type TransformsFile = (PathBuf, bool);

/// Keys that state a camera which is not supported, unless their values are 0 or false: `from_mitsuba` and `from_na` of
/// instant-ngp and NeuS2 change its axes.
pub(super) const REFUSED_KEYS: [&str; 10] = [
    "equirectangular",
    "from_mitsuba",
    "from_na",
    "ftheta_p0",
    "latlong",
    "normal_mts_args",
    "orthographic",
    "rolling_shutter",
    "transform_matrix_end",
    "transform_matrix_start",
];

/// Keys on which nothing that is drawn depends: how other programs scale, turn and crop the world of the file, where its
/// points and depth maps are, how photographs were made.
pub(super) const IGNORED_KEYS: [&str; 20] = [
    "aabb",
    "aabb_scale",
    "applied_scale",
    "applied_transform",
    "colmap_im_id",
    "depth_file_path",
    "depth_path",
    "depth_unit_scale_factor",
    "enable_depth_loading",
    "enable_ray_loading",
    "importance_sampling",
    "integer_depth_scale",
    "n_extra_learnable_dims",
    "offset",
    "orientation_override",
    "ply_file_path",
    "render_aabb",
    "rotation",
    "scale",
    "sharpness",
];

/// Keys that no field of a structure here has, with their values.
type OtherKeys = BTreeMap<String, Value>;

/// Intrinsics of all frames or of one.
#[derive(Clone, Default, PartialEq, Deserialize)]
#[cfg_attr(test, derive(serde::Serialize))]
struct Intrinsics {
    camera_model: Option<String>,
    /// instant-ngp's way to state OPENCV_FISHEYE or OPENCV.
    is_fisheye: Option<bool>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    /// Field of view in degrees.
    x_fov: Option<f64>,
    y_fov: Option<f64>,
    /// Field of view in radians.
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    k5: Option<f64>,
    k6: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    /// nerfstudio's list of k1, k2, k3, k4, p1, p2.
    distortion_params: Option<Vec<f64>>,
    /// Image size in pixels that the other values refer to; by default the photograph's.
    w: Option<f64>,
    h: Option<f64>,
}

#[derive(Deserialize)]
#[cfg_attr(test, derive(serde::Serialize))]
struct Transforms {
    #[serde(flatten)]
    intrinsics: Intrinsics,
    frames: Vec<Frame>,
    /// Up direction of the world.
    up: Option<[f64; 3]>,
    /// Values of `file_path` in nerfstudio's splits.
    train_filenames: Option<BTreeSet<ListedName>>,
    val_filenames: Option<BTreeSet<ListedName>>,
    test_filenames: Option<BTreeSet<ListedName>>,
    #[serde(flatten)]
    others: OtherKeys,
}

/// A picture's path however it is spelled: with `./` before it, or with Windows' separators.
#[derive(Deserialize, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(test, derive(serde::Serialize))]
#[serde(from = "String")]
struct ListedName(String);

impl From<String> for ListedName {
    fn from(path: String) -> ListedName {
        let slashed = path.replace('\\', "/");
        ListedName(slashed.trim_start_matches("./").to_owned())
    }
}

#[derive(Deserialize)]
#[cfg_attr(test, derive(serde::Serialize))]
struct Frame {
    file_path: String,
    mask_path: Option<String>,
    time: Option<f64>,
    transform_matrix: [[f64; 4]; 4],
    #[serde(flatten)]
    intrinsics: Intrinsics,
    #[serde(flatten)]
    others: OtherKeys,
}

/// The files of this layout in `folder`; `None` if there are none.
pub(super) fn files(folder: &Path) -> Option<Vec<TransformsFile>> {
    let existing = |name: &str, held| Some((folder.join(name), held)).filter(|(path, _)| path.is_file());
    match existing("transforms.json", false) {
        Some(file) => Some(vec![file]),
        None => {
            let train = existing("transforms_train.json", false)?;
            Some([Some(train), existing("transforms_test.json", true)].into_iter().flatten().collect())
        }
    }
}

impl Transforms {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file, and its frame if the problem is with one.
    fn read(path: &Path) -> Result<Transforms, Fault> {
        let text = read_text(path)?;
        let transforms: Transforms = serde_json::from_str(&text).map_err(|error| {
            bad_layout(path, about_entry::<Frame>(&text, &error, "frames", "frame", "file_path"))
        })?;
        let frames =
            transforms.frames.iter().map(|frame| (format!("frame {}: ", frame.file_path), &frame.others));
        for (whose, others) in std::iter::once((String::new(), &transforms.others)).chain(frames) {
            if let Some(key) = REFUSED_KEYS.into_iter().find(|key| others.get(*key).is_some_and(is_stated)) {
                let problem = format!(
                    "{whose}{key} states a camera that is not supported; write it without, with OpenGL's axes and \
                     undistorted pictures"
                );
                return Err(bad_layout(path, problem));
            }
        }
        match transforms.up.filter(|up| !unit(*up).iter().all(|x| x.is_finite())) {
            Some(up) => Err(bad_layout(path, format!("up {up:?} is no direction"))),
            None => Ok(transforms),
        }
    }

    /// The note on the keys of the file at `path` that are not read.
    fn note(&self, path: &Path) -> Option<String> {
        let file = path.file_name().unwrap_or_default().display();
        unread_note(&format!("{file} states"), self.unread_keys().into_iter())
    }

    /// The keys that are not read though something that is drawn may depend on them.
    fn unread_keys(&self) -> BTreeSet<&str> {
        let others = std::iter::once(&self.others).chain(self.frames.iter().map(|frame| &frame.others));
        let stated = others.flatten().filter(|(_, value)| is_stated(value)).map(|(key, _)| key.as_str());
        stated.filter(|key| !IGNORED_KEYS.contains(key)).collect()
    }

    /// Whether all frames share their intrinsics, and none its time with another: a device is at one place at a time.
    fn is_of_one_device(&self) -> bool {
        let mut times: Vec<f64> = self.frames.iter().filter_map(|frame| frame.time).collect();
        times.sort_by(f64::total_cmp);
        times.windows(2).all(|pair| pair[0] < pair[1])
            && self.frames.windows(2).all(|pair| pair[0].intrinsics == pair[1].intrinsics)
    }

    /// Whether the file holds a frame out from fitting.
    fn is_held(&self, frame: &Frame) -> bool {
        let Transforms { train_filenames, val_filenames, test_filenames, .. } = self;
        let name = ListedName::from(frame.file_path.clone());
        match train_filenames {
            Some(train) => !train.contains(&name),
            None => [val_filenames, test_filenames].into_iter().flatten().any(|held| held.contains(&name)),
        }
    }
}

/// The cameras of a file, named as its pictures without their extensions. The keys that are not read go to `notes`.
///
/// # Errors
/// [`Fault::Data`] that names the file.
pub(super) fn cameras(path: &Path, notes: &mut Vec<String>) -> Result<Vec<CalibratedCamera>, Fault> {
    let transforms = Transforms::read(path)?;
    notes.extend(transforms.note(path));
    let camera = |frame: &Frame| {
        let name =
            Path::new(&frame.file_path.replace('\\', "/")).with_extension("").to_string_lossy().into_owned();
        let at = |problem: String| bad_layout(path, format!("frame {name}: {problem}"));
        let side =
            |key: fn(&Intrinsics) -> Option<f64>| key(&frame.intrinsics).or(key(&transforms.intrinsics));
        let (Some(w), Some(h)) = (side(|i| i.w), side(|i| i.h)) else {
            return Err(at("w and h are missing, the size of its pictures".into()));
        };
        let (k, lens) = frame.intrinsics.resolve(&transforms.intrinsics, (w as u32, h as u32)).map_err(at)?;
        let camera = pinhole((w as u32, h as u32), k, camera_from_world(frame.transform_matrix));
        Ok(calibrated(name, camera, lens))
    };
    transforms.frames.iter().map(camera).collect()
}

pub(super) fn open(folder: &Path, files: &[TransformsFile]) -> anyhow::Result<CaptureFiles> {
    let mut builder = CaptureBuilder::new(folder);
    let mut listed = ListedPaths::new(folder);
    let mut stated_up = None;
    // Of the photographs, in the order of the files.
    let mut photo_times = Vec::new();
    let mut is_timed = None;
    for (number, (path, held)) in (0..).zip(files) {
        let transforms = Transforms::read(path)?;
        transforms.note(path).into_iter().for_each(|note| builder.note(note));
        stated_up = stated_up.or(transforms.up.map(unit));
        let is_of_one_device = transforms.is_of_one_device();
        for frame in &transforms.frames {
            let name = frame.file_path.trim_start_matches("./");
            let Some(image) = listed.find(name, |name| find_image_in(folder, name))? else {
                return Err(missing(folder, path, name).into());
            };
            let size = size_of(&folder.join(&image))?;
            let at = |problem: String| bad_layout(path, format!("frame {name}: {problem}"));
            let (pinhole_k, lens) = frame.intrinsics.resolve(&transforms.intrinsics, size).map_err(at)?;
            let camera = pinhole(size, pinhole_k, camera_from_world(frame.transform_matrix));
            if *is_timed.get_or_insert(frame.time.is_some()) != frame.time.is_some() {
                return Err(at("only some frames have a time; state it for all or for none".into()).into());
            }
            let mask = match &frame.mask_path {
                Some(mask) => {
                    // The end of its path may be the photograph's.
                    let existing =
                        |mask: &str| (mask != image && folder.join(mask).is_file()).then(|| mask.to_owned());
                    // Without its file, reading the mask says what is missing.
                    Some(listed.find(mask, existing)?.unwrap_or_else(|| mask.clone()))
                }
                None => None,
            };
            let name = Path::new(&image).with_extension("");
            let name = name.to_string_lossy();
            let index = builder.camera(&name, camera, lens, *held || transforms.is_held(frame));
            if is_of_one_device {
                builder.device(index, number);
            }
            let paths = PhotoPath { image: &image, name: &name, mask: mask.as_deref() };
            builder.photo(index, photo_times.len(), paths)?;
            photo_times.push(frame.time.unwrap_or(0.0));
        }
    }
    listed.note().into_iter().for_each(|note| builder.note(note));
    let mut times = photo_times.clone();
    times.sort_by(f64::total_cmp);
    times.dedup();
    builder.renumber(|photo| times.partition_point(|time| *time < photo_times[photo]));
    Ok(CaptureFiles { stated_up, ..builder.build(frame_times_s(&times), None) })
}

/// The fault of the photograph `name` of the file at `path`, which is not in `folder`.
fn missing(folder: &Path, path: &Path, name: &str) -> Fault {
    let model = match colmap::model(folder) {
        Some(_) => format!(", or move {} away to read the COLMAP model beside it", path.display()),
        None => String::new(),
    };
    let missing =
        || bad(&folder.join(name), format!("this photograph is missing{}{model}", advice(folder, name)));
    unread_picture(&folder.join(name)).unwrap_or_else(missing)
}

/// Scales ascending times of frames, in any unit, to seconds since the first, at [`DEFAULT_FPS`] on average.
/// D-NeRF's files have i / N, others frame numbers or seconds.
fn frame_times_s(times: &[f64]) -> Vec<f64> {
    match times {
        [first, .., last] => {
            let duration_s = (times.len() - 1) as f64 / f64::from(DEFAULT_FPS);
            // Halves, so that no difference overflows.
            let since_first = |t: &f64| 0.5 * t - 0.5 * first;
            times.iter().map(|t| since_first(t) / since_first(last) * duration_s).collect()
        }
        _ => vec![0.0; times.len()],
    }
}

impl Intrinsics {
    /// Focal lengths, principal point and lens, in pixels of a photograph of the given size, which may be
    /// smaller than the file states. Values of `self`, a frame, override the file's values.
    fn resolve(&self, file: &Intrinsics, (width, height): (u32, u32)) -> Result<([f64; 4], Lens), String> {
        let pick = |key: fn(&Intrinsics) -> Option<f64>| key(self).or(key(file));
        let [actual_w, actual_h] = [width, height].map(f64::from);
        let (w, h) = (pick(|i| i.w).unwrap_or(actual_w), pick(|i| i.h).unwrap_or(actual_h));
        if !(w >= 1.0 && h >= 1.0) {
            return Err(format!("w and h are {w} and {h}: an image has pixels"));
        }
        // A frame with a focal length of its own has the other from there, too.
        let focals = self.focals([w, h]).or_else(|| file.focals([w, h]));
        let [fx, fy] = focals.ok_or("neither fl_x nor x_fov nor camera_angle_x is given")?;
        let cx = pick(|i| i.cx).unwrap_or(0.5 * w);
        let cy = pick(|i| i.cy).unwrap_or(0.5 * h);
        let [x, y] = scale_of_photograph([w, h], (width, height))?;
        Ok(([fx * x, fy * y, cx * x, cy * y], self.lens(file)?))
    }

    /// Focal lengths in pixels of pictures of a size; both are equal if one is stated. `None` if none is.
    fn focals(&self, [w, h]: [f64; 2]) -> Option<[f64; 2]> {
        let from_angle = |side: f64, angle: f64| 0.5 * side / (0.5 * angle).tan();
        let focal = |side: f64, [focal, fov, angle]: [Option<f64>; 3]| {
            focal.or(fov.map(f64::to_radians).or(angle).map(|angle| from_angle(side, angle)))
        };
        let fx = focal(w, [self.fl_x, self.x_fov, self.camera_angle_x]);
        let fy = focal(h, [self.fl_y, self.y_fov, self.camera_angle_y]);
        Some([fx.or(fy)?, fy.or(fx)?])
    }

    /// The camera model, if it is stated.
    ///
    /// # Errors
    /// If it is stated twice, differently.
    fn model(&self) -> Result<Option<&str>, String> {
        const FISHEYE: &str = "OPENCV_FISHEYE";
        match (self.camera_model.as_deref(), self.is_fisheye) {
            (Some(model), Some(is_fisheye)) if is_fisheye != (model == FISHEYE) => {
                Err(format!("camera_model {model} contradicts is_fisheye {is_fisheye}; remove the wrong one"))
            }
            (Some(model), _) => Ok(Some(model)),
            (None, is_fisheye) => {
                Ok(is_fisheye.map(|is_fisheye| if is_fisheye { FISHEYE } else { "OPENCV" }))
            }
        }
    }

    /// The same with the listed coefficients by name.
    ///
    /// # Errors
    /// If the list has another length, or a coefficient is stated twice, differently.
    fn with_listed(&self) -> Result<Intrinsics, String> {
        let mut named = self.clone();
        let Some(list) = &self.distortion_params else { return Ok(named) };
        let &[k1, k2, k3, k4, p1, p2] = list.as_slice() else {
            return Err(format!("distortion_params has {} numbers, not k1, k2, k3, k4, p1, p2", list.len()));
        };
        for (name, slot, listed) in [
            ("k1", &mut named.k1, k1),
            ("k2", &mut named.k2, k2),
            ("k3", &mut named.k3, k3),
            ("k4", &mut named.k4, k4),
            ("p1", &mut named.p1, p1),
            ("p2", &mut named.p2, p2),
        ] {
            if slot.replace(listed).is_some_and(|stated| stated != listed) {
                return Err(format!("distortion_params contradicts {name}; remove the wrong one"));
            }
        }
        Ok(named)
    }

    fn lens(&self, file: &Intrinsics) -> Result<Lens, String> {
        let (own, file) = (self.with_listed()?, file.with_listed()?);
        let coefficient = |key: fn(&Intrinsics) -> Option<f64>| key(&own).or(key(&file)).unwrap_or(0.0);
        let [k1, k2, k3, k4, k5, k6] = [
            coefficient(|i| i.k1),
            coefficient(|i| i.k2),
            coefficient(|i| i.k3),
            coefficient(|i| i.k4),
            coefficient(|i| i.k5),
            coefficient(|i| i.k6),
        ];
        let [p1, p2] = [coefficient(|i| i.p1), coefficient(|i| i.p2)];
        let model = self.model()?.or(file.model()?).unwrap_or("OPENCV");
        // nerfstudio's k4 of OPENCV belongs to the eighth power of the radius, unlike OpenCV's.
        let (lens, own, others): (_, _, &[f64]) = match model {
            "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" => {
                (Lens::rational(&[k1, k2, p1, p2, k3]), "k1, k2, k3, p1, p2", &[k4, k5, k6])
            }
            // The k4 of the list is of another model.
            "FULL_OPENCV" if own.distortion_params.is_some() || file.distortion_params.is_some() => {
                return Err("distortion_params has no k5 and k6; state those of FULL_OPENCV by name".into());
            }
            "FULL_OPENCV" => (Lens::rational(&[k1, k2, p1, p2, k3, k4, k5, k6]), "k1 to k6, p1, p2", &[]),
            "OPENCV_FISHEYE" => (Lens::fisheye(&[k1, k2, k3, k4]), "k1 to k4", &[k5, k6, p1, p2]),
            _ => {
                return Err(format!(
                    "camera model {model} is not supported: OPENCV, FULL_OPENCV, OPENCV_FISHEYE and those with fewer \
                     coefficients are"
                ));
            }
        };
        if others.iter().any(|k| *k != 0.0) {
            return Err(format!("camera model {model} has {own}, but another coefficient is not 0"));
        }
        lens
    }
}

/// Scale of a pose up to which it counts as rounding, less 1.
const SCALE_ROUNDING: f64 = 1e-4;

/// The scale of a pose whose axes have one length: that of a scaled object in Blender, which changes no picture. Else 1.
fn scale_of(world_from_gl: &DMat4) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| world_from_gl.col(axis).truncate().length());
    let is_uniform = DVec3::new(x, y, z).abs_diff_eq(DVec3::splat(x), SCALE_ROUNDING * x);
    if is_uniform && x > 0.0 && (x - 1.0).abs() > SCALE_ROUNDING { x } else { 1.0 }
}

/// Inverts a pose and converts it to OpenCV's axes.
fn camera_from_world(world_from_gl: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
    let world_from_gl = DMat4::from_cols_array_2d(&world_from_gl).transpose();
    let s = scale_of(&world_from_gl).recip();
    let gl_from_camera = DMat4::from_diagonal(DVec4::new(s, -s, -s, 1.0));
    let mut rows = (world_from_gl * gl_from_camera).inverse().transpose().to_cols_array_2d();
    // The inverse rounds; this row is exact.
    rows[3] = [0.0, 0.0, 0.0, 1.0];
    rows
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const FRAME: &str = r#"{"file_path": "a", "transform_matrix":
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"#;

    /// The keys of a file and its frames that are read.
    pub(in crate::capture) fn read_keys() -> BTreeSet<String> {
        let file: Transforms = serde_json::from_str(&format!(r#"{{"frames": [{FRAME}}}]}}"#)).unwrap();
        let keys = |value: Value| value.as_object().unwrap().keys().cloned().collect::<BTreeSet<String>>();
        let frame = serde_json::to_value(&file.frames[0]).unwrap();
        &keys(serde_json::to_value(&file).unwrap()) | &keys(frame)
    }

    #[test]
    fn a_pose_becomes_a_camera() {
        // At (1, 2, 3), looking along -z with y up.
        let mut pose = DMat4::IDENTITY.to_cols_array_2d();
        (pose[0][3], pose[1][3], pose[2][3]) = (1.0, 2.0, 3.0);
        let camera = pinhole((8, 8), [4.0, 4.0, 4.0, 4.0], camera_from_world(pose));
        camera.check().unwrap();
        assert_eq!(camera.position(), [1.0, 2.0, 3.0]);
        assert_eq!(camera.camera_from_world[2][..3], [0.0, 0.0, -1.0]);
        assert_eq!(camera.camera_from_world[1][..3], [0.0, -1.0, 0.0]);
        // A camera that is scaled in Blender sees the same.
        let mut scaled = pose;
        scaled.iter_mut().take(3).for_each(|row| row[..3].iter_mut().for_each(|x| *x *= 2.5));
        let same = pinhole((8, 8), [4.0, 4.0, 4.0, 4.0], camera_from_world(scaled));
        assert_eq!(same, camera);
        scaled[0][0] = 1.0;
        let sheared = pinhole((8, 8), [4.0, 4.0, 4.0, 4.0], camera_from_world(scaled));
        assert!(sheared.check().is_err());
    }

    #[test]
    fn a_frame_overrides_the_file() {
        let all = Intrinsics { fl_x: Some(100.0), k1: Some(0.1), ..Intrinsics::default() };
        let own = Intrinsics { fl_x: Some(50.0), ..Intrinsics::default() };
        let (k, lens) = own.resolve(&all, (64, 48)).unwrap();
        assert_eq!((k, lens), ([50.0, 50.0, 32.0, 24.0], Lens::rational(&[0.1]).unwrap()));
        let angle = Intrinsics { camera_angle_x: Some(std::f64::consts::FRAC_PI_2), ..Intrinsics::default() };
        assert!((angle.resolve(&Intrinsics::default(), (64, 48)).unwrap().0[0] - 32.0).abs() < 1e-9);
        assert!(Intrinsics::default().resolve(&Intrinsics::default(), (64, 48)).is_err());
    }

    #[test]
    fn camera_models_name_their_coefficients() {
        let lens = |text: &str| -> Result<Lens, String> {
            let all: Intrinsics = serde_json::from_str(text).unwrap();
            Ok(Intrinsics::default().resolve(&Intrinsics { fl_x: Some(9.0), ..all }, (64, 48))?.1)
        };
        let eight =
            r#""k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4, "k3": 0.5, "k4": 0.6, "k5": 0.7, "k6": 0.8}"#;
        let rational = Lens::rational(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]).unwrap();
        assert_eq!(lens(&format!(r#"{{"camera_model": "FULL_OPENCV", {eight}"#)).unwrap(), rational);
        let four = r#""k1": 0.1, "k2": 0.2, "k3": 0.5, "k4": 0.6, "p1": 0, "p2": 0}"#;
        let fisheye = Lens::fisheye(&[0.1, 0.2, 0.5, 0.6]).unwrap();
        assert_eq!(lens(&format!(r#"{{"camera_model": "OPENCV_FISHEYE", {four}"#)).unwrap(), fisheye);
        assert_eq!(lens(&format!(r#"{{"is_fisheye": true, {four}"#)).unwrap(), fisheye);
        // A frame's model overrides the file's.
        let [own, file] = ["OPENCV_FISHEYE", "OPENCV"]
            .map(|model| Intrinsics { camera_model: Some(model.into()), ..Intrinsics::default() });
        assert_eq!(own.lens(&file), Lens::fisheye(&[]));
        let listed = |model: &str, list: &str| {
            lens(&format!(r#"{{"camera_model": "{model}", "distortion_params": [{list}]}}"#))
        };
        assert_eq!(listed("OPENCV_FISHEYE", "0.1, 0.2, 0.5, 0.6, 0, 0").unwrap(), fisheye);
        let opencv = Lens::rational(&[0.1, 0.2, 0.3, 0.4, 0.5]).unwrap();
        assert_eq!(listed("OPENCV", "0.1, 0.2, 0.5, 0, 0.3, 0.4").unwrap(), opencv);
        // A frame's list overrides the file's coefficients.
        let own = Intrinsics { distortion_params: Some(vec![0.1, 0.2, 0.5, 0.0, 0.3, 0.4]), ..own.clone() };
        let own = Intrinsics { camera_model: None, ..own };
        assert_eq!(own.lens(&Intrinsics { k1: Some(9.0), p2: Some(9.0), ..file.clone() }), Ok(opencv));
        for (model, list, problem) in [
            ("OPENCV", "0.1, 0.2, 0.5, 0.6, 0, 0", "another coefficient is not 0"),
            ("OPENCV_FISHEYE", "0.1, 0.2, 0.5, 0.6, 0.3, 0", "another coefficient is not 0"),
            ("FULL_OPENCV", "0.1, 0.2, 0.5, 0, 0.3, 0.4", "by name"),
            ("OPENCV", "0.1, 0.2", "has 2 numbers, not k1"),
        ] {
            let error = listed(model, list).unwrap_err();
            assert!(error.contains(problem), "{model} {list}: {error}");
        }
        for (refused, problem) in [
            (
                r#"{"k1": 0.2, "distortion_params": [0.1, 0, 0, 0, 0, 0]}"#.into(),
                "distortion_params contradicts k1",
            ),
            (format!(r#"{{"camera_model": "OPENCV", {four}"#), "another coefficient is not 0"),
            (format!("{{{four}"), "another coefficient is not 0"),
            (format!(r#"{{"camera_model": "OPENCV_FISHEYE", {eight}"#), "another coefficient is not 0"),
            (format!(r#"{{"camera_model": "FISHEYE624", {four}"#), "FISHEYE624 is not supported"),
            (format!(r#"{{"is_fisheye": true, {eight}"#), "another coefficient is not 0"),
            (
                format!(r#"{{"is_fisheye": true, "camera_model": "OPENCV", {four}"#),
                "contradicts is_fisheye true",
            ),
        ] {
            let error = lens(&refused).unwrap_err();
            assert!(error.contains(problem), "{refused}: {error}");
        }
    }

    #[test]
    fn focal_lengths_are_stated_in_several_ways() {
        let focals = |text: &str| -> Option<[f64; 2]> {
            let intrinsics: Intrinsics = serde_json::from_str(text).unwrap();
            intrinsics.focals([64.0, 48.0])
        };
        let [right, half_right] = [std::f64::consts::FRAC_PI_2, 2.0 * 0.5_f64.atan()];
        for (text, expected) in [
            (r#"{"fl_x": 50, "camera_angle_x": 1}"#.to_owned(), [50.0, 50.0]),
            (r#"{"fl_y": 60}"#.into(), [60.0, 60.0]),
            (r#"{"x_fov": 90}"#.into(), [32.0, 32.0]),
            (r#"{"x_fov": 90, "y_fov": 90}"#.into(), [32.0, 24.0]),
            (format!(r#"{{"camera_angle_x": {half_right}, "camera_angle_y": {right}}}"#), [64.0, 24.0]),
        ] {
            let found = focals(&text).unwrap();
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{text}: {found:?}");
        }
        assert_eq!(focals("{}"), None);
        // A frame's angle counts before the focal length of the file.
        let [own, file] = [r#"{"x_fov": 90}"#, r#"{"fl_x": 9, "fl_y": 8}"#]
            .map(|text| serde_json::from_str::<Intrinsics>(text).unwrap());
        let (k, _) = own.resolve(&file, (64, 48)).unwrap();
        assert!((k[0] - 32.0).abs() < 1e-9 && k[0] == k[1], "{k:?}");
    }

    #[test]
    fn statements_are_read_refused_or_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        let read = |file: &str, frame: &str| {
            std::fs::write(&path, format!(r#"{{{file} "frames": [{FRAME}{frame}}}]}}"#)).unwrap();
            Transforms::read(&path)
        };
        for (file, frame, problem) in [
            (r#""latlong": true,"#, "", "json: latlong states"),
            (r#""from_na": true,"#, "", "json: from_na states"),
            (r#""from_mitsuba": true,"#, "", "json: from_mitsuba states"),
            (r#""rolling_shutter": [0, 0, 0.5],"#, "", "json: rolling_shutter states"),
            ("", r#", "ftheta_p0": 0.1"#, "frame a: ftheta_p0 states"),
            ("", r#", "fl_x": "wide""#, "frame a: "),
            (r#""up": [0, 0, 0],"#, "", "no direction"),
        ] {
            let error = read(file, frame).err().unwrap().to_string();
            assert!(error.contains(problem), "{file}{frame}: {error}");
        }
        let file = r#""latlong": false, "from_na": false, "rolling_shutter": [0, 0, 0], "aabb_scale": 4, "white_transparent": true,
            "black_transparent": false,"#;
        let found = read(file, r#", "sharpness": 31.5, "timestamp": 7"#).ok().unwrap();
        assert_eq!(found.unread_keys().into_iter().collect::<Vec<_>>(), ["timestamp", "white_transparent"]);
        // As Windows' editors write it.
        std::fs::write(&path, format!("\u{feff}{{\"frames\": [{FRAME}}}]}}")).unwrap();
        assert!(Transforms::read(&path).is_ok());
    }

    #[test]
    fn splits_of_nerfstudio_are_held() {
        let held_as = |name: &str, splits: &str| {
            let frame = FRAME.replace(r#""a""#, &format!(r#""{name}""#));
            let file = format!(r#"{{{splits}, "frames": [{frame}}}]}}"#);
            let transforms: Transforms = serde_json::from_str(&file).unwrap();
            transforms.is_held(&transforms.frames[0])
        };
        let held = |splits: &str| held_as("a", splits);
        assert!(
            held(r#""train_filenames": ["b"]"#)
                && !held(r#""train_filenames": ["a"], "val_filenames": ["a"]"#)
        );
        assert!(held(r#""val_filenames": ["a"]"#) && held(r#""test_filenames": ["a"]"#));
        assert!(!held(r#""test_filenames": ["b"]"#));
        assert!(
            held(r#""test_filenames": ["./a"]"#) && held(r#""val_filenames": [".\\a"]"#),
            "the same file"
        );
        assert!(held_as("./a", r#""test_filenames": ["a"]"#));
    }

    #[test]
    fn photographs_may_be_smaller_than_the_file_says() {
        let all = Intrinsics {
            fl_x: Some(100.0),
            cy: Some(50.0),
            w: Some(128.0),
            h: Some(96.0),
            ..Default::default()
        };
        let (k, _) = Intrinsics::default().resolve(&all, (64, 48)).unwrap();
        assert_eq!(k, [50.0, 50.0, 32.0, 25.0]);
        let turned = Intrinsics::default().resolve(&all, (96, 128)).unwrap_err();
        assert!(turned.contains("proportions"), "{turned}");
        let none = Intrinsics { w: Some(0.0), ..all };
        assert!(Intrinsics::default().resolve(&none, (64, 48)).unwrap_err().contains("pixels"));
    }

    #[test]
    fn times_become_seconds() {
        assert_eq!(frame_times_s(&[0.25, 0.375, 0.75]), [0.0, 0.25 * 2.0 / 30.0, 2.0 / 30.0]);
        assert_eq!(frame_times_s(&[0.7]), [0.0]);
        assert_eq!(
            frame_times_s(&[100.0, 101.0, 103.0]),
            [0.0, 1.0 / 3.0 * (2.0 / 30.0), 2.0 / 30.0],
            "any unit"
        );
        assert_eq!(frame_times_s(&[-f64::MAX, f64::MAX]), [0.0, 1.0 / 30.0]);
        assert!(frame_times_s(&[]).is_empty());
    }
}
