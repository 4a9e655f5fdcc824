//! Captures in EasyVolcap's layout: `intri.yml`, `extri.yml`, `images/CAMERA/FRAME.png` and optional
//! `masks/CAMERA/FRAME.png`.
//!
//! OpenCV's FileStorage writes the two files in a dialect of YAML that generic readers reject. This reader
//! supports lists, numbers and matrices at the top level.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use codec::Camera;
use formats::list_folder;
use glam::{DMat3, DVec3};
use program::Fault;
use refine::capture::{CalibratedCamera, Lens, even_times_s};

use super::capture_files::{
    CaptureBuilder, CaptureFiles, calibrated, intrinsics as intrinsics_of, pinhole, rigid,
};
use super::image_file::{
    bad_layout, find_image, find_image_in, joined, no_mask, read_text, size_of, unread_picture,
};
use super::photo_paths::PhotoPath;
use super::unread::unread_note;
use crate::messages::unreadable;
use crate::scene::DEFAULT_FPS;

/// File of the intrinsics, which identifies the layout.
pub(super) const INTRINSICS: &str = "intri.yml";
const EXTRINSICS: &str = "extri.yml";

/// Accepted names of the folder of masks.
const MASKS: [&str; 2] = ["masks", "mask"];

/// Keys that are read, each for a camera: `K_00`.
pub(super) const CAMERA_KEYS: [&str; 8] = ["D", "H", "K", "R", "Rot", "T", "W", "dist"];

/// Keys of cameras on which nothing that is drawn depends: near and far planes, bounds, and places in grids of times and views.
pub(super) const IGNORED_KEYS: [&str; 5] = ["bounds", "f", "n", "t", "v"];

/// Key of a camera's matrix of colours, which EasyVolcap writes also where it changes none.
const COLORS: &str = "ccm";

/// The two files, read.
struct CalibrationFiles {
    intrinsics: Storage,
    intrinsics_path: PathBuf,
    extrinsics: Storage,
    extrinsics_path: PathBuf,
}

impl CalibrationFiles {
    fn read(folder: &Path) -> Result<CalibrationFiles, Fault> {
        let [intrinsics_path, extrinsics_path] = [INTRINSICS, EXTRINSICS].map(|name| folder.join(name));
        Ok(CalibrationFiles {
            intrinsics: parse(&read_text(&intrinsics_path)?),
            intrinsics_path,
            extrinsics: parse(&read_text(&extrinsics_path)?),
            extrinsics_path,
        })
    }

    /// Names of the cameras, each once.
    fn names(&self) -> Result<Vec<String>, Fault> {
        let path = &self.intrinsics_path;
        let names = names(&self.intrinsics).ok_or_else(|| bad_layout(path, "no list of names"))?;
        let mut seen = BTreeSet::new();
        match names.iter().find(|name| !seen.insert(*name)) {
            Some(name) => Err(bad_layout(path, format!("camera {name} is listed twice"))),
            None => Ok(names),
        }
    }

    /// The note on the keys that are not read though something that is drawn may depend on them.
    fn note(&self, names: &[String]) -> Option<String> {
        let names: BTreeSet<&str> = names.iter().map(String::as_str).collect();
        let is_known = |key: &str, value: &str| match key.split_once('_') {
            Some((COLORS, name)) => is_identity(value) && names.contains(name),
            Some((kind, name)) => {
                (CAMERA_KEYS.contains(&kind) || IGNORED_KEYS.contains(&kind)) && names.contains(name)
            }
            None => key == "names",
        };
        let unread =
            self.intrinsics.iter().chain(&self.extrinsics).filter(|(key, value)| !is_known(key, value));
        unread_note(&format!("{INTRINSICS} and {EXTRINSICS} state"), unread.map(|(key, _)| key.as_str()))
    }

