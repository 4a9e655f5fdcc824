//! A small capture by an analytic ray tracer: ground truth without splatting, for fitting and evaluation.
//!
//! A figure of capsules and ellipsoids (`solid`, `figure`) with textures in its own axes (`texture`)
//! strikes with a mace, surrounded by a ring of cameras. Each image is traced (`trace`) and saved with its mask
//! and depths (`write`). Equal settings give equal bytes on every machine.

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

/// Size of the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageSettings {
    /// Number of cameras, 1 to 256.
    pub cameras: usize,
    /// Number of frames, 1 to 1000.
    pub frames: usize,
    /// Width and height of the images in pixels, 8 to 2048.
    pub size: [u32; 2],
}

/// Permitted values of [`StageSettings`].
const CAMERAS: RangeInclusive<usize> = 1..=256;
const FRAMES: RangeInclusive<usize> = 1..=1000;
const SIDE: RangeInclusive<u32> = 8..=2048;

/// Distance and heights of the cameras and the point they look at, in metres; tangent of half the field of
/// view along the shorter side of the image.
const DISTANCE: f64 = 3.0;
const HEIGHTS: [f64; 2] = [1.2, 2.2];
const TARGET: [f64; 3] = [0.0, 0.97, 0.1];
const HALF_VIEW: f64 = 0.43;

/// Cameras `HELD_FIRST`, `HELD_FIRST + HELD_STRIDE`, ... are held out.
const HELD_STRIDE: usize = 8;
const HELD_FIRST: usize = 3;

impl StageSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the value out of range.
    pub fn check(&self) -> Result<(), Fault> {
        let fault = |what: String| Err(Fault::Usage(what));
        let StageSettings { cameras, frames, size: [width, height] } = *self;
        if !CAMERAS.contains(&cameras) {
            return fault(format!("{cameras} cameras: use {} to {}", CAMERAS.start(), CAMERAS.end()));
        }
        if !FRAMES.contains(&frames) {
            return fault(format!("{frames} frames: use {} to {}", FRAMES.start(), FRAMES.end()));
        }
        if !SIDE.contains(&width) || !SIDE.contains(&height) {
            let (least, most) = (SIDE.start(), SIDE.end());
            return fault(format!("{width}x{height} pixels: use {least} to {most} for a side"));
        }
        Ok(())
    }

    /// Number of images.
    pub fn images(&self) -> usize {
        self.cameras * self.frames
    }
}

/// Whether the camera with this number is held out.
pub fn is_held(camera: usize) -> bool {
    camera % HELD_STRIDE == HELD_FIRST
}

/// The cameras, evenly spaced around the figure from the front, alternately low and high.
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
    fn values_out_of_range_are_refused() {
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
