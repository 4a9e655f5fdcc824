//! The views in which variants are measured.

use codec::{Camera, Clip};
use glam::UVec2;
use refine::reference::PosedView;

use crate::cameras::measured_cameras;

/// Number of views for errors, times and counts.
const PICTURES: usize = 4;

/// Number of frames of the turning head.
const TURN_FRAMES: usize = 8;

/// Frames per second of a headset, and degrees per frame of a head that looks around: 90 degrees per second.
const TURN_FPS: f64 = 90.0;
const TURN_DEG: f64 = 1.0;

/// All views of a measurement.
pub(super) struct ViewSet {
    /// Views from where people stand, each at its own instant.
    pub(super) pictures: Vec<PosedView>,
    /// Consecutive frames from the first viewpoint, while the clip plays and the head turns.
    pub(super) turn: Vec<PosedView>,
}

/// The views of a clip, for images of `size` pixels.
pub(super) fn view_set(clip: &Clip, size: UVec2) -> ViewSet {
    let cameras = measured_cameras(&clip.info, &clip.surroundings(), PICTURES, size.to_array());
    let picture = |(camera, t): (&Camera, f64)| PosedView { camera: camera.clone(), t };
    let middle = PosedView { camera: cameras[0].clone(), t: 0.5 };
    let duration_s = f64::from(clip.info.duration_s);
    let turned = |i: usize| frames_later(&middle, i as f64 - 0.5 * (TURN_FRAMES - 1) as f64, duration_s);
    ViewSet {
        pictures: cameras.iter().zip(instants()).map(picture).collect(),
        turn: (0..TURN_FRAMES).map(turned).collect(),
    }
}

/// The view of the turning head `frames` frames before `posed_view`, in a clip of `duration_s` seconds.
pub(super) fn earlier(posed_view: &PosedView, frames: usize, duration_s: f64) -> PosedView {
    if frames == 0 { posed_view.clone() } else { frames_later(posed_view, -(frames as f64), duration_s) }
}

fn frames_later(posed_view: &PosedView, frames: f64, duration_s: f64) -> PosedView {
    let t = posed_view.t + frames / (TURN_FPS * duration_s);
    PosedView { camera: turned(&posed_view.camera, (frames * TURN_DEG).to_radians()), t: t.clamp(0.0, 1.0) }
}

/// Instants of the views: the centres of equal parts of the clip.
pub(super) fn instants() -> impl ExactSizeIterator<Item = f64> {
    (0..PICTURES).map(|i| (i as f64 + 0.5) / PICTURES as f64)
}

/// The camera, turned to the right about its eye by `angle` radians.
fn turned(camera: &Camera, angle: f64) -> Camera {
    let [right, down, forward, last] = camera.camera_from_world;
    let (sin, cos) = angle.sin_cos();
    let mixed = |a: f64, b: f64| [0, 1, 2, 3].map(|i| a * right[i] + b * forward[i]);
    Camera { camera_from_world: [mixed(cos, -sin), down, mixed(sin, cos), last], ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Motion, Recipe, decoded_with};

    fn clip() -> Clip {
        let motion = Motion::Dynamic;
        let recipe = Recipe { count: 50, sh_degree: 0, motion, motion_order: 1, turning: false, seed: 3 };
        decoded_with(&recipe.field(), None, &[])
    }

    #[test]
    fn a_head_turns_about_its_eye() {
        let ViewSet { pictures, turn } = view_set(&clip(), UVec2::new(64, 48));
        let distance = |a: &PosedView, b: &PosedView| {
            let (a, b) = (a.camera.position(), b.camera.position());
            (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
        };
        for pair in turn.windows(2) {
            pair[0].camera.check().unwrap();
            assert!(distance(&pair[0], &pair[1]) < 1e-9);
            let forward = |posed_view: &PosedView| posed_view.camera.camera_from_world[2];
            let (a, b) = (forward(&pair[0]), forward(&pair[1]));
            let cos: f64 = (0..3).map(|axis| a[axis] * b[axis]).sum();
            assert!((cos.acos().to_degrees() - TURN_DEG).abs() < 1e-3);
            assert!(pair[0].t < pair[1].t);
        }
        assert!(pictures.windows(2).all(|pair| distance(&pair[0], &pair[1]) > 1e-3));
    }
}
