//! [`Placement`]: the place of a clip in the room.
//!
//! The stage is the room: metres, +y up, the floor at 0. Three transforms put a clip into it: [`Subject`] turns
//! the clip's axes upright, with the side that its first viewpoint sees towards +z and the ground below its
//! center at the origin; life size converts its units to metres; the placement scales, turns about the vertical
//! and moves. So a clip always stands upright.

use std::f64::consts::PI;

use glam::{DMat4, DQuat, DVec3, Mat4};

use super::hands::Pose;
use program::{Standpoint, Subject};

/// Smallest and largest size of a clip, as a multiple of life.
pub const SCALE_RANGE: (f64, f64) = (0.05, 20.0);

/// Farthest position of a clip along an axis of the stage, in metres.
const FARTHEST_M: f64 = 1000.0;

/// Least initial distance in metres from the viewer to the near side of a clip in front. Its center is as far away as
/// [`Standpoint::Standing`] where that is farther, and no farther than from the first viewpoint: a wall may be behind that.
const START_CLEARANCE_M: f64 = 1.0;

/// Largest radius in metres of a clip that starts in front of the viewer rather than around.
const IN_FRONT_RADIUS_M: f64 = 2.0;

/// Eye heights of people above the floor in metres, sitting to standing.
const EYE_HEIGHTS_M: (f64, f64) = (0.8, 2.2);

/// Scale, heading and position of a clip. The default is life size at the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    scale: f64,
    yaw: f64,
    position: DVec3,
}

impl Placement {
    /// `scale` times life size, turned about +y by `yaw` radians, with the ground below the center at
    /// `position` in metres. Values that are not finite become the default; others are clamped to
    /// [`SCALE_RANGE`] and a kilometre.
    pub fn new(scale: f64, yaw: f64, position: DVec3) -> Placement {
        let or = |x: f64, default: f64| if x.is_finite() { x } else { default };
        Placement {
            scale: or(scale, 1.0).clamp(SCALE_RANGE.0, SCALE_RANGE.1),
            // Keeps the sines exact after thousands of turns.
            yaw: (or(yaw, 0.0) + PI).rem_euclid(2.0 * PI) - PI,
            position: position.map(|x| or(x, 0.0).clamp(-FARTHEST_M, FARTHEST_M)),
        }
    }

    /// Size as a multiple of life.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Angle about +y in radians, from -pi to pi.
    pub fn yaw(&self) -> f64 {
        self.yaw
    }

    /// The ground below the center of the clip, in metres.
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// Scales to `scale`, turns by `angle` and moves so that the point at `from` in the stage goes to `to`.
    pub fn carried(&self, from: DVec3, to: DVec3, angle: f64, scale: f64) -> Placement {
        let scaled = Placement::new(scale, self.yaw + angle, self.position);
        let arm = DQuat::from_rotation_y(angle) * (self.position - from) * (scaled.scale / self.scale);
        Placement::new(scaled.scale, scaled.yaw, to + arm)
    }

    /// This placement in a stage whose origin is at the pose `old_from_new` of the stage before. Floors are level: the
    /// origin turns about the vertical only.
    pub fn seen_from(&self, old_from_new: &Pose) -> Placement {
        let origin = old_from_new.position.as_dvec3();
        self.carried(origin, DVec3::ZERO, -old_from_new.heading(), self.scale)
    }

    /// Turns by `angle` about the vertical through `point`, which keeps its place in the clip.
    pub fn turned_about(&self, point: DVec3, angle: f64) -> Placement {
        self.carried(point, point, angle, self.scale)
    }
}

impl Default for Placement {
    fn default() -> Placement {
        Placement { scale: 1.0, yaw: 0.0, position: DVec3::ZERO }
    }
}

impl Placement {
    /// A comfortable initial placement of `subject` for a viewer with the head at `head`: life size, feet on
    /// the floor.
    ///
    /// A small clip stands in front and faces the viewer. In a larger scene, or one around its viewpoint, the
    /// viewer takes the place and direction of the viewpoint, and its height too if that is not an eye height
    /// of people.
    pub fn start(subject: &Subject, head: &Pose) -> Placement {
        Placement::start_at(subject, head, None, 1.0)
    }

