//! Captures in COLMAP's layout: sparse models, binary or text, in folders of `sparse` or of `colmap/sparse`, in one of these
//! or in the folder itself, photographs in `images`, and optional masks in `masks`. The scene is static: each photograph has
//! a camera of its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use formats::list_folder;
use glam::{DMat3, DQuat};
use program::Fault;
use refine::capture::{CalibratedCamera, Lens};

use super::capture_files::{CaptureBuilder, CaptureFiles, calibrated, pinhole, rigid};
use super::image_file::{
    bad, bad_layout, find_image_in, joined, no_mask, read_bytes, read_text, scale_of_photograph, size_of,
};
use super::listed_paths::{ListedPaths, advice};
use super::photo_paths::PhotoPath;

/// Folders that may hold a model, or several, each in a folder of its own.
const FOLDERS: [&str; 3] = ["sparse", ".", "colmap/sparse"];

/// The model of a capture.
pub(super) struct Model {
    folder: PathBuf,
    /// Why it was taken of several, in a sentence.
    pub(super) note: Option<String>,
}

/// Finds the model in `folder`. COLMAP makes several of photographs that it cannot connect: the one with the most photographs
/// is taken, and the first of those that have equally many.
pub(super) fn model(folder: &Path) -> Option<Model> {
    let mut names: Vec<String> = Vec::new();
    for parent in FOLDERS {
        if parent != "." {
            let mut inner = list_folder(&folder.join(parent)).unwrap_or_default();
            // By number, and by name after those.
            inner.sort_by_key(|name| name.parse().unwrap_or(u64::MAX));
            names.extend(inner.into_iter().map(|name| format!("{parent}/{name}")));
        }
        names.push(parent.to_owned());
    }
    names.retain(|name| is_model(&folder.join(name)));
    let [first, others @ ..] = &names[..] else { return None };
    if others.is_empty() {
        return Some(Model { folder: folder.join(first), note: None });
    }
    let photographs = |name: &String| read_poses(&folder.join(name)).map(|poses| poses.len()).ok();
    let counts: Vec<Option<usize>> = names.iter().map(photographs).collect();
    let most = (0..names.len()).rev().max_by_key(|i| counts[*i])?;
    let listed = |i: usize| match counts[i] {
        Some(count) => format!("{} ({count})", names[i]),
        None => format!("{} (cannot be read)", names[i]),
    };
    let others: Vec<String> = (0..names.len()).filter(|i| *i != most).map(listed).collect();
    let note = format!(
        "{} is read, of the COLMAP models the one with the most photographs; the others: {}",
        listed(most),
        others.join(", ")
    );
    Some(Model { folder: folder.join(&names[most]), note: Some(note) })
}

fn is_model(path: &Path) -> bool {
    ["cameras.bin", "cameras.txt"].iter().any(|name| path.join(name).is_file())
}

/// Size, focal lengths and principal point, lens.
type Intrinsics = ((u32, u32), [f64; 4], Lens);

/// The cameras of a model by number, each with its intrinsics or why these are not supported, which matters if a photograph
/// is of it.
struct Cameras<'m> {
    model: &'m Path,
    cameras: BTreeMap<u32, Result<Intrinsics, Fault>>,
}

impl Cameras<'_> {
    /// Reads the cameras of a model.
    fn read(model: &Path) -> Result<Cameras<'_>, Fault> {
        let binary = model.join("cameras.bin");
        let cameras =
            if binary.is_file() { cameras_bin(&binary) } else { cameras_txt(&model.join("cameras.txt")) };
        Ok(Cameras { model, cameras: cameras? })
    }

    /// The camera of a photograph.
    fn of(&self, pose: &Pose) -> Result<&Intrinsics, Fault> {
        match self.cameras.get(&pose.camera) {
            Some(Ok(intrinsics)) => Ok(intrinsics),
            Some(Err(fault)) => Err(Fault::Data(fault.to_string())),
            None => {
                Err(bad_layout(self.model, format!("{}: the model has no camera {}", pose.name, pose.camera)))
            }
        }
    }
}

/// A photograph of a model.
struct Pose {
    camera: u32,
    /// w, x, y, z.
    rotation: [f64; 4],
    translation: [f64; 3],
    name: String,
}

