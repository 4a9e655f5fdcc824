//! [`Lens`]: what a headset shows to two eyes, without a headset: its angles and the size of its images. And
//! [`Standpoint`]: where its wearer stands.
//!
//! Fragments of a frame depend on both, so that counts compare only if they are taken through the same lens
//! from the same place.

use clap::ValueEnum;
use codec::Camera;
use glam::{DVec3, dvec3};

use crate::Subject;

/// Height of the eyes of a standing person above the ground, in metres.
const EYE_HEIGHT_M: f64 = 1.6;

/// Height at which a person who stands before a clip looks, as a fraction of the clip's height: the height of a chest.
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
    /// At arm's length, 0.7 m in front of the middle of the content.
    Near,
    /// 2 m in front of it.
    Standing,
    /// In it, looking level in the direction of the first viewpoint.
    Inside,
}

impl Lens {
    /// Width and height in pixels of the image that the headset recommends for an eye.
    pub fn size(self) -> [u32; 2] {
        match self {
            Lens::Quest3 => [1680, 1760],
        }
    }

    /// Angles in degrees from the axis of the left eye to the left, right, upper and lower edge of its image.
    /// Those of the right eye are mirrored. Both eyes look straight ahead.
    fn degrees(self) -> [f64; 4] {
        match self {
            Lens::Quest3 => [54.0, 40.0, 42.0, 55.0],
        }
    }

    /// The cameras of the left and the right eye, with images of `width` by `height` pixels. `head` is midway between the
    /// eyes; only its pose counts.
    pub fn cameras(self, head: &Camera, metres_per_unit: f64, [width, height]: [u32; 2]) -> [Camera; 2] {
        let [outer, inner, upper, lower] = self.degrees().map(|angle| angle.to_radians().tan());
        let focal = [f64::from(width) / (outer + inner), f64::from(height) / (upper + lower)];
        let mut eyes = head.stereo_pair(Camera::EYE_DISTANCE_M / metres_per_unit);
        for (eye, left) in eyes.iter_mut().zip([outer, inner]) {
            (eye.width, eye.height) = (width, height);
            eye.k = [[focal[0], 0.0, left * focal[0]], [0.0, focal[1], upper * focal[1]], [0.0, 0.0, 1.0]];
        }
        eyes
    }
}

impl Standpoint {
    /// Level distance from the middle of the content, in metres.
    pub fn distance_m(self) -> f64 {
        match self {
            Standpoint::Near => 0.7,
            Standpoint::Standing => 2.0,
            Standpoint::Inside => 0.0,
        }
    }

    /// A camera midway between the eyes; only its pose counts. `up` is the clip's.
    pub fn camera(self, subject: &Subject, up: [f32; 3]) -> Camera {
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
    use std::f64::consts::FRAC_PI_2;

    use codec::{Clip, ClipInfo, Field};
    use glam::{DMat4, DVec2};

    use super::*;

    /// A person of 1.8 units, off the origin.
    fn person() -> Clip {
        let centers: Vec<[f32; 3]> = (0..100)
            .map(|i| [3.0 + 0.2 * (i % 5) as f32, 0.018 * i as f32, 1.0 + 0.05 * (i % 7) as f32])
            .collect();
        let count = centers.len();
        let static_field = Field {
            centers,
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scales: vec![[-4.0; 3]; count],
            opacities: vec![0.9; count],
            sh: vec![[0.0; 3]; count],
            ..Field::default()
        };
        let info = ClipInfo { up: [0.0, 1.0, 0.0], metres_per_unit: 1.0, ..ClipInfo::default() };
        Clip::of_one_layer(info, static_field.bounds(), static_field, Field::default(), None)
    }

    fn cameras(clip: &Clip, standpoint: Standpoint) -> [Camera; 2] {
        let subject = Subject::from_clip(clip);
        let head = standpoint.camera(&subject, clip.info.up);
        Lens::Quest3.cameras(&head, subject.metres_per_unit, Lens::Quest3.size())
    }

    /// A point of the clip in pixels from the axis of a camera.
    fn project(camera: &Camera, point: DVec3) -> DVec2 {
        let p = DMat4::from_cols_array_2d(&camera.camera_from_world).transpose().transform_point3(point);
        DVec2::new(camera.k[0][0], camera.k[1][1]) * p.truncate() / p.z
    }

    #[test]
    fn the_eyes_are_mirrored_and_see_farther_outwards() {
        let [left, right] = cameras(&person(), Standpoint::Standing);
        for eye in [&left, &right] {
            eye.check().unwrap();
            assert!((eye.k[0][0] - 757.0).abs() < 2.0 && (eye.k[1][1] - 757.0).abs() < 2.0, "{eye:?}");
        }
        assert!((left.k[0][2] + right.k[0][2] - 1680.0).abs() < 1e-9);
        assert!(left.k[0][2] > 1000.0 && left.k[1][2] < 700.0, "{left:?}");
        let outer = (left.k[0][2] / left.k[0][0]).atan();
        assert!((outer - 54f64.to_radians()).abs() < 1e-12 && outer < FRAC_PI_2);
    }

    #[test]
    fn the_eyes_are_apart_as_those_of_people() {
        let mut clip = person();
        for metres_per_unit in [1.0, 0.01] {
            clip.info.metres_per_unit = metres_per_unit;
            let [left, right] = cameras(&clip, Standpoint::Standing).map(|eye| DVec3::from(eye.position()));
            let apart_m = left.distance(right) * f64::from(metres_per_unit);
            assert!((apart_m - 0.063).abs() < 1e-6, "{apart_m}");
        }
    }

    #[test]
    fn standpoints_are_as_far_as_they_say() {
        let clip = person();
        let subject = Subject::from_clip(&clip);
        let axis = |height_m| subject.in_clip(dvec3(0.0, height_m, 0.0));
        for (standpoint, distance_m) in
            [(Standpoint::Near, 0.7), (Standpoint::Standing, 2.0), (Standpoint::Inside, 0.0)]
        {
            let eyes = cameras(&clip, standpoint);
            let [left, right] = [0, 1].map(|i| DVec3::from(eyes[i].position()));
            let measured_m = (0.5 * (left + right)).distance(axis(EYE_HEIGHT_M)) * subject.metres_per_unit;
            assert!((measured_m - distance_m).abs() < 1e-6, "{standpoint:?}: {measured_m} m");
            let target = match standpoint {
                Standpoint::Inside => subject.in_clip(dvec3(0.0, EYE_HEIGHT_M, -100.0)),
                _ => axis(GAZE_HEIGHT * subject.height_m),
            };
            // Both eyes look ahead: the target is on either side of their axes.
            let seen = [0, 1].map(|i| project(&eyes[i], target));
            let off = 0.5 * (seen[0] + seen[1]);
            assert!(off.length() < 0.1 && seen[0].x > 0.0, "{standpoint:?}: {seen:?}");
        }
    }
}
