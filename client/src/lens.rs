//! [`Lens`]: what a headset shows to two eyes, without a headset: its angles and the size of its images. And
//! [`Standpoint`]: where its wearer stands.
//!
//! Fragments of a frame depend on both, so that counts compare only if they are taken through the same lens
//! from the same place.

use clap::ValueEnum;
use codec::{Camera, Clip, Viewpoint};
use glam::{DMat4, DVec3, UVec2, dvec3};

use crate::subject::Subject;
use crate::view::{Fov, View};

/// Height of the eyes of a standing person above the ground, in metres.
const EYE_HEIGHT_M: f64 = 1.6;

/// Height at which a person who stands before a clip looks, as a fraction of the clip's height: that of a chest.
const GAZE_HEIGHT: f64 = 0.75;

/// A headset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Lens {
    /// Meta Quest 3 at its default lens distance.
    Quest3,
}

/// Where the wearer of a headset stands and looks, on a clip of life size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standpoint {
    /// At arm's length, 0.7 m in front of the centre.
    Near,
    /// 2 m in front of the centre.
    Standing,
    /// In the centre, looking level in the direction of the first viewpoint.
    Inside,
}

impl Lens {
    /// Size in pixels of the image that the headset recommends for an eye.
    pub fn size(self) -> UVec2 {
        match self {
            Lens::Quest3 => UVec2::new(1680, 1760),
        }
    }

    /// The angles of the left and the right eye, which are mirrored. Both eyes look straight ahead.
    fn angles(self) -> [Fov; 2] {
        let left = match self {
            Lens::Quest3 => Fov {
                left: -54f32.to_radians(),
                right: 40f32.to_radians(),
                up: 42f32.to_radians(),
                down: -55f32.to_radians(),
            },
        };
        [left, Fov { left: -left.right, right: -left.left, ..left }]
    }

    /// The views of the left and the right eye of a viewer of `clip` at `standpoint`, or else at `viewpoint`, in
    /// images of `size` pixels.
    pub fn views(
        self,
        clip: &Clip,
        viewpoint: &Viewpoint,
        standpoint: Option<Standpoint>,
        size: UVec2,
    ) -> [View; 2] {
        let subject = Subject::of(clip);
        let head = match standpoint {
            Some(standpoint) => standpoint.camera(&subject, clip.info.up),
            None => viewpoint.camera(clip.info.up, 1, 1),
        };
        let eyes = head.stereo_pair(Camera::EYE_DISTANCE_M / subject.metres_per_unit);
        let angles = self.angles();
        [0, 1].map(|i| {
            let view_from_world = DMat4::from_cols_array_2d(&eyes[i].camera_from_world).transpose();
            View::from_angles(view_from_world, angles[i], size).expect("a lens has an image")
        })
    }
}

impl Standpoint {
    /// Level distance from the clip's centre, in metres.
    pub(crate) fn distance_m(self) -> f64 {
        match self {
            Standpoint::Near => 0.7,
            Standpoint::Standing => 2.0,
            Standpoint::Inside => 0.0,
        }
    }

    /// A camera midway between the eyes; only its pose counts. `up` is that of the clip.
    fn camera(self, subject: &Subject, up: [f32; 3]) -> Camera {
        let eye_m = dvec3(0.0, EYE_HEIGHT_M, self.distance_m());
        let target_m = match self {
            Standpoint::Near | Standpoint::Standing => dvec3(0.0, GAZE_HEIGHT * subject.height_m, 0.0),
            Standpoint::Inside => dvec3(0.0, EYE_HEIGHT_M, -1.0),
        };
        let [eye, target] = [eye_m, target_m].map(|point| subject.in_clip(point).to_array());
        let up = DVec3::from(up.map(f64::from)).try_normalize().unwrap_or(DVec3::Y);
        Camera::look_at(eye, target, up.to_array(), 1.0, 1, 1)
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use glam::{Vec2, vec2};

    use super::*;
    use crate::{clips, viewpoint};

    fn demo() -> Clip {
        clips::open(None, &Default::default()).unwrap().wait(None, |_| ()).unwrap()
    }

    fn views(clip: &Clip, standpoint: Option<Standpoint>) -> [View; 2] {
        Lens::Quest3.views(clip, &viewpoint::viewpoints(clip)[0], standpoint, Lens::Quest3.size())
    }

    /// The pixel of a point of the clip.
    fn project(view: &View, point: DVec3) -> Vec2 {
        let p = view.view_from_world.transform_point3(point).as_vec3();
        view.focal * p.truncate() / p.z + view.principal
    }

    #[test]
    fn the_eyes_are_mirrored_and_see_farther_outwards() {
        let [left, right] = views(&demo(), None);
        assert_eq!(left.focal, right.focal);
        assert!((left.focal - 757.0).abs().max_element() < 2.0, "{}", left.focal);
        assert!((left.principal.x + right.principal.x - 1680.0).abs() < 1e-2);
        assert!(left.principal.x > 1000.0 && left.principal.y < 700.0, "{}", left.principal);
        let slope = (left.principal / left.focal).x;
        assert!((slope.atan() - 54f32.to_radians()).abs() < 1e-5 && slope.atan() < FRAC_PI_2);
    }

    #[test]
    fn the_eyes_are_apart_as_those_of_people() {
        let mut clip = demo();
        for metres_per_unit in [1.0, 0.01] {
            clip.info.metres_per_unit = metres_per_unit;
            let [left, right] = views(&clip, Some(Standpoint::Standing));
            let apart_m = left.eye().distance(right.eye()) * f64::from(metres_per_unit);
            assert!((apart_m - 0.063).abs() < 1e-6, "{apart_m}");
        }
    }

    #[test]
    fn standpoints_are_as_far_as_they_say() {
        let clip = demo();
        let subject = Subject::of(&clip);
        let axis = |height_m| subject.in_clip(dvec3(0.0, height_m, 0.0));
        for (standpoint, distance_m) in
            [(Standpoint::Near, 0.7), (Standpoint::Standing, 2.0), (Standpoint::Inside, 0.0)]
        {
            let eyes = views(&clip, Some(standpoint));
            let middle = 0.5 * (eyes[0].eye() + eyes[1].eye());
            let measured_m = middle.distance(axis(EYE_HEIGHT_M)) * subject.metres_per_unit;
            assert!((measured_m - distance_m).abs() < 1e-6, "{standpoint:?}: {measured_m} m");
            let target = match standpoint {
                Standpoint::Inside => subject.in_clip(dvec3(0.0, EYE_HEIGHT_M, -100.0)),
                _ => axis(GAZE_HEIGHT * subject.height_m),
            };
            // Both eyes look ahead: the target is on either side of their axes.
            let seen = eyes.map(|eye| project(&eye, target) - eye.principal);
            let off = 0.5 * (seen[0] + seen[1]);
            assert!(off.distance(vec2(0.0, 0.0)) < 0.1 && seen[0].x > 0.0, "{standpoint:?}: {seen:?}");
        }
    }
}
