//! TOML as Pose2Sim, Caliscope and aniposelib write it: a table for each camera, in OpenCV's convention. Caliscope's tables
//! are in a table of their own, `cameras`.
//!
//! `rotation` is a Rodrigues vector, or a matrix, and with `translation` leads from the world to the camera. The unit is
//! not stated: Pose2Sim and Caliscope use metres, aniposelib the unit of its board.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use program::Fault;
use refine::capture::Lens;
use serde::Deserialize;

use super::camera::{Calibration, RigCamera, opencv_camera, unread_warning};
use crate::capture::{bad, intrinsics, is_stated, read_text, rodrigues};

#[derive(Deserialize)]
struct Table {
    name: Option<String>,
    size: Option<Vec<f64>>,
    resolution: Option<Vec<f64>>,
    matrix: Vec<Vec<f64>>,
    #[serde(default)]
    distortions: Vec<f64>,
    rotation: Rotation,
    translation: Vec<f64>,
    #[serde(default)]
    fisheye: bool,
    #[serde(flatten)]
    others: BTreeMap<String, serde_json::Value>,
}

/// Keys on which no camera depends: its number, and how well it was calibrated.
pub(super) const IGNORED: [&str; 5] = ["cam_id", "error", "exposure", "grid_count", "port"];

#[derive(Deserialize)]
#[serde(untagged)]
enum Rotation {
    Vector(Vec<f64>),
    Matrix(Vec<Vec<f64>>),
}

/// Reads the cameras of a file. The keys of their tables that are not read go to `warnings`.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem.
pub(super) fn read(path: &Path, warnings: &mut Vec<String>) -> Result<Calibration, Fault> {
    let wrong = |problem: String| bad(path, format!("{problem}; export the calibration again"));
    let file: toml::Table = read_text(path)?.parse().map_err(|error: toml::de::Error| {
        wrong(error.message().lines().next().unwrap_or("not TOML").to_owned())
    })?;
    let mut tables: Vec<(String, toml::Value)> = Vec::new();
    for (key, value) in file {
        match value {
            toml::Value::Table(inner) if key == "cameras" => tables.extend(inner),
            value => tables.push((key, value)),
        }
    }
    let (mut cameras, mut unread) = (Vec::new(), BTreeSet::new());
    for (key, value) in tables {
        // Others hold settings and metadata.
        if value.get("matrix").is_none() {
            continue;
        }
        if value.get("rotation").is_none() {
            let what = "has no rotation, so its place is not known, and it is left out";
            warnings.push(format!("{}: [{key}] {what}", path.display()));
            continue;
        }
        let table: Table = value
            .try_into()
            .map_err(|error: toml::de::Error| wrong(format!("[{key}]: {}", error.message())))?;
        let others =
            table.others.iter().filter(|(key, value)| !IGNORED.contains(&key.as_str()) && is_stated(value));
        unread.extend(others.map(|(key, _)| key.clone()));
        cameras.push(camera(&key, table).map_err(|problem| wrong(format!("[{key}]: {problem}")))?);
    }
    warnings.extend(unread_warning(path, &unread));
    match cameras.is_empty() {
        true => Err(bad(path, "it has no camera with matrix and rotation; name another calibration")),
        false => Ok(Calibration {
            path: path.to_owned(),
            layout: "TOML of Pose2Sim, Caliscope and aniposelib",
            cameras,
            ..Calibration::default()
        }),
    }
}

fn camera(key: &str, table: Table) -> Result<RigCamera, String> {
    let size = match table.size.as_deref().or(table.resolution.as_deref()) {
        Some(&[width, height]) if width >= 1.0 && height >= 1.0 => (width as u32, height as u32),
        Some(size) => return Err(format!("the size {size:?} is no width and height")),
        None => (0, 0),
    };
    let rows = three(&table.matrix).ok_or("matrix has not 3 rows of 3")?;
    let rotation = match &table.rotation {
        Rotation::Vector(vector) => {
            let vector = <[f64; 3]>::try_from(vector.as_slice()).map_err(|_| "rotation has not 3 numbers")?;
            rodrigues(&vector)
        }
        Rotation::Matrix(matrix) => three(matrix).ok_or("rotation has not 3 rows of 3")?,
    };
    let translation =
        <[f64; 3]>::try_from(table.translation.as_slice()).map_err(|_| "translation has not 3 numbers")?;
    let lens = match table.fisheye {
        true => Lens::fisheye(&table.distortions),
        false => Lens::rational(&table.distortions),
    };
    let k = intrinsics(rows.as_flattened())?;
    let name = table.name.unwrap_or_else(|| key.to_owned());
    Ok(RigCamera { name, camera: opencv_camera(size, k, rotation, translation), lens: lens? })
}