    /// Size of a camera's pictures, if it is stated: a side of -1 or 0 is unknown.
    fn size(&self, name: &str) -> Result<Option<(u32, u32)>, Fault> {
        let is_known = |value: &&String| !matches!(numbers(value).as_deref(), Some([-1.0 | 0.0]));
        let side = |key: &str| {
            let value = self.intrinsics.get(&format!("{key}_{name}"));
            let malformed =
                || bad_layout(&self.intrinsics_path, format!("{key}_{name} is no number of pixels"));
            value.filter(is_known).map(|value| pixels(value).ok_or_else(malformed)).transpose()
        };
        Ok(side("W")?.zip(side("H")?))
    }

    /// A camera with pictures of this size, and its lens.
    fn camera(&self, name: &str, size: (u32, u32)) -> Result<(Camera, Lens), Fault> {
        let matrix = |map: &Storage, path: &Path, keys: &[&str], least: usize| {
            let at = keys.iter().find_map(|key| map.get(&format!("{key}_{name}")));
            let data = at.and_then(|value| numbers(value)).filter(|data| data.len() >= least);
            data.ok_or_else(|| {
                bad_layout(path, format!("{}_{name} is missing, malformed or too short", keys[0]))
            })
        };
        let CalibrationFiles { intrinsics, intrinsics_path, extrinsics, extrinsics_path } = self;
        let k = matrix(intrinsics, intrinsics_path, &["K"], 9)?;
        let k =
            intrinsics_of(&k).map_err(|problem| bad_layout(intrinsics_path, format!("{name}: {problem}")))?;
        let has = |storage: &Storage, key: &str| storage.contains_key(&format!("{key}_{name}"));
        let d = match has(intrinsics, "D") || has(intrinsics, "dist") {
            true => matrix(intrinsics, intrinsics_path, &["D", "dist"], 1)?,
            false => Vec::new(),
        };
        let lens = Lens::rational(&d)
            .map_err(|problem| bad_layout(intrinsics_path, format!("{name}: {problem}")))?;
        let t = matrix(extrinsics, extrinsics_path, &["T"], 3)?;
        let rotation = match has(extrinsics, "Rot") {
            true => {
                let r = matrix(extrinsics, extrinsics_path, &["Rot"], 9)?;
                [[r[0], r[1], r[2]], [r[3], r[4], r[5]], [r[6], r[7], r[8]]]
            }
            false => rodrigues(&matrix(extrinsics, extrinsics_path, &["R"], 3)?),
        };
        Ok((pinhole(size, k, rigid(rotation, [t[0], t[1], t[2]])), lens))
    }
}

/// The cameras of the two files in `folder`; 0x0 pixels where no size is stated. The keys that are not read go to `notes`.
///
/// # Errors
/// [`Fault::Data`] that names the file.
pub(super) fn cameras(folder: &Path, notes: &mut Vec<String>) -> Result<Vec<CalibratedCamera>, Fault> {
    let files = CalibrationFiles::read(folder)?;
    let names = files.names()?;
    notes.extend(files.note(&names));
    let camera_named = |name: String| {
        let (camera, lens) = files.camera(&name, files.size(&name)?.unwrap_or_default())?;
        Ok(calibrated(name, camera, lens))
    };
    names.into_iter().map(camera_named).collect()
}

