//! Captures in the layout of nerfstudio and Blender's NeRF scenes: `transforms.json`, or
//! `transforms_train.json` with `transforms_test.json` for held cameras.
//!
//! Each of its frames has a camera of its own, and a `time` if the scene is dynamic. Poses are camera to
//! world in OpenGL's axes: x right, y up, z backwards.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec4};
use program::Fault;
use refine::capture::{CalibratedCamera, Lens};
use serde::Deserialize;

use super::capture_files::{CaptureBuilder, CaptureFiles, calibrated, pinhole};
use super::image_file::{bad, bad_layout, find_image_in, read_text, size_of};
use super::photo_paths::PhotoPath;
use crate::scene::DEFAULT_FPS;

/// A file of transforms, and whether its cameras are held out.
type TransformsFile = (PathBuf, bool);

/// Intrinsics of all frames or of one.
#[derive(Clone, Default, Deserialize)]
struct Intrinsics {
    camera_model: Option<String>,
    camera_angle_x: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
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
    /// Image size in pixels that the other values refer to; by default the photograph's.
    w: Option<f64>,
    h: Option<f64>,
}

#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    intrinsics: Intrinsics,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    mask_path: Option<String>,
    time: Option<f64>,
    transform_matrix: [[f64; 4]; 4],
    #[serde(flatten)]
    intrinsics: Intrinsics,
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

