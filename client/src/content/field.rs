//! [`load_field`]: a field in the format of another program, as a clip of one layer.

use std::path::Path;

use codec::{Clip, Field};
use formats::{ImportLimits, ImportedScene, SceneFiles, has_field, is_field_file, is_package, list_folder};
use program::{Fault, counted};

use super::source_options::SourceOptions;

/// Whether a field is at a path: a folder with a field or several, or a file with the extension of a field
/// that is no package.
pub(super) fn is_field(path: &Path) -> bool {
    if path.is_dir() {
        return list_folder(path).is_ok_and(|names| has_field(path, &names));
    }
    let has_name = path.file_name().and_then(|name| name.to_str()).is_some_and(is_field_file);
    has_name && !is_package(path)
}

/// Reads a field file, or a folder with one field or a sequence, and what there is to say of it.
///
/// # Errors
/// [`Fault::Data`] with the path and the reason.
pub(super) fn load_field(path: &Path, options: &SourceOptions) -> Result<(Clip, Option<String>), Fault> {
    let fault = |error: formats::ImportError| Fault::Data(error.to_string());
    let mut files = SceneFiles::at(path).map_err(fault)?;
    files.up = options.up.map(|axis| axis.map(f32::from));
    let scene = files.read(ImportLimits::default()).map_err(fault)?;
    let ImportedScene { subject, plate, info, assumed: _ } = scene;
    let gaussians = subject.field.len() + plate.as_ref().map_or(0, |plate| plate.field.len());
    let most = options.limits.max_gaussians;
    if gaussians > most {
        let (path, has) = (path.display(), counted(gaussians, "Gaussian"));
        return Err(Fault::Data(format!(
            "{path}: {has}, and at most {most} are played: package it with aarc-studio package --budget"
        )));
    }
    let background = plate.iter().flat_map(|plate| plate.account.sentences());
    let sentences: Vec<String> = subject.account.sentences().into_iter().chain(background).collect();
    let note = (!sentences.is_empty()).then(|| format!("{}: {}", path.display(), sentences.join("; ")));
    let bounds = subject.field.bounds();
    let [static_field, dynamic_field] = regions(subject.field);
    let plate = plate.map(|plate| plate.field);
    Ok((Clip::of_one_layer(info, bounds, static_field, dynamic_field, plate), note))
}

/// The Gaussians that are always on and motionless, and the others.
fn regions(field: Field) -> [Field; 2] {
    let Some(temporal) = &field.temporal else { return [field, Field::default()] };
    let is_static = |&row: &usize| {
        let rates = temporal.rotation_rates.as_ref().map_or([0.0; 4], |rates| rates[row]);
        let is_motionless = temporal.motion_of(row).iter().flatten().all(|&x| x == 0.0);
        temporal.s[row].is_infinite() && is_motionless && rates == [0.0; 4]
    };
    let (fixed, others): (Vec<usize>, Vec<usize>) = (0..field.len()).partition(is_static);
    [Field { temporal: None, ..field.select(&fixed) }, field.select(&others)]
}

#[cfg(test)]
mod tests {
    use std::fs;

    use codec::Limits;

    use super::*;

    const NAMES: &str = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

    fn ply(more: &str, rows: &[&str]) -> String {
        let names = format!("{NAMES}{more}");
        let properties: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
        let (count, rows) = (rows.len(), rows.join("\n"));
        format!(
            "ply\nformat ascii 1.0\ncomment aarc field 1\nelement vertex {count}\n{properties}end_header\n{rows}\n"
        )
    }

    #[test]
    fn a_field_is_a_clip_of_one_layer_with_its_background() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let rows = ["1 2 3 0 0 0 0 -1 -1 -1 1 0 0 0 0.5 0.1", "0 0 0 0 0 0 0 -1 -1 -1 1 0 0 0 0 inf"];
        fs::write(&path, ply(" tau s", &rows)).unwrap();
        fs::write(folder.path().join("a.plate.ply"), ply("", &["0 0 9 0 0 0 0 -1 -1 -1 1 0 0 0"])).unwrap();
        fs::write(folder.path().join("scene.json"), r#"{"duration_s": 2.5}"#).unwrap();
        for (path, duration_s) in [(&path, 1.0), (&folder.path().to_owned(), 2.5)] {
            assert!(is_field(path));
            let (clip, note) = load_field(path, &SourceOptions::default()).unwrap();
            assert_eq!(clip.info.up, [0.0, -1.0, 0.0]);
            let upright = SourceOptions { up: Some([0, 1, 0]), ..SourceOptions::default() };
            assert_eq!(load_field(path, &upright).unwrap().0.info.up, [0.0, 1.0, 0.0]);
            assert_eq!((clip.static_field.len(), clip.dynamic_field.len(), note), (1, 1, None));
            assert_eq!((clip.layers.len(), clip.layers_announced.len()), (1, 1));
            assert_eq!(clip.plate.as_ref().map(Field::len), Some(1));
            assert_eq!((clip.info.duration_s, clip.info.viewpoints.len()), (duration_s, 1));
            assert!(clip.static_field.temporal.is_none());
        }
    }

    #[test]
    fn what_is_wrong_with_a_field_is_bad_data() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        fs::write(&path, ply("", &["0 0 0 0 0 0 0 -1 -1 -1 1 0 0 0"; 3])).unwrap();
        let limits = Limits { max_gaussians: 2, ..Limits::default() };
        let few = SourceOptions { limits, ..SourceOptions::default() };
        let fault = load_field(&path, &few).unwrap_err();
        assert!(fault.to_string().contains("3 Gaussians, and at most 2 are played"), "{fault}");
        fs::write(&path, "ply\nformat ascii 1.0\nend_header\n").unwrap();
        for path in [&path, &folder.path().join("none.ply")] {
            let fault = load_field(path, &SourceOptions::default()).unwrap_err();
            let name = path.display().to_string();
            assert!(fault.to_string().starts_with(&name) && fault.exit_code() == 3, "{fault}");
        }
        fs::write(&path, include_bytes!("../../../assets/demo.aarc")).unwrap();
        assert!(!is_field(&path), "a package with another name");
        assert!(!is_field(&folder.path().join("a.aarc")));
        let clips = tempfile::tempdir().unwrap();
        fs::write(clips.path().join("a.aarc"), "").unwrap();
        assert!(!is_field(clips.path()), "a folder without a field");
    }
}