/// The cameras of a model, named as its images without their extensions.
///
/// # Errors
/// [`Fault::Data`] that names the file.
pub(super) fn cameras(model: &Model) -> Result<Vec<CalibratedCamera>, Fault> {
    let model = &model.folder;
    let (cameras, poses) = (Cameras::read(model)?, read_poses(model)?);
    let camera_at = |pose: &Pose| {
        let (size, k, lens) = cameras.of(pose)?;
        let name = Path::new(&pose.name).with_extension("").to_string_lossy().into_owned();
        Ok(calibrated(name, pinhole(*size, *k, pose.transform()), *lens))
    };
    poses.iter().map(camera_at).collect()
}

/// Reads the photographs of a model, in a file of the same kind.
fn read_poses(model: &Path) -> Result<Vec<Pose>, Fault> {
    match model.join("cameras.bin").is_file() {
        true => images_bin(&model.join("images.bin")),
        false => images_txt(&model.join("images.txt")),
    }
}

impl Pose {
    fn transform(&self) -> [[f64; 4]; 4] {
        let [w, x, y, z] = self.rotation;
        let turn = DQuat::from_xyzw(x, y, z, w).normalize();
        rigid(DMat3::from_quat(turn).transpose().to_cols_array_2d(), self.translation)
    }
}

pub(super) fn open(folder: &Path, Model { folder: model, note }: Model) -> anyhow::Result<CaptureFiles> {
    let (cameras, poses) = (Cameras::read(&model)?, read_poses(&model)?);
    let has_masks = folder.join("masks").is_dir();
    let mut builder = CaptureBuilder::new(folder);
    note.into_iter().for_each(|note| builder.note(note));
    let mut listed = ListedPaths::new(folder);
    for pose in poses {
        let existing = |name: &str| Some(joined("images", name)).filter(|image| folder.join(image).is_file());
        let Some(image) = listed.find(&pose.name, existing)? else {
            let what = format!("this photograph is missing{}", advice(folder, &pose.name));
            return Err(bad(&folder.join(joined("images", &pose.name)), what).into());
        };
        let path = folder.join(&image);
        let (size, k, lens) = cameras.of(&pose)?;
        let actual = size_of(&path)?;
        let stated = [size.0, size.1].map(f64::from);
        let scale = scale_of_photograph(stated, actual).map_err(|problem| bad(&path, problem))?;
        let k = [k[0] * scale[0], k[1] * scale[1], k[2] * scale[0], k[3] * scale[1]];
        let camera = pinhole(actual, k, pose.transform());
        let listed_name = image.strip_prefix("images/").unwrap_or(&image);
        let name = Path::new(listed_name).with_extension("");
        let name = name.to_string_lossy();
        let mask = match has_masks {
            // COLMAP appends an extension to the whole name.
            true => {
                let [with_extension, without] = [listed_name, &*name].map(|name| joined("masks", name));
                let mask = find_image_in(folder, &with_extension).or_else(|| find_image_in(folder, &without));
                Some(mask.ok_or_else(|| no_mask(&folder.join(without)))?)
            }
            false => None,
        };
        let index = builder.camera(&name, camera, *lens, false);
        builder.device(index, pose.camera);
        builder.photo(index, 0, PhotoPath { image: &image, name: &name, mask: mask.as_deref() })?;
    }
    listed.note().into_iter().for_each(|note| builder.note(note));
    Ok(builder.build(vec![0.0], None))
}

/// Supported camera models: number, name and number of parameters.
pub(super) const CAMERA_MODELS: [(i32, &str, usize); 9] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
    (8, "SIMPLE_RADIAL_FISHEYE", 4),
    (9, "RADIAL_FISHEYE", 5),
];