pub(super) fn open(folder: &Path) -> anyhow::Result<CaptureFiles> {
    let files = CalibrationFiles::read(folder)?;
    let names = files.names()?;
    let masks = MASKS.into_iter().find(|name| folder.join(name).is_dir());

    let mut builder = CaptureBuilder::new(folder);
    files.note(&names).into_iter().for_each(|note| builder.note(note));
    // The names of all frames, with numbers in the order in which they were found.
    let mut found: BTreeMap<String, usize> = BTreeMap::new();
    for name in &names {
        let images = folder.join("images").join(name);
        let frames = frames(&images)?;
        let Some(first) = frames.first() else {
            if let Some(fault) = unread_pictures(&images) {
                return Err(fault.into());
            }
            builder.note(format!("camera {name} has no photograph in images/{name}"));
            continue;
        };
        let first = find_image(&images.join(first)).expect("just listed");
        let size = match files.size(name)? {
            Some(size) => size,
            None => size_of(&first)?,
        };
        let (camera, lens) = files.camera(name, size)?;
        let index = builder.camera(name, camera, lens, false);
        for frame in frames {
            let name = format!("{name}/{frame}");
            let image = find_image_in(folder, &joined("images", &name)).expect("just listed");
            let mask = match masks {
                Some(masks) => {
                    let mask = joined(masks, &name);
                    Some(find_image_in(folder, &mask).ok_or_else(|| no_mask(&folder.join(mask)))?)
                }
                None => None,
            };
            let next = found.len();
            let number = *found.entry(frame).or_insert(next);
            builder.photo(index, number, PhotoPath { image: &image, name: &name, mask: mask.as_deref() })?;
        }
    }
    let mut numbers = vec![0; found.len()];
    for (number, frame) in sorted_names(found.keys().cloned().collect()).iter().enumerate() {
        numbers[found[frame]] = number;
    }
    builder.renumber(|found| numbers[found]);
    Ok(builder.build(even_times_s(numbers.len(), f64::from(DEFAULT_FPS)), None))
}

/// Sorts names by number if all are numbers, with or without leading zeros; else by text.
fn sorted_names(names: BTreeSet<String>) -> Vec<String> {
    let mut names: Vec<String> = names.into_iter().collect();
    if names.iter().all(|name| name.parse::<u64>().is_ok()) {
        names.sort_by_key(|name| name.parse::<u64>().expect("a number"));
    }
    names
}

/// Sorted names of the images in a folder, without extensions; none if the folder is missing.
fn frames(folder: &Path) -> Result<Vec<String>, Fault> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut frames = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        let path = entry.map_err(|error| unreadable(folder, &error))?.path();
        let stem = path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned);
        // The same search finds the file later.
        frames.extend(stem.filter(|stem| find_image(&folder.join(stem)).is_some()));
    }
    frames.sort();
    // An image in two formats is one frame.
    frames.dedup();
    Ok(frames)
}

/// The fault of a folder whose pictures are in formats that are not read.
fn unread_pictures(folder: &Path) -> Option<Fault> {
    list_folder(folder).ok()?.iter().find_map(|name| unread_picture(&folder.join(name)))
}

/// Unparsed values by their names at the top level of a file.
pub(crate) type Storage = BTreeMap<String, String>;

/// Reads the top level of a file of OpenCV's FileStorage.
pub(crate) fn parse(text: &str) -> Storage {
    let mut storage = Storage::new();
    let mut key = None;
    for line in text.lines().filter(|line| !line.starts_with(['%', '#']) && line.trim() != "---") {
        let top = (!line.starts_with([' ', '\t', '-'])).then(|| line.split_once(':')).flatten();
        if let Some((name, rest)) = top {
            let name = name.trim().trim_matches('"').to_owned();
            storage.insert(name.clone(), rest.to_owned());
            key = Some(name);
        } else if let Some(value) = key.as_ref().and_then(|key| storage.get_mut(key)) {
            value.push('\n');
            value.push_str(line);
        }
    }
    storage
}

/// Names of the cameras.
fn names(storage: &Storage) -> Option<Vec<String>> {
    let text = storage.get("names")?;
    let items = text.split(['\n', ',', '[', ']']);
    let names = items.map(|item| item.trim().trim_start_matches('-').trim().trim_matches('"').to_owned());
    Some(names.filter(|name| !name.is_empty()).collect())
}

/// Parses a number of pixels, of at least 1.
pub(crate) fn pixels(value: &str) -> Option<u32> {
    match numbers(value)?[..] {
        [side] if (1.0..=f64::from(u32::MAX)).contains(&side) => Some(side as u32),
        _ => None,
    }
}

