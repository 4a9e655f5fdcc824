//! [`Workload`]: the frames that every player draws.

use std::path::Path;

use codec::{Camera, ClipInfo, Viewpoint};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Angle in degrees by which the camera swings to either side.
const SWING: f64 = 10.0;

/// Frames of one size.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Workload {
    /// Width of the images in pixels.
    pub(crate) width: u32,
    /// Height of the images in pixels.
    pub(crate) height: u32,
    /// The frames in playing order.
    pub(crate) frames: Vec<WorkFrame>,
}

/// A frame to draw.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct WorkFrame {
    /// Clip time, in `[0, 1]`.
    pub(crate) t: f64,
    /// The camera.
    pub(crate) camera: Camera,
}

impl Workload {
    /// `count` frames while the camera swings around the target of `viewpoint`. `t` maps the progress of the
    /// swing, in `[0, 1]`, to clip time.
    pub(crate) fn swinging(
        viewpoint: &Viewpoint,
        info: &ClipInfo,
        [width, height]: [u32; 2],
        count: usize,
        t: impl Fn(f64) -> f64,
    ) -> Workload {
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let (target, up) = (vector(viewpoint.target), vector(info.up).normalize_or(DVec3::Y));
        let arm = vector(viewpoint.position) - target;
        let frame = |i: usize| {
            let progress = (i as f64 + 0.5) / count as f64;
            let turn = DQuat::from_axis_angle(up, SWING.to_radians() * (2.0 * progress - 1.0));
            let position = target + turn * arm;
            let camera = Camera::look_at(
                position.to_array(),
                target.to_array(),
                up.to_array(),
                f64::from(viewpoint.fov_y),
                width,
                height,
            );
            WorkFrame { t: t(progress), camera }
        };
        Workload { width, height, frames: (0..count).map(frame).collect() }
    }

    /// Reads the work from a folder.
    pub(crate) fn read(folder: &Path) -> anyhow::Result<Workload> {
        Ok(serde_json::from_slice(&std::fs::read(folder.join(FILE))?)?)
    }

    /// Writes the work to a folder.
    pub(crate) fn write(&self, folder: &Path) -> anyhow::Result<()> {
        Ok(std::fs::write(folder.join(FILE), serde_json::to_vec(self)?)?)
    }
}

/// File name of the work, in the folder of the fields; `web/page.js` fetches it.
const FILE: &str = "work.json";