/// Models that are supported if all coefficients but those of OpenCV's models are 0: as above.
pub(super) const OTHER_MODELS: [(i32, &str, usize); 5] = [
    (7, "FOV", 5),
    (10, "THIN_PRISM_FISHEYE", 12),
    (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
    (12, "SIMPLE_DIVISION", 4),
    (13, "DIVISION", 5),
];

fn intrinsics(model: &str, size: (u64, u64), p: &[f64]) -> Result<Intrinsics, String> {
    let side = |x: u64| u32::try_from(x).ok().filter(|x| *x > 0).ok_or("an image size is out of range");
    let size = (side(size.0)?, side(size.1)?);
    let (k, lens) = match (model, p) {
        ("SIMPLE_PINHOLE", &[f, cx, cy])
        | ("SIMPLE_RADIAL", &[f, cx, cy, _])
        | ("RADIAL", &[f, cx, cy, _, _]) => ([f, f, cx, cy], Lens::rational(&p[3..])),
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, _]) | ("RADIAL_FISHEYE", &[f, cx, cy, _, _]) => {
            ([f, f, cx, cy], Lens::fisheye(&p[3..]))
        }
        // Their coefficients are in OpenCV's order.
        ("PINHOLE", &[fx, fy, cx, cy])
        | ("OPENCV", &[fx, fy, cx, cy, _, _, _, _])
        | ("FULL_OPENCV", &[fx, fy, cx, cy, _, _, _, _, _, _, _, _]) => {
            ([fx, fy, cx, cy], Lens::rational(&p[4..]))
        }
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, _, _, _, _]) => ([fx, fy, cx, cy], Lens::fisheye(&p[4..])),
        ("FOV" | "DIVISION", &[fx, fy, cx, cy, 0.0]) => ([fx, fy, cx, cy], Lens::rational(&[])),
        ("SIMPLE_DIVISION", &[f, cx, cy, 0.0]) => ([f, f, cx, cy], Lens::rational(&[])),
        ("THIN_PRISM_FISHEYE", &[fx, fy, cx, cy, k1, k2, 0.0, 0.0, k3, k4, 0.0, 0.0]) => {
            ([fx, fy, cx, cy], Lens::fisheye(&[k1, k2, k3, k4]))
        }
        (
            "RAD_TAN_THIN_PRISM_FISHEYE",
            &[fx, fy, cx, cy, k1, k2, k3, k4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ) => ([fx, fy, cx, cy], Lens::fisheye(&[k1, k2, k3, k4])),
        _ => {
            let known = CAMERA_MODELS.map(|(_, name, _)| name).join(", ");
            let other = OTHER_MODELS.iter().any(|(_, name, count)| *name == model && *count == p.len());
            let other = if other { ", and this model without its own coefficients" } else { "" };
            return Err(format!(
                "camera model {model} with {} parameters: supported are {known}{other}; undistort the photographs",
                p.len()
            ));
        }
    };
    Ok((size, k, lens?))
}

/// Reads little-endian values from the start of `rest`.
struct Reader<'a> {
    path: &'a Path,
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let (bytes, rest) =
            self.rest.split_at_checked(count).ok_or_else(|| bad_layout(self.path, "the file is cut off"))?;
        self.rest = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        Ok(self.bytes(N)?.try_into().expect("so many bytes"))
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Result<f64, Fault> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    fn text(&mut self) -> Result<String, Fault> {
        let end = self.rest.iter().position(|byte| *byte == 0);
        let end = end.ok_or_else(|| bad_layout(self.path, "a name does not end"))?;
        let text = String::from_utf8_lossy(self.bytes(end)?).into_owned();
        self.bytes(1)?;
        Ok(text)
    }
}

fn cameras_bin(path: &Path) -> Result<BTreeMap<u32, Result<Intrinsics, Fault>>, Fault> {
    let bytes = read_bytes(path)?;
    let mut reader = Reader { path, rest: &bytes };
    let mut cameras = BTreeMap::new();
    for _ in 0..reader.u64()? {
        let (id, number) = (reader.u32()?, reader.u32()? as i32);
        let size = (reader.u64()?, reader.u64()?);
        let known = CAMERA_MODELS.iter().chain(&OTHER_MODELS).find(|(known, _, _)| *known == number);
        let (_, model, count) = known.ok_or_else(|| {
            let known = CAMERA_MODELS.map(|(_, name, _)| name).join(", ");
            bad_layout(path, format!("camera {id} has model number {number}: supported are {known}"))
        })?;
        let parameters = (0..*count).map(|_| reader.f64()).collect::<Result<Vec<_>, _>>()?;
        let intrinsics = intrinsics(model, size, &parameters);
        cameras.insert(id, intrinsics.map_err(|problem| bad_layout(path, format!("camera {id}: {problem}"))));
    }
    Ok(cameras)
}

