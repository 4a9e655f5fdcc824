//! [`CameraCorrections`]: a file of what a fit learned of the cameras of a capture, and what it changes there.
//!
//! `fit` writes it beside the field, and commands that compare the field with photographs read it there.

use std::path::Path;

use codec::Camera;
use glam::DVec3;
use program::Fault;
use refine::capture::{CalibratedCamera, Response};
use serde::{Deserialize, Serialize};

use super::capture_files::CaptureFiles;
use super::image_file::{bad, read_text};
use super::origin::move_camera;
use super::part::scaled;

/// The cameras of a capture as a fit learned them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraCorrections {
    /// The point of the capture's world that is their origin; `None` in a file that does not say it.
    #[serde(default)]
    pub origin: Option<[f64; 3]>,
    /// In the order of the capture.
    pub cameras: Vec<CameraCorrection>,
}

/// A camera as a fit learned it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraCorrection {
    /// Name in the capture.
    pub id: String,
    /// Seconds by which its photographs are later than their frames.
    pub time_offset_s: f64,
    /// Rigid transform from the world to the camera.
    pub w2c: [[f64; 4]; 4],
    /// Factor of the focal lengths that the capture states.
    pub focal_factor: f64,
    /// How it shows colours.
    pub response: Response,
}

impl CameraCorrections {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Fault::Data`] that names it.
    pub fn read(path: &Path) -> Result<CameraCorrections, Fault> {
        serde_json::from_str(&read_text(path)?).map_err(|error| unusable(path, error))
    }

    /// The file.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers and names") + "\n"
    }
}

impl CaptureFiles {
    /// The cameras as they are.
    pub fn corrections(&self) -> CameraCorrections {
        let correction = |(i, camera): (usize, &CalibratedCamera)| CameraCorrection {
            id: camera.name.clone(),
            time_offset_s: camera.time_offset_s,
            w2c: camera.camera.camera_from_world,
            focal_factor: self.focal_factor(i, &camera.camera),
            response: camera.response,
        };
        let origin = Some(self.origin);
        CameraCorrections {
            origin,
            cameras: self.capture.cameras.iter().enumerate().map(correction).collect(),
        }
    }

    /// The factor of the focal lengths of a camera against those that the capture states.
    pub fn focal_factor(&self, camera: usize, corrected: &Camera) -> f64 {
        let stated = scaled(&self.file_cameras[camera], corrected.width, corrected.height);
        corrected.k[1][1] / stated.k[1][1]
    }

    /// Corrects the cameras that `corrections` name, from their origin to the capture's; `path` is the path of their file, for
    /// messages.
    ///
    /// # Errors
    /// [`Fault::Data`] if they name none of the capture's, do not say about which origin they are where the capture's was moved,
    /// or a camera would be invalid.
    pub fn correct(&mut self, corrections: &CameraCorrections, path: &Path) -> Result<(), Fault> {
        let to = DVec3::from(self.origin);
        let moved = match corrections.origin {
            Some(from) => to - DVec3::from(from),
            None if to == DVec3::ZERO => DVec3::ZERO,
            None => return Err(unusable(path, "it does not say the origin of its cameras")),
        };
        let mut is_any = false;
        for (i, CalibratedCamera { name, camera, time_offset_s, response, .. }) in
            self.capture.cameras.iter_mut().enumerate()
        {
            let Some(learned) = corrections.cameras.iter().find(|learned| learned.id == *name) else {
                continue;
            };
            is_any = true;
            let stated = scaled(&self.file_cameras[i], camera.width, camera.height);
            camera.camera_from_world = learned.w2c;
            move_camera(camera, moved);
            (0..2).for_each(|axis| camera.k[axis][axis] = stated.k[axis][axis] * learned.focal_factor);
            let numbers = [learned.response.color.as_flattened(), &[learned.response.vignette]].concat();
            if !(learned.time_offset_s.is_finite() && numbers.iter().all(|x| x.is_finite())) {
                return Err(unusable(path, format!("camera {name}: a number is not finite")));
            }
            let vignette = learned.response.vignette;
            if vignette <= -1.0 {
                let problem =
                    format!("camera {name}: its vignette {vignette} leaves no light in the corners");
                return Err(unusable(path, problem));
            }
            camera.check().map_err(|problem| unusable(path, format!("camera {name}: {problem}")))?;
            *time_offset_s = learned.time_offset_s;
            *response = learned.response;
        }
        self.is_corrected = true;
        match is_any {
            true => Ok(()),
            false => Err(bad(path, "it names no camera of this capture; name the file of its fit")),
        }
    }

    /// Whether the cameras are other ones than the capture states, by [`CaptureFiles::correct`].
    pub fn is_corrected(&self) -> bool {
        self.is_corrected
    }
}

fn unusable(path: &Path, problem: impl std::fmt::Display) -> Fault {
    bad(path, format!("{problem}; remove it to use the cameras of the capture, or fit again"))
}
