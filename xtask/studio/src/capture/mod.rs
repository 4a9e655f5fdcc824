//! Reads captures from disk. Each supported layout has a file here; `xtask/CAPTURE.md` specifies them.

mod camera_part;
mod capture_files;
mod colmap;
mod corrections;
mod depth;
mod easyvolcap;
mod fitted;
mod image_file;
mod manifest;
mod part;
mod photo_paths;
mod transforms;
mod video;

use std::path::Path;

use anyhow::bail;
use program::Fault;
use refine::capture::CalibratedCamera;

pub use camera_part::CameraPart;
pub use capture_files::CaptureFiles;
pub use corrections::{CameraCorrection, CameraCorrections};
#[cfg(feature = "onnx")]
pub use depth::pfm_file;
use image_file::{bad, bad_layout};
pub use image_file::{find_image, read_picture};

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
        let capture_files = if folder.join(manifest::FILE).is_file() {
            manifest::open(folder)?
        } else if folder.join(easyvolcap::INTRINSICS).is_file() {
            easyvolcap::open(folder)?
        } else if let Some(files) = transforms::files(folder) {
            transforms::open(folder, &files)?
        } else if let Some(model) = colmap::model(folder) {
            colmap::open(folder, &model)?
        } else {
            bail!(Fault::Data(format!(
                "{}: no capture: it has no {}, {}, transforms.json or COLMAP model; xtask/CAPTURE.md describes them",
                folder.display(),
                manifest::FILE,
                easyvolcap::INTRINSICS
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
            false => Ok(capture_files),
        }
    }
}