    /// [`Placement::start`] of a clip of `scale` times life size. With a `standpoint`, the viewer is there instead, and the
    /// clip's front towards the viewer.
    pub fn start_at(subject: &Subject, head: &Pose, standpoint: Option<Standpoint>, scale: f64) -> Placement {
        let heading = head.heading();
        let stage_from_upright = DQuat::from_rotation_y(heading);
        let eye = head.position.as_dvec3();
        let ahead = |distance_m: f64| DVec3 { y: 0.0, ..eye - stage_from_upright * DVec3::Z * distance_m };
        let (eye_m, radius_m) = (scale * subject.eye_m, scale * subject.radius_m);
        // Who makes a room smaller looks at it from outside.
        let within = scale >= 1.0 && eye_m.x.hypot(eye_m.z) < radius_m + 0.5 * START_CLEARANCE_M;
        let position = if let Some(standpoint) = standpoint {
            ahead(standpoint.distance_m())
        } else if radius_m > IN_FRONT_RADIUS_M || within {
            let on_eye = eye - stage_from_upright * eye_m;
            let has_floor = (EYE_HEIGHTS_M.0..=EYE_HEIGHTS_M.1).contains(&eye_m.y);
            DVec3 { y: if has_floor { 0.0 } else { on_eye.y }, ..on_eye }
        } else {
            let distance_m = Standpoint::Standing.distance_m().max(radius_m + START_CLEARANCE_M);
            // Who makes a clip smaller stands outside of its walls.
            let free_m = if scale >= 1.0 { eye_m.x.hypot(eye_m.z) } else { f64::INFINITY };
            ahead(distance_m.min(free_m))
        };
        Placement::new(scale, heading, position)
    }

    /// The similarity that puts the clip with `subject` into the stage.
    pub fn stage_from_clip(&self, subject: &Subject) -> Similarity {
        let rotation = DQuat::from_rotation_y(self.yaw) * subject.upright_from_clip;
        let scale = self.scale * subject.metres_per_unit;
        Similarity { scale, rotation, translation: self.position - rotation * subject.ground * scale }
    }
}

/// A change of the spaces in which a runtime tracks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpaceChange {
    /// The stage has another origin, at this pose in the stage before: the room stays where it is.
    Stage {
        /// The new origin, as the stage before sees it.
        old_from_new: Pose,
    },
    /// The viewer has recentred the view by the system, or the runtime no longer knows where the room is.
    Viewer,
}

/// A uniform scale, then a rotation, then a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Positive.
    pub scale: f64,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// In units of the target.
    pub translation: DVec3,
}

impl Similarity {
    /// Image of a point.
    pub fn point(&self, source: DVec3) -> DVec3 {
        self.rotation * (source * self.scale) + self.translation
    }

    /// Source of a point: the inverse of [`Similarity::point`].
    pub fn source_of(&self, target: DVec3) -> DVec3 {
        self.rotation.inverse() * (target - self.translation) / self.scale
    }

