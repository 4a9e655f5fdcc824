//! Places the cameras of a capture about their subject, where the origin of its world is too far away.
//!
//! Positions of Gaussians have 32 bits. In a world of geographic coordinates, millions of metres from its origin, these would
//! be half a metre apart. Files of captures have 64 bits, so cameras are moved before anything is computed from them.

use codec::Camera;
use glam::{DMat3, DVec3, DVec4};
use program::Fault;
use refine::capture::Focus;

use super::capture_files::CaptureFiles;
use crate::fields::FitRecord;

/// Distance of a subject from the origin, in distances of its cameras from it, beyond which cameras are moved. There, 32-bit
/// positions are 2^-16 of the cameras' distance apart, which 4K photographs begin to show.
const FARTHEST: f64 = 256.0;

impl CaptureFiles {
    /// Makes a round point near the subject the [`origin`](CaptureFiles::origin), if the capture's is far away.
    pub(super) fn move_origin(&mut self) {
        let cameras = &mut self.capture.cameras;
        let Some(origin) = origin_near(cameras.iter().map(|camera| camera.camera.clone()).collect()) else {
            return;
        };
        let moved = cameras.iter_mut().map(|camera| &mut camera.camera).chain(&mut self.file_cameras);
        moved.for_each(|camera| move_camera(camera, origin));
        self.origin = origin.to_array();
        let [x, y, z] = self.origin;
        self.notes.push(format!(
            "the subject is far from the origin, so the origin of cameras and fields is at {x} {y} {z} of its world"
        ));
    }

    /// Checks that a field was fitted with the same origin: `name`, its file. Packages do not record theirs.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it was not.
    pub(crate) fn check_origin(&self, record: &FitRecord, name: &str) -> Result<(), Fault> {
        // Other programs keep the origin of the capture.
        let assumed = (!name.ends_with(".aarc")).then_some([0.0; 3]);
        let fitted = record.recorded_origin().or(assumed);
        let Some(fitted) = fitted.filter(|fitted| *fitted != self.origin) else { return Ok(()) };
        let folder = self.folder.display();
        let point = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
        Err(Fault::Usage(format!(
            "{name} was fitted about {} of the world of its capture, and cameras of {folder} are about {}; name the capture of \
             the fit, with all its cameras, or fit the field anew",
            point(fitted),
            point(self.origin)
        )))
    }
}

/// A round point near what the cameras look at, if that is far from the origin.
fn origin_near(mut cameras: Vec<Camera>) -> Option<DVec3> {
    // Far from the origin, rounding of a rotation is a long way: the focus is found from near the first camera.
    let (rotation, translation) = parts(cameras.first()?);
    let near = -rotation.inverse() * translation;
    cameras.iter_mut().for_each(|camera| move_camera(camera, near));
    let Focus { center, distance, .. } = Focus::from_cameras(&cameras)?;
    let (center, step) = (near + center, 10_f64.powi(distance.log10().floor() as i32));
    (center.length() > FARTHEST * distance).then(|| (center / step).round() * step)
}

/// Moves a camera so that `origin` becomes the origin. The view of the world stays, whatever rounding its rotation has.
pub(super) fn move_camera(camera: &mut Camera, origin: DVec3) {
    let (rotation, translation) = parts(camera);
    let moved = rotation * origin + translation;
    (0..3).for_each(|row| camera.camera_from_world[row][3] = moved[row]);
}

/// The rotation and the translation from the world to a camera.
fn parts(camera: &Camera) -> (DMat3, DVec3) {
    let rows = camera.camera_from_world.map(DVec4::from_array);
    let [x, y, z, _] = rows.map(DVec4::truncate);
    (DMat3::from_cols(x, y, z).transpose(), DVec3::new(rows[0].w, rows[1].w, rows[2].w))
}