fn images_bin(path: &Path) -> Result<Vec<Pose>, Fault> {
    let bytes = read_bytes(path)?;
    let mut reader = Reader { path, rest: &bytes };
    let mut poses = Vec::new();
    for _ in 0..reader.u64()? {
        reader.u32()?;
        let rotation = [reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?];
        let translation = [reader.f64()?, reader.f64()?, reader.f64()?];
        let (camera, name) = (reader.u32()?, reader.text()?);
        let points = usize::try_from(reader.u64()?).ok().and_then(|count| count.checked_mul(24));
        reader.bytes(points.ok_or_else(|| bad_layout(path, "the file is cut off"))?)?;
        poses.push(Pose { camera, rotation, translation, name });
    }
    Ok(poses)
}

/// Lines that are no comments, without blanks around them, with their numbers from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let trimmed = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    trimmed.filter(|(_, line)| !line.starts_with('#'))
}

fn cameras_txt(path: &Path) -> Result<BTreeMap<u32, Result<Intrinsics, Fault>>, Fault> {
    let text = read_text(path)?;
    let mut cameras = BTreeMap::new();
    for (number, line) in lines(&text).filter(|(_, line)| !line.is_empty()) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let at = |problem: String| bad_layout(path, format!("line {number}: {problem}"));
        let [id, model, width, height, parameters @ ..] = words.as_slice() else {
            return Err(at("not a camera".into()));
        };
        let parameters: Option<Vec<f64>> = parameters.iter().map(|word| word.parse().ok()).collect();
        let (Ok(id), Ok(width), Ok(height), Some(parameters)) =
            (id.parse(), width.parse(), height.parse(), parameters)
        else {
            return Err(at("not a camera".into()));
        };
        cameras.insert(id, intrinsics(model, (width, height), &parameters).map_err(at));
    }
    Ok(cameras)
}

fn images_txt(path: &Path) -> Result<Vec<Pose>, Fault> {
    poses(&read_text(path)?).map_err(|number| bad_layout(path, format!("line {number}: not an image")))
}

/// The images of a text; a line lists the points of the image before it, or there is none. COLMAP skips blank lines, too.
///
/// # Errors
/// The number of a line that is neither.
fn poses(text: &str) -> Result<Vec<Pose>, usize> {
    let mut poses = Vec::new();
    let mut is_after_image = false;
    for (number, line) in lines(text).filter(|(_, line)| !line.is_empty()) {
        let is_image = !(is_after_image && are_points(line));
        if is_image {
            poses.push(pose(line).ok_or(number)?);
        }
        is_after_image = is_image;
    }
    Ok(poses)
}

/// Whether a line is of numbers, three a point.
fn are_points(line: &str) -> bool {
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    line.split_whitespace().count().is_multiple_of(3) && line.split_whitespace().all(is_number)
}