/// A matrix of 3 rows of 3 numbers.
fn three(rows: &[Vec<f64>]) -> Option<[[f64; 3]; 3]> {
    let [a, b, c] = rows else { return None };
    let row = |row: &Vec<f64>| <[f64; 3]>::try_from(row.as_slice()).ok();
    Some([row(a)?, row(b)?, row(c)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: &str = "[cam_01]\nname = \"a\"\nsize = [ 64.0, 48.0]\nmatrix = [ [ 50.0, 0.0, 31.5], [ 0.0, 51.0, 23.5], \
                          [ 0.0, 0.0, 1.0]]\ndistortions = [ -0.1, 0.02, 0.0, 0.0]\nrotation = [ 0.0, 0.0, 1.5707963267948966]\n\
                          translation = [ 1.0, 2.0, 3.0]\nfisheye = false\n[metadata]\nerror = 0.0\n";

    fn read_text(text: &str) -> Result<Calibration, Fault> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path(), &mut Vec::new())
    }

    #[test]
    fn a_table_is_a_camera() {
        let calibration = read_text(CAMERA).unwrap();
        let RigCamera { name, camera, lens } = &calibration.cameras[0];
        assert_eq!((name.as_str(), camera.width, camera.height), ("a", 64, 48));
        assert_eq!([camera.k[0], camera.k[1]], [[50.0, 0.0, 32.0], [0.0, 51.0, 24.0]]);
        assert_eq!(*lens, Lens::rational(&[-0.1, 0.02]).unwrap());
        let expected = [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]];
        for (x, y) in camera.camera_from_world.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((x - y).abs() < 1e-12, "{camera:?}");
        }
        let fisheye = read_text(&CAMERA.replace("= false", "= true")).unwrap();
        assert_eq!(fisheye.cameras[0].lens, Lens::fisheye(&[-0.1, 0.02]).unwrap());
    }

    #[test]
    fn tables_may_be_in_a_table_of_cameras() {
        let caliscope = "[cameras]\n\n".to_owned()
            + &CAMERA.replace("[cam_01]\nname = \"a\"", "[cameras.3]\ncam_id = 3\nrotation_count = 0");
        let (found, expected) = (read_text(&caliscope).unwrap(), read_text(CAMERA).unwrap());
        assert_eq!((found.cameras.len(), found.cameras[0].name.as_str()), (1, "3"));
        assert_eq!(found.cameras[0].camera, expected.cameras[0].camera);
    }

    /// Caliscope's cameras have none before they are calibrated to each other.
    #[test]
    fn a_camera_without_a_pose_is_said() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let alone = "[cam_02]\nmatrix = [[50, 0, 31], [0, 50, 23], [0, 0, 1]]\n".to_owned() + CAMERA;
        std::fs::write(file.path(), alone).unwrap();
        let mut warnings = Vec::new();
        assert_eq!(read(file.path(), &mut warnings).unwrap().cameras.len(), 1);
        assert!(warnings.len() == 1 && warnings[0].contains("[cam_02] has no rotation"), "{warnings:?}");
    }

    #[test]
    fn keys_that_are_not_read_are_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for (key, unread) in [
            ("distortion", Some("distortion")),
            ("cam_id = 3\nrotation_count = 0\nignore = false\ndistortions", None),
            ("rotation_count = 1\ndistortions", Some("rotation_count")),
        ] {
            std::fs::write(file.path(), CAMERA.replace("distortions", key)).unwrap();
            let mut warnings = Vec::new();
            read(file.path(), &mut warnings).unwrap();
            let said = format!("{} states what is not read: ", file.path().display());
            assert_eq!(warnings, Vec::from_iter(unread.map(|key| said + key)), "{key}");
        }
    }

    #[test]
    fn malformed_tables_are_named() {
        for (from, to, problem) in [
            ("[ 1.0, 2.0, 3.0]", "[1.0]", "[cam_01]: translation has not 3 numbers"),
            ("[ 64.0, 48.0]", "[0.0, 48.0]", "is no width and height"),
            ("[cam_01]", "[cam_01", "export the calibration again"),
            ("matrix", "matrices", "it has no camera"),
            ("-0.1", "\"x\"", "[cam_01]"),
            ("[ 50.0, 0.0,", "[ 50.0, 0.5,", "[cam_01]: K has a skew of 0.5"),
        ] {
            let error = read_text(&CAMERA.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(problem) && !error.contains('\n'), "{error}");
        }
    }
}