/// The cameras of a file, named as its pictures without their extensions.
///
/// # Errors
/// [`Fault::Data`] that names the file.
pub(super) fn cameras(path: &Path) -> Result<Vec<CalibratedCamera>, Fault> {
    let transforms: Transforms =
        serde_json::from_str(&read_text(path)?).map_err(|error| bad_layout(path, error))?;
    let camera = |frame: &Frame| {
        let name = Path::new(&frame.file_path).with_extension("").to_string_lossy().into_owned();
        let at = |problem: String| bad_layout(path, format!("{name}: {problem}"));
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
    // Of the photographs, in the order of the files.
    let mut photo_times = Vec::new();
    for (path, held) in files {
        let transforms: Transforms =
            serde_json::from_str(&read_text(path)?).map_err(|error| bad_layout(path, error))?;
        for frame in transforms.frames {
            let name = frame.file_path.trim_start_matches("./").to_owned();
            let Some(image) = find_image_in(folder, &name) else {
                return Err(bad(&folder.join(&name), "this photograph is missing; put it there").into());
            };
            let size = size_of(&folder.join(&image))?;
            let (pinhole_k, lens) = frame
                .intrinsics
                .resolve(&transforms.intrinsics, size)
                .map_err(|problem| bad_layout(path, format!("{name}: {problem}")))?;
            let camera = pinhole(size, pinhole_k, camera_from_world(frame.transform_matrix));
            let time = frame.time.unwrap_or(0.0);
            if !(0.0..=1.0).contains(&time) {
                return Err(bad_layout(path, format!("{name}: time {time} is not within 0 to 1")).into());
            }
            let name = Path::new(&name).with_extension("");
            let name = name.to_string_lossy();
            let index = builder.camera(&name, camera, lens, *held);
            let mask = frame.mask_path.as_deref();
            builder.photo(index, photo_times.len(), PhotoPath { image: &image, name: &name, mask })?;
            photo_times.push(time);
        }
    }
    let mut times = photo_times.clone();
    times.sort_by(f64::total_cmp);
    times.dedup();
    builder.renumber(|photo| times.partition_point(|time| *time < photo_times[photo]));
    Ok(builder.build(frame_times_s(&times), None))
}

/// Scales ascending times of frames, in any unit, to seconds since the first, at [`DEFAULT_FPS`] on average.
/// D-NeRF's files have i / N.
fn frame_times_s(times: &[f64]) -> Vec<f64> {
    match times {
        [first, .., last] => {
            let duration_s = (times.len() - 1) as f64 / f64::from(DEFAULT_FPS);
            times.iter().map(|t| (t - first) / (last - first) * duration_s).collect()
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
        let from_angle = |angle: f64| 0.5 * w / (0.5 * angle).tan();
        let fx = pick(|i| i.fl_x).or(pick(|i| i.camera_angle_x).map(from_angle));
        let fx = fx.ok_or("neither fl_x nor camera_angle_x is given")?;
        let fy = pick(|i| i.fl_y).unwrap_or(fx);
        let cx = pick(|i| i.cx).unwrap_or(0.5 * w);
        let cy = pick(|i| i.cy).unwrap_or(0.5 * h);
        let [x, y] = [actual_w / w, actual_h / h];
        // Shrinking rounds sides to whole pixels.
        if (x / y - 1.0).abs() > 2.0 / actual_w.min(actual_h) {
            return Err(format!(
                "w and h are {w} and {h}, the photograph is {width}x{height}: not its proportions"
            ));
        }
        Ok(([fx * x, fy * y, cx * x, cy * y], self.lens(file)?))
    }

    fn lens(&self, file: &Intrinsics) -> Result<Lens, String> {
        let coefficient = |key: fn(&Intrinsics) -> Option<f64>| key(self).or(key(file)).unwrap_or(0.0);
        let [k1, k2, k3, k4, k5, k6] = [
            coefficient(|i| i.k1),
            coefficient(|i| i.k2),
            coefficient(|i| i.k3),
            coefficient(|i| i.k4),
            coefficient(|i| i.k5),
            coefficient(|i| i.k6),
        ];
        let [p1, p2] = [coefficient(|i| i.p1), coefficient(|i| i.p2)];
        let model = self.camera_model.as_deref().or(file.camera_model.as_deref()).unwrap_or("OPENCV");
        // nerfstudio's k4 of OPENCV belongs to the eighth power of the radius, unlike OpenCV's.
        let (lens, own, others): (_, _, &[f64]) = match model {
            "OPENCV" | "PINHOLE" => {
                (Lens::rational(&[k1, k2, p1, p2, k3]), "k1, k2, k3, p1, p2", &[k4, k5, k6])
            }
            "FULL_OPENCV" => (Lens::rational(&[k1, k2, p1, p2, k3, k4, k5, k6]), "k1 to k6, p1, p2", &[]),
            "OPENCV_FISHEYE" => (Lens::fisheye(&[k1, k2, k3, k4]), "k1 to k4", &[k5, k6, p1, p2]),
            _ => {
                return Err(format!(
                    "camera model {model} is not supported: OPENCV, PINHOLE, FULL_OPENCV and OPENCV_FISHEYE are"
                ));
            }
        };
        if others.iter().any(|k| *k != 0.0) {
            return Err(format!("camera model {model} has {own}, but another coefficient is not 0"));
        }
        lens
    }
}

/// Inverts a pose and converts it to OpenCV's axes.
fn camera_from_world(world_from_gl: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
    let world_from_gl = DMat4::from_cols_array_2d(&world_from_gl).transpose();
    let gl_from_camera = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
    let mut rows = (world_from_gl * gl_from_camera).inverse().transpose().to_cols_array_2d();
    // The inverse rounds; this row is exact.
    rows[3] = [0.0, 0.0, 0.0, 1.0];
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

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
        // A frame's model overrides the file's.
        let [own, file] = ["OPENCV_FISHEYE", "OPENCV"]
            .map(|model| Intrinsics { camera_model: Some(model.into()), ..Intrinsics::default() });
        assert_eq!(own.lens(&file), Lens::fisheye(&[]));
        for (refused, problem) in [
            (format!(r#"{{"camera_model": "OPENCV", {four}"#), "another coefficient is not 0"),
            (format!("{{{four}"), "another coefficient is not 0"),
            (format!(r#"{{"camera_model": "OPENCV_FISHEYE", {eight}"#), "another coefficient is not 0"),
            (format!(r#"{{"camera_model": "FISHEYE624", {four}"#), "FISHEYE624 is not supported"),
        ] {
            let error = lens(&refused).unwrap_err();
            assert!(error.contains(problem), "{refused}: {error}");
        }
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
        assert!(frame_times_s(&[]).is_empty());
    }
}
