//! Reads the calibration of a rig: Pose2Sim's, Caliscope's and aniposelib's TOML, Qualisys, OpenCV YAML, COLMAP, nerfstudio.
//!
//! OpenCV counts pixel centres from 0, [`codec::Camera`] from 0.5: files in OpenCV's convention gain half a pixel.

mod camera;
mod opencv;
mod qualisys;
mod toml;

use std::path::{Path, PathBuf};

use program::Fault;

use crate::capture::{bad, calibrated_cameras, lfs_pointer};
use crate::messages::unreadable;
pub(super) use camera::{Calibration, RigCamera};

/// Reads the calibration at `stated`, or else those in `folder`: at least one. Where others can be read, those that are
/// malformed are named in `warnings`, and so are keys that are not read.
///
/// # Errors
/// [`Fault::Data`] if there is none or it is malformed.
pub(super) fn read(
    folder: &Path,
    stated: Option<&Path>,
    warnings: &mut Vec<String>,
) -> Result<Vec<Calibration>, Fault> {
    if let Some(path) = stated {
        std::fs::metadata(path).map_err(|error| unreadable(path, &error))?;
        return Ok(vec![read_one(path, warnings)?]);
    }
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        entries.push(entry.map_err(|error| unreadable(folder, &error))?.path());
    }
    entries.sort();
    let is_model = |path: &PathBuf| path.is_dir() && path.ends_with("sparse");
    let found = entries.iter().filter(|path| is_calibration(path) || is_model(path));
    // One YAML file for each camera is one calibration.
    let (mut each, others): (Vec<PathBuf>, Vec<PathBuf>) =
        found.cloned().partition(|path| opencv::is_camera(path));
    let one = if each.len() == 1 { each.pop() } else { None };
    let model = |path: PathBuf| if is_model(&path) { folder.to_owned() } else { path };
    let mut read: Vec<Result<Calibration, Fault>> =
        others.into_iter().chain(one).map(|path| read_one(&model(path), warnings)).collect();
    if !each.is_empty() {
        read.push(opencv::read_each(folder, &each, warnings));
    }
    let (calibrations, faults): (Vec<_>, Vec<_>) = read.into_iter().partition(Result::is_ok);
    let calibrations: Vec<Calibration> = calibrations.into_iter().flatten().collect();
    let mut faults = faults.into_iter().filter_map(Result::err);
    if calibrations.is_empty() {
        let none =
            || bad(folder, "there is no calibration in it; put one there, or name it with --calibration");
        return Err(faults.next().unwrap_or_else(none));
    }
    warnings.extend(faults.map(|fault| format!("not read: {fault}")));
    Ok(calibrations)
}

/// Whether a file of a rig's folder looks like a calibration, by name and content.
fn is_calibration(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if !path.is_file() {
        return false;
    }
    // In any encoding: reading it says which one it needs.
    let has =
        |text: &str| std::fs::read(path).is_ok_and(|bytes| String::from_utf8_lossy(&bytes).contains(text));
    match name.rsplit('.').next().unwrap_or_default() {
        "toml" | "txt" | "yml" | "yaml" if lfs_pointer(path).is_some() => true,
        "toml" => has("matrix") && has("rotation"),
        "txt" => name == "cameras.txt" || has("<calibration"),
        "yml" | "yaml" => name == "intri.yml" || opencv::is_camera(path),
        "json" => name == "transforms.json",
        "bin" => name == "cameras.bin",
        _ => false,
    }
}

fn read_one(path: &Path, warnings: &mut Vec<String>) -> Result<Calibration, Fault> {
    lfs_pointer(path).map_or(Ok(()), Err)?;
    let extension = path.extension().and_then(|x| x.to_str()).unwrap_or_default().to_lowercase();
    if path.is_file() && extension == "toml" {
        return toml::read(path, warnings);
    }
    if path.is_file() && extension == "txt" && !path.ends_with("cameras.txt") {
        return qualisys::read(path);
    }
    if opencv::is_camera(path) {
        return opencv::read_each(path, &[path.to_owned()], warnings);
    }
    let known =
        "Pose2Sim, Caliscope and aniposelib TOML, Qualisys .qca.txt, OpenCV YAML, COLMAP and nerfstudio";
    let (layout, cameras) = calibrated_cameras(path, warnings)?
        .ok_or_else(|| bad(path, format!("no calibration in a known layout: {known} are known")))?;
    let rig_camera = |camera: refine::capture::CalibratedCamera| RigCamera {
        name: camera.name,
        camera: camera.camera,
        lens: camera.lens,
    };
    let cameras = cameras.into_iter().map(rig_camera).collect();
    Ok(Calibration { path: path.to_owned(), layout, cameras, ..Calibration::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calibration_that_cannot_be_read_says_why() {
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n";
        for (name, content, problem) in [
            ("a.toml", &b"# Andr\xe9\n[a]\nmatrix = 1\nrotation = 2\n"[..], "not in UTF-8; save it as UTF-8"),
            ("a.qca.txt", b"<!-- Andr\xe9 --><calibration>", "not in UTF-8; save it as UTF-8"),
            ("a.yml", b"# Andr\xe9\nK: [1]\n", "not in UTF-8; save it as UTF-8"),
            ("a.toml", pointer, "a pointer of Git LFS"),
            ("a.qca.txt", pointer, "a pointer of Git LFS"),
            ("a.yaml", pointer, "a pointer of Git LFS"),
        ] {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join(name), content).unwrap();
            let error = read(folder.path(), None, &mut Vec::new()).unwrap_err().to_string();
            assert!(error.contains(&format!("{name}: ")) && error.contains(problem), "{name}: {error}");
        }
    }

    #[test]
    fn the_document_lists_the_keys_that_are_ignored() {
        let text = include_str!("../../../../CAPTURE.md");
        for (layout, ignored) in [("OpenCV YAML", &opencv::IGNORED[..]), ("Pose2Sim", &toml::IGNORED[..])] {
            let row =
                text.lines().find(|line| line.starts_with(&format!("| {layout}, of each camera"))).unwrap();
            let last = row.trim_matches(['|', ' ']).rsplit('|').next().unwrap();
            assert_eq!(last.split('`').skip(1).step_by(2).collect::<Vec<_>>(), ignored, "{layout}");
        }
    }
}
