//! A small capture by an analytic ray tracer: ground truth without splatting, for fitting and evaluation.
//!
//! A figure of capsules and ellipsoids (`solid`, `figure`) with textures in its own axes (`texture`)
//! strikes with a mace, again and again in other ways (`motion`), on request on a floor beside a chair (`props`),
//! surrounded by a ring of cameras. Each image is traced (`trace`) and saved with its mask and depths (`write`).
//! Equal settings give equal bytes on every machine.

mod figure;
mod motion;
mod props;
mod solid;
mod texture;
mod trace;
mod write;

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use codec::Camera;
use figure::figure;
use program::Fault;

pub(super) use figure::FigurePart;
pub(super) use motion::Motion;
pub(super) use texture::{noise, split_mix, unit};
pub(super) use trace::{PixelSamples, Rays, is_shaded, sample_pixel};
pub use write::write;
pub(super) use write::{mask_png, name};

/// Size of the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageSettings {
    /// Number of cameras, 1 to 256.
    pub cameras: usize,
    /// Number of frames, 1 to 100,000. Up to 33 show one step and blow; of more, another begins every 32 frames.
    pub frames: usize,
    /// Width and height of the images in pixels, 8 to 2048.
    pub size: [u32; 2],
    /// Whether a floor and a chair stand still around the figure.
    pub props: bool,
}

/// Frames per second of the figure's movement in captures of more than 33 frames.
pub(super) const FPS: u32 = 30;

/// Permitted values of [`StageSettings`].
const CAMERAS: RangeInclusive<usize> = 1..=256;
const FRAMES: RangeInclusive<usize> = 1..=100_000;
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
        let StageSettings { cameras, frames, size: [width, height], .. } = *self;
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

/// All parts at `frame`, see [`Motion::pose`].
pub(super) fn subject(settings: &StageSettings, motion: &Motion, frame: f64) -> Vec<FigurePart> {
    let mut parts = figure(&motion.pose(frame));
    if settings.props {
        parts.extend(props::props());
    }
    parts
}

/// The cameras, evenly spaced around the figure from the front, alternately low and high.
pub(super) fn rig(settings: &StageSettings) -> Vec<Camera> {
    let [width, height] = settings.size;
    let half_y = HALF_VIEW * f64::from(height) / f64::from(width.min(height));
    let camera = |number: usize| {
        let (sin, cos) = libm::sincos(TAU * number as f64 / settings.cameras as f64);
        let position = [DISTANCE * sin, HEIGHTS[number % 2], DISTANCE * cos];
        Camera::look_at(position, TARGET, [0.0, 1.0, 0.0], 2.0 * libm::atan(half_y), width, height)
    };
    (0..settings.cameras).map(camera).collect()
}