/// Parses a matrix, a list or a number, row by row; `None` if it is malformed.
pub(crate) fn numbers(value: &str) -> Option<Vec<f64>> {
    let text = value.split_once("data:").map_or(value, |(_, data)| data);
    let mut depth = 0;
    let mut list = String::new();
    for c in text.lines().flat_map(|line| line.split('#').next().unwrap_or_default().chars().chain([' '])) {
        depth += i32::from(c == '[') - i32::from(c == ']');
        list.push(if "[],".contains(c) { ' ' } else { c });
        if c == ']' && depth <= 0 {
            break;
        }
    }
    // Items of a block begin with a dash.
    let items = list.split_whitespace().filter(|item| *item != "-");
    let parsed: Option<Vec<f64>> = items.map(|item| item.parse().ok()).collect();
    parsed.filter(|parsed| depth == 0 && !parsed.is_empty() && parsed.iter().all(|x| x.is_finite()))
}

/// Whether a value is the identity of three rows.
fn is_identity(value: &str) -> bool {
    numbers(value).is_some_and(|matrix| matrix == DMat3::IDENTITY.to_cols_array())
}

/// The rotation matrix of a Rodrigues vector: direction of the axis, length of the angle.
pub(crate) fn rodrigues(vector: &[f64]) -> [[f64; 3]; 3] {
    let vector = DVec3::new(vector[0], vector[1], vector[2]);
    DMat3::from_quat(glam::DQuat::from_scaled_axis(vector)).transpose().to_cols_array_2d()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "%YAML:1.0\n---\nnames:\n   - \"00\"\n   - \"b\"\nK_00: !!opencv-matrix\n   rows: 3\n   \
                        cols: 3\n   dt: d\n   data: [ 390., 0., 256., 0.,\n       3.9e2, 187.5, 0., 0., 1. ]\nH_00: 375\n";

    #[test]
    fn lists_numbers_and_matrices_are_read() {
        let storage = parse(TEXT);
        assert_eq!(names(&storage).unwrap(), ["00", "b"]);
        let matrix = vec![390.0, 0.0, 256.0, 0.0, 390.0, 187.5, 0.0, 0.0, 1.0];
        assert_eq!(numbers(&storage["K_00"]), Some(matrix));
        assert_eq!(pixels(&storage["H_00"]), Some(375));
        for list in ["[1, -2.5]", " [[1], [-2.5]] # both", "\n  - 1\n  - -2.5", "[1,\n -2.5]", "[1 -2.5]"] {
            assert_eq!(numbers(list), Some(vec![1.0, -2.5]), "{list}");
        }
        for malformed in ["data: [ 1, x ]", "[1, 2", "1]", "[]", "", "[.Nan]", "\n rows: 1"] {
            assert_eq!(numbers(malformed), None, "{malformed}");
        }
        assert_eq!(names(&parse("names: [ \"a\", c ]")).unwrap(), ["a", "c"]);
    }

    #[test]
    fn photographs_are_found_with_any_extension() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["1.png", "1.jpg", "2.PNG", "3.25.jpeg", "4.WebP", "notes.txt", "5"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = frames(folder.path()).unwrap();
        assert_eq!(found, ["1", "2", "3.25"]);
        assert!(found.iter().all(|name| find_image(&folder.path().join(name)).is_some()));
    }

    #[test]
    fn frames_are_sorted_by_number() {
        let order = |names: &[&str]| sorted_names(names.iter().map(|name| name.to_string()).collect());
        assert_eq!(order(&["10", "9", "0008"]), ["0008", "9", "10"]);
        assert_eq!(order(&["b10", "b9", "7"]), ["7", "b10", "b9"]);
    }

    #[test]
    fn a_quarter_turn_about_z() {
        let r = rodrigues(&[0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let expected = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        for (row, expected) in r.iter().flatten().zip(expected.iter().flatten()) {
            assert!((row - expected).abs() < 1e-12);
        }
    }
}
