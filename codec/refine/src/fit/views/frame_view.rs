//! [`FrameView`]: the viewpoint that a step renders.

use codec::Camera;

/// How far outside the image the Jacobian may be evaluated, as a fraction of tan(fov / 2).
const MARGIN: f64 = 0.3;

/// A camera at an instant.
#[derive(Clone, Copy, Debug)]
pub struct FrameView<'a> {
    /// The camera; it satisfies [`Camera::check`].
    pub camera: &'a Camera,
    /// Time in intervals since the first frame, see [`Timeline`](crate::fit::Timeline).
    pub time: f64,
}

impl FrameView<'_> {
    /// Lowest and highest x/z and y/z at which the Jacobian of the projection is evaluated:
    /// `[lowest, highest]`, each `[x/z, y/z]`.
    pub(in crate::fit) fn slope_limits(&self) -> [[f64; 2]; 2] {
        let camera = self.camera;
        let focal = [camera.k[0][0], camera.k[1][1]];
        let principal = [camera.k[0][2], camera.k[1][2]];
        let size = [f64::from(camera.width), f64::from(camera.height)];
        let margin = |axis: usize| MARGIN * 0.5 * size[axis] / focal[axis];
        [
            [0, 1].map(|axis| -principal[axis] / focal[axis] - margin(axis)),
            [0, 1].map(|axis| (size[axis] - principal[axis]) / focal[axis] + margin(axis)),
        ]
    }
}
