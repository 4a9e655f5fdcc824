//! [`Calibration`] and [`RigCamera`]: what all layouts are read to.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use codec::Camera;
use refine::capture::Lens;

use crate::capture::{pinhole, rigid, unread_note};

/// Half a pixel: what OpenCV's pixel centres lack.
const HALF_PIXEL: f64 = 0.5;

/// The calibration of a rig.
#[derive(Clone, Debug, Default)]
pub(in crate::ingest) struct Calibration {
    /// The file, or the folder of its files.
    pub(in crate::ingest) path: PathBuf,
    /// Name of its layout.
    pub(in crate::ingest) layout: &'static str,
    pub(in crate::ingest) cameras: Vec<RigCamera>,
    /// Names of cameras that cannot be read, and why, which matters if there is a video of one.
    pub(in crate::ingest) unusable: Vec<(String, String)>,
    /// Up direction of its world, if the layout has one.
    pub(in crate::ingest) up: Option<[f64; 3]>,
    /// Metres per unit of its world, if the layout says so.
    pub(in crate::ingest) metres_per_unit: Option<f64>,
}

/// A camera of a calibration; 0x0 pixels if no size is stated.
#[derive(Clone, Debug)]
pub(in crate::ingest) struct RigCamera {
    pub(in crate::ingest) name: String,
    pub(in crate::ingest) camera: Camera,
    pub(in crate::ingest) lens: Lens,
}

/// The warning on keys of the cameras at `path` that are not read.
pub(super) fn unread_warning(path: &Path, keys: &BTreeSet<String>) -> Option<String> {
    unread_note(&format!("{} states", path.display()), keys.iter().map(String::as_str))
}

/// A camera of OpenCV's numbers: focal lengths and principal point, rotation from the world to the camera, row by row,
/// translation.
pub(super) fn opencv_camera(
    size: (u32, u32),
    [fx, fy, cx, cy]: [f64; 4],
    rotation: [[f64; 3]; 3],
    t: [f64; 3],
) -> Camera {
    pinhole(size, [fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL], rigid(rotation, t))
}
