//! Reads captures from disk. Each supported layout has a file here; `xtask/CAPTURE.md` specifies them.

mod camera_part;
mod camera_plate;
mod capture_files;
mod colmap;
mod color_profile;
mod corrections;
mod depth;
mod easyvolcap;
mod fitted;
mod image_file;
mod listed_paths;
mod manifest;
mod origin;
mod part;
mod photo_paths;
mod plates;
mod temporal_median;
mod transforms;
mod unread;
mod video;

use std::path::Path;

use anyhow::bail;
use program::Fault;
use refine::capture::CalibratedCamera;

pub use camera_part::CameraPart;
pub use capture_files::{CaptureFiles, CaptureSound};
pub(crate) use capture_files::{intrinsics, pinhole, rigid};
pub use corrections::{CameraCorrection, CameraCorrections};
#[cfg(feature = "onnx")]
pub use depth::pfm_file;
pub(crate) use easyvolcap::{Storage, numbers, parse as parse_storage, pixels, rodrigues};
pub(crate) use image_file::{bad, bad_layout, lfs_pointer, read as read_file_image, read_text};
pub use image_file::{find_image, read_picture};
pub(crate) use manifest::{check_fps, check_length};
pub use plates::BackgroundSource;
pub(crate) use plates::{PICTURES_MAX, PICTURES_MIN, median_frames};
pub(crate) use unread::{is_stated, unread_note};
pub use video::UnusualPictures;
pub(crate) use video::{Video, picture_notes};

use crate::messages::unreadable;

/// Maximum side of a photograph in pixels.
const SIDE_MAX: u32 = 1 << 15;

impl CaptureFiles {
    /// Detects the layout of a folder and reads its cameras; photographs stay on disk.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and the problem.
    pub fn open(folder: &Path) -> anyhow::Result<CaptureFiles> {
        if !folder.is_dir() {
            std::fs::metadata(folder).map_err(|error| unreadable(folder, &error))?;
            return Err(bad(folder, "a file; a capture is a folder, so name that").into());
        }
        let mut capture_files = if folder.join(manifest::FILE).is_file() {
            manifest::open(folder)?
        } else if folder.join(easyvolcap::INTRINSICS).is_file() {
            easyvolcap::open(folder)?
        } else if let Some(files) = transforms::files(folder) {
            transforms::open(folder, &files)?
        } else if let Some(model) = colmap::model(folder) {
            colmap::open(folder, model)?
        } else {
            let (manifest, intrinsics) = (manifest::FILE, easyvolcap::INTRINSICS);
            let source = trained_from(folder).map_or_else(String::new, |source| {
                format!(" ({ARGUMENTS} says that it was fitted to {source})")
            });
            bail!(Fault::Data(format!(
                "{}: no capture{source}: it has no {manifest}, {intrinsics}, transforms.json or COLMAP model; \
                 xtask/CAPTURE.md describes them",
                folder.display()
            )));
        };
        for CalibratedCamera { name, camera, .. } in &capture_files.capture.cameras {
            camera.check().map_err(|problem| bad_layout(folder, format!("camera {name}: {problem}")))?;
            if camera.width.max(camera.height) > SIDE_MAX {
                let size = format!("{}x{}", camera.width, camera.height);
                let what = format!(
                    "camera {name}: image size {size} is too large; shrink its images to {SIDE_MAX} pixels a side"
                );
                return Err(bad(folder, what).into());
            }
        }
        match capture_files.capture.photos.is_empty() {
            true => {
                Err(bad(folder, "no camera has a photograph; xtask/CAPTURE.md says where they belong").into())
            }
            false => {
                capture_files.move_origin();
                Ok(capture_files)
            }
        }
    }
}

/// File of the arguments of a training of 3D Gaussian Splatting, in the folder of its output.
const ARGUMENTS: &str = "cfg_args";

