//! OpenCV YAML with one camera in each file: `K` (or `camera_matrix`), `D` (or `distortion_coefficients`), `R` or `rvec`, and
//! `T` or `tvec`, from the world to the camera.

use std::path::{Path, PathBuf};

use glam::DMat3;
use program::Fault;
use refine::capture::Lens;

use super::camera::{Calibration, RigCamera, opencv_camera};
use crate::capture::{Storage, bad, numbers, parse_storage, read_text, rodrigues};

/// Accepted names of each matrix.
const K: [&str; 3] = ["K", "camera_matrix", "cameraMatrix"];
const D: [&str; 4] = ["D", "distortion_coefficients", "distCoeffs", "dist"];
const R: [&str; 3] = ["R", "rotation", "rvec"];
const T: [&str; 3] = ["T", "translation", "tvec"];
const SIZE: [[&str; 2]; 2] = [["image_width", "image_height"], ["width", "height"]];

/// Whether a file is of this layout.
pub(super) fn is_camera(path: &Path) -> bool {
    let extension = path.extension().and_then(|x| x.to_str()).unwrap_or_default().to_lowercase();
    let is_yaml = ["yml", "yaml"].contains(&extension.as_str()) && path.is_file();
    is_yaml && read_text(path).is_ok_and(|text| value(&parse_storage(&text), &K).is_some())
}

/// Reads one camera of each file.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem.
pub(super) fn read_each(path: &Path, files: &[PathBuf]) -> Result<Calibration, Fault> {
    let cameras = files.iter().map(|file| camera(file)).collect::<Result<_, _>>()?;
    Ok(Calibration { path: path.to_owned(), layout: "OpenCV YAML", cameras, up: None, metres_per_unit: None })
}

fn value<'s>(storage: &'s Storage, names: &[&str]) -> Option<&'s String> {
    names.iter().find_map(|name| storage.get(*name))
}

fn camera(path: &Path) -> Result<RigCamera, Fault> {
    let storage = parse_storage(&read_text(path)?);
    let wrong = |problem: String| bad(path, format!("{problem}; export the calibration again"));
    let matrix = |names: &[&str], counts: &[usize]| {
        let data = value(&storage, names).map(|value| numbers(value)).unwrap_or_default();
        match counts.contains(&data.len()) {
            true => Ok(data),
            false => Err(wrong(format!("{} is missing or malformed", names[0]))),
        }
    };
    let k = matrix(&K, &[9])?;
    let rotation = matrix(&R, &[3, 9])?;
    let rotation = match rotation.len() {
        9 => [0, 3, 6].map(|row| [rotation[row], rotation[row + 1], rotation[row + 2]]),
        _ => rodrigues(&rotation),
    };
    let t = matrix(&T, &[3])?;
    let d = value(&storage, &D).map(|value| numbers(value)).unwrap_or_default();
    let side = |name: &str| storage.get(name).and_then(|value| numbers(value).first().copied());
    let size = SIZE.iter().find_map(|[width, height]| Some((side(width)? as u32, side(height)? as u32)));
    let camera = opencv_camera(
        size.unwrap_or_default(),
        [k[0], k[4], k[2], k[5]],
        DMat3::from_cols_array_2d(&rotation).transpose(),
        [t[0], t[1], t[2]],
    );
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(RigCamera { name, camera, lens: Lens::rational(&d).map_err(wrong)? })
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
        let RigCamera { name, camera, lens } = camera(&path).unwrap();
        assert_eq!((name.as_str(), camera.width, camera.k[0][2], camera.k[1][2]), ("left", 64, 32.0, 24.0));
        assert_eq!(camera.camera_from_world[0], [1.0, 0.0, 0.0, 1.0]);
        assert!(lens.is_none());
        std::fs::write(&path, text.replace("tvec", "other")).unwrap();
        assert!(super::camera(&path).unwrap_err().to_string().contains("T is missing"));
    }
}
