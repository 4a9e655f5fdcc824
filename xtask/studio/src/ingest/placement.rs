//! [`Placement`]: which way is up, how large a unit is, and where the origin is. What is assumed is said.

use codec::Camera;
use formats::up_of;
use program::Fault;
use refine::capture::common_point;
use serde::Serialize;

use super::calibration::{Calibration, RigCamera};
use super::options::{IngestOptions, UpSource};
use crate::messages::decimal;

/// Where a rig is in its world.
#[derive(Clone, Debug, Serialize)]
pub struct Placement {
    /// Up direction, of length 1.
    pub up: [f64; 3],
    /// Metres per unit, if stated.
    pub metres_per_unit: Option<f64>,
    /// The point that is nearest to the axes of all cameras; `None` if these are parallel, or look away from it.
    pub focus: Option<[f64; 3]>,
    /// What the numbers come from, in sentences.
    pub notes: Vec<String>,
}

/// Moves the origin of `cameras` where asked, and finds the rest.
///
/// # Errors
/// [`Fault::Usage`] if the calibration lacks what an option asks for.
pub(super) fn place(
    cameras: &mut [RigCamera],
    calibration: &Calibration,
    options: &IngestOptions,
) -> Result<Placement, Fault> {
    if let Some(origin) = options.origin {
        cameras.iter_mut().for_each(|camera| move_origin(&mut camera.camera, origin));
    }
    let mut notes = Vec::new();
    let layout = calibration.layout;
    let of_cameras = || up_of(cameras.iter().map(|camera| &camera.camera)).map(|up| up.map(f64::from));
    let up = match options.up {
        Some(UpSource::Stated(up)) => up,
        Some(UpSource::Calibration) => calibration.up.ok_or_else(|| {
            Fault::Usage(format!(
                "--up calibration: a calibration of the layout {layout} has no up; use --up cameras or --up X,Y,Z"
            ))
        })?,
        None if calibration.up.is_some() => {
            notes.push(format!("up is that of the calibration ({layout}); --up states another"));
            calibration.up.unwrap_or_default()
        }
        Some(UpSource::Cameras) | None => {
            let up = of_cameras().ok_or_else(|| {
                Fault::Usage("the up directions of the cameras cancel out; state it with --up X,Y,Z".into())
            })?;
            if options.up.is_none() {
                notes.push(format!(
                    "up is assumed to be the mean of the cameras', {}; --up states another",
                    up.map(|x| decimal(x, 3)).join(", ")
                ));
            }
            up
        }
    };
    let metres_per_unit = options.metres_per_unit.or(calibration.metres_per_unit);
    match (options.metres_per_unit.or(options.height_m), calibration.metres_per_unit) {
        (Some(_), _) => {}
        (None, Some(_)) => notes.push(format!("lengths are metres: the calibration ({layout}) states its unit")),
        (None, None) => notes.push(
            "a unit of the calibration is assumed to be a metre; --metres-per-unit or --height states another"
                .into(),
        ),
    }
    let focus = common_point(cameras.iter().map(|camera| &camera.camera));
    Ok(Placement { up, metres_per_unit, focus: focus.map(|focus| focus.to_array()), notes })
}

/// Makes a point of the world its origin.
fn move_origin(camera: &mut Camera, origin: [f64; 3]) {
    for row in camera.camera_from_world.iter_mut().take(3) {
        row[3] += (0..3).map(|axis| row[axis] * origin[axis]).sum::<f64>();
    }
}

#[cfg(test)]
mod tests {
    use refine::capture::Lens;

    use super::*;

    fn ring(center: [f64; 3]) -> Vec<RigCamera> {
        let camera = |i: usize| {
            let (sin, cos) = libm::sincos(i as f64);
            let position = [center[0] + 3.0 * sin, center[1] + 1.0, center[2] + 3.0 * cos];
            let camera = Camera::look_at(position, center, [0.0, 1.0, 0.0], 0.8, 64, 48);
            RigCamera { name: i.to_string(), camera, lens: Lens::default() }
        };
        (0..5).map(camera).collect()
    }

    #[test]
    fn cameras_keep_looking_at_a_point_that_becomes_the_origin() {
        let mut cameras = ring([10.0, 0.0, 0.0]);
        cameras.iter_mut().for_each(|camera| move_origin(&mut camera.camera, [10.0, 0.0, 0.0]));
        let focus = common_point(cameras.iter().map(|camera| &camera.camera)).unwrap();
        assert!(focus.length() < 1e-9, "{focus}");
    }
}