/// The cameras with their masks of `frame`, and how high the figure is then, in metres.
#[cfg(test)]
pub(crate) fn silhouettes(settings: &StageSettings, frame: f64) -> (Vec<(Camera, Vec<u8>)>, f64) {
    let parts = subject(settings, &Motion::new(settings.frames), frame);
    let end = |along: glam::DVec3| {
        let reach =
            |part: &FigurePart| along.dot(part.center) + part.solid.support(part.axes.transpose() * along);
        parts.iter().map(reach).fold(f64::NEG_INFINITY, f64::max)
    };
    let masks = rig(settings).into_iter().map(|camera| {
        let mask = trace::trace(&parts, &camera).mask;
        (camera, mask)
    });
    (masks.collect(), end(glam::DVec3::Y) + end(glam::DVec3::NEG_Y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use trace::trace;

    #[test]
    fn values_out_of_range_are_refused() {
        let settings = StageSettings { cameras: 8, frames: 9, size: [64, 64], props: false };
        assert!(settings.check().is_ok());
        for wrong in [
            StageSettings { cameras: 0, ..settings },
            StageSettings { frames: 0, ..settings },
            StageSettings { frames: 100_001, ..settings },
            StageSettings { size: [64, 7], ..settings },
            StageSettings { size: [4096, 64], ..settings },
        ] {
            assert_eq!(wrong.check().unwrap_err().exit_code(), 2);
        }
    }

    #[test]
    fn every_camera_sees_the_whole_figure_at_all_times() {
        for size in [[32, 32], [45, 30], [30, 45]] {
            let settings = StageSettings { cameras: 7, frames: 5, size, props: false };
            let (cameras, motion) = (rig(&settings), Motion::new(5));
            for frame in [0.0, 2.0, 4.0] {
                for camera in &cameras {
                    camera.check().unwrap();
                    let mask = trace(&subject(&settings, &motion, frame), camera).mask;
                    let [width, height] = size.map(|side| side as usize);
                    let on_edge = |i: usize| {
                        [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width))
                    };
                    let seen = mask.iter().filter(|mask| **mask > 0).count();
                    assert!((0..mask.len()).all(|i| !on_edge(i) || mask[i] == 0), "{size:?} {frame}");
                    assert!(seen * 25 > mask.len() && seen * 3 < mask.len(), "{seen} of {}", mask.len());
                }
            }
        }
    }

    /// Distance by which the parts lie inside the image's edges, negative outside.
    fn margin(parts: &[FigurePart], camera: &Camera) -> f64 {
        let row = |r: usize| DVec3::from_slice(&camera.camera_from_world[r][..3]);
        let position = DVec3::from(camera.position());
        let planes = (0..4).map(|edge| {
            let axis = edge / 2;
            let outward = row(axis) * if edge % 2 == 0 { 1.0 } else { -1.0 };
            (outward - row(2) * (camera.k[axis][2] / camera.k[axis][axis])).normalize()
        });
        let outside = planes.flat_map(|normal| {
            parts.iter().map(move |part| {
                normal.dot(part.center - position) + part.solid.support(part.axes.transpose() * normal)
            })
        });
        -outside.fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn every_camera_sees_the_whole_figure_and_what_stands_around_it_for_minutes() {
        let motion = Motion::new(3600);
        for cameras in [7, 12] {
            let settings = StageSettings { cameras, frames: 3600, size: [72, 72], props: true };
            let rig = rig(&settings);
            for frame in (0..3600).step_by(3) {
                let parts = subject(&settings, &motion, f64::from(frame));
                for (number, camera) in rig.iter().enumerate() {
                    let margin = margin(&parts, camera);
                    assert!(margin > 0.0, "frame {frame}, camera {number} of {cameras}: {margin} m");
                }
            }
        }
    }

    #[test]
    fn floor_and_chair_stand_still_in_view() {
        let with = StageSettings { cameras: 8, frames: 1200, size: [48, 48], props: true };
        let without = StageSettings { props: false, ..with };
        let motion = Motion::new(1200);
        let figure_parts = subject(&without, &motion, 0.0).len();
        let centers = |frame: f64| -> Vec<DVec3> {
            subject(&with, &motion, frame)[figure_parts..].iter().map(|part| part.center).collect()
        };
        assert!(centers(0.0).len() > 5);
        for frame in (0..1200).step_by(7).map(f64::from) {
            assert_eq!(centers(frame), centers(0.0));
            // The soles stay above the floor's middle, which is its highest point.
            let parts = subject(&with, &motion, frame);
            let down =
                |part: &FigurePart| part.center.y - part.solid.support(part.axes.transpose() * DVec3::NEG_Y);
            let floor = &parts[figure_parts];
            let top = floor.center.y + floor.solid.support(DVec3::Y);
            let sole = parts[..figure_parts].iter().map(down).fold(1.0, f64::min);
            assert!(sole >= top, "{sole} {top}");
        }
        for (number, camera) in rig(&with).iter().enumerate() {
            let frame = 100.0 * number as f64;
            let [more, less] =
                [with, without].map(|settings| trace(&subject(&settings, &motion, frame), camera).depths);
            let added = more.iter().zip(&less).filter(|(more, less)| **more > 0 && **less == 0).count();
            assert!(added > 60, "camera {number}: {added} pixels of floor and chair");
        }
    }
}
