//! Reads any bytes as the files of a capture: cameras in every layout, photographs, depth maps.

use std::sync::OnceLock;

use refine::capture::PhotoId;
use studio::capture::CaptureFiles;

use crate::files::{InputFiles, check_refusal};
use crate::kinds::capture::*;
use crate::parts;
use crate::seeds::{easyvolcap, manifest, photograph};

/// Largest number of frames of a manifest: each takes a look-up on disk.
const FRAMES_MAX: u64 = 50;

/// Opens the capture of an input and reads its first photographs.
///
/// # Panics
/// If an accepted file is invalid, or a refusal is not one line.
// Long: one arm a kind of input.
pub fn check_capture(bytes: &[u8]) {
    static FILES: OnceLock<InputFiles> = OnceLock::new();
    let Some((kind, bytes)) = parts::split_kind(bytes, KINDS) else { return };
    let files = FILES.get_or_init(files_of_corpus);
    let folder = match kind {
        MANIFEST => {
            let manifest = serde_json::from_slice::<serde_json::Value>(bytes).ok();
            if manifest.and_then(|value| value["frames"].as_u64()).is_some_and(|frames| frames > FRAMES_MAX) {
                return;
            }
            files.put("manifest/capture.json", bytes);
            "manifest"
        }
        EASYVOLCAP => {
            let (intrinsics, extrinsics) = parts::split(bytes);
            files.put("easyvolcap/intri.yml", intrinsics);
            files.put("easyvolcap/extri.yml", extrinsics);
            "easyvolcap"
        }
        TRANSFORMS => {
            files.put("transforms/transforms.json", bytes);
            "transforms"
        }
        COLMAP_BINARY | COLMAP_TEXT => {
            let (cameras, images) = parts::split(bytes);
            let extension = if kind == COLMAP_BINARY { "bin" } else { "txt" };
            files.remove("colmap/sparse/0/cameras.bin");
            files.put(format!("colmap/sparse/0/cameras.{extension}"), cameras);
            files.put(format!("colmap/sparse/0/images.{extension}"), images);
            "colmap"
        }
        PHOTOGRAPH => {
            files.put("photograph/images/00/0.png", bytes);
            "photograph"
        }
        _ => {
            let extension = ["pfm", "npy", "png"][usize::from(kind - DEPTH_PFM)];
            for other in ["pfm", "npy", "png"] {
                files.remove(format!("depths/00/0.{other}"));
            }
            files.put(format!("depths/00/0.{extension}"), bytes);
            "depth"
        }
    };
    let capture_files = match CaptureFiles::open(&files.path(folder)) {
        Ok(capture_files) => capture_files,
        Err(error) => return check_refusal(&error),
    };
    check_cameras_and_photos(&capture_files);
    for &photo_id in capture_files.capture.photos.iter().take(2) {
        match capture_files.photo(photo_id) {
            Ok(photo) => {
                let camera = &capture_files.capture.cameras[photo_id.camera].camera;
                assert_eq!((photo.image.width, photo.image.height), (camera.width, camera.height));
                assert!(photo.image.pixels.iter().flatten().all(|x| x.is_finite()));
            }
            Err(fault) => check_refusal(&fault.into()),
        }
    }
    if folder == "depth" {
        match capture_files.depth(&files.path("depths"), PhotoId { frame: 0, camera: 0 }) {
            Ok(map) => {
                let map = map.expect("the file exists");
                assert_eq!(map.depths.len(), map.width as usize * map.height as usize);
            }
            Err(fault) => check_refusal(&fault.into()),
        }
    }
}

fn check_cameras_and_photos(capture_files: &CaptureFiles) {
    let capture = &capture_files.capture;
    for camera in &capture.cameras {
        camera.camera.check().expect("accepted cameras are valid");
    }
    let (frames, times_s) = (capture.frames(), &capture.frame_times_s);
    assert!(times_s.first() == Some(&0.0) && times_s.iter().all(|time_s| time_s.is_finite()), "{times_s:?}");
    assert!(times_s.is_sorted());
    let exists = |photo_id: &PhotoId| photo_id.camera < capture.cameras.len() && photo_id.frame < frames;
    assert!(!capture.photos.is_empty() && capture.photos.iter().all(exists));
    assert!(capture.photos.iter().all(|photo_id| capture.clip_time(*photo_id).is_finite()));
    assert!(capture_files.missing_count() <= capture.cameras.len() * frames);
}

/// A folder with the photographs that the initial corpus names.
fn files_of_corpus() -> InputFiles {
    let photograph = photograph();
    let images = ["00/0", "00/1", "01/0", "01/1"];
    let numbered = ["manifest", "easyvolcap", "photograph", "depth"];
    let photographs = numbered
        .into_iter()
        .flat_map(|layout| images.map(|image| (format!("{layout}/images/{image}.png"), photograph.clone())));
    let masks = ["manifest", "photograph"]
        .into_iter()
        .flat_map(|layout| images.map(|image| (format!("{layout}/masks/{image}.png"), photograph.clone())));
    let flat_paths =
        ["transforms/images/a.png", "transforms/images/b.png", "colmap/images/a.png", "colmap/images/b.png"];
    let flat_photographs = flat_paths.map(|path| (path.to_owned(), photograph.clone()));
    let (intrinsics, extrinsics) = easyvolcap();
    let cameras = [
        ("photograph/capture.json".to_owned(), manifest().into_bytes()),
        ("depth/intri.yml".to_owned(), intrinsics.into_bytes()),
        ("depth/extri.yml".to_owned(), extrinsics.into_bytes()),
    ];
    InputFiles::new(photographs.chain(masks).chain(flat_photographs).chain(cameras))
}
