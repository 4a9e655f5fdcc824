//! [`Calibration`] and [`RigCamera`]: what all layouts are read to.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use codec::Camera;
use formats::list_of;
use glam::DMat3;
use refine::capture::Lens;

/// Half a pixel: what OpenCV's pixel centres lack.
const HALF_PIXEL: f64 = 0.5;

/// The calibration of a rig.
#[derive(Clone, Debug)]
pub(in crate::ingest) struct Calibration {
    /// The file, or the folder of its files.
    pub(in crate::ingest) path: PathBuf,
    /// Name of its layout.
    pub(in crate::ingest) layout: &'static str,
    pub(in crate::ingest) cameras: Vec<RigCamera>,
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
    let keys = list_of(keys.iter().map(String::as_str))?;
    Some(format!("{} states what is not read: {keys}", path.display()))
}

/// A camera of OpenCV's numbers: focal lengths and principal point, rotation from the world to the camera, translation.
pub(super) fn opencv_camera(
    size: (u32, u32),
    [fx, fy, cx, cy]: [f64; 4],
    rotation: DMat3,
    t: [f64; 3],
) -> Camera {
    let row = |i: usize| {
        let row = rotation.row(i);
        [row.x, row.y, row.z, t[i]]
    };
    Camera {
        width: size.0,
        height: size.1,
        k: [[fx, 0.0, cx + HALF_PIXEL], [0.0, fy, cy + HALF_PIXEL], [0.0, 0.0, 1.0]],
        camera_from_world: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    }
}