/// The capture that the arguments in a folder name, if there are any.
fn trained_from(folder: &Path) -> Option<String> {
    let arguments = read_text(&folder.join(ARGUMENTS)).ok()?;
    python_text(arguments.split_once("source_path=")?.1)
}

/// The text that a literal of Python at the start of `text` stands for. Backslashes and quotes in it are escaped.
fn python_text(text: &str) -> Option<String> {
    let mut rest = text.chars();
    let quote = rest.next().filter(|quote| matches!(quote, '\'' | '"'))?;
    let mut literal = String::new();
    loop {
        match rest.next()? {
            '\\' => literal.push(rest.next()?),
            end if end == quote => return Some(literal),
            other => literal.push(other),
        }
    }
}

/// The layout and the cameras of a calibration that this project reads as a part of a capture, without photographs. A camera
/// whose size it does not state has 0x0 pixels. What the user should know of it goes to `notes`. `None` if `path`, a file or a
/// folder, is none.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem.
pub(crate) fn calibrated_cameras(
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Option<(&'static str, Vec<CalibratedCamera>)>, Fault> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    let is_named = |names: &[&str]| path.is_dir() || names.iter().any(|name| path.ends_with(name));
    if folder.join(easyvolcap::INTRINSICS).is_file() && is_named(&[easyvolcap::INTRINSICS]) {
        return easyvolcap::cameras(folder, notes).map(|cameras| Some(("OpenCV YAML", cameras)));
    }
    if path.ends_with("transforms.json") || (path.is_dir() && path.join("transforms.json").is_file()) {
        let file = if path.is_dir() { path.join("transforms.json") } else { path.to_owned() };
        return transforms::cameras(&file, notes).map(|cameras| Some(("nerfstudio", cameras)));
    }
    match colmap::model(folder).filter(|_| is_named(&["cameras.bin", "cameras.txt"])) {
        Some(model) => {
            let cameras = colmap::cameras(&model)?;
            notes.extend(model.note);
            Ok(Some(("COLMAP", cameras)))
        }
        None => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fs;

    use glam::{DMat4, DVec3};
    use tempfile::TempDir;

    use super::*;

    /// A folder with these text files and photographs of these sizes.
    fn folder_of(texts: &[(&str, &str)], photographs: &[(&str, [u32; 2])]) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let path_of = |name: &str| {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            path
        };
        texts.iter().for_each(|(name, text)| fs::write(path_of(name), text).unwrap());
        for (name, [width, height]) in photographs {
            image::RgbImage::new(*width, *height).save(path_of(name)).unwrap();
        }
        folder
    }

    fn refusal(folder: &TempDir) -> String {
        CaptureFiles::open(folder.path()).unwrap_err().to_string()
    }

    const CAMERAS: (&str, &str) = ("sparse/0/cameras.txt", "1 PINHOLE 100 80 110 110 50 40");
    const IMAGES: (&str, &str) = ("sparse/0/images.txt", "1 1 0 0 0 0 0 3 1 a/0.png");

    /// A file of transforms with a camera for each path, on a circle of `radius` about `center`.
    fn transforms(paths: &[&str], radius: f64, center: [f64; 3]) -> String {
        let frame = |(i, path): (usize, &&str)| {
            let (sin, cos) = (0.7 * i as f64).sin_cos();
            let [x, y, z] = center;
            let rows =
                [[cos, 0.0, sin, x + radius * sin], [0.0, 1.0, 0.0, y], [-sin, 0.0, cos, z + radius * cos]];
            serde_json::json!({"file_path": path, "transform_matrix": [rows[0], rows[1], rows[2], [0.0, 0.0, 0.0, 1.0]]})
        };
        let frames: Vec<_> = paths.iter().enumerate().map(frame).collect();
        serde_json::json!({"fl_x": 110, "w": 100, "h": 80, "frames": frames}).to_string()
    }

    #[test]
    fn photographs_have_the_proportions_of_their_camera() {
        let half = folder_of(&[CAMERAS, IMAGES], &[("images/a/0.png", [50, 40])]);
        let camera = &CaptureFiles::open(half.path()).unwrap().capture.cameras[0].camera;
        assert_eq!((camera.k[0][0], camera.k[1][1], camera.k[1][2]), (55.0, 55.0, 20.0));
        let other = folder_of(&[CAMERAS, IMAGES], &[("images/a/0.png", [100, 60])]);
        let error = refusal(&other);
        assert!(error.contains("0.png: the photograph has 100x60 pixels, its camera 100x80"), "{error}");
    }

    #[test]
    fn photographs_of_other_machines_are_found() {
        let paths = ["/home/somebody/take/images/a/0.png", r"images\b\0.png"];
        let text = transforms(&paths, 3.0, [0.0; 3]);
        let photographs = [("images/a/0.png", [100, 80]), ("images/b/0.png", [100, 80])];
        let found = folder_of(&[("transforms.json", &text)], &photographs);
        let capture_files = CaptureFiles::open(found.path()).unwrap();
        let names: Vec<&str> =
            capture_files.capture.cameras.iter().map(|camera| camera.name.as_str()).collect();
        assert_eq!(names, ["images/a/0", "images/b/0"]);
        assert!(
            capture_files.notes[0].contains("images/a/0.png for /home/somebody"),
            "{:?}",
            capture_files.notes
        );
        let missing = folder_of(&[("transforms.json", &text), CAMERAS], &photographs[1..]);
        let error = refusal(&missing);
        assert!(error.starts_with("/home/somebody") && error.contains("whose path ends like it"), "{error}");
        assert!(error.contains("to read the COLMAP model beside it"), "{error}");
        let model =
            folder_of(&[CAMERAS, ("images.txt", ""), (IMAGES.0, &IMAGES.1.replace('/', r"\"))], &photographs);
        assert_eq!(CaptureFiles::open(model.path()).unwrap().capture.cameras[0].name, "a/0");
    }

    #[test]
    fn pictures_in_other_formats_are_to_be_converted() {
        let listed = folder_of(
            &[("transforms.json", &transforms(&["images/0.tif"], 3.0, [0.0; 3])), ("images/0.tif", "II*")],
            &[],
        );
        let unnamed = folder_of(
            &[("transforms.json", &transforms(&["images/0"], 3.0, [0.0; 3])), ("images/0.EXR", "v/1")],
            &[],
        );
        let intrinsics = "names: [a]\nK_a: [110, 0, 50, 0, 110, 40, 0, 0, 1]\n";
        let calibration = [("intri.yml", intrinsics), ("extri.yml", "R_a: [0, 0, 0]\nT_a: [0, 0, 3]\n")];
        let photographs = folder_of(&[calibration[0], calibration[1], ("images/a/0.bmp", "BM")], &[]);
        let masks = folder_of(
            &[calibration[0], calibration[1], ("masks/a/0.tiff", "II*")],
            &[("images/a/0.png", [100, 80])],
        );
        for (folder, file) in
            [(listed, "0.tif"), (unnamed, "0.EXR"), (photographs, "0.bmp"), (masks, "0.tiff")]
        {
            let error = refusal(&folder);
            assert!(
                error.contains(&format!("{file}: a picture in a format that is not read; convert")),
                "{error}"
            );
        }
    }

    #[test]
    fn frames_have_times_or_none_has() {
        let timed = |times: [&str; 3]| {
            let mut text = transforms(&["a.png", "b.png", "c.png"], 3.0, [0.0; 3]);
            for (name, time) in ["a", "b", "c"].iter().zip(times) {
                let path = format!(r#""file_path":"{name}.png""#);
                text = text.replace(&path, &format!("{path}{time}"));
            }
            let photographs = ["a.png", "b.png", "c.png"].map(|name| (name, [100, 80]));
            folder_of(&[("transforms.json", &text)], &photographs)
        };
        let seconds = timed([r#","time":12"#, r#","time":10.5"#, r#","time":11"#]);
        let frames: Vec<usize> = CaptureFiles::open(seconds.path())
            .unwrap()
            .capture
            .photos
            .iter()
            .map(|photo| photo.frame)
            .collect();
        assert_eq!(frames, [0, 1, 2]);
        for mixed in [["", r#","time":0.5"#, r#","time":1"#], [r#","time":0.5"#, r#","time":null"#, ""]] {
            let error = refusal(&timed(mixed));
            assert!(error.contains("frame b.png: only some frames have a time"), "{error}");
        }
    }

    /// EasyVolcap writes -1 for a side that it does not know.
    #[test]
    fn an_unknown_size_is_the_photographs() {
        for [w, h] in [["-1", "-1."], ["0", "0"], ["100", "-1"], ["100", "80"]] {
            let intrinsics = format!(
                "names: [a]\nW_a: {w}\nH_a: {h}\nK_a: !!opencv-matrix\n  data: [110, 0, 50, 0, 110, 40, 0, 0, 1]\n"
            );
            let extrinsics =
                "R_a: !!opencv-matrix\n  data: [0, 0, 0]\nT_a: !!opencv-matrix\n  data: [0, 0, 3]\n";
            let texts = [("intri.yml", &*intrinsics), ("extri.yml", extrinsics)];
            let folder = folder_of(&texts, &[("images/a/0.png", [100, 80])]);
            let camera = &CaptureFiles::open(folder.path()).unwrap().capture.cameras[0].camera;
            assert_eq!((camera.width, camera.height), (100, 80), "{w} {h}");
            let (_, cameras) = calibrated_cameras(folder.path(), &mut Vec::new()).unwrap().unwrap();
            let expected = if h == "80" { (100, 80) } else { (0, 0) };
            assert_eq!((cameras[0].camera.width, cameras[0].camera.height), expected, "{w} {h}");
        }
        let wrong = [("intri.yml", "names: [a]\nW_a: -7\nH_a: 80\n"), ("extri.yml", "")];
        let error = refusal(&folder_of(&wrong, &[("images/a/0.png", [100, 80])]));
        assert!(error.contains("W_a is no number of pixels"), "{error}");
    }

    #[test]
    fn cameras_without_photographs_are_named() {
        let matrices = |keys: &[(&str, &str)]| {
            let matrix = |name: &str, (key, data): &(&str, &str)| {
                format!("{key}_{name}: !!opencv-matrix\n  data: [{data}]\n")
            };
            ["a", "b"].map(|name| keys.iter().map(|key| matrix(name, key)).collect::<String>()).concat()
        };
        let k = matrices(&[("K", "110, 0, 50, 0, 110, 40, 0, 0, 1"), ("ccm", "2, 0, 0, 0, 1, 0, 0, 0, 1")]);
        let intrinsics = format!("names: [a, b]\n{k}");
        let extrinsics = matrices(&[("R", "0, 0, 0"), ("T", "0, 0, 3"), ("n", "0.1")]);
        let read = |intrinsics: &str, extrinsics: &str| {
            let texts = [("intri.yml", intrinsics), ("extri.yml", extrinsics)];
            let folder = folder_of(&texts, &[("images/b/0.png", [100, 80])]);
            CaptureFiles::open(folder.path())
                .map(|capture_files| capture_files.notes)
                .map_err(|error| error.to_string())
        };
        assert_eq!(
            read(&intrinsics, &extrinsics).unwrap(),
            [
                "intri.yml and extri.yml state what is not read: ccm_a, ccm_b",
                "camera a has no photograph in images/a"
            ]
        );
        // What is malformed is not absent.
        let error = read(&intrinsics, &(extrinsics.clone() + "Rot_b: !!opencv-matrix\n  data: [1, x]\n"))
            .unwrap_err();
        assert!(error.contains("extri.yml: Rot_b is missing, malformed or too short"), "{error}");
        let colors = intrinsics.replace("2, 0, 0, 0, 1, 0, 0, 0, 1", "1, 0, 0, 0, 1, 0, 0, 0, 1");
        assert_eq!(read(&colors, &extrinsics).unwrap(), ["camera a has no photograph in images/a"]);
        let many: String = (0..20).map(|k| format!("key_{k:02}: 1\n")).collect();
        let notes = read(&(colors + &many), &extrinsics).unwrap();
        assert!(notes[0].ends_with("key_06, key_07 and 12 more"), "{notes:?}");
        let error = read(&intrinsics.replace("110, 0, 50", "110, 2, 50"), &extrinsics).unwrap_err();
        assert!(error.contains("intri.yml: b: K has a skew of 2"), "{error}");
        let camera = |id: &str| {
            serde_json::json!({"id": id, "w": 100, "h": 80, "K": [[110, 0, 50], [0, 110, 40], [0, 0, 1]],
                "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]})
        };
        let manifest = serde_json::json!({"frames": 1, "images": "images/{camera}/0.png", "cameras": [camera("a"), camera("b")]});
        let folder = folder_of(&[("capture.json", &manifest.to_string())], &[("images/b/0.png", [100, 80])]);
        assert_eq!(CaptureFiles::open(folder.path()).unwrap().notes, ["camera a has no photograph"]);
    }

    #[test]
    fn calibrations_name_what_is_not_read() {
        let notes = |texts: &[(&str, &str)]| {
            let mut notes = Vec::new();
            calibrated_cameras(folder_of(texts, &[]).path(), &mut notes).unwrap().unwrap();
            notes
        };
        let file = transforms(&["a"], 3.0, [0.0; 3]).replacen('{', r#"{"white_transparent": true,"#, 1);
        assert_eq!(
            notes(&[("transforms.json", &file)]),
            ["transforms.json states what is not read: white_transparent"]
        );
        let intrinsics = "names: [a]\nK_a: [110, 0, 50, 0, 110, 40, 0, 0, 1]\ngamma_a: 2\n";
        assert_eq!(
            notes(&[("intri.yml", intrinsics), ("extri.yml", "R_a: [0, 0, 0]\nT_a: [0, 0, 3]\n")]),
            ["intri.yml and extri.yml state what is not read: gamma_a"]
        );
    }

    #[test]
    fn of_several_models_the_others_are_named() {
        let folder =
            folder_of(&[CAMERAS, IMAGES, ("sparse/1/cameras.txt", "")], &[("images/a/0.png", [100, 80])]);
        let notes = CaptureFiles::open(folder.path()).unwrap().notes;
        let said = "sparse/0 (1) is read, of the COLMAP models the one with the most photographs; the others: sparse/1 (cannot \
                    be read)";
        assert_eq!(notes, [said]);
    }

    #[test]
    fn of_several_models_the_one_with_the_most_photographs_is_read() {
        let more = "1 1 0 0 0 0 0 3 1 a/0.png\n2 1 0 0 0 0 0 4 1 a/1.png";
        let photographs = [("images/a/0.png", [100, 80]), ("images/a/1.png", [100, 80])];
        for model in ["sparse/1", "sparse/10", "sparse", ".", "colmap/sparse/0", "colmap/sparse"] {
            let [cameras, images] = ["cameras", "images"].map(|name| format!("{model}/{name}.txt"));
            let folder = folder_of(&[(&cameras, CAMERAS.1), (&images, more), CAMERAS, IMAGES], &photographs);
            let opened = CaptureFiles::open(folder.path()).unwrap();
            assert_eq!(opened.capture.cameras.len(), 2, "{model}");
            assert!(opened.notes[0].starts_with(&format!("{model} (2) is read")), "{:?}", opened.notes);
            // Alone, it is read without a word.
            fs::remove_dir_all(folder.path().join("sparse/0")).unwrap();
            let opened = CaptureFiles::open(folder.path()).unwrap();
            assert_eq!((opened.capture.cameras.len(), opened.notes.len()), (2, 0), "{model}");
        }
    }

    #[test]
    fn a_model_of_a_camera_matters_if_a_photograph_is_of_it() {
        let cameras = format!("{}\n2 FOV 100 80 110 110 50 40 0.9", CAMERAS.1);
        let photographs = [("images/a/0.png", [100, 80])];
        let unused = folder_of(&[(CAMERAS.0, &cameras), IMAGES], &photographs);
        assert_eq!(CaptureFiles::open(unused.path()).unwrap().capture.cameras.len(), 1);
        let images = IMAGES.1.replace("3 1 a", "3 2 a");
        let error = refusal(&folder_of(&[(CAMERAS.0, &cameras), (IMAGES.0, &images)], &photographs));
        assert!(error.contains("cameras.txt: line 2: camera model FOV"), "{error}");
    }

    #[test]
    fn files_that_git_lfs_has_not_fetched_are_named() {
        let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n";
        for texts in [
            &[CAMERAS, IMAGES, ("images/a/0.png", pointer)][..],
            &[("transforms.json", pointer)],
            &[("sparse/0/cameras.bin", pointer), ("sparse/0/images.bin", pointer)],
        ] {
            let error = refusal(&folder_of(texts, &[]));
            assert!(error.contains("a pointer of Git LFS") && error.contains("git lfs pull"), "{error}");
        }
        let latin = folder_of(&[], &[]);
        fs::write(latin.path().join("transforms.json"), b"{\"\xe9\": 1}").unwrap();
        assert!(refusal(&latin).contains("transforms.json: not in UTF-8"));
    }

    #[test]
    fn the_output_of_a_training_is_no_capture_but_names_its_own() {
        for (literal, path) in [
            ("'/data/truck'", "/data/truck"),
            (r"'C:\\data\\new truck'", r"C:\data\new truck"),
            (r#""D:\\a driver's""#, r"D:\a driver's"),
        ] {
            let arguments =
                format!("Namespace(data_device='cuda', source_path={literal}, white_background=False)");
            let folder = folder_of(&[("cfg_args", &arguments), ("input.ply", "")], &[]);
            let error = refusal(&folder);
            let said = format!("no capture (cfg_args says that it was fitted to {path}): it has");
            assert!(error.contains(&said), "{error}");
        }
    }

    /// Cameras of geographic coordinates see the same as cameras about the origin, and those near the origin stay.
    #[test]
    fn cameras_far_from_the_origin_are_moved() {
        let names: Vec<String> = (0..6).map(|i| format!("{i}.png")).collect();
        let paths: Vec<&str> = names.iter().map(String::as_str).collect();
        let photographs: Vec<(&str, [u32; 2])> = paths.iter().map(|path| (*path, [100, 80])).collect();
        let opened = |radius: f64, center: [f64; 3]| {
            let folder = folder_of(&[("transforms.json", &transforms(&paths, radius, center))], &photographs);
            CaptureFiles::open(folder.path()).unwrap()
        };
        let near = opened(3.0, [500.0, 40.0, 0.0]);
        assert_eq!((near.origin, near.notes.len()), ([0.0; 3], 0));
        let far = opened(3.0, [500_000.25, 4_100_000.75, -20.0]);
        assert_eq!(far.origin, [500_000.0, 4_100_001.0, -20.0]);
        assert_eq!(far.fit_record(refine::capture::Holdout::None).origin, Some(far.origin));
        let expected = opened(3.0, [0.25, -0.25, 0.0]);
        for (camera, file_camera) in far.capture.cameras.iter().zip(&far.file_cameras) {
            assert_eq!(camera.camera, *file_camera);
        }
        for (moved, camera) in far.capture.cameras.iter().zip(&expected.capture.cameras) {
            let pairs = moved
                .camera
                .camera_from_world
                .iter()
                .flatten()
                .zip(camera.camera.camera_from_world.iter().flatten());
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-8), "{moved:?}");
        }
        let record = crate::fields::FitRecord { frames: Some(0..1), ..Default::default() };
        let error = far.check_origin(&record, "field.ply").unwrap_err().to_string();
        assert!(
            error.contains("field.ply was fitted about 0 0 0") && error.contains("about 500000 4100001 -20"),
            "{error}"
        );
        near.check_origin(&record, "field.ply").unwrap();
        // Fields of other programs have the origin of the capture; a package may be of a field that was moved.
        let unrecorded = crate::fields::FitRecord::default();
        assert!(far.check_origin(&unrecorded, "theirs.ply").is_err());
        far.check_origin(&unrecorded, "clip.aarc").unwrap();
        // What a fit learned about one origin serves about another.
        let mut learned = opened(3.0, [500_100.25, 4_100_000.75, -20.0]);
        learned.capture.cameras[2].camera.camera_from_world[0][3] += 0.125;
        let corrections = learned.corrections();
        let mut corrected = far.clone();
        corrected.correct(&corrections, Path::new("cameras.json")).unwrap();
        let in_world = |files: &CaptureFiles| {
            let rows = files.capture.cameras[2].camera.camera_from_world;
            let camera = DMat4::from_cols_array_2d(&rows).transpose();
            camera * DMat4::from_translation(-DVec3::from(files.origin))
        };
        let (was, is) = (in_world(&learned), in_world(&corrected));
        assert!(was.abs_diff_eq(is, 1e-6) && far.origin != learned.origin, "{was} {is}");
        let unstated = CameraCorrections { origin: None, ..corrections };
        let error = corrected.correct(&unstated, Path::new("cameras.json")).unwrap_err().to_string();
        assert!(error.contains("cameras.json: it does not say the origin of its cameras"), "{error}");
        near.clone().correct(&unstated, Path::new("cameras.json")).unwrap();
        // In kilometres, the same place is as far away.
        assert_eq!(opened(0.003, [500.0, 4_100.0, 0.0]).origin, [500.0, 4_100.0, 0.0]);
    }

    /// The words in code of the cells of the row of the table of statements that begins so.
    fn row(layout: &str) -> Vec<BTreeSet<&str>> {
        let text = include_str!("../../../CAPTURE.md");
        let (_, table) = text.split_once("## What other programs state").unwrap();
        let row = table.lines().find(|line| line.starts_with(&format!("| {layout}"))).unwrap();
        let cells = row.trim_matches('|').split('|').skip(1);
        cells.map(|cell| cell.split('`').skip(1).step_by(2).collect()).collect()
    }

    #[test]
    fn the_document_lists_the_statements_of_other_programs() {
        let set = |keys: &[&'static str]| keys.iter().copied().collect::<BTreeSet<_>>();
        let [read, refused, ignored] = &row("nerfstudio")[..] else { panic!("three columns") };
        assert_eq!((refused, ignored), (&set(&transforms::REFUSED_KEYS), &set(&transforms::IGNORED_KEYS)));
        let keys = transforms::tests::read_keys();
        assert_eq!(read, &keys.iter().map(String::as_str).collect());
        let [read, _, ignored] = &row("EasyVolcap")[..] else { panic!("three columns") };
        assert_eq!((read, ignored), (&set(&easyvolcap::CAMERA_KEYS), &set(&easyvolcap::IGNORED_KEYS)));
        let models = colmap::CAMERA_MODELS.map(|(_, name, _)| name);
        let others = colmap::OTHER_MODELS.map(|(_, name, _)| name);
        assert_eq!(row("COLMAP")[..2], [set(&models), set(&others)]);
    }
}
