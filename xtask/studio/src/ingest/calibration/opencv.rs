//! OpenCV YAML with one camera in each file: `K` (or `camera_matrix`), `D` (or `distortion_coefficients`) and
//! `distortion_model`, `R` or `rvec`, and `T` or `tvec`, from the world to the camera.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use program::Fault;
use refine::capture::Lens;

use super::camera::{Calibration, RigCamera, opencv_camera, unread_warning};
use crate::capture::{Storage, bad, intrinsics, numbers, parse_storage, pixels, read_text, rodrigues};

/// Accepted names of each matrix.
const K: [&str; 3] = ["K", "camera_matrix", "cameraMatrix"];
const D: [&str; 6] = ["D", "distortion_coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "dist"];
const R: [&str; 3] = ["R", "rotation", "rvec"];
const T: [&str; 3] = ["T", "translation", "tvec"];
const MODEL: [&str; 4] = ["distortion_model", "lens_model", "camera_model", "model"];
const FISHEYE: [&str; 2] = ["fisheye", "fisheye_model"];
const SIZE: [[&str; 2]; 2] = [["image_width", "image_height"], ["width", "height"]];

/// Keys on which no camera depends: how a calibration was made, in OpenCV's tutorials and its program.
pub(super) const IGNORED: [&str; 15] = [
    "aspectRatio",
    "avg_reprojection_error",
    "board_height",
    "board_width",
    "calibration_time",
    "camera_name",
    "extrinsic_parameters",
    "fix_aspect_ratio",
    "flags",
    "grid_points",
    "image_points",
    "nframes",
    "nr_of_frames",
    "per_view_reprojection_errors",
    "square_size",
];

/// Whether a file is of this layout.
pub(super) fn is_camera(path: &Path) -> bool {
    let extension = path.extension().and_then(|x| x.to_str()).unwrap_or_default().to_lowercase();
    let is_yaml = ["yml", "yaml"].contains(&extension.as_str()) && path.is_file();
    // Comments in another encoding are said when it is read.
    is_yaml
        && std::fs::read(path)
            .is_ok_and(|bytes| value(&parse_storage(&String::from_utf8_lossy(&bytes)), &K).is_some())
}

/// Reads one camera of each file. The keys that are not read go to `warnings`.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem.
pub(super) fn read_each(
    path: &Path,
    files: &[PathBuf],
    warnings: &mut Vec<String>,
) -> Result<Calibration, Fault> {
    let mut unread = BTreeSet::new();
    let cameras = files.iter().map(|file| camera(file, &mut unread)).collect::<Result<_, _>>()?;
    warnings.extend(unread_warning(path, &unread));
    Ok(Calibration { path: path.to_owned(), layout: "OpenCV YAML", cameras, ..Calibration::default() })
}

fn value<'s>(storage: &'s Storage, names: &[&str]) -> Option<&'s String> {
    names.iter().find_map(|name| storage.get(*name))
}