    /// Matrix for column vectors.
    pub fn matrix(&self) -> Mat4 {
        DMat4::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation, self.translation)
            .as_mat4()
    }

    /// For `self` = `stage_from_clip`: the rigid transform of an eye in the stage, in OpenCV axes and units of
    /// the clip, as in [`View::view_from_world`]. Focal lengths and principal points are the stage's: a
    /// uniform scale does not change them.
    ///
    /// [`View::view_from_world`]: crate::view::View::view_from_world
    pub fn view_from_clip(&self, eye: &Pose) -> DMat4 {
        let eye_in_clip = self.source_of(eye.position.as_dvec3());
        // From y up, z back to y down, z ahead.
        let view_from_eye = DQuat::from_rotation_x(PI);
        let rotation = view_from_eye * eye.orientation.as_dquat().inverse() * self.rotation;
        DMat4::from_rotation_translation(rotation.normalize(), -(rotation * eye_in_clip))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use codec::{ClipInfo, Field, Surroundings, Viewpoint};
    use glam::{Quat, dvec3, vec3};

    use super::super::random::Random;
    use super::*;
    use crate::content;
    use crate::test_fields::{self, Row, field, room, sky, y_up};

    /// The subject of a clip of `rows`, with y up, that states `viewpoint`.
    fn subject(rows: &[Row], metres_per_unit: f32, viewpoint: Viewpoint) -> Subject {
        let info = ClipInfo { metres_per_unit, viewpoints: vec![viewpoint], ..y_up() };
        Subject::new(&info, &Surroundings::new(&field(rows), None, info.up))
    }

    /// A person of 1.8 units in a clip with y down, standing on y = 1 at (3, z = 5), seen from
    /// -z, with a few strays far off.
    fn person() -> Subject {
        let down = |(center, scale): Row| (dvec3(center.x, 1.0 - center.y, center.z), scale);
        let body = test_fields::person(dvec3(3.0, 0.0, 5.0)).into_iter().map(down);
        let strays = (0..5).map(|i| (dvec3(500.0, 40.0 * f64::from(i), -90.0), 0.03));
        let rows: Vec<Row> = body.chain(strays).collect();
        let info = ClipInfo { viewpoints: vec![viewpoint([3.0, 0.0, 2.0])], ..ClipInfo::default() };
        Subject::new(&info, &Surroundings::new(&field(&rows), None, info.up))
    }

    fn viewpoint(position: [f32; 3]) -> Viewpoint {
        Viewpoint { name: "front".into(), position, target: [3.0, 0.0, 5.0], fov_y: 0.8 }
    }

    fn head(heading: f32) -> Pose {
        Pose { position: vec3(0.4, 1.6, -0.2), orientation: Quat::from_rotation_y(heading) }
    }

    #[test]
    fn a_person_starts_on_the_floor_in_front_and_faces_the_viewer() {
        for heading in [-2.5f32, 0.0, 1.0] {
            let (subject, head) = (person(), head(heading));
            let stage_from_clip = Placement::start(&subject, &head).stage_from_clip(&subject);
            let feet = stage_from_clip.point(dvec3(3.0, 1.0, 5.0));
            let crown = stage_from_clip.point(dvec3(3.0, -0.8, 5.0));
            assert!(feet.y.abs() < 0.04 && (crown.y - 1.8).abs() < 0.04, "{feet} {crown}");
            let ahead = dvec3(feet.x, 1.6, feet.z) - head.position.as_dvec3();
            assert!((ahead.length() - 2.0).abs() < 0.05, "{ahead}");
            assert!(ahead.normalize().dot(head.forward().as_dvec3()) > 0.99);
            // The viewpoint's side of the clip is the near one.
            let chest = stage_from_clip.point(dvec3(3.0, 0.0, 4.0));
            assert!(chest.distance(head.position.as_dvec3()) < feet.distance(head.position.as_dvec3()) - 0.5);
            assert!((stage_from_clip.scale - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_standpoint_is_as_far_from_the_center_as_it_says() {
        for (standpoint, distance_m) in
            [(Standpoint::Near, 0.7), (Standpoint::Standing, 2.0), (Standpoint::Inside, 0.0)]
        {
            let (subject, head) = (person(), head(0.8));
            let stage_from_clip =
                Placement::start_at(&subject, &head, Some(standpoint), 1.0).stage_from_clip(&subject);
            let feet = stage_from_clip.point(subject.ground);
            let eye = head.position.as_dvec3();
            let expected = DVec3 { y: 0.0, ..eye } + distance_m * head.forward().as_dvec3();
            assert!(feet.distance(expected) < 1e-6, "{standpoint:?}: {feet}, expected {expected}");
            // The first viewpoint looks where the viewer looks.
            let back = stage_from_clip.point(subject.in_clip(DVec3::NEG_Z)) - feet;
            assert!(back.dot(head.forward().as_dvec3()) > 0.999, "{back}");
        }
    }

    #[test]
    fn a_clip_of_another_size_starts_as_near() {
        let (subject, head) = (person(), head(0.8));
        for scale in [0.1, 0.5, 2.0] {
            let placement = Placement::start_at(&subject, &head, None, scale);
            let stage_from_clip = placement.stage_from_clip(&subject);
            let ahead = DVec3 { y: 1.6, ..stage_from_clip.point(subject.ground) } - head.position.as_dvec3();
            assert!(placement.scale() == scale && placement.position().y == 0.0, "{placement:?}");
            let near_m = ahead.length() - scale * subject.radius_m;
            assert!(near_m >= 0.99 && ahead.length() < 2.01 + scale, "{scale}: {ahead}");
        }
    }

    #[test]
    fn a_clip_stays_in_the_room_when_the_stage_moves() {
        let (subject, mut random) = (person(), Random::new(4));
        for _ in 0..200 {
            let (placement, point) = (random.placement(), random.point());
            let heading = random.placement().yaw();
            let old_from_new = Pose {
                position: random.point().as_vec3(),
                orientation: Quat::from_rotation_y(heading as f32),
            };
            let old = placement.stage_from_clip(&subject).point(point);
            let new = placement.seen_from(&old_from_new).stage_from_clip(&subject).point(point);
            let back = old_from_new.orientation.as_dquat() * new + old_from_new.position.as_dvec3();
            assert!(back.distance(old) < 1e-4 * old.length().max(1.0), "{back} {old}");
        }
    }

    #[test]
    fn life_size_follows_the_unit() {
        let centimetres = |(center, scale): Row| (100.0 * center, 100.0 * scale);
        let rows: Vec<Row> = test_fields::person(DVec3::ZERO).into_iter().map(centimetres).collect();
        let at = Viewpoint { position: [0.0, 90.0, 300.0], target: [0.0, 90.0, 0.0], ..viewpoint([0.0; 3]) };
        let subject = subject(&rows, 0.01, at);
        let stage_from_clip = Placement::start(&subject, &Pose::IDENTITY).stage_from_clip(&subject);
        assert!((stage_from_clip.point(dvec3(0.0, 180.0, 0.0)).y - 1.8).abs() < 0.04);
    }

    #[test]
    fn a_person_in_a_room_or_under_a_sky_starts_as_that_person_alone() {
        let (feet, head) = (dvec3(1.0, 0.0, 0.5), head(0.8));
        let around = [Vec::new(), room(), sky(30.0), [room(), sky(1000.0)].concat()];
        for (i, around) in around.into_iter().enumerate() {
            let rows = [test_fields::person(feet), around].concat();
            let surroundings = Surroundings::new(&field(&rows), None, y_up().up);
            let subject = Subject::new(&y_up(), &surroundings);
            let placement = Placement::start(&subject, &head);
            let stage_from_clip = placement.stage_from_clip(&subject);
            let stage_feet = stage_from_clip.point(feet);
            assert!(stage_feet.y.abs() < 0.04 && (subject.height_m - 1.8).abs() < 0.08, "{i}: {subject:?}");
            let ahead = dvec3(stage_feet.x, 1.6, stage_feet.z) - head.position.as_dvec3();
            assert!((ahead.length() - 2.0).abs() < 0.1, "{i}: {ahead}");
            assert!(ahead.normalize().dot(head.forward().as_dvec3()) > 0.99, "{i}: {ahead}");
            // The side of the opening view is the near one, and the room is around all of it.
            let eye = stage_from_clip.point(DVec3::from(surroundings.opening().position.map(f64::from)));
            assert!((eye - stage_feet).dot(ahead) < 0.0 && placement.scale() == 1.0, "{i}: {eye}");
        }
    }

    #[test]
    fn within_a_scene_the_viewer_stands_at_the_viewpoint() {
        let head = head(0.8);
        for (eye_height, expected) in [(1.5f32, 1.5), (5.0, 1.6)] {
            let at = Viewpoint {
                position: [1.0, eye_height, 2.0],
                target: [0.0, 1.0, 0.0],
                ..viewpoint([0.0; 3])
            };
            let subject = subject(&room(), 1.0, at.clone());
            let stage_from_clip = Placement::start(&subject, &head).stage_from_clip(&subject);
            let eye = stage_from_clip.point(DVec3::from(at.position.map(f64::from)));
            let expected = dvec3(0.4, expected, -0.2);
            assert!(eye.distance(expected) < 0.02, "{eye}, expected {expected}");
            let target = stage_from_clip.point(dvec3(0.0, 1.0, 0.0)) - eye;
            let level = DVec3 { y: 0.0, ..target }.normalize();
            assert!(level.dot(head.forward().as_dvec3()) > 0.999);
        }
        // A person may be seen from within reach.
        let person = test_fields::person(dvec3(3.0, 0.0, 5.0));
        let at = Viewpoint { position: [3.0, 1.5, 5.3], ..viewpoint([0.0; 3]) };
        let subject = subject(&[person, room()].concat(), 1.0, at);
        let stage_from_clip = Placement::start(&subject, &head).stage_from_clip(&subject);
        let eye = stage_from_clip.point(dvec3(3.0, 1.5, 5.3));
        assert!(eye.distance(dvec3(0.4, 1.5, -0.2)) < 0.04, "{eye}");
    }

    #[test]
    fn the_demo_clip_stands_before_the_viewer() {
        let clip = content::open(None, &Default::default()).unwrap().wait(|_| ()).unwrap();
        let subject = clip.subject().unwrap();
        let head = head(0.3);
        let stage_from_clip = Placement::start(&subject, &head).stage_from_clip(&subject);
        let target = DVec3::from(clip.info().viewpoints[0].target.map(f64::from));
        let seen = stage_from_clip.view_from_clip(&head).transform_point3(target);
        assert!(seen.z > 1.0 && seen.x.abs() < 0.3 * seen.z && seen.y.abs() < 0.6 * seen.z, "{seen}");
    }

    #[test]
    fn odd_clips_have_a_place() {
        for (up, metres_per_unit, position) in [
            ([0.0; 3], 0.0, [3.0, 0.0, 5.0]),
            ([0.0, f32::NAN, 0.0], f32::NAN, [3.0, 9.0, 5.0]),
            ([1e-30, 0.0, 0.0], -1.0, [-3.0, 0.0, 5.0]),
        ] {
            let info = ClipInfo {
                up,
                metres_per_unit,
                viewpoints: vec![viewpoint(position)],
                ..ClipInfo::default()
            };
            let subject = Subject::new(&info, &Surroundings::new(&Field::default(), None, up));
            let start = Placement::start(&subject, &Pose::IDENTITY);
            assert!(start.stage_from_clip(&subject).matrix().is_finite(), "{subject:?}");
        }
        let wild = Placement::new(f64::NAN, f64::INFINITY, DVec3::NAN);
        assert_eq!(wild, Placement::default());
        let wild = Placement::new(1e9, 1e9, DVec3::splat(-1e300));
        assert!(wild.scale() == 20.0 && wild.yaw().abs() <= PI && wild.position() == DVec3::splat(-1000.0));
    }

    #[test]
    fn the_clip_stays_upright_and_undistorted() {
        let (subject, mut random) = (person(), Random::new(1));
        for _ in 0..200 {
            let placement = random.placement();
            let stage_from_clip = placement.stage_from_clip(&subject);
            let up = stage_from_clip.point(dvec3(0.0, -1.0, 0.0)) - stage_from_clip.point(DVec3::ZERO);
            assert!((up.y / up.length() - 1.0).abs() < 1e-9, "{up}");
            let point = random.point();
            let there = stage_from_clip.point(point);
            assert!(stage_from_clip.source_of(there).distance(point) < 1e-6);
            assert!(
                stage_from_clip.matrix().transform_point3(point.as_vec3()).distance(there.as_vec3()) < 1e-3
            );
        }
    }

    #[test]
    fn a_view_sees_the_clip_as_the_eye_sees_the_stage() {
        let (subject, mut random) = (person(), Random::new(2));
        for _ in 0..200 {
            let stage_from_clip = random.placement().stage_from_clip(&subject);
            let (eye, point) = (random.pose(), random.point());
            let seen = stage_from_clip.view_from_clip(&eye).transform_point3(point);
            let stage = stage_from_clip.point(point) - eye.position.as_dvec3();
            let ours = eye.orientation.as_dquat().inverse() * stage / stage_from_clip.scale;
            let expected = dvec3(ours.x, -ours.y, -ours.z);
            let error = (seen - expected).length() / expected.length().max(1.0);
            assert!(error < 1e-4, "{seen} {expected}");
        }
    }

    #[test]
    fn carrying_takes_a_point_to_a_point() {
        let (subject, mut random) = (person(), Random::new(3));
        for _ in 0..200 {
            let (placement, from, to) = (random.placement(), random.point(), random.point());
            let clip_point = placement.stage_from_clip(&subject).source_of(from);
            let scale = placement.scale() * 3.0;
            let carried = placement.carried(from, to, 0.4, scale);
            assert!(carried.stage_from_clip(&subject).point(clip_point).distance(to) < 1e-6);
            assert!((carried.scale() - scale.min(20.0)).abs() < 1e-9);
        }
        let turned = Placement::new(1.0, 0.0, DVec3::NEG_Z).turned_about(DVec3::ZERO, FRAC_PI_2);
        assert!(turned.position().distance(DVec3::NEG_X) < 1e-9 && (turned.yaw() - FRAC_PI_2).abs() < 1e-9);
    }
}
