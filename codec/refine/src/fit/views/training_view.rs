//! [`TrainingView`]: one sample of the training set.

use codec::Camera;

use super::{FrameView, Photograph};

/// A photograph with its camera and time, as calibrated.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// Number of the camera in the capture.
    pub camera_id: usize,
    /// The camera; its image has the size of the photograph.
    pub camera: Camera,
    /// Time in intervals since the first frame, see [`Timeline`](crate::fit::Timeline).
    pub time: f64,
    /// The photograph.
    pub photograph: Photograph,
}

impl TrainingView {
    /// The view with pixels `factor` times as large; the remainder at the right and bottom is cut off.
    ///
    /// # Panics
    /// If `factor` is 0.
    pub fn shrunk(&self, factor: u32) -> TrainingView {
        let photograph = self.photograph.shrunk(factor);
        let mut camera = self.camera.clone();
        (camera.width, camera.height) = (photograph.width, photograph.height);
        camera.k.iter_mut().take(2).flatten().for_each(|x| *x /= f64::from(factor));
        TrainingView { camera, photograph, ..*self }
    }

    /// Where a point of the world is in the image, in pixels from its corner; `None` outside.
    pub(in crate::fit) fn place_of(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let camera = &self.camera;
        let row = |r: usize| {
            let row = camera.camera_from_world[r];
            row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3]
        };
        let depth = row(2);
        let at = [0, 1].map(|axis| camera.k[axis][axis] * row(axis) / depth + camera.k[axis][2]);
        let size = [camera.width, camera.height];
        let is_inside = depth > 0.0 && (0..2).all(|axis| (0.0..f64::from(size[axis])).contains(&at[axis]));
        is_inside.then_some(at)
    }

    /// Index of the pixel that shows a point of the world; `None` outside the image.
    pub fn pixel_of(&self, point: [f64; 3]) -> Option<usize> {
        self.place_of(point).map(|[x, y]| y as usize * self.camera.width as usize + x as usize)
    }

    /// Viewpoint from which the photograph was taken.
    pub fn view(&self) -> FrameView<'_> {
        FrameView { camera: &self.camera, time: self.time }
    }
}