/// The keys that are not read though the camera may depend on them: unknown ones, and the second name of a value.
fn unread(storage: &Storage) -> impl Iterator<Item = &String> {
    let names: [&[&str]; 6] = [&K, &D, &R, &T, &MODEL, &FISHEYE];
    let first = |names: &[&'static str]| names.iter().copied().find(|name| storage.contains_key(*name));
    let read: Vec<&str> = names.into_iter().filter_map(first).chain(SIZE.concat()).chain(IGNORED).collect();
    storage.keys().filter(move |key| !read.contains(&key.as_str()))
}

fn camera(path: &Path, unread: &mut BTreeSet<String>) -> Result<RigCamera, Fault> {
    let storage = parse_storage(&read_text(path)?);
    unread.extend(self::unread(&storage).cloned());
    let wrong = |problem: String| bad(path, format!("{problem}; export the calibration again"));
    let matrix = |names: &[&str], counts: &[usize]| {
        let data = value(&storage, names).and_then(|value| numbers(value));
        let data = data.filter(|data| counts.contains(&data.len()));
        data.ok_or_else(|| wrong(format!("{} is missing or malformed", names[0])))
    };
    let k = intrinsics(&matrix(&K, &[9])?).map_err(wrong)?;
    if value(&storage, &R).or(value(&storage, &T)).is_none() {
        let what = "it has intrinsics alone, and R and T are needed, which place the camera in the world; calibrate the \
                    cameras to each other";
        return Err(bad(path, what));
    }
    let rotation = matrix(&R, &[3, 9])?;
    let rotation = match rotation.len() {
        9 => [0, 3, 6].map(|row| [rotation[row], rotation[row + 1], rotation[row + 2]]),
        _ => rodrigues(&rotation),
    };
    let t = matrix(&T, &[3])?;
    let d = match value(&storage, &D) {
        Some(value) => numbers(value).ok_or_else(|| wrong(format!("{} is malformed", D[0])))?,
        None => Vec::new(),
    };
    let side = |name: &str| {
        let malformed = || wrong(format!("{name} is no number of pixels"));
        storage.get(name).map(|value| pixels(value).ok_or_else(malformed)).transpose()
    };
    let mut size = None;
    for [width, height] in SIZE {
        size = size.or(side(width)?.zip(side(height)?));
    }
    let lens = match is_fisheye(&storage).map_err(wrong)? {
        true => Lens::fisheye(&d),
        false => Lens::rational(&d),
    };
    let camera = opencv_camera(size.unwrap_or_default(), k, rotation, [t[0], t[1], t[2]]);
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(RigCamera { name, camera, lens: lens.map_err(wrong)? })
}

/// Whether a file says that its coefficients are of a fisheye lens.
///
/// # Errors
/// A sentence if it names a model that is neither of OpenCV's two.
fn is_fisheye(storage: &Storage) -> Result<bool, String> {
    if storage.contains_key("xi") {
        return Err(
            "xi: an omnidirectional lens is not supported; calibrate with OpenCV's fisheye model".into()
        );
    }
    let word = |value: &String| value.trim().trim_matches(['"', '\'']).to_lowercase();
    let flag = value(storage, &FISHEYE).map(word).is_some_and(|flag| ["1", "true", "yes"].contains(&&*flag));
    let Some(model) = value(storage, &MODEL).map(word) else { return Ok(flag) };
    match &*model {
        "fisheye" | "equidistant" | "kannala_brandt" | "opencv_fisheye" => Ok(true),
        ""
        | "none"
        | "pinhole"
        | "plumb_bob"
        | "radtan"
        | "brown_conrady"
        | "rational"
        | "rational_polynomial"
        | "opencv"
        | "standard" => Ok(flag),
        _ => Err(format!("the lens model {model} is not supported; OpenCV's rational and fisheye are")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_a_camera() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("left.yml");
        let text = "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
                    dt: d\n   data: [ 50., 0., 31.5, 0., 51., 23.5, 0., 0., 1. ]\nrvec: !!opencv-matrix\n   data: [ 0., 0., 0. ]\n\
                    tvec: !!opencv-matrix\n   data: [ 1., 2., 3. ]\n";
        std::fs::write(&path, text).unwrap();
        assert!(is_camera(&path));
        let RigCamera { name, camera, lens } = camera(&path, &mut BTreeSet::new()).unwrap();
        assert_eq!((name.as_str(), camera.width, camera.k[0][2], camera.k[1][2]), ("left", 64, 32.0, 24.0));
        assert_eq!(camera.camera_from_world[0], [1.0, 0.0, 0.0, 1.0]);
        assert!(lens.is_none());
        let read = |more: &str| {
            std::fs::write(&path, format!("{text}{more}\n")).unwrap();
            super::camera(&path, &mut BTreeSet::new())
                .map(|camera| camera.lens)
                .map_err(|fault| fault.to_string())
        };
        let [d, bracketed] = ["D: !!opencv-matrix\n   data: [ -0.1, 0.02 ]", "dist: [-0.1, 0.02]"];
        let (rational, fisheye) = (Lens::rational(&[-0.1, 0.02]), Lens::fisheye(&[-0.1, 0.02]));
        for d in [d, bracketed] {
            assert_eq!(read(d), rational);
            assert_eq!(read(&format!("{d}\ndistortion_model: plumb_bob")), rational);
            assert_eq!(read(&format!("{d}\ndistortion_model: \"equidistant\"")), fisheye);
            assert_eq!(read(&format!("{d}\nfisheye_model: 1")), fisheye);
            for model in ["camera_model", "model"] {
                assert_eq!(read(&format!("{d}\n{model}: fisheye")), fisheye);
            }
        }
        for name in D {
            assert_eq!(read(&format!("{name}: [-0.1, 0.02]")), rational, "{name}");
        }
        for (more, unread) in [
            ("distortion: [-0.1]\nk1: 3", Some("distortion, k1")),
            ("D: [-0.1]\ndist: [0.2]", Some("dist")),
            ("flags: 2\nsquare_size: 1.5", None),
        ] {
            std::fs::write(&path, format!("{text}{more}\n")).unwrap();
            let mut warnings = Vec::new();
            read_each(folder.path(), &[path.clone(), path.clone()], &mut warnings).unwrap();
            let said = format!("{} states what is not read: ", folder.path().display());
            assert_eq!(warnings, Vec::from_iter(unread.map(|keys| said + keys)), "{more}");
        }
        for (more, problem) in [
            ("D: !!opencv-matrix\n   data: [ -0.1, 0.o2 ]", "D is malformed"),
            ("D: [ -0.1", "D is malformed"),
            ("D: none", "D is malformed"),
            ("distortion_model: fov", "the lens model fov is not supported"),
            ("xi: 1.2", "an omnidirectional lens"),
            ("image_height: x", "image_height is no number of pixels"),
            ("tvec: [1, 2]", "T is missing or malformed"),
            ("K: [50, 0.5, 31.5, 0, 51, 23.5, 0, 0, 1]", "K has a skew of 0.5"),
        ] {
            let error = read(more).unwrap_err();
            assert!(error.contains(problem) && !error.contains('\n'), "{more}: {error}");
        }
        let [intrinsics, _] = text.split_once("rvec").map(<[&str; 2]>::from).unwrap();
        std::fs::write(&path, intrinsics).unwrap();
        let error = super::camera(&path, &mut BTreeSet::new()).unwrap_err().to_string();
        assert!(error.contains("left.yml: it has intrinsics alone, and R and T are needed"), "{error}");
    }
}