/// The image of a line; its name is what follows the number of its camera, with its blanks.
fn pose(line: &str) -> Option<Pose> {
    let mut rest = line;
    let mut word = || {
        let (word, after) = rest.split_once(char::is_whitespace)?;
        rest = after.trim_start();
        Some(word)
    };
    word()?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = word()?.parse().ok()?;
    }
    let camera = word()?.parse().ok()?;
    let [w, x, y, z, t0, t1, t2] = numbers;
    Some(Pose { camera, rotation: [w, x, y, z], translation: [t0, t1, t2], name: rest.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_of_cameras() {
        let parsed = |model, p: &[f64]| intrinsics(model, (64, 48), p).map(|(_, k, lens)| (k, lens));
        assert_eq!(parsed("SIMPLE_PINHOLE", &[50.0, 32.0, 24.0]).unwrap().0, [50.0, 50.0, 32.0, 24.0]);
        assert_eq!(
            parsed("RADIAL", &[50.0, 32.0, 24.0, 0.1, 0.2]).unwrap().1,
            Lens::rational(&[0.1, 0.2]).unwrap()
        );
        let opencv = parsed("OPENCV", &[50.0, 51.0, 32.0, 24.0, 0.1, 0.2, 0.3, 0.4]).unwrap();
        let k = [50.0, 51.0, 32.0, 24.0];
        let coefficients = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
        let rational = |count: usize| Lens::rational(&coefficients[..count]).unwrap();
        let fisheye = |count: usize| Lens::fisheye(&coefficients[..count]).unwrap();
        assert_eq!(opencv, (k, rational(4)));
        let with =
            |model, k: &[f64], count: usize| parsed(model, &[k, &coefficients[..count]].concat()).unwrap();
        assert_eq!(with("FULL_OPENCV", &k, 8), (k, rational(8)));
        assert_eq!(with("OPENCV_FISHEYE", &k, 4), (k, fisheye(4)));
        let simple = [50.0, 50.0, 32.0, 24.0];
        assert_eq!(with("SIMPLE_RADIAL_FISHEYE", &simple[1..], 1), (simple, fisheye(1)));
        assert_eq!(with("RADIAL_FISHEYE", &simple[1..], 2), (simple, fisheye(2)));
        // Without their own coefficients they are others.
        let prism = [&k[..], &[0.1, 0.2, 0.0, 0.0, 0.3, 0.4, 0.0, 0.0]].concat();
        assert_eq!(parsed("THIN_PRISM_FISHEYE", &prism).unwrap(), (k, fisheye(4)));
        let prism = [&k[..], &coefficients[..4], &[0.0; 8]].concat();
        assert_eq!(parsed("RAD_TAN_THIN_PRISM_FISHEYE", &prism).unwrap(), (k, fisheye(4)));
        assert_eq!(parsed("FOV", &[50.0, 51.0, 32.0, 24.0, 0.0]).unwrap(), (k, rational(0)));
        assert_eq!(parsed("SIMPLE_DIVISION", &[50.0, 32.0, 24.0, 0.0]).unwrap(), (simple, rational(0)));
        for (_, model, count) in OTHER_MODELS {
            let error = parsed(model, &vec![1.0; count]).unwrap_err();
            assert!(error.contains("without its own coefficients"), "{error}");
        }
        for (model, count) in [("FOV", 5), ("THIN_PRISM_FISHEYE", 12), ("PINHOLE", 1), ("OPENCV_FISHEYE", 12)]
        {
            assert!(parsed(model, &vec![1.0; count]).unwrap_err().contains(model), "{model}");
        }
        assert!(parsed("RADIAL_FISHEYE", &[50.0, 32.0, 24.0, 0.1, f64::NAN]).unwrap_err().contains("finite"));
    }

    #[test]
    fn images_have_a_line_of_points_or_none() {
        let names = |text: &str| {
            poses(text).map(|poses| poses.into_iter().map(|pose| pose.name).collect::<Vec<String>>())
        };
        let [a, b] = ["1 1 0 0 0 0 0 3 1 a.png", "2 0.9 0 0.1 0 0 0 3 2 take  2.png"];
        let expected = vec!["a.png".to_owned(), "take  2.png".to_owned()];
        for text in [
            format!("{a}\n0.5 0.5 -1\n{b}\n1 2 3 4 5 6\n"),
            format!("{a}\n\n{b}\n\n"),
            format!("{a}\n{b}"),
            format!("# one\n\n{a}\r\n0.5 0.5 -1\r\n  # two\n\n \n{b}\t\r\n"),
            format!("{a}\n\n0.5 0.5 -1\n\n{b}\n"),
        ] {
            assert_eq!(names(&text).as_ref(), Ok(&expected), "{text}");
        }
        assert_eq!(names("1 1 0 0 0 0 0 3 1 2024\n2 1 0 0 0 0 0 3 1 2025").unwrap(), ["2024", "2025"]);
        for (text, line) in [("0.5 0.5 -1", 1), (&*format!("{a}\n1 2 3 4"), 2), ("1 1 0 0 0 0 0 3 1 ", 1)] {
            assert_eq!(names(text), Err(line), "{text}");
        }
    }
}
