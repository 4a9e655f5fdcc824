//! [`Subject`]: the upright frame of a clip: where its ground and its front are, and how large its content is.

use codec::{Clip, ClipInfo, Surroundings};
use glam::{DMat3, DQuat, DVec3};

/// The upright frame of a clip, and the size of its content, as [`Surroundings`] have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subject {
    /// Rotation from the clip to axes with +y up and the front towards +z.
    pub upright_from_clip: DQuat,
    /// At least the smallest positive normal number.
    pub metres_per_unit: f64,
    /// The ground below the center of the content, in units of the clip.
    pub ground: DVec3,
    /// Level distance from the center to the sides of the content, in metres.
    pub radius_m: f64,
    /// Height of the content above the ground, in metres.
    pub height_m: f64,
    /// First viewpoint relative to the ground below the center, upright, in metres.
    pub eye_m: DVec3,
}

impl Subject {
    /// The subject of a clip. Takes a tenth of a second and more.
    pub fn from_clip(clip: &Clip) -> Subject {
        Subject::new(&clip.info, &clip.surroundings())
    }

    /// The subject of a clip or a take with this `info` and these `surroundings`.
    pub fn new(info: &ClipInfo, surroundings: &Surroundings) -> Subject {
        let up = DVec3::from(info.up.map(f64::from)).try_normalize().unwrap_or(DVec3::Y);
        let viewpoint = surroundings.first_viewpoint(info);
        let eye = DVec3::from(viewpoint.position.map(f64::from));
        let target = DVec3::from(viewpoint.target.map(f64::from));
        // Towards the viewpoint, level.
        let front = (eye - target).reject_from_normalized(up);
        let front = front.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        let clip_from_upright = DMat3::from_cols(up.cross(front), up, front);
        let upright_from_clip = DQuat::from_mat3(&clip_from_upright).inverse().normalize();

        let [low, high] =
            surroundings.content_bounds_along(clip_from_upright.to_cols_array_2d()).map(DVec3::from);
        let ground = DVec3 { y: low.y, ..0.5 * (low + high) };
        let metres_per_unit = f64::from(info.metres_per_unit);
        let metres_per_unit = if metres_per_unit.is_normal() { metres_per_unit.abs() } else { 1.0 };
        let size_m = metres_per_unit * (high - low);
        Subject {
            upright_from_clip,
            metres_per_unit,
            ground: upright_from_clip.inverse() * ground,
            radius_m: 0.5 * size_m.x.max(size_m.z),
            height_m: size_m.y,
            eye_m: metres_per_unit * (upright_from_clip * eye - ground),
        }
    }

    /// As [`Subject::new`], of a clip or a take without viewpoints: adds its opening view to `info`.
    pub fn with_opening(surroundings: &Surroundings, info: &mut ClipInfo) -> Subject {
        info.viewpoints.push(surroundings.opening());
        Subject::new(info, surroundings)
    }

    /// The point `upright_m`, in metres from the ground below the center with +y up and the front towards +z, in
    /// the clip.
    pub fn in_clip(&self, upright_m: DVec3) -> DVec3 {
        self.upright_from_clip.inverse() * (upright_m / self.metres_per_unit) + self.ground
    }
}
