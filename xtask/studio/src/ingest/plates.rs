//! Clean plates: what each camera shows without the subject. They are the medians of pictures spread over the camera's video,
//! or of a video without the subject, or a picture without it.

use std::path::{Path, PathBuf};

use image::RgbImage;
use program::Fault;
use rayon::prelude::*;
use refine::matte::Plate;
use serde::{Deserialize, Serialize};

use super::matching::matches;
use super::videos::{self, RigVideo};
use crate::capture::{Video, bad, median_frames, read_file_image};
use crate::messages::unreadable;

/// Fewest pictures of a median, if a video has as many.
const PICTURES_MIN: usize = 5;

/// Cameras whose pictures are in memory at a time.
const CAMERAS_MAX: usize = 4;

/// File extensions of pictures.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// What a plate is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlateSource {
    /// The median of the video itself, subject and all.
    Median,
    /// The median of a video without the subject.
    EmptyVideo,
    /// A picture without the subject.
    EmptyPicture,
}

/// The file of a plate.
#[derive(Clone, Debug)]
pub(super) struct PlateFile {
    pub(super) path: PathBuf,
    pub(super) source: PlateSource,
}

/// The file of the plate of each video: the video itself, or the file of its name in `folder`.
///
/// # Errors
/// [`Fault::Data`] if the folder cannot be read, or lacks a plate or has two of a camera.
pub(super) fn find(videos: &[RigVideo], folder: Option<&Path>) -> Result<Vec<PlateFile>, Fault> {
    let Some(folder) = folder else {
        let median = |video: &RigVideo| PlateFile { path: video.path.clone(), source: PlateSource::Median };
        return Ok(videos.iter().map(median).collect());
    };
    let files = files(folder)?;
    let names: Vec<&str> = videos.iter().map(|video| video.name.as_str()).collect();
    let mut plates: Vec<Option<PlateFile>> = vec![None; videos.len()];
    let stems: Vec<String> = files
        .iter()
        .map(|file| file.path.file_stem().unwrap_or_default().to_string_lossy().into_owned())
        .collect();
    let stems: Vec<&str> = stems.iter().map(String::as_str).collect();
    for (file, found) in files.into_iter().zip(matches(&stems, &names)) {
        // Other files do no harm: a camera that lacks its own is named below.
        let [camera] = found[..] else { continue };
        if let Some(other) = &plates[camera] {
            let (other, video) = (other.path.display(), names[camera]);
            return Err(bad(
                &file.path,
                format!("{other} is the plate of {video}, too; leave one of the two"),
            ));
        }
        plates[camera] = Some(file);
    }
    let found = |(plate, name): (Option<PlateFile>, &str)| {
        plate.ok_or_else(|| {
            bad(folder, format!("there is no plate of {name} in it; put {name}.png or {name}.mp4 there"))
        })
    };
    plates.into_iter().zip(names).map(found).collect()
}

/// Pictures and videos in a folder, by name.
fn files(folder: &Path) -> Result<Vec<PlateFile>, Fault> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        let path = entry.map_err(|error| unreadable(folder, &error))?.path();
        let extension = path.extension().and_then(|x| x.to_str()).unwrap_or_default().to_lowercase();
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        let source = match extension.as_str() {
            extension if EXTENSIONS.contains(&extension) => PlateSource::EmptyPicture,
            extension if videos::EXTENSIONS.contains(&extension) => PlateSource::EmptyVideo,
            _ => continue,
        };
        if !is_hidden && path.is_file() {
            files.push(PlateFile { path, source });
        }
    }
    files.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(files)
}

/// The pictures that a plate of a camera of this size is made of.
///
/// # Errors
/// [`Fault::Data`] if the file cannot be decoded or has another size.
fn pictures(file: &PlateFile, video: &RigVideo) -> Result<Vec<RgbImage>, Fault> {
    let (width, height) = video.probe.size;
    let check = |(w, h): (u32, u32)| match (w, h) == (width, height) {
        true => Ok(()),
        false => Err(bad(
            &file.path,
            format!(
                "{w}x{h} pixels, but {} has {width}x{height}; record the plate with the settings of the video",
                video.path.display()
            ),
        )),
    };
    if file.source == PlateSource::EmptyPicture {
        let picture = read_file_image(&file.path)?.into_rgb8();
        check(picture.dimensions())?;
        return Ok(vec![picture]);
    }
    let opened = Video::open(&file.path)?;
    check(opened.size)?;
    let frames = median_frames(opened.times_s.len(), width as usize * height as usize, PICTURES_MIN);
    frames.into_iter().map(|frame| opened.frame(frame)).collect()
}

/// Makes the plates of cameras. Files of [`CAMERAS_MAX`] of them are decoded at a time, into as many
/// pictures each as [`median_frames`] says.
///
/// # Errors
/// Those of decoding, and of sizes.
pub(super) fn make(cameras: &[(&PlateFile, &RigVideo)]) -> Result<Vec<Plate>, Fault> {
    let mut plates = Vec::new();
    for cameras in cameras.chunks(CAMERAS_MAX) {
        let decoded = cameras.par_iter().map(|(file, video)| pictures(file, video));
        let decoded = decoded.collect::<Result<Vec<Vec<RgbImage>>, Fault>>()?;
        plates.extend(decoded.iter().zip(cameras).map(|(pictures, (file, video))| {
            let (width, pixels) = (video.probe.size.0 as usize, pictures.iter().map(colors));
            let plate = Plate::from_pictures(&pixels.collect::<Vec<&[[u8; 3]]>>(), width);
            // The noise of another video, which may be a still, is not the noise of this video.
            if file.source == PlateSource::EmptyVideo {
                Plate::from_pictures(&[plate.colors()], width)
            } else {
                plate
            }
        }));
    }
    Ok(plates)
}

/// The pixels of a picture.
pub(super) fn colors(picture: &RgbImage) -> &[[u8; 3]] {
    picture.as_raw().as_chunks().0
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::videos::tests::video;
    use super::*;

    #[test]
    fn each_camera_has_one_plate() {
        let folder = tempfile::tempdir().unwrap();
        let videos = [video("cam01", 25.0), video("cam02", 25.0)];
        let put = |name: &str| fs::write(folder.path().join(name), b"").unwrap();
        let find = || find(&videos, Some(folder.path())).map_err(|fault| fault.to_string());
        put("Cam 01 empty.JPG");
        put("notes.txt");
        assert!(find().unwrap_err().contains("there is no plate of cam02 in it; put cam02.png or cam02.mp4"));
        put("cam02.mov");
        let found: Vec<PlateSource> = find().unwrap().iter().map(|file| file.source).collect();
        assert_eq!(found, [PlateSource::EmptyPicture, PlateSource::EmptyVideo]);
        put("cam2_02.png");
        put("cam02.png");
        assert!(find().unwrap_err().contains("is the plate of cam02, too; leave one of the two"));
        assert!(super::find(&videos, Some(Path::new("/nowhere"))).is_err());
    }
}
