//! A small capture by an analytic ray tracer: ground truth that owes nothing to splatting, for
//! fitting and evaluation.
//!
//! A figure of capsules and ellipsoids (`solid`, `figure`) with textures in its own axes (`texture`)
//! strikes with a mace in front of cameras in a ring. Each picture is traced (`trace`) and saved
//! with its mask and its depths (`write`). The same settings give the same bytes on every machine.

mod figure;
mod solid;
mod texture;
mod trace;
mod write;

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use codec::Camera;
use program::Fault;

pub use write::write;

/// How much is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageSettings {
    /// Number of cameras, 1 to 256.
    pub cameras: usize,
    /// Number of frames, 1 to 1000.
    pub frames: usize,
    /// Width and height of the pictures in pixels, 8 to 2048.
    pub size: [u32; 2],
}

/// What can be made.
const CAMERAS: RangeInclusive<usize> = 1..=256;
const FRAMES: RangeInclusive<usize> = 1..=1000;
const SIDE: RangeInclusive<u32> = 8..=2048;

/// Where the cameras stand and what they look at, in metres, and half of the field of view along the
/// shorter side of the picture as its tangent.
const DISTANCE: f64 = 3.0;
const HEIGHTS: [f64; 2] = [1.2, 2.2];
const TARGET: [f64; 3] = [0.0, 0.97, 0.1];
const HALF_VIEW: f64 = 0.43;

/// One of this many cameras is held out, from this one.
const HELD_STRIDE: usize = 8;
const HELD_FIRST: usize = 3;

impl StageSettings {
    /// # Errors
    /// [`Fault::Usage`] that says what is out of range.
    pub fn check(&self) -> Result<(), Fault> {
        let fault = |what: String| Err(Fault::Usage(what));
        let StageSettings { cameras, frames, size: [width, height] } = *self;
        if !CAMERAS.contains(&cameras) {
            return fault(format!(
                "{cameras} cameras: there can be {} to {}",
                CAMERAS.start(),
                CAMERAS.end()
            ));
        }
        if !FRAMES.contains(&frames) {
            return fault(format!("{frames} frames: there can be {} to {}", FRAMES.start(), FRAMES.end()));
        }
        if !SIDE.contains(&width) || !SIDE.contains(&height) {
            let (least, most) = (SIDE.start(), SIDE.end());
            return fault(format!("{width}x{height} pixels: a side can have {least} to {most}"));
        }
        Ok(())
    }

    /// Number of pictures.
    pub fn images(&self) -> usize {
        self.cameras * self.frames
    }
}

/// Whether the camera with this number is held out.
pub fn is_held(camera: usize) -> bool {
    camera % HELD_STRIDE == HELD_FIRST
}

/// The cameras: evenly around the figure, the first in front of it, by turns low and high.
fn rig(settings: &StageSettings) -> Vec<Camera> {
    let [width, height] = settings.size;
    let half_y = HALF_VIEW * f64::from(height) / f64::from(width.min(height));
    let camera = |number: usize| {
        let (sin, cos) = libm::sincos(TAU * number as f64 / settings.cameras as f64);
        let position = [DISTANCE * sin, HEIGHTS[number % 2], DISTANCE * cos];
        Camera::look_at(position, TARGET, [0.0, 1.0, 0.0], 2.0 * libm::atan(half_y), width, height)
    };
    (0..settings.cameras).map(camera).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::trace;

    #[test]
    fn what_is_out_of_range_is_refused() {
        let settings = StageSettings { cameras: 8, frames: 9, size: [64, 64] };
        assert!(settings.check().is_ok());
        for wrong in [
            StageSettings { cameras: 0, ..settings },
            StageSettings { frames: 0, ..settings },
            StageSettings { frames: 1001, ..settings },
            StageSettings { size: [64, 7], ..settings },
            StageSettings { size: [4096, 64], ..settings },
        ] {
            assert_eq!(wrong.check().unwrap_err().exit_code(), 2);
        }
    }

    #[test]
    fn every_camera_sees_the_whole_figure_at_all_times() {
        for size in [[32, 32], [45, 30], [30, 45]] {
            let cameras = rig(&StageSettings { cameras: 7, frames: 5, size });
            for t in [0.0, 0.5, 1.0] {
                for camera in &cameras {
                    camera.check().unwrap();
                    let mask = trace(&figure::figure(t), camera).mask;
                    let [width, height] = size.map(|side| side as usize);
                    let on_edge = |i: usize| {
                        [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width))
                    };
                    let seen = mask.iter().filter(|mask| **mask > 0).count();
                    assert!((0..mask.len()).all(|i| !on_edge(i) || mask[i] == 0), "{size:?} {t}");
                    assert!(seen * 25 > mask.len() && seen * 3 < mask.len(), "{seen} of {}", mask.len());
                }
            }
        }
    }
}
